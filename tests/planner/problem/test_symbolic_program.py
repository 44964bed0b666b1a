"""Laws of the problem in symbols: its penalty is that of the loops, with first and second derivatives, for every term
of every scene; there is no callback in it; it can be kept; and obstacles are where its parameters say."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import pkgutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hdplan
import hdplan.planner.problem as room
from hdplan.planner.build import build
from hdplan.planner.problem.clearance import PairTerm
from hdplan.planner.problem.compiled_solver import not_in_c
from hdplan.planner.problem.hinge import Hinge
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.symbolic_penalty import SymbolicPenalty, refuse_unwritten
from hdplan.planner.problem.terms import MotionPenalty, Term
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from tests.planner.problem.whole_graph import ROUNDING, agreed, close, graph_of, loops_at, motion

WEIGHT = 1e4  # of the penalty [1/m²]


def few_waypoints(scene: Scene, count: int = 4, **changes: object) -> Scene:
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=count, **changes))


@functools.cache
def problem_of(name: str, **changes: object) -> Problem:
    return build(few_waypoints(load_scene(name), **changes))


def agree(problem: Problem, motions: list[Array], exact: bool = True) -> float:
    """Hold the graph to the loops at motions; return the largest penalty that was seen."""
    graph, poses, seen = graph_of(problem, exact), SymbolicPenalty(problem, exact).values({}), 0.0
    for positions in motions:
        cost, slope, hessian = loops_at(problem, positions, exact)
        agreed(graph(positions.ravel(), poses), (cost, slope, hessian))
        seen = max(seen, cost)
    return seen


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", sorted(shipped_scenes()))
def test_every_shipped_scene(name: str) -> None:
    problem = problem_of(name)
    seen = agree(problem, [motion(problem, np.random.default_rng(7), spread) for spread in (0.3, 1.5)])
    assert seen > 0.0 or name in ("empty", "pr2_shelf")


def test_an_uncertain_obstacle_grows_with_time() -> None:
    """An obstacle grows with time where it stands and where it is moved, and is met in the last part of a motion."""
    scene = load_scene("panda_person")
    person = dataclasses.replace(scene.obstacles[1], pose=hdplan.Pose(position=(0.35, 0.75, 0.6)))
    scene = dataclasses.replace(scene, obstacles=(person,), start=scene.goal, goal=scene.start)
    problem = build(few_waypoints(scene))
    positions = problem.polyline()
    assert agree(problem, [positions, motion(problem, np.random.default_rng(2), 0.3)]) > 0.0
    still = build(few_waypoints(dataclasses.replace(scene, obstacles=(dataclasses.replace(person, uncertainty=None),))))
    assert problem.evaluate(positions, 1.0).penalty > still.evaluate(positions, 1.0).penalty
    away = np.eye(4)
    away[:3, 3] = 0.3, 0.9, 0.6
    there = dataclasses.replace(person, pose=hdplan.Pose(position=(0.3, 0.9, 0.6)))
    moved = build(few_waypoints(dataclasses.replace(scene, obstacles=(there,))))
    graph, poses = graph_of(problem, True), SymbolicPenalty(problem, True).values({"person": away})
    agreed(graph(positions.ravel(), poses), loops_at(moved, positions, True))


BASES = ("planar_arm", "panda_corridor", "panda_cup", "panda_conveyor", "panda_heavy", "ur5_scan", "panda_carry")


def random_scene(seed: int, varied: bool) -> Scene:
    """A shipped scene with other standing obstacles, of any convex shape, close to the robot or around it."""
    rng = np.random.default_rng(seed)
    scene = load_scene(BASES[seed % len(BASES)])
    shapes = (
        lambda: hdplan.Box(rng.uniform(0.02, 0.5, 3)),
        lambda: hdplan.Sphere(rng.uniform(0.02, 0.3)),
        lambda: hdplan.Cylinder(rng.uniform(0.02, 0.3), rng.uniform(0.02, 0.5)),
        lambda: hdplan.Capsule(rng.uniform(0.02, 0.2), rng.uniform(0.02, 0.5)),
        lambda: hdplan.Ellipsoid(rng.uniform(0.02, 0.3, 3)),
    )
    obstacles = [
        hdplan.Obstacle(
            f"drawn{k}",
            shapes[rng.integers(len(shapes))](),
            hdplan.Pose.from_rpy(rng.uniform(-0.7, 0.7, 3), rng.choice([0.0, np.pi / 2, rng.uniform(-3, 3)], 3)),
            clearance=float(rng.choice([0.0, 0.05])),
        )
        for k in range(rng.integers(1, 5))
    ]
    changes: dict[str, object] = {"swept": bool(rng.random() < 0.3), "activation": float(rng.uniform(0.01, 0.1))}
    if varied:
        changes |= {"gamma": int(rng.integers(1, 5)), "normals": str(rng.choice(["box", "faces", "sphere"]))}
    return few_waypoints(dataclasses.replace(scene, obstacles=(*scene.moving, *obstacles)), 3, **changes)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("chunk", range(4))
def test_random_scenes(chunk: int) -> None:
    seen = 0
    for seed in range(2 * chunk, 2 * chunk + 2):
        problem = build(random_scene(seed, varied=False))
        seen += agree(problem, [motion(problem, np.random.default_rng(seed), 0.6)]) > 0.0
    assert seen >= 1


@pytest.mark.slow
@pytest.mark.parametrize("chunk", range(20))
def test_many_random_scenes(chunk: int) -> None:
    """Every setting of the distance, and Gauss-Newton's curvature too."""
    seen = 0
    for seed in range(1000 + 10 * chunk, 1010 + 10 * chunk):
        problem = build(random_scene(seed, varied=True))
        motions = [motion(problem, np.random.default_rng(seed + k), spread) for k, spread in enumerate((0.1, 0.6, 2.0))]
        seen += agree(problem, motions) > 0.0
        agree(problem, motions, exact=False)
    assert seen >= 5


