"""How a controller works: its barriers, margins, rate and period, refused where they are provably not safe."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from hdplan.planner.barrier_rules import guaranteed_clearance, refuse_unsafe
from hdplan.planner.barriers import BarrierSettings
from hdplan.scenes.values import Checked, Number


@dataclass(frozen=True)
class ControlSettings(Checked):
    """How a controller works."""

    barriers: BarrierSettings = field(default_factory=BarrierSettings)
    margin: Annotated[float, Number(unit="m")] = 0.014
    """δ between robot and obstacles: where the barrier stops. D bends over a length of about itself, so that commands
    are as smooth as this is large, however far obstacles are grown."""
    self_margin: Annotated[float, Number(unit="m")] = -2.5e-4  # the same between links
    rate: Annotated[float, Number(high=1e3, above=0.0, unit="1/s")] = 2.0
    """η: how fast a barrier may be approached, the part per second [1/s]."""
    period: Annotated[float, Number(high=1.0, above=0.0, unit="s")] = 0.005  # T: commands are held as long [s]
    speed: Annotated[float, Number(high=1.0, above=0.0)] = 1.0  # share of the robot's velocity limits that is used
    look_ahead: bool = True  # whether commands are looked at once more at their end
    as_published: bool = False  # takes settings that are provably not safe, to show what they do

    def _check_whole(self) -> None:
        if not self.as_published:
            self.refuse_unsafe()

    def refuse_unsafe(self) -> None:
        """Raise InputError for settings that are provably not safe."""
        b = self.barriers
        for margin, growth in ((self.margin, b.growth), (self.self_margin, b.self_growth)):
            refuse_unsafe(b.distance, margin, growth, b.gamma, b.shaping_length, b.normals, self.rate, self.period)

    @property
    def clearance(self) -> float | None:
        """True clearance [m] to obstacles that Δ ≥ δ proves at a sample, whatever planes they have: of those in a scene
        `Barriers.clearance` proves more. None if nothing is proven."""
        return self._proven(self.margin, self.barriers.growth)

    @property
    def self_clearance(self) -> float | None:
        """The same between links."""
        return self._proven(self.self_margin, self.barriers.self_growth)

    def _proven(self, margin: float, growth: float) -> float | None:
        b = self.barriers
        return guaranteed_clearance(b.distance, margin, growth, b.gamma, b.shaping_length, b.normals)
