"""Every robot that comes by name: it plans and certifies a small motion, or says in a word why not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_files.library import robot_names
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Sphere
from hdplan.scenes.targets import JointTarget

QUICK = ("TwoDofs", "double_pendulum", "double_pendulum_continuous", "quadruped", "simple_humanoid")
WITHOUT = {  # robots for which nothing can be planned
    "iris_simple": "iris_simple has no joint left to plan",
    "quadrotor_base": "quadrotor_base has no joint left to plan",
    "ur_description/ur3.urdf": "holds no <link>; a file of macros holds no robot of its own",
}
BALL = Obstacle("ball", Sphere(0.05), Pose((3.0, 3.0, 3.0)))


def scene_of(spec: RobotSpec, start: np.ndarray, goal: np.ndarray) -> Scene:
    ends = JointTarget("start", tuple(start.tolist())), JointTarget("goal", tuple(goal.tolist()))
    return Scene("small", Path("small.yaml"), spec, (BALL,), *ends)


def depth(certifier: Certifier, q: np.ndarray) -> float:
    return sum(contact.depth + 1e-3 for contact in certifier.contacts(q))


def freed(certifier: Certifier, q: np.ndarray) -> np.ndarray:
    """Move one joint after the other at random, as long as the robot touches itself less for it."""
    rng, deep = np.random.default_rng(0), depth(certifier, q)
    for _ in range(600):
        if deep == 0.0:
            break
        trial, joint = q.copy(), rng.integers(len(q))
        trial[joint] = certifier.robot.draw(rng, 1)[0, joint]
        if (found := depth(certifier, trial)) <= deep:
            q, deep = trial, found
    return q


def beside(robot: Robot, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A configuration in which every joint stands a little elsewhere: 0.01 to 0.02 rad or m, or a tenth of its
    range; joints whose URDF gives them none stand still (two double pendulums, the quadruped)."""
    step = rng.uniform(0.5, 1.0, robot.n) * np.minimum(0.02, 0.2 * (robot.upper - robot.lower))
    step *= rng.choice((-1.0, 1.0), robot.n)
    inside = (q + step <= robot.upper) & (q + step >= robot.lower)
    return np.where(inside, q + step, q - step)


def small_motion(robot: Robot) -> Scene:
    """From a free configuration, every joint a little farther: the least that a robot must be able to do.

    Pairs of links whose meshes overlap nearly everywhere (an iCub's hips) belong in `robot.ignore_pairs`.
    """
    spec = RobotSpec(name=robot.name)
    rest = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
    states = [
        np.clip([state[joint] for joint in robot.joint_names], robot.lower, robot.upper)
        for state in robot.named_states.values()
        if all(joint in state for joint in robot.joint_names)
    ]
    certifier = Certifier(Setup.of(scene_of(spec, rest, rest), robot))
    start = next((q for q in (rest, *states) if not certifier.contacts(q)), None)
    stuck: tuple[tuple[str, str], ...] = ()
    if start is None:
        start = freed(certifier, rest)
        stuck = tuple((contact.link, contact.other) for contact in certifier.contacts(start))
        assert len(stuck) <= 4
    goals = (beside(robot, start, np.random.default_rng(seed)) for seed in range(100))
    goal = next(q for q in goals if {(each.link, each.other) for each in certifier.contacts(q)} <= {*stuck})
    return scene_of(RobotSpec(name=robot.name, ignore_pairs=stuck), start, goal)


def plans(name: str) -> None:
    robot = load_robot(RobotSpec(name=name))
    result = hdplan.plan(small_motion(robot), time_limit=300.0)
    assert result.certificate.certified, result.certificate.text
    moved = np.abs(result.trajectory.positions[-1] - result.trajectory.positions[0])
    assert (moved >= 0.09 * np.minimum(0.1, robot.upper - robot.lower)).all()
    assert np.abs(result.trajectory.positions).max() < 100.0
    assert bool(robot.links) == (
        not any("has collision geometry, so it cannot touch anything" in note for note in robot.notes)
    )


@pytest.mark.parametrize("name", QUICK)
def test_small_robots_plan_a_small_motion(name: str) -> None:
    plans(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(robot_names()) - set(QUICK) - set(WITHOUT)))
def test_every_robot_plans_a_small_motion(name: str) -> None:
    plans(name)


@pytest.mark.parametrize(("name", "words"), WITHOUT.items())
def test_robots_without_a_joint_or_a_name_say_so(name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_robot(RobotSpec(name=name))


def test_joints_without_limits_are_not_drawn_from_astronomical_ranges() -> None:
    iris = load_robot(RobotSpec(name="iris"))
    assert np.isinf(iris.upper).all()
    assert np.abs(iris.draw(np.random.default_rng(0), 50)).max() <= np.pi