@pytest.mark.parametrize("name", ["panda_corridor", "panda_cup", "panda_heavy", "panda_conveyor"])
def test_gauss_newtons_curvature(name: str) -> None:
    problem = problem_of(name)
    assert agree(problem, [motion(problem, np.random.default_rng(3), 0.6)], exact=False) > 0.0


def test_swept_bodies() -> None:
    problem = problem_of("panda_cage", swept=True)
    motions = [motion(problem, np.random.default_rng(4), 0.4)]
    assert agree(problem, motions) > 0.0
    agree(problem, motions, exact=False)


def test_aligned_touching_and_deep() -> None:
    """An arm stretched along boxes that are parallel to it: vertices and planes tie; then margins with which each pair
    in turn just touches, to rounding."""
    scene = load_scene("planar_arm")
    straight, shares = np.zeros((3, 2)), []
    for gap in (-0.15, -0.1, -0.05, -1e-9, 0.0, 1e-9, 0.05):
        box = hdplan.Obstacle("beam", hdplan.Box([0.4, 0.1, 0.1]), hdplan.Pose([0.5, 0.15 + gap, 0.0]))
        problem = build(few_waypoints(dataclasses.replace(scene, obstacles=(box,)), 3, activation=0.05))
        shares.append(agree(problem, [straight, straight + 1e-9]))
    assert shares[0] > shares[1] > shares[2] > shares[-1] == 0.0
    (term,) = problem.terms.pairs
    pairs = np.arange(len(term.pairs))
    _, _, separation = term.distance(problem.kinematics.evaluate(straight[:1]), np.zeros_like(pairs), pairs)
    for touching in separation:
        changed = dataclasses.replace(
            problem.scene, planner=dataclasses.replace(problem.scene.planner, activation=0.05 + touching)
        )
        agree(build(changed), [straight, straight + 1e-12])


def test_no_function_of_it_calls_back() -> None:
    """The whole graph, derivatives included, is made of CasADi's own kinds of Function."""
    kinds = {"MXFunction", "SXFunction", "Map", "Switch"}
    for name in ("panda_conveyor", "panda_heavy", "panda_cup"):
        graph = graph_of(problem_of(name))
        assert {each.class_name() for each in [graph, *graph.find_functions()]} <= kinds
        assert not not_in_c(problem_of(name).casadi(form="symbolic").f)
    external = problem_of("planar_arm").casadi()
    assert not_in_c(external.f) == ["penalty"]


