"""A robot that has no way leaves those who come to it, by motions that are proven as all others."""

from __future__ import annotations

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.link_frame import link_poses, links_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from tests.planner.replanning.driving import Drive, limited

SPEED, BALL = 0.4, 0.06  # [m/s] of the ball, [m] its radius


@pytest.mark.core
def test_a_robot_without_a_way_leaves_a_ball_that_comes_to_its_hand() -> None:
    """It would touch the hand of a robot that stays."""
    scene = limited("planar_arm", obstacles=())
    taken = hdplan.Obstacle("taken", hdplan.Sphere(0.1), _hand(Drive(scene), np.array([1.0, 0.4])))
    drive = Drive(scene.with_obstacles([taken]))
    begins = _hand(drive, drive.step().position)
    outward = begins / np.linalg.norm(begins)
    least, modes, certified = np.inf, [], []

    def ball(t: float) -> hdplan.Obstacle:
        at = begins + max(0.6 - SPEED * t, 0.0) * outward
        return hdplan.Obstacle("ball", hdplan.Sphere(BALL), at, uncertainty=hdplan.Uncertainty(speed=SPEED))

    def look(t: float, q: Array, moves: bool) -> None:
        nonlocal least
        near, _ = Certifier(Setup.of(scene.with_obstacles([ball(t)]), drive.robot)).nearest(q)
        assert near is not None
        least = min(least, near.distance)

    while drive.now < 2.0:
        drive.replanner.update([ball(drive.now)], at=drive.now)
        command = drive.period(look)
        modes.append(command.mode.value)
        if modes[-1] == "retreating":
            certified.append(drive.certified(command, [ball(command.time)]))
    assert set(modes) == {"standing", "retreating"}
    assert certified
    assert all(certified)
    assert least > 0.05


def test_room_grows_as_its_slopes_say() -> None:
    scene = hdplan.load_scene("panda_gate")
    person = hdplan.Obstacle(
        "person", hdplan.Capsule(0.1, 0.8), [0.6, 0.2, 0.5], uncertainty=hdplan.Uncertainty(0.01, speed=0.5)
    )
    certifier = Certifier(Setup.of(scene.with_obstacles([person])))
    rng = np.random.default_rng(0)
    q = np.array([0.1, -0.7, 0.0, -2.3, 0.0, 1.6, 0.8])
    room, slopes = certifier.room(q, 0.3, 0.5)
    assert len(room)
    step = 1e-4 * rng.normal(size=7)
    later, _ = certifier.room(q + step, 0.3, 0.5)
    np.testing.assert_allclose(later - room, slopes @ step, atol=1e-6)
    nearest, _ = certifier.nearest(q)
    assert nearest is not None
    assert room.min() <= nearest.distance - 0.01 - 0.5 * 0.3 + 1e-9


def _hand(drive: Drive, q: Array) -> Array:
    return np.asarray(link_poses(drive.robot, q[None], links_of(drive.robot)[drive.robot.links[-1]])[0, :3, 3])
