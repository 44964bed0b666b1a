"""A way is searched once, though the robot is still braking when it is found."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

import numpy as np

from hdplan.planner.replanning.held import Grid, Held
from hdplan.planner.replanning.picture import Sightings
from hdplan.planner.replanning.ways import Ways
from hdplan.planner.robot.setup import Setup
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
