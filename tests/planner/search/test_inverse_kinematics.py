"""Laws of the search for configurations: in C and in NumPy it finds the same, and what it finds keeps its word."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pinocchio as pin
import pytest

from hdplan import AllOf, InputError, Limits, Pose, PoseTarget, RobotSpec, load_robot, load_scene
from hdplan.planner.certificate.pose_goals import miss_of
from hdplan.planner.kinematics import inverse
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.search import inverse_kinematics as search
from hdplan.planner.search.inverse_kinematics import LEAST_DIFFERENCE, inverse_kinematics, reaching
from tests.loops import in_numpy, needs_loops

from ..links import pose_of

ROBOTS = ("panda", "ur5", "z1", "double_pendulum_continuous")
SAME = 1e-6  # [rad] between configurations after some forty steps that each round a little differently


def turned(way: np.ndarray) -> np.ndarray:
    """The same turns without whole ones."""
    return (way + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.sampled(3)
@needs_loops
@pytest.mark.parametrize("name", ROBOTS)
def test_without_a_compiler_the_same_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot(RobotSpec(name=name))
    rng = np.random.default_rng(11)
    link = robot.links[-1]
    for number, free in enumerate(("none", "none", "x", "y", "z", "all")):
        start, q = robot.draw(rng, 2)
        pose = pose_of(robot, link, q)
        target = PoseTarget(
            link,
            Pose(pose.position) if free == "all" else pose,
            *(1e-3, 1e-2)[: 2 - (free == "all")],
            free_rotation=free,
        )
        both = AllOf([target, PoseTarget(robot.links[-2], pose_of(robot, robot.links[-2], q), 2e-3, 2e-2)])
        for goal in (target, both):
            found, missed = reaching(robot, goal, start, np.random.default_rng(number))
            with monkeypatch.context() as patch:
                in_numpy(patch, inverse, search)
                expected, missed_too = reaching(robot, goal, start, np.random.default_rng(number))
            assert len(found) == len(expected) > 0
            np.testing.assert_allclose(found, expected, atol=SAME, rtol=0)
            np.testing.assert_allclose(missed, missed_too, atol=SAME, rtol=0)
            assert all(miss_of(robot, each, row).within(each) for row in found for each in goal.poses)
            assert np.all((found >= robot.lower) & (found <= robot.upper))
            assert all(np.abs(a - b).max() > LEAST_DIFFERENCE for a, b in itertools.combinations(found, 2))


@needs_loops
def test_in_c_and_in_numpy_the_same_rows_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole turns aside for joints that circle, also where rows are a hair more or less than LEAST_DIFFERENCE."""
    rng = np.random.default_rng(8)
    for n in (1, 2, 7):
        q = rng.integers(-4, 5, (60, n)) * (LEAST_DIFFERENCE / 4.0) + rng.choice([0.0, 1e-12, 2 * np.pi], (60, n))
        for circling in (None, rng.random(n) < 0.5):
            found = search._distinct(q, q[0], circling)
            with monkeypatch.context() as patch:
                in_numpy(patch, search)
                expected = search._distinct(q, q[0], circling)
            assert found.tobytes() == expected.tobytes()
            assert 1 <= len(found) < 60
    assert search._distinct(np.empty((0, 3)), np.zeros(3)).shape == (0, 3)


