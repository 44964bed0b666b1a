"""A planned motion replayed: the file's commands, and, if the scene has torque limits, the robot's response.

Scene and trajectory -> `Simulation`. Without `limits.torque` the replay is kinematic: the file is sampled as a
controller would, a thousand times a second by its own interpolation rule. With it the robot and its loads are simulated
(`computed_torque`), and the simulated motion counts; so it does where a plant of another kind executes the motion
(`mujoco_arm`). Samples prove nothing; the certificate does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.control.computed_torque import LONGEST_STEP, Arm, Execution, execute
from hdplan.planner.control.loop import measured_tracking
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.tracking import tracking
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import unknown_in
from hdplan.scenes.sizes import Tracking

CLEARANCE_STEP = 0.01  # [s] between configurations at which the clearance is computed, at most
LONGEST_MOTION = 3600.0  # [s] that a motion may take: the rows of all steps are kept
PATH_SAMPLES = 1000  # of a path without times
SAMPLES_AT_ONCE = 256  # configurations at which the closest bodies are found together
RATE_ROUNDING = 1e-6  # relative, by which a rate may exceed its limit
TORQUE_EXCESS = 1e-3  # relative, by which a commanded torque may exceed its limit, due to the controller's time steps
UNNOTICED_JUMP = 1e-6  # [rad/s] or [rad/s²] that no controller notices

Plant = Callable[[Setup, Curve], Execution]
"""Executes a curve with times of a scene's robot."""


@dataclass(frozen=True)
class Peak:
    """The largest absolute value of a quantity of a joint."""

    value: float  # inf where the quantity whose derivative it is jumps
    limit: float | None  # None: the scene has none
    time: float  # of the peak [s]

    @property
    def share(self) -> float | None:
        """The value over the limit."""
        return None if self.limit is None else self.value / self.limit

    @property
    def left(self) -> float | None:
        """The difference to the limit; negative beyond it."""
        return None if self.limit is None else self.limit - self.value


@dataclass(frozen=True)
class JointUse:
    """Record of one joint."""

    name: str
    travel: float  # from its least to its greatest value in the file [rad] or [m]
    peaks: dict[str, Peak]  # velocity, acceleration and jerk if timed; torque with dynamics; other limited quantities
    error: float | None = None  # largest tracking error [rad] or [m]; with dynamics
    error_rms: float | None = None


@dataclass(frozen=True)
class Close:
    """Two bodies that came close."""

    link: str
    other: str  # an obstacle or another link
    distance: float  # [m] exact, negative in contact
    time: float  # [s], or path parameter of a path without times


@dataclass(frozen=True, eq=False)
class Simulation:
    """The outcome of a replay."""

    duration: float | None  # [s] of the motion; None: a path without times
    curve: Curve  # of the file
    joints: tuple[JointUse, ...]
    closest: Close | None  # of robot and obstacles, at the sampled configurations; None without obstacles
    self_closest: Close | None  # between links
    samples: int  # configurations at which distances were computed
    execution: Execution | None  # with dynamics
    failures: tuple[str, ...]  # messages on what went wrong
    others: Mapping[str, Array] = field(default_factory=dict)  # (k, n) limited quantities that are no rates, at `times`
    times: Array = field(default_factory=lambda: np.zeros(0))  # (k,) [s]
    unknown: tuple[str, ...] = ()  # fields of the scene that say how far it may be off, and were left out

    @property
    def succeeded(self) -> bool:
        """True if nothing touched, no limit was exceeded, and tracking was not lost."""
        return not self.failures

    @property
    def text(self) -> str:
        """The verdict in one line."""
        if self.failures:
            return f"failed: {'; '.join(self.failures)}"
        remark = nominal(self.unknown)
        if self.execution is None:
            return f"replayed: kinematics only, within all limits of the scene{remark}"
        worst = max(joint.error or 0.0 for joint in self.joints)
        limited = ", torques within their limits" if self.joints[0].peaks["torque"].limit is not None else ""
        tracked = f"tracked within {worst:.1e} rad{limited}"
        return f"executed: simulated with dynamics, {tracked}{remark}"

    @property
    def tracking(self) -> Tracking | None:
        """The largest errors of each joint, rounded up, as `robot.tracking` takes them; None without dynamics."""
        done = self.execution
        return None if done is None else measured_tracking(done.errors, done.velocity_errors)

    def summary(self) -> dict[str, Any]:
        """Return all of it as one JSON object: SI units; null where the scene has no such limit."""
        return {
            "status": "succeeded" if self.succeeded else "failed",
            "text": self.text,
            "failures": list(self.failures),
            "dynamics": self.execution is not None,
            "interpolation": self.curve.rule,
            "duration_s": self.duration,
            "closest": _about(self.closest),
            "self_closest": _about(self.self_closest),
            "tracking": None if self.tracking is None else asdict(self.tracking),
            "joints": [
                {
                    "name": joint.name,
                    "travel": joint.travel,
                    **{
                        what: {"largest": _finite(peak.value), "limit": peak.limit, "time": peak.time}
                        for what, peak in joint.peaks.items()
                    },
                    **({} if joint.error is None else {"error": joint.error, "error_rms": joint.error_rms}),
                }
                for joint in self.joints
            ],
        }


