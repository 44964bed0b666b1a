"""Laws of single commands: their proofs, refused input, threads, and the measures of commands."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from hdplan import InputError, Obstacle, Pose, Robot, SteadyMotion
from hdplan.control import Controller, ControlSettings, Mode
from hdplan.planner.control.braking import Command
from hdplan.planner.control.rollout import fast_energy, simulate, total_variation
from hdplan.planner.control.tasks import TrackTask, standing
from hdplan.scenes.array_types import Array
from hdplan.scenes.shapes import Sphere

from .rooms import READY, random_boxes, scene_of


def test_an_obstacle_at_a_link_that_no_joint_moves_ends_the_proof(robot: Robot) -> None:
    """No command can prevent the contact, so the pair has no row: the command is the same, and nothing is proven."""
    ball = Obstacle("ball", Sphere(0.1), Pose((-1.5, 0.0, 0.05)), motion=SteadyMotion((0.5, 0.0, 0.0)))
    controller = Controller.of(scene_of(ball), robot=robot)
    free, met = (controller.step(READY, standing(READY), time) for time in (0.0, 2.6))
    assert {"panda_link0"}.isdisjoint(link for link, _ in controller.barriers.names)
    assert free.proven is not None
    assert met.proven is None
    assert met.mode is Mode.MOVING


def test_nan_and_other_wrong_numbers_are_refused_before_anything_is_commanded(robot: Robot) -> None:
    controller = Controller.of(scene_of(), robot=robot)
    nan = np.where(np.arange(7) == 2, np.nan, 1.0)

    class Task:
        def __init__(self, hessian: Array, linear: Array) -> None:
            self.both = hessian, linear

        def objective(self, q: Array, time: float) -> tuple[Array, Array]:
            return self.both

        def met(self, q: Array, time: float) -> bool:
            return False

    def limited(**limits: Array) -> Controller:
        return Controller(robot, controller.barriers, ControlSettings(), limits)

    for act, words in (
        (lambda: controller.step(nan, standing(READY)), ("q", "panda_joint3", "nan", "allowed")),
        (lambda: controller.step(READY[:6], standing(READY)), ("q", "(6,)", "(7,)")),
        (lambda: controller.step(1e300 * READY, standing(READY)), ("q", "panda_joint2", "allowed")),
        (lambda: controller.step("here", standing(READY)), ("q", "7 numbers")),
        (lambda: controller.step(READY, standing(READY), math.nan), ("time", "nan")),
        (lambda: standing(nan), ("q", "nan")),
        (lambda: standing(READY, gain=math.nan), ("gain", "nan")),
        (lambda: controller.step(READY, TrackTask(lambda time: (nan, READY))), ("reference", "joint '2'", "nan")),
        (lambda: controller.step(READY, standing(READY[:5])), ("reference", "(5,)", "(7,)")),
        (lambda: controller.step(READY, Task(np.eye(6), READY)), ("task.objective", "(6, 6)", "(7, 7)")),
        (lambda: controller.step(READY, Task(-np.eye(7), READY)), ("task.objective", "positive definite")),
        (lambda: controller.step(READY, Task(np.full((7, 7), np.nan), READY)), ("task.objective", "finite")),
        (lambda: limited(velocity=nan), ("limits.velocity", "panda_joint3", "nan", "allowed")),
        (lambda: limited(acceleration=-np.ones(7)), ("limits.acceleration", "-1", "more than 0")),
        (lambda: limited(jerk=np.ones(3)), ("limits.jerk", "(3,)", "(7,)")),
        (lambda: controller.step(READY, standing(READY), 0.0, Command(nan, READY)), ("last.velocity", "nan")),
        (lambda: controller.step(READY, standing(READY), 0.0, Command(READY, READY[:2])), ("last.acc", "(2,)")),
        (lambda: controller.step(READY, standing(READY), 0.0, READY), ("last", "Command")),
        (lambda: simulate(controller, nan, standing(READY), 1.0), ("start", "panda_joint3")),
        (lambda: simulate(controller, READY, standing(READY), math.nan), ("duration", "nan")),
        (lambda: simulate(controller, READY, standing(READY), math.inf), ("duration", "inf")),
    ):
        with pytest.raises(InputError) as refused:
            act()
        assert "\n" not in str(refused.value)
        for word in words:
            assert any(each in str(refused.value) for each in word.split("|")), (word, str(refused.value))


def test_threads_that_share_a_controller_command_what_one_does(robot: Robot) -> None:
    rng = np.random.default_rng(13)
    ball = Obstacle("ball", Sphere(0.08), Pose((0.5, 0.3, 0.5)), motion=SteadyMotion((0.0, -0.3, 0.0)))
    controller = Controller.of(scene_of(*random_boxes(rng, 4), ball), robot=robot)
    cases = [(q, standing(goal), float(t)) for q, goal, t in
             zip(robot.draw(rng, 40), robot.draw(rng, 40), rng.uniform(0, 2, 40), strict=True)]  # fmt: skip
    alone = [controller.step(*case).velocity for case in cases]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda case: controller.step(*case).velocity, cases * 3))
    np.testing.assert_array_equal(together, alone * 3)


def test_a_free_robot_tracks(robot: Robot) -> None:
    controller = Controller.of(scene_of(), robot=robot)
    wave = np.array([0.3, 0.1, -0.2, 0.1, 0.2, 0.1, 0.3])
    follow = TrackTask(lambda t: (READY + wave * math.sin(t), wave * math.cos(t)), end=3.0)
    run = simulate(controller, READY, follow, 3.0)
    wanted = READY + wave * np.sin(run.times)[:, None]
    assert np.abs(run.positions - wanted).max() < 1e-2
    assert set(run.modes) == {Mode.MOVING}


def test_measures_of_commands() -> None:
    time = np.arange(1000) * 0.01
    slow, fast = np.sin(2 * math.pi * 0.5 * time), 0.1 * np.sin(2 * math.pi * 20.0 * time)
    assert total_variation(np.stack([slow, slow], 1)) == pytest.approx(2 * total_variation(slow))
    assert total_variation(slow) == pytest.approx(20.0, rel=0.01)
    assert fast_energy(slow, 0.01) < 1e-3
    assert fast_energy(slow + fast, 0.01) == pytest.approx(0.1**2 / 2 * 10.0, rel=0.1)
