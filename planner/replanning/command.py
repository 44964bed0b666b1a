"""Commands: the motion of a robot from now until standstill, whatever happens next."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.motion.samples import Samples
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.array_types import Array
from hdplan.scenes.arrays import as_numbers
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.values import describe


class Mode(Enum):
    """The state of a robot that a replanner moves."""

    MOVING = "moving"  # a motion was proven in this step
    BRAKING = "braking"  # none was: the robot brakes as proven before
    STANDING = "standing"  # and has come to rest
    ARRIVED = "arrived"  # at its goal


@dataclass(frozen=True, eq=False)
class Command(ReadOnly):
    """A motion from now until the robot stands, proven as a whole: it is safe to execute to its end, whether or not
    another command follows."""

    time: float  # of the step, on the clock [s]
    position: Array  # (n,) now [rad or m]
    velocity: Array  # (n,) [rad/s or m/s]
    acceleration: Array  # (n,) [rad/s² or m/s²]
    motion: Trajectory  # from now, or shortly before, until the robot stands; its times count from `time`
    mode: Mode
    why: str  # reason why no motion was proven in this step; empty if one was, or none is needed
    clearance: float | None  # [m] proven for the motion, less the uncertainty: at least; None for a robot that stands
    picture: float  # [s] when the picture was taken against which the motion was proven last
    seconds: float  # that the step took

    def __repr__(self) -> str:
        """Return the mode and the reason, for display."""
        return f"<Command at {self.time:.6g} s: {self.mode.value}{f', {self.why}' if self.why else ''}>"

    def at(self, t: ArrayLike) -> Samples:
        """Return positions, velocities and accelerations at times [s] on the clock, for controllers that sample faster
        than the steps; after the motion's end the robot stands. Raises InputError for times before the command's."""
        given = as_numbers(t)
        if given is None or not ((times := given - self.time) >= -1e-9).all():
            raise InputError(f"t: must be {self.time:.6g} [s], the command's, or later, found {describe(t)}")
        assert self.motion.times is not None
        return self.motion.at_time(np.minimum(times, self.motion.times[-1]))
