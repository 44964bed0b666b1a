"""A way is searched once, though the robot is still braking when it is found, and where nothing moves."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.replanning.held import Grid, Held
from hdplan.planner.replanning.outlook import ROOM_SHARES, Question, outlook
from hdplan.planner.replanning.picture import Sightings
from hdplan.planner.replanning.ways import Ways
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import HdplanError
from tests.planner.replanning.driving import AtOnce, limited


class Counted(AtOnce):
    """Counts its calls."""

    def __init__(self) -> None:
        self.count = 0

    def submit(self, work: Any, /, *args: Any, **named: Any) -> Future[Any]:
        self.count += 1
        return super().submit(work, *args, **named)


def test_a_way_from_where_the_robot_will_stand_waits_until_it_stands() -> None:
    setup = Setup.of(limited("planar_arm"))
    start = setup.robot.configuration(setup.scene.start)
    braking = start + np.array([[-0.02], [-0.005], [0.0]])
    held = Held(Grid(0.0, 0.01), 0, (braking, np.zeros_like(braking), np.zeros_like(braking)))
    executor = Counted()
    ways = Ways(setup.robot, executor)
    for k, row in enumerate((0, 1)):
        seen = Sightings.of(setup.scene, 0.0)  # another picture
        ways.ask(setup.scene, seen, 0.1 * k, 0.4, held, None, row, moves=False)
        assert ways.hear(0.1 * k + 0.05, held, None, row) is None
    assert executor.count == 1
    course = ways.hear(0.2, held, None, held.last)
    assert course is not None
    np.testing.assert_array_equal(course.nominal.motion.positions[0], held.stop)
    elsewhere = Held.standing(held.grid, 0, held.stop + 0.1)
    ways.ask(setup.scene, seen, 0.3, 0.4, held, None, 0, moves=False)
    assert ways.hear(0.35, elsewhere, None, 0) is None
    assert ways.hear(0.4, held, None, held.last) is None  # it was of no use any more


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_a_way_is_planned_again_with_less_room_only_where_something_moves(
    speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup, margins = Setup.of(limited("planar_arm")), list[float]()

    def failing(question: Question, margin: float) -> None:
        margins.append(margin)
        raise HdplanError("planted")

    monkeypatch.setattr("hdplan.planner.replanning.outlook._way", failing)
    ball = hdplan.Obstacle("ball", hdplan.Sphere(0.1), [3.0, 0.0, 0.0], uncertainty=hdplan.Uncertainty(speed=speed))
    seen = Sightings.of(setup.scene, 0.0).updated(0.0, [ball], None, None)
    standing = setup.robot.configuration(setup.scene.start)
    question = Question(setup.scene, setup.robot, seen, 0.0, 0.5, None, True, 0, standing, stuck=False)
    assert outlook(question).why == "planted"
    assert margins == [share * 0.5 for share in (ROOM_SHARES if speed else (1.0,))]
