"""Laws of the CasADi program: the same cost as `Problem.evaluate` at every motion, its derivatives, and what may be
added to it."""

from __future__ import annotations

import dataclasses
import functools
import gc
from typing import Any

import casadi as ca
import numpy as np
import pytest

import hdplan
from hdplan.planner.build import build
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.program import Program
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import load_scene

ROUNDING = 1e-11  # the same sums in another order; relative to the largest number
STEP, DIFFERENCE = 1e-5, 1e-7  # [rad] fourth-order differences; the distance bends over 1 mm
WEIGHT = 1e4  # of the penalty [1/m²]
SCENES = {  # each with a term of another kind
    "planar_arm": {},
    "panda_corridor": {},
    "panda_cup": {},  # path constraints
    "panda_conveyor": {},  # moving obstacles, velocities
    "panda_heavy": {},  # torques
    "panda_cage": {"swept": True},  # couples waypoints by a block that is not symmetric
    "ur5_table": {"distance": "fcl"},
}
PLUGINS: dict[str, dict[str, Any]] = {"ipopt": {"print_level": 0, "sb": "yes"}, "fatrop": {"print_level": 0}}


@functools.cache
def problem_of(name: str, waypoints: int = 7) -> Problem:
    scene = load_scene(name)
    settings = dataclasses.replace(scene.planner, waypoints=waypoints, **SCENES[name])
    return build(dataclasses.replace(scene, planner=settings))


def motion(problem: Problem, seed: int, spread: float = 0.3) -> Array:
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    return problem.clip(line + spread * np.random.default_rng(seed).normal(size=line.shape))


def carried(problem: Problem, moved: Array) -> Array:
    """A motion of the waypoints between the ends (M, n) in the program's x."""
    q = np.zeros((problem.waypoints, moved.shape[1]))
    q[1:-1] = moved
    step = np.diff(q, axis=0)
    return np.concatenate([np.hstack([q[:-2], step[:-1], np.diff(step, axis=0)]).ravel(), q[-2], step[-1]])


def close(found: object, expected: Array, tolerance: float = ROUNDING) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1.0, float(np.abs(expected).max())))


every_scene = pytest.mark.parametrize("name", SCENES)


@every_scene
@pytest.mark.parametrize("waypoints", [3, 4, 7])
def test_cost_gradient_and_curvature_are_those_of_the_evaluation(name: str, waypoints: int) -> None:
    """Along every motion of the waypoints, which is all that a solver can move; for the exact Hessian see
    `test_hessian`."""
    problem = problem_of(name, waypoints)
    program = problem.casadi("gauss_newton")
    hessian, gradient = ca.hessian(program.f, program.x)
    given = [program.x, program.p]
    found = ca.Function("found", given, [program.f, gradient, hessian, ca.vertcat(*program.rows)])
    rng = np.random.default_rng(5)
    for seed in range(3):
        positions = motion(problem, seed)
        state = problem.evaluate(positions, WEIGHT)
        cost, slope, curvature, rows = (np.array(part) for part in found(program.guess(positions), WEIGHT))
        close(cost, np.array([[state.cost]]))
        close(rows.ravel(), np.concatenate(program.lower))
        one, other = rng.normal(size=(2, *state.gradient.shape))
        close(slope.ravel() @ carried(problem, one), np.sum(state.gradient * one))
        smooth = np.einsum("ki,kl,li", one, problem.smoothness.matrix[1:-1, 1:-1], other)
        across = sum(a @ c @ b for a, c, b in zip(one[1:], state.coupling, other[:-1], strict=True))
        across += sum(a @ c @ b for a, c, b in zip(other[1:], state.coupling, one[:-1], strict=True))
        within = np.einsum("ki,kij,kj", one, state.diagonal, other)
        close(carried(problem, one) @ curvature @ carried(problem, other), smooth + within + across)
        close(curvature, curvature.T)


