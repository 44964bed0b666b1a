"""The robot itself as it reports its joints while it moves: the newest report, and how old that is."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, listed

STALE = 1.0  # [s] after which a report counts as old


class Report(NamedTuple):
    """The joints of a robot, and when they came."""

    q: Array  # (n,)
    came: float  # [s] time.monotonic()

    @property
    def words(self) -> str:
        """The name of the robot, where it is, and how old the report is, if it is old."""
        age = time.monotonic() - self.came
        return "the robot itself" + (f", {age:.0f} s ago" if age > STALE else "")


class Reported:
    """The newest report of a robot's joints; by any thread."""

    def __init__(self, robot: Robot) -> None:
        """Begin without any."""
        self._robot = robot
        self.newest: Report | None = None

    def take(self, q: Sequence[float] | Array | Mapping[str, float] | None) -> None:
        """Take a report, or None: there are no more. Raises InputError for values that are not one finite number for
        each planned joint."""
        self.newest = None if q is None else Report(self._checked(q), time.monotonic())

    def _checked(self, q: Sequence[float] | Array | Mapping[str, float]) -> Array:
        names = self._robot.joint_names
        if isinstance(q, Mapping):
            if missing := [name for name in names if name not in q]:
                raise InputError(f"state: no value for {listed(missing)}")
            q = [q[name] for name in names]
        try:
            found = np.array(q, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"state: must be {len(names)} numbers, found {q!r:.60}") from None
        if found.shape != (len(names),):
            raise InputError(f"state: shape {found.shape}, must be ({len(names)},), for {listed(names)}")
        if not np.isfinite(found).all():
            joint = names[int(np.flatnonzero(~np.isfinite(found))[0])]
            raise InputError(f"state: {found[names.index(joint)]} for joint {joint} is not finite")
        return found
