"""A robot that a replanner drives in a simulated world, whose clock stands still while a step computes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any

import numpy as np

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array

PERIOD, LATENCY = 0.04, 0.01  # [s]
LIMITS = hdplan.Limits(velocity=2.0, acceleration=8.0, jerk=200.0)
LOOKS = 4  # in a period


class AtOnce(Executor):
    """Does its work on request."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
        future = Future[Any]()
        future.set_result(work(*args, **named))
        return future


def limited(name: str, **changes: Any) -> hdplan.Scene:
    """A shipped scene with limits of rates."""
    return dataclasses.replace(hdplan.load_scene(name), **{"limits": LIMITS, **changes})


class Drive:
    """One run. The robot executes the newest command that has reached it."""

    def __init__(self, scene: hdplan.Scene, **settings: Any) -> None:
        self.now = 0.0
        self.scene = scene
        settings = {"period": PERIOD, "latency": LATENCY, "clock": lambda: self.now, "executor": AtOnce()} | settings
        self.replanner = hdplan.Replanner(scene, **settings)
        self.robot = self.replanner.robot
        self.commands: list[hdplan.Command] = []
        self.executed: hdplan.Command | None = None

    def step(self) -> hdplan.Command:
        self.commands.append(self.replanner.step(self.now))
        return self.commands[-1]

    def period(self, look: Callable[[float, Array, bool], None] = lambda t, q, moves: None) -> hdplan.Command:
        """Step, let one period pass, and look at the robot several times: when, where, and whether it moves."""
        command, before = self.step(), self.executed
        for k in range(LOOKS):
            t = self.now + k * PERIOD / LOOKS
            done = command if t >= self.now + LATENCY or before is None else before
            there = done.at(max(t, done.time))
            look(t, there.positions, bool(there.velocities.any()))
        self.executed = command
        self.now = round((self.now + PERIOD) / PERIOD) * PERIOD
        return command

    def moves(self) -> Drive:
        """Drive until a command moves the robot."""
        while not self.commands or not self.commands[-1].velocity.any():
            self.period()
        return self

    def arrives(self, within: float) -> bool:
        """Drive until the robot has arrived."""
        while self.now < within:
            if self.period().mode.value == "arrived":
                return True
        return False

    def certified(self, command: hdplan.Command, obstacles: Sequence[hdplan.Obstacle] = ()) -> bool:
        """True if a command's motion is certified by a certifier of its own among obstacles, if it moves at all."""
        motion = command.motion
        assert motion.velocities is not None
        assert motion.accelerations is not None
        if not motion.velocities.any():
            return True
        first = (each[0].tolist() for each in (motion.positions, motion.velocities, motion.accelerations))
        position, velocity, acceleration = first
        scene = dataclasses.replace(
            self.scene,
            obstacles=[*self.scene.obstacles, *obstacles],
            start=hdplan.State(position, velocity, acceleration),
            goal=motion.positions[-1],
        )
        return Certifier(Setup.of(scene, self.robot)).certify(motion).certified


def straight_to(at: Array, target: Array, most: float) -> Array:
    """Return a place that is up to so much nearer to another one."""
    way = target - at
    return np.asarray(at + way * min(1.0, most / max(float(np.linalg.norm(way)), 1e-9)))
