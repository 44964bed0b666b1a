"""How a controller works: its barriers, margins, rate and period, refused where they are provably not safe."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hdplan.planner.barrier_rules import guaranteed_clearance, refuse_unsafe
from hdplan.planner.barriers import BarrierSettings
from hdplan.scenes.errors import InputError


@dataclass(frozen=True)
class ControlSettings:
    """How a controller works."""

    barriers: BarrierSettings = field(default_factory=BarrierSettings)
    margin: float = -2.5e-4  # δ between robot and obstacles [m]: where the barrier stops
    self_margin: float = -2.5e-4  # the same between links [m]
    rate: float = 2.0  # η: how fast a barrier may be approached, the part per second [1/s]
    period: float = 0.005  # T: commands are held as long [s]
    speed: float = 1.0  # share of the robot's velocity limits that is used
    look_ahead: bool = True  # whether commands are looked at once more at their end
    as_published: bool = False  # takes settings that are provably not safe, to show what they do

    def __post_init__(self) -> None:
        """Refuse, by name, what is out of range and what is provably not safe."""
        for name, low, high in (("rate", 0.0, 1e3), ("period", 0.0, 1.0), ("speed", 0.0, 1.0)):
            if not low < getattr(self, name) <= high:
                raise InputError(f"control.{name}: found {getattr(self, name):g}, allowed is up to {high:g}, above 0")
        for name in ("margin", "self_margin"):
            if not np.isfinite(getattr(self, name)):
                raise InputError(f"control.{name}: found {getattr(self, name)}, allowed is a finite length")
        if not self.as_published:
            self.refuse_unsafe()

    def refuse_unsafe(self) -> None:
        """Raise InputError for settings that are provably not safe."""
        b = self.barriers
        for margin, growth in ((self.margin, b.growth), (self.self_margin, b.self_growth)):
            refuse_unsafe(b.distance, margin, growth, b.gamma, b.shaping_length, b.normals, self.rate, self.period)

    @property
    def clearance(self) -> float | None:
        """True clearance [m] to obstacles that Δ ≥ δ proves at a sample; None if nothing is proven."""
        return self._proven(self.margin, self.barriers.growth)

    @property
    def self_clearance(self) -> float | None:
        """The same between links."""
        return self._proven(self.self_margin, self.barriers.self_growth)

    def _proven(self, margin: float, growth: float) -> float | None:
        b = self.barriers
        return guaranteed_clearance(b.distance, margin, growth, b.gamma, b.shaping_length, b.normals)
