"""Where a robot that moves comes to stand: the ends of the path that is planned, and whether the way there is free.

A motion is planned only where the robot could also brake without touching anything, as fast as its limits allow.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Query, Setup
from hdplan.planner.timing.braking import Braking
from hdplan.planner.timing.moving_ends import MovingEnds
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import UnsolvableError

REFUSED = (Status.IN_CONTACT, Status.OFF_PATH)  # what no rounding of a corner mends


def check_brakes(setup: Setup, certifier: Certifier, ends: MovingEnds) -> Query:
    """Return where the robot of a scene with one goal stands, before it goes on and at last. Raises UnsolvableError
    where it meets something, or leaves a path constraint, while it brakes or speeds up."""
    standing, scene = ends.standing(setup.query), setup.scene
    last = scene.end_time - len(ends.tail) / ends.rate if scene.moving else 0.0
    _check(certifier, standing.start + ends.head.away, ends.head, ends.rate, 0.0, f"{scene.start.field}.velocity: braking")
    _check(certifier, standing.goal + ends.tail.away, ends.tail, ends.rate, last, "goal.velocity: speeding up to it")
    return standing


def _check(certifier: Certifier, rows: Array, part: Braking, rate: float, begins: float, what: str) -> None:
    """Look at one of the two, rows (m, n) that begin at a time [s]."""
    if not len(part):
        return
    robot, scene = certifier.robot, certifier.scene
    times = begins + np.arange(len(rows)) / rate
    motion = Trajectory(robot.joint_names, rows, robot.locked, times, part.velocity, part.acceleration)
    found = certifier.certify(motion, required=0.0, check_ends=False)
    if found.status not in REFUSED:
        return
    if found.failures:
        place = found.failures[0]
        why = f"{place.link} and {place.other} meet"
    else:
        why = found.departures[0].words
    raise UnsolvableError(
        f"{scene.source}: {what} as fast as the limits allow: {why}",
        "end_in_contact" if found.failures else "end_off_path",
    )
