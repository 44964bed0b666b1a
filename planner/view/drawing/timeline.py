"""The range of the slider: seconds where anything that is shown has times, or else the path parameter of the motions.

Motions of different durations share it: each waits at its start before its first row, and at its goal after its last. A
path without times is spread over the whole range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array
from hdplan.scenes.scene import Scene

PATH_DURATION = 4.0  # [s] that paths without times take at speed 1


@dataclass(frozen=True)
class Timeline:
    """A span of time."""

    begin: float = 0.0  # [s], or path parameter
    end: float = 1.0
    timed: bool = False  # whether these are seconds

    @classmethod
    def of(cls, scene: Scene, curves: Sequence[Curve]) -> Timeline:
        """Return the timeline that contains all these motions; without any, that of the scene's moving obstacles."""
        times = [curve.times for curve in curves if curve.times is not None]
        if times:
            return cls(float(min(rows[0] for rows in times)), float(max(rows[-1] for rows in times)), True)
        if scene.moving:
            return cls(0.0, scene.end_time, True)
        return cls()

    @property
    def duration(self) -> float:
        """Duration at speed 1 [s], that of the motions."""
        return self.end - self.begin if self.timed else PATH_DURATION

    @property
    def name(self) -> str:
        """The axis and its unit."""
        return "time [s]" if self.timed else "path parameter"

    def words(self, now: float) -> str:
        """Return a moment in words."""
        return f"{now:.3f} s" if self.timed else f"{now:.3f}"

    def seconds(self, now: float) -> float:
        """Return the time of a moment [s], for obstacles; 0 where nothing has times."""
        return now if self.timed else 0.0

    def parameter(self, curve: Curve, now: float) -> float:
        """Return the path parameter of a motion at a moment."""
        if curve.times is not None:
            return float(curve.parameter_of(now))
        return min(max((now - self.begin) / (self.end - self.begin), 0.0), 1.0)

    def moments(self, curve: Curve, parameter: ArrayLike) -> Array:
        """Return when (…) a motion is at path parameters (…)."""
        if curve.times is not None:
            return curve.time_of(parameter)
        return self.begin + np.asarray(parameter, dtype=np.float64) * (self.end - self.begin)
