"""Laws of the path constraints' terms: exact slopes at any angle, clear means kept with room, absent is absent."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest

from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.path_check import PathCheck
from hdplan.planner.plan import plan
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.samples import Samples
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search import goals
from hdplan.planner.search.goals import goal_choice
from hdplan.planner.search.roadmap import Roadmap, onto_path
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.path_constraints import PathConstraints, Relative, Upright, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget
from hdplan.scenes.yaml_format.reader import load_scene

LINKS = {"panda_carry": "panda_hand", "ur5_table": "tool0", "kinova_shelf": "j2s6s200_end_effector"}
OTHERS = {"panda_carry": "panda_link2", "ur5_table": "upper_arm_link", "kinova_shelf": "j2s6s200_link_base"}
TURNED = Pose((0.4, 0.1, 0.3), (0.1, 0.2, -0.3, math.sqrt(1 - 0.14)))
BAND, HALF_STEP = 0.02, 1e-6


def held(name: str, **given: Upright | Within | Relative) -> Scene:
    scene = load_scene(name)
    return dataclasses.replace(scene, obstacles=(), attached=(), path=PathConstraints(**given))


def upright(name: str, tolerance: float = 0.1, axis: tuple[float, float, float] = (0.0, 0.0, -1.0)) -> Scene:
    return held(name, upright=Upright(LINKS[name], axis, tolerance))


def within(name: str, size: tuple[float, float, float] = (0.02, math.inf, 0.5)) -> Scene:
    return held(name, position=Within(LINKS[name], size, TURNED, (0.01, 0.02, 0.1)))


def relative(name: str) -> Scene:
    return held(name, relative=Relative(LINKS[name], OTHERS[name], TURNED, 0.05, 0.3))


def between(scene: Scene, start: Array, goal: Array) -> Scene:
    ends = {"start": JointTarget("start", tuple(start.tolist())), "goal": JointTarget("goal", tuple(goal.tolist()))}
    return dataclasses.replace(scene, **ends)


def cost(problem: Problem, q: Array) -> Array:
    """The path terms' penalty at single configurations (B, n) -> (B,), from their depths' definition alone."""
    inside = [term.inside(problem.kinematics.evaluate(q))[0] for term in problem.terms.path]
    return 0.5 * sum((each**2).sum(axis=1) for each in inside)


@pytest.mark.parametrize("name", LINKS)
@pytest.mark.parametrize("make", [upright, within, relative])
def test_slopes_are_those_of_the_penalty(name: str, make: object) -> None:
    problem = build(make(name))  # type: ignore[operator]
    (term,) = problem.terms.path
    q = problem.robot.draw(np.random.default_rng(1), 40)
    samples = Samples((40,))
    penalty = term.at_samples(problem.kinematics.evaluate(q), samples)
    assert penalty.cost == pytest.approx(float(samples.weight @ cost(problem, q)), rel=1e-12)
    for j in range(problem.robot.n):
        step = HALF_STEP * np.eye(problem.robot.n)[j]
        slope = (cost(problem, q + step) - cost(problem, q - step)) / (2 * HALF_STEP)
        np.testing.assert_allclose(penalty.gradient[:, j], samples.weight * slope, atol=1e-9)
    assert np.linalg.eigvalsh(penalty.curvature).min() > -1e-12
    np.testing.assert_array_equal(penalty.depth, term.depth(problem.kinematics.evaluate(q)))


def test_an_upright_link_has_no_penalty_and_one_upside_down_is_still_drawn_back() -> None:
    up = build(upright("ur5_table"))
    (term,) = up.terms.path
    level = onto_path(up, up.robot.draw(np.random.default_rng(2), 60))
    level = level[term.depth(up.kinematics.evaluate(level)) == 0.0]
    assert len(level) > 30
    assert not cost(up, level).any()
    down = build(upright("ur5_table", axis=(0.0, 0.0, 1.0)))
    (other,) = down.terms.path
    inside, slope = other.inside(down.kinematics.evaluate(level))
    assert inside.min() > math.pi - 0.2
    lengths = np.linalg.norm(slope[:, 0], axis=1)
    assert np.isfinite(slope).all()
    assert lengths.min() > 0.5  # the wrist alone turns it at a rate of 1
    assert np.linalg.norm(onto_path(down, level) - level, axis=1).min() > 0.1


def angles(robot: Robot, link: str, q: Array) -> Array:
    """Angle of the axis −z of a link to the upward direction, by Pinocchio."""
    data, found = robot.model.createData(), []
    for row in q:
        pin.framesForwardKinematics(robot.model, data, robot.pin_q(row))
        found.append(math.acos(np.clip(-data.oMf[robot.model.getFrameId(link)].rotation[2, 2], -1, 1)))
    return np.array(found)


@pytest.mark.parametrize("tolerance", [1e-3, 0.03, 0.1, 2.0])
@pytest.mark.parametrize("activation", [0.0, 0.02])
def test_a_clear_motion_keeps_the_constraint(tolerance: float, activation: float) -> None:
    scene = upright("panda_carry", tolerance)
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, activation=activation))
    problem = build(scene)
    (term,) = problem.terms.path
    q = onto_path(problem, problem.robot.draw(np.random.default_rng(3), 200))
    q = np.vstack([q, q + 0.4 * tolerance * np.random.default_rng(4).normal(size=q.shape)])
    tilt, depth = angles(problem.robot, "panda_hand", q), term.depth(problem.kinematics.evaluate(q))
    room = tolerance - 0.5 * min(tolerance / 2, BAND) if activation else tolerance
    clear = depth <= 0.5 * activation
    assert 50 < np.count_nonzero(clear) < len(q)
    assert np.all(tilt[clear] <= room + 1e-7)
    assert np.all(tilt[~clear] >= room - 1e-7)


@pytest.mark.parametrize("name", LINKS)
def test_drawn_configurations_are_brought_to_where_the_constraints_hold(name: str) -> None:
    both = dataclasses.replace(
        within(name), path=PathConstraints(upright(name).path.upright, within(name).path.position)
    )
    for scene in (upright(name), within(name), both):
        problem = build(scene)
        check = Certifier(Setup.of(scene, problem.robot)).path
        drawn = problem.robot.draw(np.random.default_rng(5), 60)
        assert sum(not check.at(q) for q in drawn) < 10
        found = onto_path(problem, drawn)
        assert np.all((found >= problem.robot.lower) & (found <= problem.robot.upper))
        kept = np.array([not check.at(q) for q in found])
        assert np.count_nonzero(kept) > 30
        settled = np.all([term.depth(problem.kinematics.evaluate(found)) == 0.0 for term in problem.terms.path], axis=0)
        assert np.all(kept[settled])


def test_the_roadmap_is_drawn_where_the_constraints_hold() -> None:
    scene = upright("ur5_table")
    problem = build(scene)
    ends = onto_path(problem, problem.robot.draw(np.random.default_rng(6), 20))
    check = Certifier(Setup.of(scene, problem.robot)).path
    first, last = [q for q in ends if not check.at(q)][:2]
    roadmap = Roadmap(build(between(scene, first, last)), np.random.default_rng(0))
    roadmap.grow()
    assert len(roadmap.nodes) > 10
    assert not any(check.at(q) for q in roadmap.nodes)


def test_absent_is_absent() -> None:
    scene = load_scene("panda_cage")
    problem = build(scene)
    assert problem.terms.path == ()
    assert {term.name for term in problem.terms} == {"obstacles", "self-collision"}
    assert Certifier(Setup.of(scene, problem.robot)).path is None


@pytest.mark.parametrize("field", ["upright", "position"])
@pytest.mark.parametrize(
    ("link", "message"), [("panda_hnd", "unknown link 'panda_hnd'"), ("panda_link0", "fixed to the")]
)
def test_unknown_and_fixed_links_are_refused_by_name(field: str, link: str, message: str) -> None:
    constraint = Upright(link) if field == "upright" else Within(link, (0.1, 0.1, 0.1))
    scene = held("panda_carry", **{field: constraint})
    for refuses in (build, plan):
        with pytest.raises(InputError, match=rf"the scene made from panda_carry: path\.{field}\.link: .*{message}"):
            refuses(scene)


def test_ends_that_break_a_constraint_are_refused_with_by_how_much() -> None:
    scene = upright("panda_carry", 0.1)
    robot = load_scene_robot(scene)
    check = Certifier(Setup.of(scene, robot)).path
    problem = build(scene)
    level = next(q for q in onto_path(problem, robot.draw(np.random.default_rng(7), 50)) if not check.at(q))
    tilted = np.clip(level - [0, 0, 0, 0, 0, 0.4, 0], robot.lower, robot.upper)
    angle = float(angles(robot, "panda_hand", tilted[None])[0])
    text = rf"breaks a path constraint: path\.upright: panda_hand is tilted by {angle:.3g} rad, 0\.1 are allowed"
    with pytest.raises(InputError, match=rf"start: {text}"):
        plan(between(scene, tilted, level))
    with pytest.raises(InputError, match=rf"goal: {text}"):
        plan(between(scene, level, tilted))


def test_goals_by_inverse_kinematics_keep_the_constraint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "DRAW_ROUNDS", 2)
    scene = upright("ur5_table", 0.1)
    robot, start = load_scene_robot(scene), load_scene_robot(scene).configuration(scene.start)
    setup = Setup.of(scene, robot)
    assert not PathCheck(setup, Certifier(setup).sweep.bodies.chain).at(start)
    place = Pose((0.5, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0))
    tilted = Pose((0.5, 0.2, 0.3), (math.cos(0.2), 0.0, math.sin(0.2), 0.0))
    aimed = dataclasses.replace(scene, goal=Goals((PoseTarget("tool0", place, free_rotation="z", field="goal.pose"),)))
    certifier = Certifier(Setup.of(aimed, robot))
    for goal in goal_choice(certifier).goals:
        assert not certifier.path.at(robot.configuration(goal))
    anyhow = dataclasses.replace(
        scene, goal=Goals((PoseTarget("tool0", Pose(place.position), free_rotation="all", field="goal.pose"),))
    )
    assert len(goal_choice(Certifier(Setup.of(anyhow, robot))).goals) > 1  # few of all turns hold it upright
    wrong = dataclasses.replace(scene, goal=Goals((PoseTarget("tool0", tilted, field="goal.pose"),)))
    with pytest.raises(
        InputError,
        match=r"goal\.pose: none of .*: breaks a path constraint: path\.upright: tool0 is tilted by 0\.4 rad",
    ):
        goal_choice(Certifier(Setup.of(wrong, robot)))


def test_terms_are_named_after_their_sections() -> None:
    problem = build(within("ur5_table"))
    assert [term.name for term in problem.terms.path] == ["path.position"]
