"""Laws of the closed loop: certified motions, kept margins and limits, no robot that stands for no reason."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hdplan import Obstacle, Pose, Robot, SteadyMotion
from hdplan.control import Barriers, BarrierSettings, Controller, ControlSettings, Mode
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.control.program_rows import NEAR_DISTANCE
from hdplan.planner.control.rollout import simulate
from hdplan.planner.control.tasks import standing
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.shapes import Box, Sphere

from .rooms import READY, certificate, random_boxes, scene_of


def directions(count: int) -> Array:
    """Directions (count, 3) that are spread evenly."""
    index = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * index / count), np.pi * (1.0 + math.sqrt(5.0)) * index
    return np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)


@pytest.mark.parametrize("count", [9, pytest.param(24, marks=pytest.mark.slow)])
def test_a_ball_that_comes_is_given_way_to(count: int, robot: Robot) -> None:
    """Slow balls from all sides, aimed at the arm: none meets it, but for those that cross the shoulder, which cannot
    move aside."""
    met, column = 0, np.array([0.0, 0.0, 1.0])
    for k, direction in enumerate(directions(count)):
        target = kinematics_of(robot).evaluate(READY).translations[0, 4 + k % 4]
        way = target + np.linspace(-0.4, 0.3, 50)[:, None] * direction
        if np.linalg.norm(way - column * np.clip(way[:, 2:], 0.0, 0.4), axis=1).min() < 0.3:
            continue
        ball = Obstacle(
            "ball", Sphere(0.08), Pose(tuple((target - 0.4 * direction).tolist())),
            motion=SteadyMotion(tuple((0.5 * direction).tolist())),
        )  # fmt: skip
        scene = scene_of(ball)
        settings = ControlSettings(BarrierSettings(growth=0.005), rate=4.0, period=0.01)
        run = simulate(Controller.of(scene, settings, robot), READY, standing(READY, 4.0), 1.2, until_met=False)
        assert certificate(scene, robot, run, timed=True).certified, k
        met += 1
    assert met >= count / 3


@pytest.mark.parametrize("starts", [3, pytest.param(6, marks=pytest.mark.slow)])
def test_static_obstacles_keep_their_margins_beside_fast_moving_ones(starts: int, robot: Robot) -> None:
    """A fast ball drives the arm among boxes: of what stands nothing falls below its margin, or further below."""
    rng = np.random.default_rng(12)
    gave = 0
    for q in robot.draw(rng, starts):
        hand = kinematics_of(robot).evaluate(q).translations[0, 7]
        velocity = rng.normal(size=3)
        ball = Obstacle("ball", Sphere(0.08), Pose(tuple((hand - 0.3 * velocity).tolist())),
                        motion=SteadyMotion(tuple(velocity.tolist()), (0.5, 1.0, 0.0)))  # fmt: skip
        controller = Controller.of(scene_of(*random_boxes(rng, 4), ball), ControlSettings(period=0.01), robot)
        run = simulate(controller, q, standing(robot.draw(rng, 1)[0], gain=4.0), 0.6)
        stands = ~controller.barriers.coming
        begun = controller.barriers.evaluate(run.positions[0], 0.0).value[stands]
        for time, position in zip(run.times[1:], run.positions[1:], strict=True):
            now = controller.barriers.evaluate(position, float(time)).value[stands]
            assert (now >= np.minimum(begun, -2.5e-4) - 1e-9).all()
        gave += run.counted[Mode.GIVING_WAY]
    assert gave


@pytest.mark.parametrize(("gap", "inside"), [(-0.01, True), (0.005, False)])
def test_a_wall_that_no_joint_can_leave_does_not_freeze_the_arm(gap: float, inside: bool, robot: Robot) -> None:
    wall = Obstacle("wall", Box((0.02, 0.5, 0.2)), Pose((-0.0725 - gap - 0.01, 0.0, 0.15)))
    scene = scene_of(wall)
    controller = Controller.of(scene, ControlSettings(), robot)
    goal = READY + [0.5, 0.3, -0.3, 0.3, 0.3, 0.3, 0.3]
    run = simulate(controller, READY, replace(standing(goal, gain=4.0), tolerance=0.02), 4.0)
    assert Mode.STOPPED not in run.counted
    away = np.abs(run.positions[-1] - goal)
    assert away[1:].max() < 0.02  # turning about its own axis may bring link1 closer: then it does not
    assert run.slacks[0] < 0.0 or not inside
    assert certificate(scene, robot, run).certified


@pytest.mark.parametrize("starts", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_a_robot_on_the_flat_spot_moves_on(starts: int, robot: Robot) -> None:
    """Inside the margin, where D and its derivative vanish: the arm leaves toward what is free, and slides along the
    obstacle toward what is not; it does not stand, and never touches."""
    rng, done = np.random.default_rng(3), 0
    while done < starts:
        scene = scene_of(*random_boxes(rng, 4))
        controller = Controller.of(scene, ControlSettings(period=0.01), robot)
        certifier, outer = Certifier(Setup.of(scene, robot)), controller.barriers.obstacle_pairs

        def least(q: Array, barriers: Barriers = controller.barriers, outer: int = outer) -> float:
            return float(barriers.evaluate(q).separation[:outer].min())

        drawn = robot.draw(rng, 12)
        free, deep = ([q for q in drawn if wanted(least(q))] for wanted in (lambda d: d > 0.03, lambda d: d < -0.02))
        if not free or not deep:
            continue
        out, into = free[0], deep[0]
        for _ in range(40):  # to where D is 0
            middle = 0.5 * (out + into)
            out, into = (middle, into) if least(middle) > 0.0 else (out, middle)
        start = out if done % 2 else into
        if certifier.contacts(start):
            continue
        for goal in (free[0], deep[0]):
            run = simulate(controller, start, replace(standing(goal, gain=4.0), tolerance=0.05), 0.8)
            assert run.slacks[0] == pytest.approx(-0.014, abs=1e-6)
            assert np.abs(run.positions - start).max() > 0.1
            assert run.counted[Mode.STOPPED] == 0
            assert certificate(scene, robot, run).certified
            if goal is free[0]:
                assert run.slacks[-1] >= 0.0
        done += 1


@pytest.mark.parametrize(
    ("sides", "where", "turn", "q"),
    [
        ((0.12, 0.06, 0.05), (-0.16, -0.28, 0.24), (-0.31, 0.21, 0.75, 0.55),
         (-1.74, 1.56, -0.78, -2.76, 0.75, 3.48, -0.35)),
        ((0.24, 0.28, 0.08), (-0.48, -0.15, 0.26), (-0.17, -0.27, 0.95, -0.02),
         (0.48, -1.62, 1.23, -1.36, 1.89, 1.99, 1.82)),
    ],
)  # fmt: skip
def test_links_deep_in_a_box_come_out(sides: Array, where: Array, turn: Array, q: Array, robot: Robot) -> None:
    """Two links are in a box, 75 and 87 mm deep, and the way out of one leads deeper into it for the other: both come
    out, and no other link touches it meanwhile."""
    deep = Obstacle("deep", Box(sides), Pose(where, tuple((np.array(turn) / np.linalg.norm(turn)).tolist())))
    controller = Controller.of(scene_of(deep), ControlSettings(period=0.01), robot)
    outer = np.arange(controller.barriers.obstacle_pairs)

    def distances(q: Array) -> Array:
        return controller.barriers.at(q[None], np.zeros(1)).nearness(0 * outer, outer).value

    first = controller.step(np.array(q), standing(np.array(q)))
    run = simulate(controller, np.array(q), standing(np.array(q)), 1.9, until_met=False)
    along = np.array([distances(row) for row in run.positions[::5]])
    assert first.overlapping == tuple(np.flatnonzero(along[0] < 0.0).tolist())
    assert along[0].min() < -0.07
    assert (along[:, along[0] >= 0.0] >= -1e-9).all()
    assert along[-1].min() > 0.0


def test_a_joint_beyond_its_limit_comes_back_as_fast_as_it_may(robot: Robot) -> None:
    controller = Controller.of(scene_of(), ControlSettings(rate=4.0), robot)
    for beyond, joint in ((0.2, 6), (-0.1, 3), (2.0, 0)):
        q = READY.copy()
        q[joint] = robot.upper[joint] + beyond if beyond > 0 else robot.lower[joint] + beyond
        at_once = Controller.of(scene_of(), ControlSettings(rate=4.0, rise=0.0), robot)
        first = at_once.step(q, standing(q + np.sign(beyond)))
        assert first.velocity[joint] == pytest.approx(
            -np.sign(beyond) * min(4.0 * abs(beyond), at_once.rates.velocity[joint]), abs=1e-3
        )
        run = simulate(controller, q, standing(READY, gain=4.0), 2.0)
        assert (np.diff(np.sign(beyond) * run.positions[:, joint]) <= 1e-9).all()
        assert robot.lower[joint] - 1e-3 <= run.positions[-1, joint] <= robot.upper[joint] + 1e-3


def test_joint_limits_are_never_crossed(robot: Robot) -> None:
    controller = Controller.of(scene_of(), ControlSettings(rate=20.0), robot)
    for goal in (robot.upper + 1.0, robot.lower - 1.0):
        run = simulate(controller, READY, standing(goal), 2.0)
        assert ((robot.lower - 1e-9 <= run.positions) & (run.positions <= robot.upper + 1e-9)).all()


@pytest.mark.parametrize("starts", [5, pytest.param(1000, marks=pytest.mark.slow)])
def test_never_a_contact_from_random_starts(starts: int, robot: Robot) -> None:
    """Settings that the rule calls safe: every motion is certified, between its samples too, on the real meshes,
    and where the barriers held at the start it keeps what the rule promises."""
    rng = np.random.default_rng(7)
    settings = ControlSettings(period=0.01, speed=0.3)
    done = held = promised = 0
    while done < starts:
        scene = scene_of(*random_boxes(rng, 5))
        certifier = Certifier(Setup.of(scene, robot))
        q = robot.draw(rng, 1)[0]
        if certifier.contacts(q):
            continue
        done += 1
        controller = Controller.of(scene, settings, robot)
        assert controller.assured is not None
        assert controller.assured > 0.0
        run = simulate(controller, q, standing(robot.draw(rng, 1)[0], gain=4.0), 1.5)
        verdict = certificate(scene, robot, run)
        assert verdict.certified, verdict.text
        held += bool((run.slacks < 5e-3).any())
        if run.slacks[0] >= 0.0:
            assert run.slacks.min() >= -1e-9
            assert verdict.clearance is not None
            assert run.proven is not None
            assert run.proven >= controller.assured - 1e-12
            assert verdict.clearance >= run.proven - 1e-4  # room for the certificate's own bounds
            promised += 1
    assert held  # barriers had something to do
    assert promised > starts // 4


def test_links_that_begin_inside_a_margin_do_not_touch(robot: Robot) -> None:
    """Outer bodies that overlap while the links do not: the exact distance of the hulls is kept, and no other pair's Δ
    falls below its margin."""
    rng = np.random.default_rng(10)
    settings = ControlSettings(period=0.01, speed=0.3)
    controller = Controller.of(scene_of(), settings, robot)
    certifier = Certifier(Setup.of(scene_of(), robot))
    done = moved = 0
    for q in robot.draw(rng, 4000):
        inside = np.flatnonzero(controller.barriers.evaluate(q).value < settings.self_margin)
        if len(inside) == 0 or certifier.contacts(q):
            continue
        run = simulate(controller, q, standing(robot.draw(rng, 1)[0], gain=4.0), 0.5)

        def nearness(q: Array, inside: NDArray[np.int64] = inside) -> Array:
            return controller.barriers.at(q[None], np.zeros(1)).nearness(np.zeros_like(inside), inside).value

        near = nearness(q)
        for configuration in run.positions[::5]:
            now = nearness(configuration)
            assert (now >= np.minimum(near, NEAR_DISTANCE) - 1e-4).all()
        assert certificate(scene_of(), robot, run).certified
        moved += bool(np.abs(np.diff(run.positions, axis=0)).max() > 1e-6)
        done += 1
        if done == 6:
            break
    assert done == 6
    assert moved  # it is not that nothing goes any more


@pytest.mark.parametrize("starts", [3, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("barriers", "margin"),
    [
        (BarrierSettings(growth=0.02), -2.5e-4),
        (BarrierSettings(), 4e-3),
        (BarrierSettings("euclidean", growth=0.0), 0.01),
    ],
    ids=["grown", "hdsdf", "euclidean"],
)
def test_slacks_stay_above_zero_once_they_are(
    barriers: BarrierSettings, margin: float, starts: int, robot: Robot
) -> None:
    """The look-ahead's law: Δ ≥ δ at every sample, whatever the kinks, even with a distance that has them; and Δ falls
    from no start, except where links overlap, which come out together."""
    rng = np.random.default_rng(8)
    settings = ControlSettings(barriers, margin, 1e-3 if margin > 0 else margin, rate=20.0, period=0.02)
    controller = Controller.of(scene_of(*random_boxes(rng, 5)), settings, robot)
    for q in robot.draw(rng, starts):
        goal = standing(robot.draw(rng, 1)[0])
        run, deep = simulate(controller, q, goal, 0.8), controller.step(q, goal).overlapping
        first = run.slacks[0]
        assert (run.slacks[-1] if deep else run.slacks.min()) >= min(first, 0.0) - 1e-9
