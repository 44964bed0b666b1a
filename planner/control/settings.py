"""Settings of a controller: its barriers, margins, rate and period, refused if they are provably not safe."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from hdplan.planner.control.barrier_safety import guaranteed_clearance, refuse_unsafe
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.scenes.values import Checked, Number


@dataclass(frozen=True)
class ControlSettings(Checked):
    """Settings of a controller."""

    barriers: BarrierSettings = field(default_factory=BarrierSettings)
    margin: Annotated[float, Number(unit="m")] = 0.014
    """δ between robot and obstacles, at which the barrier stops the robot. D is curved over a length of about its own
    value, so that a larger margin makes smoother commands, whatever the growth."""
    self_margin: Annotated[float, Number(unit="m")] = -2.5e-4  # the same between links
    rate: Annotated[float, Number(high=1e3, above=0.0, unit="1/s")] = 2.0
    """η: how fast a barrier may be approached, as a share of its distance per second [1/s]."""
    yielding: Annotated[float, Number(high=1e3, above=0.0, unit="1/s")] = 4.0
    """The rate η for moving obstacles, at most `rate`: the smaller, the sooner the robot gives way [1/s]."""
    horizon: Annotated[float, Number(above=0.0, unit="m")] = 0.25
    """R: how far from its bound a static obstacle counts at all [m]; toward it the rate grows without limit."""
    period: Annotated[float, Number(high=1.0, above=0.0, unit="s")] = 0.005  # T, over which commands are held [s]
    speed: Annotated[float, Number(high=1.0, above=0.0)] = 1.0  # share of the robot's velocity limits that is used
    rise: Annotated[float, Number(0.0, 10.0, unit="s")] = 0.2
    """Least time in which a joint reaches its greatest speed, where its scene limits no acceleration [s]."""
    look_ahead: bool = True  # whether commands are checked on their way to rest
    as_published: bool = False
    """Accept settings that are provably not safe, to show what they do; one rate for every pair, however far apart, the
    paper's rows alone, and no limits of acceleration but a scene's own."""

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
        """True clearance [m] to obstacles that Δ ≥ δ proves at a sample, for all planes; for those of a scene
        `Barriers.clearance` proves more. None if nothing is proven."""
        return self._proven(self.margin, self.barriers.growth)

    @property
    def self_clearance(self) -> float | None:
        """True clearance [m] between links that Δ ≥ δ proves at a sample; None if nothing is proven."""
        return self._proven(self.self_margin, self.barriers.self_growth)

    def _proven(self, margin: float, growth: float) -> float | None:
        b = self.barriers
        return guaranteed_clearance(b.distance, margin, growth, b.gamma, b.shaping_length, b.normals)