def nominal(unknown: Sequence[str]) -> str:
    """Return the remark of a verdict that leaves out these fields of a scene."""
    return f"; in the nominal world, without {', '.join(unknown)}" if unknown else ""


def fitting(setup: Setup, trajectory: Trajectory, plant: Plant | None = None) -> Curve:
    """Return the trajectory's curve, with the robot's joints in their order.

    Raises:
        InputError: its joints do not match the robot's; it has no times, and the scene or a plant needs them; it takes
            longer than LONGEST_MOTION, or its times are so large that steps are lost in rounding.
    """
    curve = curve_of(setup.robot, trajectory)
    if curve.times is not None:
        _check_steps(curve.times)
    elif setup.scene.timed:
        raise InputError("times: missing; the scene needs them (timing, limits)")
    elif plant is not None:
        raise InputError("times: missing; a body with masses (--plant) needs them")
    return curve


def _check_steps(times: Array) -> None:
    """Refuse times (N,) with too many steps between them to keep, or too large to resolve a step."""
    if not times[-1] - times[0] <= LONGEST_MOTION:
        raise InputError(
            f"times: the motion takes {times[-1] - times[0]:g} s; at most {LONGEST_MOTION:g} s are simulated"
        )
    latest, most = float(np.abs(times).max()), 1e-3 * LONGEST_STEP / np.finfo(float).eps  # resolves 0.001 steps
    if not latest <= most:
        raise InputError(
            f"times: {latest:g} s leave no digits for steps of {LONGEST_STEP:g} s; at most {most:.3g} s are allowed"
        )


def replay(setup: Setup, trajectory: Trajectory, plant: Plant | None = None) -> Simulation:
    """Replay a trajectory of the scene's robot, executed by a plant if there is one.

    Raises:
        InputError: as `fitting`; loads or limits of the scene that do not match the robot.
    """
    robot, curve = setup.robot, fitting(setup, trajectory, plant)
    timed = curve.times is not None
    limits, certifier = setup.limits, Certifier(setup)
    torques = limits.get("torque")
    first, last = (0.0, 1.0) if curve.times is None else (float(curve.times[0]), float(curve.times[-1]))
    count = max(int(np.ceil((last - first) / LONGEST_STEP)), 1) if timed else PATH_SAMPLES
    by_file = times = np.linspace(first, last, count + 1)
    positions = curve.at_time(times)
    travel = np.ptp(positions, axis=0).tolist()
    peaks: list[dict[str, Peak]] = [{} for _ in range(robot.n)]
    for name, order in DERIVATIVES.items() if timed else ():
        for peak, found in zip(peaks, _rates(setup, curve, order, times, limits.get(name)), strict=True):
            peak[name] = found
    execution = None
    if plant is not None:
        execution = plant(setup, curve)
    elif torques is not None:
        execution = execute(Arm(setup.loaded_model, robot), curve, torques)
    if execution is not None:
        times, positions = execution.times, execution.positions
        for joint, peak in enumerate(peaks):
            peak["torque"] = _peak(
                execution.commanded[:, joint], execution.times, None if torques is None else float(torques[joint])
            )
    others: dict[str, Array] = {}
    for check in certifier.limits if timed else ():
        for name in check.limits.keys() - peaks[0].keys():  # neither a derivative nor measured in the execution
            others[name] = check.values(name, curve, *curve.interval_of(curve.parameter_of(by_file)))
            for peak, values, limit in zip(peaks, others[name].T, check.limits[name].tolist(), strict=True):
                peak[name] = _peak(values, by_file, limit)
    every = max(int(CLEARANCE_STEP / (times[1] - times[0])), 1) if timed else PATH_SAMPLES // 100
    samples = np.unique(np.r_[np.arange(0, len(times), every), len(times) - 1])
    closest, between_links = _closest(certifier, positions[samples], times[samples])
    joints = tuple(map(JointUse, robot.joint_names, travel, peaks))
    failures: list[str] = []
    if execution is not None:
        largest, rms = np.abs(execution.errors).max(axis=0), np.sqrt(np.mean(execution.errors**2, axis=0))
        errors = largest.tolist(), rms.tolist()
        joints = tuple(map(JointUse, robot.joint_names, travel, peaks, *errors))
        failures += [*_overloaded(execution, torques, robot), *_off(execution, setup)]
    failures += [*_beyond(joints), *_touching(closest, between_links)]
    duration = last - first if timed else None
    figures = joints, closest, between_links, len(samples), execution, tuple(failures), others, by_file
    return Simulation(duration, curve, *figures, tuple(unknown_in(setup.scene)))