def test_a_saved_program_has_the_same_derivatives_and_maps(tmp_path: Path) -> None:
    """A program from a file has the same value, gradient and Hessian; two motions at once are each as alone."""
    program = problem_of("planar_arm").casadi(form="symbolic")
    cost = ca.Function("cost", [program.x, program.p], [program.f])
    cost.save(str(tmp_path / "cost.casadi"))
    again, rng = ca.Function.load(str(tmp_path / "cost.casadi")), np.random.default_rng(2)
    guesses = [program.guess(motion(program.problem, rng)) for _ in range(2)]
    p, symbol = program.values(WEIGHT), ca.MX.sym("x", program.x.numel())
    for each in (cost, again):
        assert {inner.class_name() for inner in each.find_functions()} <= {"MXFunction", "SXFunction", "Map", "Switch"}
    both = [
        ca.Function("all", [symbol], [each(symbol, p), *ca.hessian(each(symbol, p), symbol)]) for each in (cost, again)
    ]
    for x in guesses:
        for found, expected in zip(both[1](x), both[0](x), strict=True):
            close(np.array(found), np.array(expected), 1e-14)
    twice = cost.map(2)(np.array(guesses).T, p)
    close(np.array(twice).ravel(), np.array([float(cost(x, p)) for x in guesses]), 1e-14)


def turned(pose: Array, rng: np.random.Generator) -> Array:
    moved = np.array(hdplan.Pose.from_rpy(rng.uniform(-0.2, 0.2, 3), rng.uniform(-0.5, 0.5, 3)).matrix)
    result: Array = moved @ pose
    return result


@pytest.mark.core
@pytest.mark.parametrize("name", ["planar_arm", "panda_cage", "panda_vase"])
def test_moved_obstacles_equal_those_of_a_new_problem(name: str) -> None:
    problem, rng = problem_of(name), np.random.default_rng(8)
    graph, penalty = graph_of(problem), SymbolicPenalty(problem, exact=True)
    for _ in range(3):
        poses = {each.name: turned(each.pose.matrix, rng) for each in problem.scene.obstacles}
        quaternions = {key: Rotation.from_matrix(pose[:3, :3]).as_quat() for key, pose in poses.items()}
        rebuilt = tuple(
            dataclasses.replace(each, pose=hdplan.Pose(poses[each.name][:3, 3], quaternions[each.name]))
            for each in problem.scene.obstacles
        )
        moved = build(dataclasses.replace(problem.scene, obstacles=rebuilt))
        positions = motion(problem, rng)
        for found, expected in zip(
            graph(positions.ravel(), penalty.values(poses)), loops_at(moved, positions), strict=True
        ):
            close(np.array(found).squeeze(), np.array(expected))


def test_derivatives_by_the_poses() -> None:
    """Value and gradient, by differences along motions of an obstacle."""
    problem, rng = problem_of("panda_cage"), np.random.default_rng(9)
    penalty = SymbolicPenalty(problem, exact=True)
    x, poses = ca.MX.sym("x", problem.start.size * problem.waypoints), ca.MX.sym("poses", penalty.size)
    waypoints = ca.reshape(x, -1, problem.waypoints)
    value = penalty(waypoints[:, :-1], waypoints[:, 1:] - waypoints[:, :-1], poses)
    slope = ca.gradient(value, x)
    derivatives = [ca.jacobian(part, poses) for part in (value, slope)]
    by_poses = ca.Function("by", [x, poses], [value, slope, *derivatives])
    close(
        np.array(
            ca.Function("row", [x, poses], [ca.jacobian(value, x).T - slope])(
                motion(problem, rng).ravel(), penalty.values({})
            )
        ),
        np.zeros((x.numel(), 1)),
    )
    q, step = motion(problem, rng).ravel(), 1e-6
    at = [each.poses[0] for each in penalty.obstacles]
    for twist in rng.normal(size=(3, 6)):
        moved = []
        for sign in (1, 0, -1):
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(sign * step * twist[3:]).as_matrix()
            turn[:3, 3] = sign * step * twist[:3]
            moved.append(
                penalty.values({each.name: turn @ pose for each, pose in zip(penalty.obstacles, at, strict=True)})
            )
        ahead, here, behind = (by_poses(q, each) for each in moved)
        rate = (moved[0] - moved[2]) / (2 * step)
        for k in (0, 1):
            expected = (np.array(ahead[k]) - np.array(behind[k])).ravel() / (2 * step)
            assert np.abs(expected).max() > 1e-5
            close((np.array(here[k + 2]) @ rate).ravel(), expected, 1e-5)


