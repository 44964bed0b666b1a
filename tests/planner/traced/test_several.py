"""Several problems of one robot in one array cost what each costs alone, and what fills the array costs nothing."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import symbolic
from hdplan.planner.problem.moving_clearance import MovingClearance
from hdplan.planner.problem.problem import Problem
from hdplan.scenes.array_types import Array
from tests.extras import jax, needs, quick_jit
from tests.planner.traced.test_cost import CLOSE, dense, motions, primitives, problem

pytestmark = needs("jax")

WEIGHTS = np.array([1e4, 1e3, 1e5, 1e4])


@functools.cache
def problems() -> tuple[Problem, ...]:
    """Four of the planar arm: more samples; many obstacles, a held rod, a turned base and other sizes; moving; and none
    at all."""
    plain = problem("planar_arm")
    scene = plain.scene
    rng = np.random.default_rng(5)
    boxes = tuple(
        hdplan.Box(rng.uniform(0.1, 0.3, 3), pose=[*rng.uniform(-0.9, 0.9, 2), 0.1], name=f"box{i}") for i in range(3)
    )
    settings = dataclasses.replace(scene.planner, activation=0.05, clearance=0.02, shaping_length=5e-3)
    rod = hdplan.Attached("rod", "forearm", hdplan.Cylinder(radius=0.03, length=0.3), pose=[0.2, 0.0, 0.1])
    robot = dataclasses.replace(scene.robot, base=hdplan.Pose.from_rpy([0.1, -0.1, 0.0], [0.0, 0.0, 0.4]))
    crowded = dataclasses.replace(
        scene, robot=robot, obstacles=(*scene.obstacles, *boxes), planner=settings, attached=(rod,)
    )
    empty = dataclasses.replace(scene, obstacles=(), self_collision=hdplan.SelfCollision(clearance=0.0))
    return plain.refined([1, 3]), hdplan.build(crowded), problem("moving"), hdplan.build(empty)


@functools.cache
def cost() -> symbolic.JaxCost:
    return symbolic.jax_cost(list(problems()))


@functools.cache
def compiled() -> Any:
    """Values, gradients and distances of motions (..., R, N, n), and curvatures of one motion for each problem."""

    def of(cost: Any, x: Any, weights: Any) -> Any:
        def total(x: Any) -> tuple[Any, Any]:
            values = cost(x, weights)
            return values.sum(), values

        (_, values), slopes = jax.value_and_grad(total, has_aux=True)(x)
        return values, slopes, cost.distances(x), cost.curvature(x[0], weights)

    return quick_jit(of)


@functools.cache
def drawn() -> Array:
    return np.stack([motions(each, 2, seed) for seed, each in enumerate(problems())], axis=1)


@functools.cache
def found() -> tuple[Array, ...]:
    with jax.enable_x64(True):
        return tuple(np.array(each) for each in compiled()(cost(), drawn(), WEIGHTS))


def test_values_gradients_and_curvatures_are_those_of_each_problem_alone() -> None:
    values, slopes, _, bent = found()
    for row, (own, weight) in enumerate(zip(problems(), WEIGHTS, strict=True)):
        for k, motion in enumerate(drawn()[:, row]):
            expected = own.evaluate(motion, weight)
            assert values[k, row] == pytest.approx(expected.cost, rel=CLOSE)
            scale = np.abs(expected.gradient).max()
            np.testing.assert_allclose(slopes[k, row, 1:-1], expected.gradient, rtol=0, atol=CLOSE * scale)
        whole = dense(own, drawn()[0, row], weight)
        np.testing.assert_allclose(bent[row], whole, rtol=0, atol=CLOSE * np.abs(whole).max())
    penalties = [own.evaluate(drawn()[0, row], 1.0).penalty for row, own in enumerate(problems())]
    assert min(penalties[:3]) > 0.0 == penalties[3]


def test_distances_are_those_of_the_planner_and_infinite_beyond() -> None:
    every = found()[2]
    for row, own in enumerate(problems()):
        samples, pairs = len(own.samples.weight), sum(len(term.pairs) for term in own.terms.pairs)
        mine = every[0, row]
        assert np.isfinite(mine[:samples, :pairs]).all()
        assert np.isinf(mine[samples:]).all()
        assert np.isinf(mine[:, pairs:]).all()
        at = own.kinematics.evaluate(own.robot.expand(own.samples.configurations(drawn()[0, row])))
        first = 0
        for term in own.terms.pairs:
            count = len(term.pairs)
            met = term.met(at, term.law.time_at(own.samples.parameter)) if isinstance(term, MovingClearance) else at
            sample, pair = (part.ravel() for part in np.indices((samples, count)))
            expected = term.distance(met, sample, pair)[0].reshape(samples, count)
            np.testing.assert_allclose(mine[:samples, first : first + count], expected, rtol=1e-9, atol=1e-12)
            first += count
    assert every.shape[-2] == max(len(own.samples.weight) for own in problems())


def test_padding_of_the_tables_costs_exactly_nothing() -> None:
    """A problem without pairs, filled up beside crowded ones, costs its smoothness to the last bit, and its slope is
    the smoothness' alone, whatever the weight."""
    values, slopes, *_ = found()
    with jax.enable_x64(True):
        heavy = compiled()(cost(), drawn(), np.full(4, 1e30))
    np.testing.assert_array_equal(np.array(heavy[0])[:, 3], values[:, 3])
    np.testing.assert_array_equal(np.array(heavy[1])[:, 3], slopes[:, 3])
    np.testing.assert_array_equal(np.array(heavy[3])[3], found()[3][3])


