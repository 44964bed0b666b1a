"""Follow a planned trajectory with the controller as a safety filter: the robot evades moving obstacles, then resumes.

Scene (obstacles may move) + trajectory → what the robot does. The reference is the trajectory's own curve at a phase τ
that waits for the robot,

    τ̇ = max(0, 1 − |e| / STOPPING_LAG),   nominal velocity  u* = (r(τ + τ̇ T) − r(τ))/T + v,   e = r(τ) − q,

so that a blocked robot is not drawn through what blocks it. v, the velocity beside the reference, heads for

    min(k |e|, √(A |e|), ∛(J e²)) sign(e)

from which a joint can brake at e = 0, and nears it without passing it (`Rates.toward`), with half of the joint's
acceleration A and jerk J; so it passes neither. The controller takes the velocity closest to u* that its
barriers allow (`controller`). A trajectory that requires more than the joints' limits is slowed evenly, a path without
times is followed from rest to rest, at half of them or over the scene's `timing.duration` (`pacing`). The joints follow
the commands smoothly, one period behind (`Run.executed`): that motion, with its velocities and accelerations, is saved,
and certified as by `hdplan check`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.control.braking import Rates
from hdplan.planner.control.controller import Controller
from hdplan.planner.control.pacing import feasible, paced
from hdplan.planner.control.rollout import Run, simulate
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array

STOPPING_LAG = 0.3  # [rad] or [m] of any joint behind the reference, at which the reference stops
GAIN = 4.0  # k [1/s]
ARRIVED_ERROR = 2e-3  # [rad] or [m] of every joint from the trajectory's end, within which it counts as reached
# [rad] or [m] of every joint at which the run ends, so that the executed motion ends where the certificate requires,
SETTLED_ERROR = 5e-7
SETTLING = 3.0  # or this long after arrival [s], if a barrier keeps the robot off
CATCHING_UP = 0.5  # share of the limits of acceleration and jerk for that
PATIENCE = 3.0, 10.0  # times the trajectory's own duration, plus [s], after which the run is given up
MARGIN = -2.5e-4  # [m] for obstacles and links, and
GROWTH = 0.005  # [m] for both: plans pass closer than a freely moving controller should
BRAKING_RATE = 50.0  # η [1/s]: a proven motion is slowed only where the robot could not brake
HELD_UP_ERROR = 0.05  # [rad] or [m] of any joint behind the trajectory, above which the robot counts as held up


@dataclass(frozen=True, eq=False)
class Followed:
    """The outcome of following a trajectory."""

    trajectory: Trajectory  # as executed: a row for each period, with its time, velocities and accelerations
    run: Run
    certificate: Certificate  # of that, over its whole time, with the obstacles where they were then
    duration: float  # of the trajectory itself [s]
    arrived: float | None  # how long the robot took to reach its end [s]; None: it did not
    away: float  # the farthest that a joint was from the trajectory at the same phase [rad] or [m]
    held: float  # how long it was HELD_UP_ERROR or more from it [s]
    unguarded: tuple[tuple[str, str], ...] = ()  # link pairs that the controller does not check
    slowed: float = 1.0  # times as long as in the file: it requires more than the limits allow

    @property
    def succeeded(self) -> bool:
        """True if the robot arrived and its motion is certified."""
        return self.arrived is not None and self.certificate.certified

    @property
    def text(self) -> str:
        """One sentence."""
        if self.arrived is None:
            return f"not arrived: gave up after {self.run.times[-1]:.1f} s, the trajectory takes {self.duration:.1f} s"
        return f"arrived after {self.arrived:.1f} s, {self.arrived - self.duration:.1f} s later than the trajectory"

    def rows(self) -> list[tuple[str, str]]:
        """Return the outcome as rows of a table."""
        seconds = self.run.step_seconds
        counted = ", ".join(f"{count} {mode.value}" for mode, count in self.run.counted.most_common())
        unguarded = ", ".join(f"{a} and {b}" for a, b in self.unguarded)
        yielded = ", ".join(f"{a} to {b} ({count} periods)" for (a, b), count in self.run.gave.most_common(3))
        return [
            *(
                [("slowed", f"{self.slowed:.3g} times: it asks for more than the limits allow")]
                if self.slowed > 1
                else []
            ),
            *([("not kept apart", f"{unguarded}: their outer bodies overlap anyway")] if unguarded else []),
            ("away", f"{self.away:.3g} rad from the trajectory at most, held up for {self.held:.1f} s"),
            *([("not kept", f"the margin of {yielded}")] if yielded else []),
            ("periods", f"{counted}, of {1e3 * self.run.period:g} ms"),
            ("time", f"{1e3 * np.median(seconds):.2f} ms a step, {1e3 * np.quantile(seconds, 0.95):.2f} ms at 95 %"),
        ]

    def summary(self) -> dict[str, object]:
        """Return the summary for JSON."""
        return {
            "status": self.certificate.status.value,
            "text": self.text,
            "arrived_s": self.arrived,
            "duration_s": self.duration,
            "slowed": self.slowed,
            "away": self.away,
            "held_s": self.held,
            "clearance_m": self.certificate.clearance,
            "self_clearance_m": self.certificate.self_clearance,
            "gave": [{"pair": list(pair), "periods": count} for pair, count in self.run.gave.most_common()],
            "periods": {mode.value: count for mode, count in self.run.counted.items()},
            "period_s": self.run.period,
        }


def follow_settings(rate: float | None = None, margin: float | None = None) -> ControlSettings:
    """Return the settings of a controller that follows plans, with another rate [1/s] or margin [m]."""
    barriers, margin = BarrierSettings(growth=GROWTH, self_growth=GROWTH), MARGIN if margin is None else margin
    return ControlSettings(barriers, margin, MARGIN, rate=BRAKING_RATE if rate is None else rate)


def follow(setup: Setup, trajectory: Trajectory, settings: ControlSettings | None = None) -> Followed:
    """Simulate a robot that follows `trajectory` in its scene, starting at the trajectory's first row, at that row's
    time or at 0.

    Raises InputError for joints that do not match, a scene whose start or goal has a velocity, settings that are
    provably not safe, and joints without a speed limit.
    """
    scene, robot = setup.scene, setup.robot
    setup.refuse_moving_ends("a controller that follows a motion begins and ends at rest")
    setup.refuse_sizes("a controller knows only the nominal world")
    settings = settings or follow_settings()
    controller = Controller.of(scene, settings, robot)
    curve = curve_of(robot, trajectory)
    if curve.times is None:
        desired = curve = paced(curve, controller.rates, scene.end_time)
    else:
        desired, curve = curve, feasible(curve, controller.rates)
    task, duration = FollowTask(curve, controller.rates), float(desired.widths.sum())
    most = PATIENCE[0] * task.duration + PATIENCE[1]
    assert curve.times is not None
    begin = float(curve.times[0])
    run = simulate(controller, curve.rows[0], task, most, begin=begin)
    executed = run.executed(robot.joint_names, robot.locked)
    behind = np.array(task.behind)
    return Followed(
        executed,
        run,
        Certifier(setup).certify(executed),
        duration,
        None if task.since is None else task.since - begin,
        float(behind.max(initial=0.0)),
        settings.period * int((behind >= HELD_UP_ERROR).sum()),
        controller.barriers.unguarded,
        task.duration / duration,
    )


@dataclass(eq=False)
class FollowTask:
    """The task of following a timed curve whose phase waits for the robot. It has a state: use one step per period."""

    curve: Curve
    rates: Rates  # of the controller
    phase: float = 0.0  # τ [s] since the curve's first row
    behind: list[float] = field(default_factory=list)  # [rad] or [m] of the worst joint, in each period
    since: float | None = None  # when the robot arrived [s]

    _before: Array | None = None  # e of the last period

    @property
    def duration(self) -> float:
        """Duration of the curve [s]."""
        return float(self.curve.widths.sum())

    def objective(self, q: Array, time: float) -> tuple[Array, Array]:
        """Return the quadratic at q, and advance the phase by one period."""
        wanted, period = self._at(self.phase), self.rates.period
        error = wanted - q
        behind = float(np.abs(error).max())
        self.behind.append(behind)
        share = max(0.0, 1.0 - behind / STOPPING_LAG)
        self.phase = min(self.phase + share * period, self.duration)
        return np.eye(len(q)), -((self._at(self.phase) - wanted) / period + self._catching_up(error))

    def _catching_up(self, error: Array) -> Array:
        """Return the velocity beside the reference (n,)."""
        rates, size = self.rates.scaled(CATCHING_UP), np.abs(error)
        heading = np.minimum(np.minimum(GAIN * size, np.sqrt(rates.acceleration * size)), np.cbrt(rates.jerk * size**2))
        velocity = np.zeros_like(error) if self._before is None else (self._before - error) / rates.period
        self._before = error
        return rates.toward(np.copysign(heading, error), velocity)

    def met(self, q: Array, time: float) -> bool:
        """True if the robot has settled at the curve's end."""
        off = float(np.abs(self.curve.rows[-1] - q).max())
        if self.phase < self.duration or off > ARRIVED_ERROR:
            self.since = None
            return False
        self.since = time if self.since is None else self.since
        return off <= SETTLED_ERROR or time - self.since >= SETTLING

    def _at(self, phase: float) -> Array:
        assert self.curve.times is not None  # `follow` gives it times
        return self.curve.at_parameter(self.curve.parameter_of(self.curve.times[0] + phase))
