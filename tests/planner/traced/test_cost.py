"""The cost of a whole problem in JAX is the planner's own, for any number of motions at once, and a pure function."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import symbolic
from hdplan.planner.problem.problem import Problem
from hdplan.scenes.array_types import Array
from tests.extras import jax, needs, quick_jit

pytestmark = needs("jax")

WEIGHT, CLOSE = 1e4, 1e-9


@functools.cache
def problem(name: str) -> Problem:
    """A problem of distances alone, with few waypoints: of a shipped scene, or the planar arm's with a moving ball."""
    scene = hdplan.load_scene("planar_arm" if name == "moving" else name)
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=6))
    if name == "moving":
        ball, prism = scene.obstacles
        ball = dataclasses.replace(ball, motion=hdplan.SteadyMotion((-0.2, 0.1, 0.0), (0.1, 0.0, 0.3)))
        scene = dataclasses.replace(scene, obstacles=(ball, prism), timing=hdplan.Timing(duration=2.0))
    built = hdplan.build(scene)
    return dataclasses.replace(built, terms=dataclasses.replace(built.terms, velocity=None))


def motions(of: Problem, count: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    waypoints = of.polyline()
    return np.array([of.clip(waypoints + rng.normal(0, 0.15, waypoints.shape)) for _ in range(count)])


@pytest.mark.parametrize(
    "name",
    [
        "planar_arm",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("panda_carry", "panda_conveyor")),
    ],
)
def test_value_and_gradient_are_the_planners_with_any_leading_axes(name: str) -> None:
    own = problem(name)
    own = own.refined([1, 3]) if name == "planar_arm" else own
    drawn = motions(own, 4)

    def both(x: Any) -> tuple[Any, Any]:
        values = cost(x, WEIGHT)
        return values.sum(), values

    with jax.enable_x64(True):
        cost = symbolic.jax_cost(own)
        slopes, values = quick_jit(jax.grad(both, has_aux=True))(drawn.reshape(2, 2, *drawn.shape[1:]))
    for motion, value, slope in zip(drawn, np.ravel(values), slopes.reshape(drawn.shape), strict=True):
        expected = own.evaluate(motion, WEIGHT)
        assert float(value) == pytest.approx(expected.cost, rel=CLOSE)
        np.testing.assert_allclose(slope[1:-1], expected.gradient, rtol=0, atol=CLOSE * np.abs(expected.gradient).max())
    assert any(own.evaluate(motion, WEIGHT).penalty > 0.0 for motion in drawn)
    assert (own.terms.moving_obstacles is None) == (name not in ("moving", "panda_conveyor"))


def dense(of: Problem, motion: Array, weight: float) -> Array:
    """The planner's Gauss-Newton Hessian as one matrix."""
    found, n = of.evaluate(motion, weight), of.robot.n
    whole = np.kron(of.smoothness.matrix[1:-1, 1:-1], np.eye(n)).astype(float)
    for k, block in enumerate(found.diagonal):
        whole[n * k : n * k + n, n * k : n * k + n] += block
    for k, block in enumerate(found.coupling):  # of the next waypoint (rows) with this one
        whole[n * k + n : n * k + 2 * n, n * k : n * k + n] += block
        whole[n * k : n * k + n, n * k + n : n * k + 2 * n] += block.T
    return whole


def test_the_curvature_is_the_planners() -> None:
    own = problem("planar_arm")
    drawn = motions(own, 3)
    with jax.enable_x64(True):
        cost = symbolic.jax_cost(own)
        every = quick_jit(jax.vmap(lambda x: cost.curvature(x, WEIGHT)))(drawn)
    for motion, curvature in zip(drawn, np.array(every), strict=True):
        whole = dense(own, motion, WEIGHT)
        np.testing.assert_allclose(curvature, whole, rtol=0, atol=CLOSE * np.abs(whole).max())
        assert np.linalg.eigvalsh(curvature).min() > 0.0


def primitives(jaxpr: Any) -> set[str]:
    """Names of all primitives in a jaxpr, those within others too."""
    found = set()
    for equation in jaxpr.eqns:
        found.add(equation.primitive.name)
        for inner in jax.tree_util.tree_leaves(
            list(equation.params.values()), is_leaf=lambda it: hasattr(it, "eqns") or hasattr(it, "jaxpr")
        ):
            if hasattr(inner, "eqns") or hasattr(inner, "jaxpr"):
                found |= primitives(getattr(inner, "jaxpr", inner))
    return found


def test_there_is_no_callback_to_the_host() -> None:
    own = problem("planar_arm")
    cost = symbolic.jax_cost(own)
    for of in (lambda x: jax.grad(cost)(x, WEIGHT), lambda x: cost.curvature(x, WEIGHT)):
        found = primitives(jax.make_jaxpr(jax.jit(jax.vmap(of)))(motions(own, 2)).jaxpr)
        assert {"dot_general", "cos"} <= found
        assert not [name for name in found if "callback" in name or "infeed" in name or "outfeed" in name]

    def called(x: Any) -> Any:  # one that has one is found
        return jax.pure_callback(lambda y: y, jax.ShapeDtypeStruct(x.shape, x.dtype), x)

    assert "pure_callback" in primitives(jax.make_jaxpr(jax.jit(called))(np.zeros(2, np.float32)).jaxpr)


def test_derivatives_are_right_where_vertices_tie() -> None:
    """An aligned pose, where automatic derivatives of a plain minimum would be those of one vertex."""
    own = problem("planar_arm")

    def of(by: Any) -> Any:
        return cost.distances(np.zeros((6, 2)) + by)

    with jax.enable_x64(True):
        cost = symbolic.jax_cost(own)
        both = quick_jit(lambda by: (of(by), jax.jacfwd(of)(by)))
        slopes, steps = both(np.zeros(2))[1], 1e-6 * np.eye(2)
        changes = [(both(step)[0] - both(-step)[0]) / 2e-6 for step in steps]
    np.testing.assert_allclose(np.moveaxis(np.array(slopes), -1, 0), changes, rtol=1e-6, atol=1e-7)


@pytest.mark.core
def test_terms_that_are_not_in_it_are_refused_by_name() -> None:
    conveyor, exact = hdplan.load_scene("panda_conveyor"), hdplan.load_scene("planar_arm")
    exact = dataclasses.replace(exact, planner=dataclasses.replace(exact.planner, distance="fcl"))
    swept = dataclasses.replace(exact, planner=hdplan.PlannerSettings(swept=True))
    planar = problem("planar_arm")
    own = {
        kind: planar.with_term(hdplan.OwnTerm(f"of {kind}", each, kind))
        for kind, each in (("cost", lambda q, step: q[0] ** 2), ("penalty", lambda q, step: q[:1] ** 2))
    }
    held = planar.with_term(hdplan.OwnTerm("held", lambda q, step: step[0], "constraint", -1.0, 1.0))
    for arguments, message in (
        (own["cost"], "the term 'of cost' is not written in JAX"),
        (own["penalty"], "the term 'of penalty' is not written in JAX"),
        (held, "the term 'held' is not written in JAX"),
        (hdplan.build(conveyor), "the term 'velocity' is not written in JAX"),
        (hdplan.build(exact), "planner.distance: must be hdsdf"),
        (hdplan.build(swept), "the term 'obstacles' is not written in JAX"),
        ("problem", "problem: must be of the class Problem"),
    ):
        with pytest.raises(hdplan.InputError, match=message) as caught:
            symbolic.jax_cost(arguments)
        assert "\n" not in str(caught.value)