def test_another_start_and_goal_share_the_graph() -> None:
    program = problem_of("planar_arm").casadi(form="symbolic")
    rng, problem = np.random.default_rng(1), program.problem
    start, goal = problem.robot.draw(rng, 2)
    moved = program.between(start, goal)
    assert moved.f is program.f
    np.testing.assert_array_equal(moved.bounds["lbx"][: len(start)], start)
    np.testing.assert_array_equal(moved.bounds["ubg"][-len(goal) :], goal)
    rebuilt = dataclasses.replace(problem, start=start, goal=goal)
    positions = motion(rebuilt, rng)
    positions[[0, -1]] = start, goal
    cost = ca.Function("cost", [program.x, program.p], [program.f])
    assert float(cost(moved.guess(positions), program.values(WEIGHT))) == pytest.approx(
        rebuilt.evaluate(positions, WEIGHT).cost, rel=ROUNDING
    )
    with pytest.raises(InputError, match="start: joint 'shoulder' is beyond its limits"):
        program.between([99.0, 0.0], goal)
    with pytest.raises(InputError, match="goal: 2 numbers are expected"):
        program.between(start, [0.0])
    with pytest.raises(InputError, match="start: is a part of form external"):
        problem.casadi().between(start, goal)


@pytest.mark.parametrize("name", ["panda_grasp", "panda_carry"])
def test_a_goal_that_slides(name: str) -> None:
    """By what a goal with free axes is slid along, the derivative with respect to the motion's end: the loops' is the
    graph's, and so are the second derivatives, for goals anywhere along the free axes."""
    problem, rng = problem_of(name), np.random.default_rng(11)
    graph, poses = graph_of(problem), SymbolicPenalty(problem, exact=True).values({})
    smooth, seen = ca.DM(problem.smoothness.matrix), 0.0
    for _ in range(3):
        moved = dataclasses.replace(problem, goal=problem.robot.draw(rng, 1)[0])
        positions = motion(moved, rng, 0.1)
        _, gradient, hessian = (np.array(part) for part in graph(positions.ravel(), poses))
        n = len(moved.goal)
        expected = WEIGHT * gradient[-n:, 0] + np.array(smooth[-1, :] @ ca.DM(positions)).ravel()
        close(moved.evaluate(positions, WEIGHT).at_goal, expected)
        close(loops_at(moved, positions)[2][-n:], hessian[-n:])
        seen = max(seen, float(np.abs(gradient[-n:]).max()))
    assert seen > 0.0


def test_compiled_it_is_the_same() -> None:
    program = problem_of("planar_arm").casadi(form="symbolic")
    options = {"ipopt": {"print_level": 0, "sb": "yes"}, "print_time": False}
    found = []
    for compiled in (False, True):
        solver = program.solver("ipopt", options, compiled=compiled)
        found.append(
            np.array(
                solver(x0=program.guess(program.problem.polyline()), p=program.values(100.0), **program.bounds)["x"]
            )
        )
    close(found[1], found[0], 1e-7)
    with pytest.raises(
        InputError, match="compiled: f calls 'penalty', which CasADi cannot write to C; allowed is form symbolic"
    ):
        problem_of("planar_arm").casadi().solver(compiled=True)
    with pytest.raises(InputError, match="options: calc_lam_p: while a compiled solver runs, obstacles stand"):
        program.solver("ipopt", {"calc_lam_p": True}, compiled=True)


@pytest.mark.parametrize("name", ["panda_conveyor", "panda_cage"])
def test_standing_obstacles_change_no_number(name: str) -> None:
    """The function that a solver evaluates, without derivatives by poses, is the graph itself, at other poses too."""
    program, rng = problem_of(name).casadi(form="symbolic"), np.random.default_rng(5)
    given, problem = [program.x, program.p], program.problem
    both = [
        ca.Function("both", given, [cost, *ca.hessian(cost, program.x)]) for cost in (program.f, program.standing["f"])
    ]
    poses = {each.name: turned(each.pose.matrix, rng) for each in problem.scene.standing}
    x, p = program.guess(motion(problem, rng)), program.values(WEIGHT, poses)
    for found, expected in zip(both[1](x, p), both[0](x, p), strict=True):
        close(np.array(found), np.array(expected), 1e-13)
    by_poses = ca.jacobian(program.standing["f"], program.p)[1:]
    assert by_poses.nnz() == 0 or not np.any(np.array(ca.Function("by", given, [by_poses])(x, p)))


