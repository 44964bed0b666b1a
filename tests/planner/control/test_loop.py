"""A loop whose steps take time on the arm's own clock: references go on meanwhile, and none jumps."""

from __future__ import annotations

import dataclasses
import threading

import numpy as np
import pytest

import hdplan
from hdplan import control
from hdplan.scenes.array_types import Array
from tests.planner.replanning.driving import AtOnce, limited

from .rooms import FakeArm

STEP = 0.004  # [s] of the arm that a step takes, mostly


class Clocked(FakeArm):
    """An arm whose clock advances with each reading, or stands still."""

    def __init__(self, names: tuple[str, ...], at: Array) -> None:
        super().__init__(names, at, 0.002)
        self.due, self.goes_on, self.ticks = 0.0, False, threading.Condition()
        self.sent: list[tuple[float, Array, Array]] = []

    def time(self) -> float:
        if self.goes_on:
            with self.ticks:
                self.now += 2e-4
                self.ticks.notify_all()
        return self.now

    def send(self, position: Array, velocity: Array) -> None:
        self.sent.append((self.now, position.copy(), velocity.copy()))
        before = self.now
        super().send(position, velocity)
        self.due += self.period
        self.now = max(before, self.due)


def test_references_go_on_while_a_step_computes_and_commands_that_come_too_late_are_passed_over() -> None:
    """One step in forty is done in time, and its command comes when its motion has left the one before."""
    tracking = hdplan.Tracking(1e-3)
    spec = dataclasses.replace(hdplan.load_scene("planar_arm").robot, tracking=tracking)
    scene, passed = limited("planar_arm", robot=spec, start=[-0.8, 0.0], goal=[1.0, 0.4], obstacles=()), 0
    arm = Clocked(("shoulder", "elbow"), np.array([-0.8, 0.0]))
    with hdplan.Replanner(scene, clock=lambda: arm.now, executor=AtOnce()) as replanner:
        step, count = replanner.step, 0

        def slow(t: float) -> hdplan.Command:
            nonlocal count, passed
            count += 1
            command, late = step(t), count % 40 == 20
            passed += late and command.mode.value == "moving"
            until = t + (0.09 if late else STEP)
            arm.goes_on = count > 1  # the first one is awaited
            with arm.ticks:
                assert not arm.goes_on or arm.ticks.wait_for(lambda: arm.now >= until, 10.0), "the loop stands still"
            arm.goes_on = False
            return command

        replanner.step = slow  # type: ignore[method-assign]
        done = control.Loop(arm).replan(replanner, 20.0)
    assert not arm.stopped, done.why
    assert done.commands[-1].mode.value == "arrived"
    assert passed
    assert len(done.commands) < count
    when, where, speed = (np.array(each) for each in zip(*arm.sent, strict=True))
    assert np.diff(when).max() < 2 * arm.period
    assert np.abs(np.diff(where, axis=0)).max() <= 1.5 * np.abs(speed).max() * arm.period + 1e-6
    np.testing.assert_allclose(where[-1], [1.0, 0.4], atol=2e-3)


def test_a_command_has_to_reach_the_arm_before_its_motion_begins() -> None:
    scene = limited("planar_arm")
    with hdplan.Replanner(scene, latency=0.001) as replanner:
        arm = Clocked(replanner.robot.joint_names, np.zeros(2))
        with pytest.raises(hdplan.InputError, match=r"latency: must be at least .* the arm, 0\.002 s, found 0\.001 s"):
            control.Loop(arm).replan(replanner, 1.0)
    assert not arm.sent