@pytest.mark.parametrize("compiled", [True, False])
def test_out_of_reach_nothing_is_found_and_the_miss_is_true(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot(RobotSpec(name="ur5"))
    if not compiled:
        in_numpy(monkeypatch, inverse)
    target = PoseTarget("tool0", Pose((2.0, 0.0, 0.0)))
    found, (miss,) = reaching(robot, target, np.zeros(6), np.random.default_rng(0))
    assert found.shape == (0, 6)
    assert 2.0 - 1.3 < miss.position < 2.0 + 1.3


@pytest.mark.parametrize(("name", "least"), [("panda", 6), ("ur5", 6), ("z1", 1)])
def test_configurations_found_reach_the_pose_nearest_first(name: str, least: int) -> None:
    """One is found for the pose of any random configuration, by Pinocchio's kinematics."""
    robot = load_robot(name)
    rng, counts = np.random.default_rng(3), []
    for q in robot.draw(rng, 12):
        link = robot.links[-1]
        pose, seed = pose_of(robot, link, q), robot.draw(rng, 1)[0]
        one = inverse_kinematics(robot, pose, link, seed=seed)
        found = inverse_kinematics(robot, pose, link, seed=seed, all_branches=True)
        assert one.shape == (1, robot.n)
        assert found.tobytes() == inverse_kinematics(robot, pose, link, seed=seed, all_branches=True).tobytes()
        for row in (*one, *found):
            off = np.linalg.inv(pose.matrix) @ pose_of(robot, link, row).matrix
            assert np.linalg.norm(off[:3, 3]) <= 1e-3 + 1e-9
            assert np.linalg.norm(pin.log3(off[:3, :3])) <= 1e-2 + 1e-9
            assert np.all((robot.lower <= row) & (row <= robot.upper))
        far = np.linalg.norm(found - seed, axis=1)
        assert np.all(np.diff(far) >= 0.0)
        assert far[0] <= np.linalg.norm(one - seed, axis=1)[0]
        apart = LEAST_DIFFERENCE if robot.n > 6 else 1e-6  # members of families; single branches may be close
        assert all(np.abs(turned(a - b)).max() > apart for a, b in itertools.combinations(found, 2))
        counts.append(len(found))
    assert np.median(counts) >= least


@pytest.mark.parametrize("name", ROBOTS)
def test_a_seed_that_reaches_the_pose_is_the_first(name: str) -> None:
    """The configuration is the same to the bit; one beyond the limits is no answer."""
    robot = load_robot(name)
    for q in robot.draw(np.random.default_rng(8), 5):
        for every in (False, True):
            pose = pose_of(robot, robot.links[-1], q)
            found = inverse_kinematics(robot, pose, robot.links[-1], seed=q, all_branches=every)
            assert found[0].tobytes() == q.tobytes()
    beyond = q + 4 * np.pi
    found = inverse_kinematics(robot, pose, robot.links[-1], seed=beyond)
    assert len(found)
    assert np.all((robot.lower <= found) & (found <= robot.upper))


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_from_a_seed_close_by_the_arm_hardly_moves(name: str) -> None:
    robot = load_robot(name)
    rng, further = np.random.default_rng(5), []
    for q in robot.draw(rng, 40):
        seed = np.clip(q + rng.uniform(-0.2, 0.2, robot.n), robot.lower, robot.upper)
        (found,) = inverse_kinematics(robot, pose_of(robot, robot.links[-1], q), robot.links[-1], seed=seed)
        further.append(np.linalg.norm(found - seed) - np.linalg.norm(q - seed))
    assert np.quantile(further, 0.9) <= 0.02


def test_a_branch_is_no_other_after_a_whole_turn() -> None:
    """A UR5 has eight; here some of them turn a joint by half a turn, either way."""
    robot = load_robot(RobotSpec("ur5", base=Pose.from_rpy([0, 0, 2], [np.pi, 0, 0])))
    assert len(inverse_kinematics(robot, [0.4, 0.2, 1.5], all_branches=True)) == 8


def test_a_changed_robot_is_refused() -> None:
    robot = load_robot("ur5")
    robot.model.jointPlacements[2] = pin.SE3.Random()
    with pytest.raises(InputError, match="was changed after the robot was loaded"):
        inverse_kinematics(robot, [0.4, 0.2, 0.5], free_rotation="all")


def test_beyond_reach_there_is_nothing() -> None:
    robot = load_robot("ur5")
    rng = np.random.default_rng(2)
    for place in ((2.0, 0.0, 0.0), (0.0, 0.0, 1e6), (0.0, 0.0, 0.0892)):  # the last one inside the shoulder
        for every in (False, True):
            pose = Pose(place, tuple(pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs().tolist()))
            found = inverse_kinematics(robot, pose, seed=robot.draw(rng, 1)[0], all_branches=every)
            assert found.shape == (0, 6)


def test_a_scene_gives_robot_limits_and_seed() -> None:
    scene = load_scene("panda_cage")
    bare, robot = load_robot("panda"), load_scene_robot(scene)
    start = robot.configuration(scene.start)
    pose = pose_of(bare, "panda_hand", start)
    np.testing.assert_array_equal(inverse_kinematics(scene, pose, "panda_hand"), [start])
    seed = start + 0.2
    narrow = dataclasses.replace(
        scene, limits=Limits(position={"panda_joint1": (float(start[0]) - 0.1, float(start[0]) + 0.1)})
    )
    found = inverse_kinematics(narrow, pose, "panda_hand", seed=seed, all_branches=True)
    free = inverse_kinematics(bare, pose, "panda_hand", seed=seed, all_branches=True)
    assert np.abs(found[:, 0] - start[0]).max() <= 0.1
    assert np.abs(free[:, 0] - start[0]).max() > 0.1
