"""A Panda among random obstacles, the certificate of its motion there, and an arm for loops."""

from __future__ import annotations

import numpy as np

from hdplan import Box, Certificate, ConvexBody, Obstacle, Pose, Scene, Trajectory
from hdplan.control import Barriers, BarrierSettings
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.collision.halfspace_bodies import from_obstacle
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.control.rollout import Run
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import read_only

READY = read_only(np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]))


def scene_of(*obstacles: Obstacle, **changes: object) -> Scene:
    return Scene(**{"robot": "panda", "obstacles": obstacles, "start": READY, "goal": READY, **changes})


def random_boxes(rng: np.random.Generator, count: int) -> list[Obstacle]:
    return [Obstacle(f"box{k}", Box(tuple(rng.uniform(0.05, 0.3, 3))), random_pose(rng)) for k in range(count)]


def random_pose(rng: np.random.Generator) -> Pose:
    turn, direction = rng.normal(size=4), rng.normal(size=3)
    where = direction / np.linalg.norm(direction) * rng.uniform(0.35, 0.9)
    return Pose((where[0], where[1], abs(where[2]) + 0.1), tuple(turn / np.linalg.norm(turn)))


def link_and_obstacle(robot: Robot, body: ConvexBody, obstacle: Obstacle, settings: BarrierSettings) -> Barriers:
    """One pair: a body that the fifth joint carries, and an obstacle."""
    link = LinkBody("five", 5, body)
    return Barriers(robot, kinematics_of(robot), [link], [], from_obstacle(obstacle)[0], settings)


def certificate(scene: Scene, robot: Robot, run: Run, timed: bool = False) -> Certificate:
    """The certificate of the commanded positions, with or without their times."""
    motion = Trajectory(robot.joint_names, run.positions, robot.locked, run.times if timed else None)
    return Certifier(Setup.of(scene, robot)).certify(motion, check_ends=False)


class FakeArm:
    """An arm that is where it was sent, one period later on its own clock."""

    def __init__(self, names: tuple[str, ...], at: Array, period: float) -> None:
        self.joint_names, self.period, self.now, self.stopped = names, period, 0.0, False
        self.q, self.v = at.copy(), np.zeros_like(at)

    def time(self) -> float:
        return self.now

    def state(self) -> tuple[Array, Array]:
        return self.q, self.v

    def send(self, position: Array, velocity: Array) -> None:
        assert not self.stopped
        self.q, self.v, self.now = position.copy(), velocity.copy(), self.now + self.period

    def stop(self) -> None:
        self.stopped = True
