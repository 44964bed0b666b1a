"""Laws of terms of one's own in symbols: their derivatives, in every form; that plans keep them; what is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

import hdplan
from hdplan.planner.build import build
from hdplan.planner.problem.problem import Problem
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.problem.whole_graph import whole_matrix

WEIGHT, STEP = 1e4, 1e-6

TERMS = (
    hdplan.OwnTerm("wavy", lambda q, step: ca.sin(3 * q[0]) * q[1] + 9 * ca.sumsqr(step)),
    hdplan.OwnTerm("low", lambda q, step: ca.vertcat(q[0] * q[1] - 0.1, ca.cos(q[0])), "penalty", scale=0.1),
    hdplan.OwnTerm("steps", lambda q, step: step, "constraint", -0.3, [0.2, 0.4], scale=0.2),
)


def small(name: str = "planar_arm", waypoints: int = 6) -> Problem:
    scene = load_scene(name)
    return build(dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=waypoints)))


def drawn(problem: Problem, seed: int) -> Array:
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    return problem.clip(line + 0.4 * np.random.default_rng(seed).normal(size=line.shape))


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)
@pytest.mark.parametrize("seed", range(3))
def test_derivatives(term: hdplan.OwnTerm, seed: int) -> None:
    """The gradient is that of the cost, the exact Hessian that of the gradient, and the curvature semidefinite."""
    problem = small().with_term(term)
    (alone,) = (*problem.terms.costs, *problem.terms.own)
    q = drawn(problem, seed)
    found, (diagonal, coupling) = alone.planned(q), alone.planned_second_order(q)
    whole = whole_matrix(found.diagonal + diagonal, found.coupling + coupling)
    assert np.linalg.eigvalsh(whole_matrix(found.diagonal, found.coupling)).min() > -1e-12
    for moved in np.random.default_rng(seed).normal(size=(3, *q.shape)):
        ahead, behind = alone.planned(q + STEP * moved), alone.planned(q - STEP * moved)
        slope = (ahead.cost - behind.cost) / (2 * STEP)
        assert np.sum(found.gradient * moved) == pytest.approx(slope, rel=1e-6, abs=1e-9)
        rate = (ahead.gradient - behind.gradient) / (2 * STEP)
        np.testing.assert_allclose(
            (whole @ moved.ravel()).reshape(moved.shape), rate, atol=1e-6 * max(1.0, np.abs(rate).max())
        )


def test_both_forms_of_the_program_are_the_same() -> None:
    problem = small()
    for term in TERMS:
        problem = problem.with_term(term)
    given: dict[str, Any] = {form: problem.casadi(form=form) for form in ("external", "symbolic")}
    for seed in range(3):
        positions = drawn(problem, seed)
        costs = [
            float(ca.Function("cost", [each.x, each.p], [each.f])(each.guess(positions), each.values(WEIGHT)))
            for each in given.values()
        ]
        assert costs == pytest.approx([problem.evaluate(positions, WEIGHT).cost] * 2, rel=1e-11)
    rows = [sum(part.numel() for part in each.rows) for each in given.values()]
    assert rows == [sum(part.numel() for part in small().casadi().rows) + 2 * (problem.waypoints - 2)] * 2
    assert repr(problem).endswith("smoothness, wavy, obstacles, low, steps>")


@pytest.mark.parametrize("polish", [0, 1])
def test_plans_keep_them(polish: int) -> None:
    """A bound on steps holds at every waypoint, a cost draws the elbow, and the motion is certified."""
    scene = load_scene("panda_corridor")
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, polish=polish))
    elbow = hdplan.OwnTerm("elbow", lambda q, step: 5 * (q[3] + 2.2) ** 2)
    most = 0.034
    steps = hdplan.OwnTerm("steps", lambda q, step: step[0], "constraint", -most, most, scale=0.5)
    plain, own = hdplan.plan(scene), hdplan.plan(scene, terms=[elbow, steps])
    assert np.abs(np.diff(plain.trajectory.positions[1:, 0])).max() > most
    assert own.certificate.certified
    assert np.abs(np.diff(own.trajectory.positions[1:, 0])).max() <= most
    off = [np.abs(each.trajectory.positions[:, 3] + 2.2).mean() for each in (plain, own)]
    assert off[1] < 0.9 * off[0]
    assert not [note for note in own.notes if note.startswith("term")]


def test_a_constraint_that_cannot_be_kept_is_reported() -> None:
    """No motion is at two places at once: it is not passed off as found."""
    never = hdplan.OwnTerm("never", lambda q, step: ca.sumsqr(q), "constraint", 1e3, 1e4)
    result = hdplan.plan(load_scene("planar_arm"), terms=[never], time_limit=0.5)
    assert [note for note in result.notes if note.startswith("term 'never': its bounds are exceeded by")]


class Doubled(ca.Callback):
    def __init__(self) -> None:
        ca.Callback.__init__(self)
        self.construct("doubled", {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def eval(self, given: Sequence[ca.DM]) -> list[ca.DM]:
        return [2 * given[0]]


DOUBLED = Doubled()
X, P = ca.MX.sym("x"), ca.MX.sym("p")
ROOT = ca.rootfinder("root", "newton", {"x": X, "p": P, "g": X + X**3 - P})
TABLE = ca.interpolant("table", "linear", [np.linspace(-4, 4, 9)], np.sin(np.arange(9.0)))
JUMPS = r"is not twice differentiable: its value or gradient jumps at"
SMOOTH = (
    lambda q, step: ca.sqrt(q[0] ** 2 + 1e-8),
    lambda q, step: ca.tanh(1e3 * q[1]),
    lambda q, step: ca.fmax(q[0] - 0.2, 0) ** 2,
    lambda q, step: ca.exp(9 * q[0]) * ca.sumsqr(step),
)


@pytest.mark.parametrize("each", SMOOTH)
def test_smooth_expressions_are_taken(each: Any) -> None:
    """However steep they are."""
    assert small().with_term(hdplan.OwnTerm("mine", each)).terms.costs


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((lambda q, step: q,), r"a scalar casadi\.MX is expected, found casadi\.MX of shape \(2, 1\)"),
        ((lambda q, step: q.T, "penalty"), r"a column casadi\.MX is expected, found casadi\.MX of shape \(1, 2\)"),
        ((lambda q, step: 1.0,), r"a scalar casadi\.MX is expected, found 1\.0"),
        ((lambda q, step: q @ q,), r"Matrix product with incompatible dimensions.*\(q and step have 2 rows\)"),
        (
            (lambda q, step: ca.sqrt(ca.fmax(q[0] - 9, 0)),),
            r"is not twice differentiable along the straight",
        ),
        (
            (lambda q, step: DOUBLED(q[0]),),
            r"calls 'doubled', which CasADi cannot write to C",
        ),
        ((lambda q, step: ROOT(x0=0, p=q[0])["x"],), r"calls 'root', which CasADi cannot write to C"),
        ((lambda q, step: ca.fabs(q[0]),), JUMPS),
        ((lambda q, step: ca.fabs(step[0]),), JUMPS),
        ((lambda q, step: ca.floor(3 * q[0]) * q[1],), JUMPS),
        ((lambda q, step: ca.if_else(q[0] > 0.1, 1, 2), "penalty"), JUMPS),
        ((lambda q, step: TABLE(q[0]),), JUMPS),
        (
            (lambda q, step: ca.MX(0, 1), "penalty"),
            r"a column casadi\.MX is expected, found casadi\.MX of shape \(0, 1\)",
        ),
        ((lambda q: q[0],), r"the function of \(q, step\) fails with TypeError"),
        ((lambda q, step: q[0] * ca.MX.sym("z"),), r"depends on 'z'; allowed are the waypoint and the step"),
        ((lambda q, step: q[0], "hard"), r"kind must be one of cost, penalty, constraint, found 'hard'"),
        ((lambda q, step: q, "constraint", 1.0, 0.0), r"lower must be below upper"),
        ((lambda q, step: q, "constraint", [0.0, 0.0, 0.0]), r"lower: a number or 2 of them are expected"),
        ((lambda q, step: q, "constraint", 0.0, np.nan), r"upper: NaN"),
        ((lambda q, step: q, "constraint", 0.0, 1.0, -1.0), r"scale must be a positive number, found -1\.0"),
    ],
)
def test_invalid_terms_are_refused(arguments: tuple[Any, ...], words: str) -> None:
    with pytest.raises(InputError, match=f"term 'mine': {words}"):
        small().with_term(hdplan.OwnTerm("mine", *arguments))


def test_two_terms_have_two_names() -> None:
    with pytest.raises(InputError, match="term 'wavy': the name is taken by another term"):
        small().with_term(TERMS[0]).with_term(dataclasses.replace(TERMS[1], name="wavy"))


def test_terms_are_checked_first() -> None:
    with pytest.raises(InputError, match="terms"):
        hdplan.plan(load_scene("planar_arm"), terms=[lambda q, step: q])