def test_problems_in_another_order_give_the_same_in_that_order() -> None:
    order = [2, 0, 3, 1]
    turned = symbolic.jax_cost([problems()[row] for row in order])
    with jax.enable_x64(True):
        values, slopes, distances, bent = (
            np.array(each) for each in compiled()(turned, drawn()[:, order], WEIGHTS[order])
        )
    expected = found()
    for got, own in ((values, expected[0]), (slopes, expected[1]), (distances, expected[2])):
        np.testing.assert_array_equal(got, own[:, order])
    np.testing.assert_array_equal(bent, expected[3][order])
    assert compiled()._cache_size() == 1  # other numbers in tables of the same shapes: nothing is compiled again


def test_single_precision_agrees_to_a_thousandth() -> None:
    values, slopes, *_ = found()
    single = quick_jit(jax.value_and_grad(lambda x: cost()(x, WEIGHTS).sum()))
    value, slope = single(drawn().astype(np.float32))
    assert value.dtype == slope.dtype == np.float32
    assert float(value) == pytest.approx(values.sum(), rel=1e-3)
    np.testing.assert_allclose(np.array(slope), slopes, rtol=0, atol=1e-3 * np.abs(slopes).max())


def test_vmap_maps_it_to_costs_of_one_problem_each_and_there_is_no_callback() -> None:
    def each(of: Any, x: Any, weight: Any) -> Any:
        assert of.tables.smoothness.ndim == 2
        return jax.grad(of)(x, weight), of.curvature(x, weight)

    def both(of: Any, x: Any, weights: Any) -> Any:
        return jax.vmap(each)(of, x, weights), jax.grad(lambda x: of(x, weights).sum())(x), of.curvature(x, weights)

    names = primitives(jax.make_jaxpr(jax.jit(both))(cost(), drawn()[0], WEIGHTS).jaxpr)
    assert {"dot_general", "cos", "gather"} <= names
    assert not [name for name in names if "callback" in name or "infeed" in name or "outfeed" in name]
    assert "4 problems" in repr(cost())
    assert "one problem" in repr(symbolic.jax_cost(problems()[0]))


def test_fields_that_do_not_fit_are_refused_in_one_line() -> None:
    plain = problems()[0]
    others = {
        "waypoints": dict(waypoints=7),
        "planner.gamma": dict(gamma=3),
    }
    cases: list[tuple[Any, str]] = [
        ([], "problem: found an empty list"),
        ([plain, "problem"], r"problem\[1\]: must be of the class Problem"),
        (
            [plain, hdplan.build(hdplan.load_scene("panda_cage"))],
            r"problem\[1\]: has other waypoints than problem\[0\]: 32",
        ),
    ]
    for what, change in others.items():
        settings = dataclasses.replace(plain.scene.planner, **change)
        built = hdplan.build(dataclasses.replace(plain.scene, planner=settings))
        cases.append(([plain, built], rf"problem\[1\]: has other {what} than problem\[0\]: \d, not \d"))
    for given, message in cases:
        with pytest.raises(hdplan.InputError, match=message) as caught:
            symbolic.jax_cost(given)
        assert "\n" not in str(caught.value)
    x = drawn()
    for call, message in (
        (
            lambda: cost()(x[:, :3], 1.0),
            r"positions: found an array of shape \(2, 3, 6, 2\), allowed is \(..., 4, 6, 2\)",
        ),
        (lambda: cost()(x[0, 0], 1.0), "positions: found an array of shape"),
        (lambda: cost().distances(x[..., :1]), "problems, waypoints, joints"),
        (lambda: cost().curvature(x, 1.0), r"allowed is \(4, 6, 2\)"),
        (lambda: cost()("motion", 1.0), "positions: not an array of numbers"),
        (lambda: cost()([[1.0], [1.0, 2.0]], 1.0), "positions: not an array of numbers"),
        (lambda: cost()(1j * x, 1.0), "positions: found complex numbers"),
        (lambda: cost()(x, np.ones(3)), r"weight: found an array of shape \(3,\), allowed is one number, or \(2, 4\)"),
        (lambda: cost()(x, np.ones((1, 2, 4))), "weight: found an array of shape"),
        (lambda: cost()(x, None), "weight: not an array of numbers"),
    ):
        with pytest.raises(hdplan.InputError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
