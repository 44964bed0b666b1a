"""Laws of the exact Hessian of every term: differences of the exact gradient, CasADi's own, and CasADi's graph of the
whole problem show the same; it is symmetric, and where it is not known it is refused."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import casadi as ca
import numpy as np
import pytest

from hdplan.distance.symbolic.halfspaces import halfspace_distance
from hdplan.planner.build import build
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.problem.problem import Problem, Terms
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.terms import MotionPenalty, Term
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.problem.whole_graph import whole_graph

SCENES: dict[str, dict[str, Any]] = {  # each with a term, a body or a joint of another kind
    "planar_arm": {},
    "panda_corridor": {"gamma": 3},
    "panda_carry": {},  # a held object
    "panda_cup": {},  # an axis that stays upright
    "ur5_scan": {},  # a point that stays in a box
    "baxter_bimanual_carry": {},  # a link that stays with another
    "panda_conveyor": {},  # moving obstacles, velocities
    "panda_heavy": {},  # torques
    "panda_cage": {"swept": True},
    "tiago_shelf": {},  # a torso that slides
}
COUNT, STEP, DIFFERENCE = 16, 1e-6, 2e-6  # configurations; [rad]; the distance bends over 1 mm

every_scene = pytest.mark.parametrize("name", SCENES)


@functools.cache
def problem_of(name: str) -> Problem:
    scene = load_scene(name)
    return build(dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=6, **SCENES[name])))


def drawn(problem: Problem, seed: int) -> Array:
    """Half of them near the motion that is looked for, the others anywhere."""
    rng, line = np.random.default_rng(seed), np.linspace(problem.start, problem.goal, COUNT // 2)
    near = np.clip(line + 0.1 * rng.normal(size=line.shape), *problem.robot.inner)
    return np.vstack([near, problem.robot.draw(rng, COUNT - len(line))])


def close(found: Array, expected: Array, tolerance: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1e-3, float(np.abs(expected).max())))


def at_samples(problem: Problem, term: Term, q: Array) -> tuple[Array, Array] | None:
    """The gradient (B, n) and the exact Hessian (B, n, n) of a term at configurations."""
    kinematics, samples = problem.kinematics.evaluate(q), Samples((len(q),))
    found, second_order = term.at_samples(kinematics, samples), term.second_order(kinematics, samples)
    return (
        None if found is None else (found.gradient, found.curvature + (0.0 if second_order is None else second_order))
    )


@pytest.mark.sampled(7)
@every_scene
@pytest.mark.parametrize("seed", [1, 2])
def test_differences_of_the_gradient_at_samples(name: str, seed: int) -> None:
    problem = problem_of(name)
    q, n = drawn(problem, seed), len(problem.start)
    seen = 0.0
    for term in problem.terms:
        if (found := at_samples(problem, term, q)) is None:
            continue
        hessian, expected = found[1], np.zeros((COUNT, n, n))
        for j, step in enumerate(STEP * np.eye(n)):
            ahead, behind = at_samples(problem, term, q + step), at_samples(problem, term, q - step)
            assert ahead is not None
            assert behind is not None
            expected[:, j] = (ahead[0] - behind[0]) / (2 * STEP)
        close(hessian, expected, DIFFERENCE)
        close(hessian, hessian.swapaxes(1, 2), 1e-12)
        seen = max(seen, float(np.abs(term.second_order(problem.kinematics.evaluate(q), Samples((COUNT,)))).max()))
    assert seen > 1e-4 or name == "panda_cage"


def blocks_times(diagonal: Array, coupling: Array, moved: Array) -> Array:
    result: Array = np.einsum("kij,kj->ki", diagonal, moved)
    result[1:] += np.einsum("kij,kj->ki", coupling, moved[:-1])
    result[:-1] += np.einsum("kij,ki->kj", coupling, moved[1:])
    return result


@pytest.mark.sampled(2)
@every_scene
def test_differences_of_the_gradient_of_the_motion(name: str) -> None:
    """Every term by itself, along random motions of all waypoints."""
    problem = problem_of(name)
    rng = np.random.default_rng(3)
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    for term in problem.terms:
        alone = dataclasses.replace(problem, terms=Terms(own=(term,)))
        q = problem.clip(line + 0.3 * rng.normal(size=line.shape))
        found, (diagonal, coupling) = alone.penalty(q), alone.second_order(q)
        close(diagonal, diagonal.swapaxes(1, 2), 1e-12)
        for moved in rng.normal(size=(3, *q.shape)):
            ahead, behind = (alone.penalty(q + sign * STEP * moved).gradient for sign in (1, -1))
            product = blocks_times(found.diagonal + diagonal, found.coupling + coupling, moved)
            close(product, (ahead - behind) / (2 * STEP), DIFFERENCE)


def test_casadis_own_derivatives_of_a_small_case() -> None:
    """The penalty written with the distance's definition, where that has derivatives of its own: away from ties."""
    problem = problem_of("planar_arm")
    (term,) = problem.terms.pairs
    pairs, distance, kinematics = term.pairs, term.distance, problem.kinematics
    assert isinstance(distance, HdsdfPairs)
    q = ca.MX.sym("q", kinematics.n)
    placements = ca.reshape(kinematics.state(q)[: 12 * kinematics.nj], 12, kinematics.nj)
    penalty = ca.MX(0)
    for k in range(len(pairs)):
        planes = int(pairs.plane_slots[k])
        value = halfspace_distance(pairs.vertex_slots, planes, distance.gamma, distance.shaping_length)
        body, row = pairs.body_table[pairs.body[k]], pairs.plane_tables[planes][pairs.plane_row[k]]
        found = value(placements[:, int(pairs.joint_a[k])], placements[:, int(pairs.joint_b[k])], body, row)[0]
        penalty += ca.fmin(found, 0) ** 2 / 2
    own = ca.Function("own", [q], [ca.densify(ca.hessian(penalty, q)[0])])
    samples = drawn(problem, 4)
    hessians = at_samples(problem, term, samples)
    assert hessians is not None
    expected = np.array([np.array(own(each)) for each in samples]) / COUNT
    assert np.abs(expected).max() > 1e-4
    close(hessians[1], expected, 1e-9)