@every_scene
def test_the_gradient_is_that_of_the_cost(name: str) -> None:
    """Differences in every direction of x."""
    problem = problem_of(name)
    program = problem.casadi("gauss_newton")
    cost = ca.Function("cost", [program.x, program.p], [program.f])
    gradient = ca.Function("gradient", [program.x, program.p], [ca.gradient(program.f, program.x)])
    rng = np.random.default_rng(6)
    x = program.guess(motion(problem, 1, 0.1))
    for unit in rng.normal(size=(3, len(x))):
        near, far = (
            float(cost(x + k * STEP * unit, WEIGHT)) - float(cost(x - k * STEP * unit, WEIGHT)) for k in (1, 2)
        )
        found = float(ca.dot(gradient(x, WEIGHT), unit))
        assert found == pytest.approx((8 * near - far) / (12 * STEP), rel=DIFFERENCE, abs=DIFFERENCE * WEIGHT)


@pytest.mark.parametrize("name", ["planar_arm", "panda_cage"])
def test_the_hessian_couples_no_stages(name: str) -> None:
    """The structure that fatrop needs, found without coloring a dense matrix."""
    problem = problem_of(name, 12)
    program = problem.casadi()
    n = len(problem.start)
    rows, columns = ca.hessian(program.f, program.x)[0].sparsity().get_triplet()
    assert np.all(np.array(rows) // (3 * n) == np.array(columns) // (3 * n))
    assert len(rows) <= (problem.waypoints - 1) * (3 * n) ** 2


@every_scene
def test_bounds_hold_the_ends_and_the_joint_limits(name: str) -> None:
    problem = problem_of(name)
    program, n = problem.casadi("gauss_newton"), len(problem.start)
    bounds = program.bounds
    wild = np.random.default_rng(3).normal(size=(problem.waypoints, n)) * 10
    x = program.guess(wild)
    waypoints = ca.Function("waypoints", [program.x], [program.waypoints])
    close(np.array(waypoints(x)).T[1:-1], wild[1:-1])
    close(np.array(waypoints(x)).T[[0, -1]], np.array([problem.start, problem.goal]))
    np.testing.assert_array_equal(program.positions(x), problem.clip(wild))
    inside = program.guess(problem.clip(wild))
    assert np.all((bounds["lbx"] <= inside) & (inside <= bounds["ubx"]))
    beyond = wild[1:-1] > problem.robot.upper
    above = (x > bounds["ubx"])[: 3 * n * (problem.waypoints - 2)].reshape(-1, 3, n)[1:, 0]
    np.testing.assert_array_equal(above, beyond[:-1])


@pytest.mark.parametrize("plugin", PLUGINS)
@pytest.mark.parametrize("name", ["planar_arm", "panda_corridor", "panda_cup"])
def test_both_solvers_find_the_same_minimum(name: str, plugin: str) -> None:
    """The minimum, which is near at a low weight: the gradient vanishes in every direction that is free."""
    problem = problem_of(name, 12)
    program = problem.casadi()
    stages = program.stages if plugin == "fatrop" else {}
    options = {"print_time": False, plugin: PLUGINS[plugin] | {"max_iter": 300}, **stages}
    solver = ca.nlpsol("solver", plugin, program.nlp, options)
    found = solver(x0=program.guess(problem.polyline()), p=100.0, **program.bounds)
    positions = program.positions(np.array(found["x"]))
    state = problem.evaluate(positions, 100.0)
    assert state.cost == pytest.approx(float(found["f"]), rel=1e-7)
    free = np.all((positions > problem.robot.inner[0] + 1e-3) & (positions < problem.robot.inner[1] - 1e-3), axis=1)
    scale = np.abs(problem.smoothness.matrix).max()
    assert np.abs(state.gradient[free[1:-1]]).max() < 1e-6 * scale


def solved(program: Program, plugin: str, weights: tuple[float, ...]) -> Array:
    stages = program.stages if plugin == "fatrop" else {}
    options = {"print_time": False, plugin: PLUGINS[plugin] | {"max_iter": 100}, **stages}
    solver = ca.nlpsol("solver", plugin, program.nlp, options)
    x = program.guess(program.problem.polyline())
    for weight in weights:
        x = np.array(solver(x0=x, p=weight, **program.bounds)["x"])
    return program.positions(x)


@pytest.mark.parametrize("plugin", PLUGINS)
def test_a_cost_and_a_constraint_of_ones_own_are_kept(plugin: str) -> None:
    """A limit on each step, and a posture: both are met, and the motion is certified by the same proof as any other."""
    problem = problem_of("panda_corridor", 32)
    plain = problem.casadi()
    most = 0.038
    elbow = plain.waypoints[3, :]
    own = plain.with_cost(5.0 * ca.sumsqr(elbow + 2.2)).with_constraint(lambda q, step: step[0], -most, most)
    before, after = (solved(each, plugin, (6e3, 2e5, 8e6)) for each in (plain, own))
    assert np.abs(np.diff(before[1:, 0])).max() > most + 0.002
    assert np.abs(np.diff(after[1:, 0])).max() <= most + 1e-6
    assert np.abs(after[:, 3] + 2.2).mean() < 0.5 * np.abs(before[:, 3] + 2.2).mean()
    trajectory = hdplan.Trajectory(problem.robot.joint_names, after, problem.robot.locked)
    assert hdplan.certify(problem.scene, trajectory).certified


def test_unfit_additions_are_refused() -> None:
    program = problem_of("planar_arm").casadi()
    assert repr(program) == "<Program of planar_arm: 34 variables, 22 constraints>"
    stranger = ca.MX.sym("stranger")
    for cost, words in (
        (program.waypoints, r"cost: a scalar casadi\.MX is expected, found casadi\.MX of shape \(2, 7\)"),
        (3.0, r"cost: a scalar casadi\.MX is expected, found 3\.0"),
        (program.f * stranger, r"cost: depends on 'stranger'; allowed are the program's x and p"),
    ):
        with pytest.raises(InputError, match=words):
            program.with_cost(cost)
    for each, bounds, words in (
        (
            lambda q, step: q.T,
            (0, 1),
            r"constraint: a column casadi\.MX is expected, found casadi\.MX of shape \(1, 2\)",
        ),
        (lambda q, step: 1.0, (0, 1), r"constraint: a column casadi\.MX is expected, found 1\.0"),
        (lambda q, step: q * stranger, (0, 1), r"constraint: depends on 'stranger'"),
        (lambda q, step: q, (np.zeros(3), 1), r"constraint: lower: a number or 2 of them are expected"),
        (lambda q, step: q, (0, np.nan), r"constraint: upper: NaN"),
        (lambda q, step: q, (1, 0), r"constraint: lower \[1\.0, 1\.0\] is above upper \[0\.0, 0\.0\]"),
    ):
        with pytest.raises(InputError, match=words):
            program.with_constraint(each, *bounds)
    with pytest.raises(InputError, match=r"guess: shape \(3, 2\), expected \(7, 2\)"):
        program.guess(np.zeros((3, 2)))
    with pytest.raises(InputError, match=r"guess: numbers of shape \(7, 2\)"):
        program.guess(np.ones((7, 2)) * 1j)


def test_a_function_that_outlives_its_program_raises_an_error() -> None:
    """CasADi holds no function of Python: the error is its own, and no crash."""
    program = problem_of("planar_arm").casadi()
    cost, x = (
        ca.Function("cost", [program.x, program.p], [program.f]),
        program.guess(problem_of("planar_arm").polyline()),
    )
    assert np.isfinite(float(cost(x, 1.0)))
    del program
    gc.collect()
    with pytest.raises(RuntimeError, match="Callback object has been deleted"):
        cost(x, 1.0)


def test_an_evaluation_serves_cost_gradient_and_hessian(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of("planar_arm")
    program = problem.casadi()
    calls = []
    whole = Problem.penalty
    monkeypatch.setattr(Problem, "penalty", lambda self, positions: calls.append(1) or whole(self, positions))
    hessian, gradient = ca.hessian(program.f, program.x)
    everything = ca.Function("everything", [program.x, program.p], [program.f, gradient, hessian])
    for seed in range(3):
        everything(program.guess(motion(problem, seed)), WEIGHT)
    assert len(calls) == 3
