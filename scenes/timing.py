"""Timing of the motion: its duration or its share of the allowed speed, and the sampling rate of the result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hdplan.scenes.errors import FieldError
from hdplan.scenes.values import Checked, Number

MOST_ROWS = 100_000  # of a motion with times


@dataclass(frozen=True, repr=False)
class Timing(Checked):
    """The timing of a motion: its duration or share of the speed, and its rate of rows."""

    duration: Annotated[float, Number(above=0.0, unit="s")] | None = None  # of the whole motion [s]; None: the fastest
    scale: Annotated[float, Number(high=1.0, above=0.0)] = 1.0  # fraction of the speed that the limits allow
    rate: Annotated[float, Number(1.0, 1e4, unit="1/s")] = 100.0  # rows of the result per second, at least [1/s]

    def _check_whole(self) -> None:
        if self.duration is None:
            return
        if self.scale != 1.0:
            raise FieldError("has both 'duration' and 'scale', which contradict each other: give one of them")
        if self.duration * self.rate > MOST_ROWS:
            raise FieldError(
                f"{self.duration:g} s are {self.duration * self.rate:.4g} rows at a rate of {self.rate:g} 1/s, at most "
                f"{MOST_ROWS} are kept: give a shorter duration or a lower rate",
                "duration",
            )