def _rates(setup: Setup, curve: Curve, order: int, times: Array, limit: Array | None) -> Iterator[Peak]:
    """Yield each joint's peak of a derivative; infinite where the derivative one order lower jumps."""
    values, around = curve.at_time(times, order), setup.rates_around(order - 1)
    jumps = curve.over_time(order - 1).jumps(*around) if order > 1 else np.zeros((len(curve), values.shape[1]))
    for joint, column in enumerate(values.T):
        bound = None if limit is None else float(limit[joint])
        if jumps[:, joint].max() > UNNOTICED_JUMP:
            row = int(jumps[:, joint].argmax())
            yield Peak(float("inf"), bound, float(curve.time_of(row / (len(curve) - 1))))
        else:
            yield _peak(column, times, bound)


def _peak(values: Array, times: Array, limit: float | None) -> Peak:
    row = int(np.abs(values).argmax())
    return Peak(float(abs(values[row])), limit, float(times[row]))


def _closest(certifier: Certifier, positions: Array, times: Array) -> tuple[Close | None, Close | None]:
    """Return the closest bodies over all configurations (k, n): to obstacles, and between links."""
    best: list[Close | None] = [None, None]
    within = np.inf  # pairs farther apart than the closest so far do not matter
    for first in range(0, len(times), SAMPLES_AT_ONCE):
        some = slice(first, first + SAMPLES_AT_ONCE)
        found = certifier.nearest_along(positions[some], times[some], within)
        for places, time in zip(found, times[some].tolist(), strict=True):
            for group, place in enumerate(places):
                known = best[group]
                if place is not None and (known is None or place.distance < known.distance):
                    best[group] = Close(place.link, place.other, place.distance, time)
        within = max([0.0, *(close.distance for close in best if close)])
    return best[0], best[1]


def _overloaded(execution: Execution, limits: Array | None, robot: Robot) -> Iterator[str]:
    """Return the first time, in words, at which the commanded torque exceeds a limit, if any, and whether tracking is
    lost."""
    if (
        limits is not None
        and (over := (shares := np.abs(execution.commanded) / limits).max(axis=1) > 1 + TORQUE_EXCESS).any()
    ):
        row = int(over.argmax())
        joint = int(shares[row].argmax())
        yield (
            f"joint '{robot.joint_names[joint]}' needs a torque of {abs(execution.commanded[row, joint]):.4g} at "
            f"{execution.times[row]:.3f} s, its limit is {limits[joint]:g}"
        )
    if execution.lost:
        joint = int(np.abs(execution.errors[-1]).argmax())
        name, when, off = robot.joint_names[joint], execution.times[-1], abs(execution.errors[-1, joint])
        yield f"tracking is lost at {when:.3f} s, where joint '{name}' is {off:.3g} off"


def _off(execution: Execution, setup: Setup) -> Iterator[str]:
    """Return the joint, in words, that is farther off than the scene's tracking error, for which the proof holds."""
    lag = setup.scene.robot.tracking
    for name, errors in (("position", execution.errors), ("velocity", execution.velocity_errors)):
        if lag is None or not getattr(lag, name):
            continue
        over = np.abs(errors) - tracking(setup.scene, setup.robot, name)
        row, joint = np.unravel_index(int(over.argmax()), over.shape)
        if over[row, joint] > 0.0:
            yield (
                f"joint '{setup.robot.joint_names[joint]}' is off by {abs(errors[row, joint]):.3g} at "
                f"{execution.times[row]:.3f} s, more than robot.tracking.{name}: the proof does not cover it"
            )


def _beyond(joints: tuple[JointUse, ...]) -> Iterator[str]:
    """Say for each rate which joint is farthest beyond its limit."""
    for what in (name for name in joints[0].peaks if name != "torque"):
        shares = [(use.peaks[what].share or 0.0, use) for use in joints]
        share, use = max(shares, key=lambda found: found[0], default=(0.0, None))
        if use is not None and share > 1 + RATE_ROUNDING:
            peak, article = use.peaks[what], "an" if what == "acceleration" else "a"
            yield (
                f"joint '{use.name}' reaches {article} {what} of {peak.value:.4g} at {peak.time:.3f} s, its limit is "
                f"{peak.limit:g}"
            )


def _touching(*places: Close | None) -> Iterator[str]:
    for close in places:
        if close is not None and close.distance <= 0:
            yield f"{close.link} and {close.other} touch at {close.time:.3f}"


def _about(close: Close | None) -> dict[str, Any] | None:
    if close is None:
        return None
    return {"time": close.time, "link": close.link, "other": close.other, "distance_m": close.distance}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