class Half(Term):
    """One's own term, that is not written in symbols."""

    name = "mine"

    def over_motion(self, positions: Array, kinematics: object) -> MotionPenalty | None:
        return None


def every_term(kind: type[Term] = Term) -> set[type[Term]]:
    return {kind, *(each for below in kind.__subclasses__() for each in every_term(below))}


def test_every_term_is_written_or_refused() -> None:
    """All classes of terms of the package; nothing is left out in silence."""
    for module in pkgutil.iter_modules(room.__path__):
        importlib.import_module(f"{room.__name__}.{module.name}")
    open_to_any = {Term, Hinge, PairTerm}  # not terms themselves
    written = {kind for kind in every_term() if kind.__module__.startswith("hdplan.")} - open_to_any
    for kind in written:
        term = object.__new__(kind)
        term.name = kind.__name__
        refuse_unwritten(term)
        assert (kind.written_at_sample, kind.written_over_motion) != (Term.written_at_sample, Term.written_over_motion)
    assert {kind.__name__ for kind in written} >= {
        *("Clearance", "MovingClearance", "SweptClearance", "VelocityPenalty", "PathTerm", "StaticTorque")
    }
    problem = problem_of("planar_arm")
    with pytest.raises(InputError, match="form: the term 'mine' is not written in symbols; allowed: external"):
        problem.with_term(Half()).casadi(form="symbolic")
    with pytest.raises(InputError, match=r"form: exact Euclidean distance by FCL.* is not written in symbols"):
        problem_of("planar_arm", distance="fcl").casadi(form="symbolic")
    with pytest.raises(InputError, match="form: must be one of external, symbolic, found 'graph'"):
        problem.casadi(form="graph")


def test_values_that_are_not_a_pose_are_refused() -> None:
    program = problem_of("planar_arm").casadi(form="symbolic")
    name = program.problem.scene.obstacles[0].name
    with pytest.raises(InputError, match=r"poses: no obstacle is named 'nothing'"):
        program.values(1.0, {"nothing": np.eye(4)})
    with pytest.raises(InputError, match=rf"poses: {name}: found an array of shape \(3, 4, 4\), allowed is \(4, 4\)"):
        program.values(1.0, {name: np.stack([np.eye(4)] * 3)})
    with pytest.raises(InputError, match=rf"poses: {name}"):
        program.values(1.0, {name: 2 * np.eye(4)})
    for weight in (-1.0, np.nan, "heavy", [1.0, 2.0]):
        with pytest.raises(InputError, match=r"weight: found .*, allowed is a number that is not negative"):
            program.values(weight)
    with pytest.raises(InputError, match=rf"x: {program.x.numel()} numbers are expected, found 3"):
        program.positions(np.zeros(3))
    with pytest.raises(InputError, match="solver 'ipopt': Unknown option: bogus"):
        program.solver("ipopt", {"bogus": 1})
    cost = ca.Function("cost", [program.x, program.p], [program.f])
    x, p = program.guess(program.problem.polyline()), program.values(1.0)
    assert np.isfinite(float(cost(x, p)))
    assert np.isnan(float(cost(x, p * 1.1)))  # not checked by `values`: never a penalty of 0
    with pytest.raises(InputError, match="poses: are parameters of form symbolic alone"):
        problem_of("planar_arm").casadi().values(1.0, {name: np.eye(4)})


def test_one_evaluation_serves_cost_and_gradient_and_none_the_hessian() -> None:
    program = problem_of("panda_cage").casadi(form="symbolic")
    cost, x = program.standing["f"], program.x
    hessian, gradient = ca.hessian(cost, x)
    for results, expected in (([cost, gradient], 1), ([hessian], 0)):
        function = ca.Function("found", [x, program.p], results)
        calls = [k for k in range(function.n_instructions()) if function.instruction_id(k) == ca.OP_CALL]
        names = [function.instruction_MX(k).which_function().name() for k in calls]
        assert names.count("samples_evaluated") == expected