@pytest.mark.parametrize("name", ["planar_arm", "panda_carry"])
def test_the_graph_of_the_whole_problem(name: str) -> None:
    problem, weight = problem_of(name), 1e4
    rng = np.random.default_rng(5)
    graph = whole_graph(problem)
    whole = ca.Function("whole", [graph.x, graph.weight], [graph.hessian])
    program = problem.casadi()
    own = ca.Function("own", [program.x, program.p], [ca.hessian(program.f, program.x)[0]])
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    q = problem.clip(line + 0.2 * rng.normal(size=line.shape))
    basis = np.array([carried(problem, each) for each in np.eye(q[1:-1].size)]).T
    found = basis.T @ np.array(own(program.guess(q), weight)) @ basis
    close(found, np.array(whole(q[1:-1].ravel(), weight)), 1e-9)


def carried(problem: Problem, moved: Array) -> Array:
    """A motion of the waypoints between the ends (M n) in the program's x."""
    q = np.zeros((problem.waypoints, len(problem.start)))
    q[1:-1] = moved.reshape(-1, q.shape[1])
    step = np.diff(q, axis=0)
    return np.concatenate([np.hstack([q[:-2], step[:-1], np.diff(step, axis=0)]).ravel(), q[-2], step[-1]])


class Cost(Term):
    """One's own term, of which only the curvature is known."""

    name = "mine"

    def over_motion(self, positions: Array, kinematics: Kinematics) -> MotionPenalty | None:
        return None


def test_unknown_hessians_are_refused() -> None:
    planar = problem_of("planar_arm")
    with pytest.raises(InputError, match=r"hessian: must be one of exact, gauss_newton, found 'full'"):
        planar.casadi("full")
    with pytest.raises(
        InputError, match=r"hessian: no second derivatives are known of the term 'mine'; allowed: gauss"
    ):
        planar.with_term(Cost()).casadi()
    scene = load_scene("planar_arm")
    euclidean = build(dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, distance="fcl")))
    with pytest.raises(
        InputError, match=r"hessian: no second derivatives are known of exact Euclidean distance by FCL"
    ):
        euclidean.casadi()
    for problem in (planar.with_term(Cost()), euclidean):
        assert problem.casadi("gauss_newton").x.numel() > 0


@pytest.mark.parametrize("plugin", ["ipopt", "fatrop"])
def test_both_solvers_need_fewer_steps(plugin: str) -> None:
    """To a tolerance, from the minimum at one weight to that at the next; without it some end before they reach it."""
    problem, steps, costs = problem_of("panda_carry"), {}, {}
    for hessian in ("exact", "gauss_newton"):
        program = problem.casadi(hessian)
        given = {"print_time": False, "error_on_fail": hessian == "exact", plugin: {"print_level": 0, "tol": 1e-7}}
        solver = ca.nlpsol("solver", plugin, program.nlp, given | (program.stages if plugin == "fatrop" else {}))
        x, count = ca.DM(program.guess(problem.polyline())), 0
        for weight in (1e3, 1e4, 1e5):
            found = solver(x0=x, p=weight, **program.bounds)
            x, count = found["x"], count + solver.stats()["iter_count"]
        steps[hessian], costs[hessian] = count, float(found["f"])
    assert costs["exact"] == pytest.approx(costs["gauss_newton"], rel=1e-6)
    assert steps["exact"] < 0.6 * steps["gauss_newton"]
