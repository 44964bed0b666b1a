"""The check of torques: those along the whole executed curve, by Pinocchio's own inverse dynamics.

Sampled every 2 ms, less often for long motions, and proven between the samples: τ stays within h²/8 max|τ̈| of the
straight line between two samples h apart (`torque_bounds`); where that is not enough, the interval is halved. A
configuration at which gravity alone exceeds a limit, so that moving slower does not help, is reported as such. A motion
is at rest before its first row and after its last: one that begins or ends at speed needs an infinite torque. Shares
nothing with the planner's own dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from hdplan.planner.certificate.limit_checks import ROUNDING_JUMP, LimitFinding, Use
from hdplan.planner.certificate.torque_bounds import torque_curvature
from hdplan.planner.certificate.verdict import Status, at_most
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.robot.loads import loads_in
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError

SAMPLE_STEP = 2e-3  # [s] between samples at first, at most
MOST_HALVINGS = 10  # of an interval before it counts as not proven: down to two microseconds
MOST_AT_FIRST, MOST_SAMPLES = 50_000, 500_000  # samples before any halving, and in all; then the rest is not proven


@dataclass(frozen=True)
class Overload:
    """A joint that gravity alone overloads at a configuration of the motion: moving slower does not help."""

    joint: str
    time: float  # [s]; 0 for a configuration that is not part of a motion
    torque: float  # that holds the joint still against gravity [Nm] or [N]
    limit: float

    @property
    def message(self) -> str:
        """Needed torque and limit, in words."""
        what = f"joint '{self.joint}' needs a torque of {self.torque:.4g} to hold still against gravity"
        return f"{what}, its limit is {self.limit:g}"


@dataclass(frozen=True, eq=False)
class TorquesFound:
    """Torques over a whole motion, for n joints [Nm or N]."""

    joint_names: tuple[str, ...]
    limits: Array  # (n,)
    proven: Array  # (n,) bound on |τ| over the whole motion, between the samples too
    found: Array  # (n,) largest |τ| at a sample
    times: Array  # (n,) of those samples [s]
    overload: Overload | None  # the worst relative to its limit, if there is any, where a sample exceeds its limit
    overloaded: tuple[int, ...]  # then the intervals between rows in which gravity alone exceeds a limit
    samples: int  # at which torques were computed

    @property
    def within(self) -> bool:
        """True if all torques are proven within their limits."""
        return bool((self.proven <= self.limits).all())

    @property
    def exceeded(self) -> bool:
        """True if a sample exceeds its limit; if neither this nor `within` holds, nothing is proven."""
        return bool((self.found > self.limits).any())

    @property
    def worst(self) -> int:
        """The joint closest to its limit: by what was found, if that exceeds a limit, or else by what is proven."""
        shares = (self.found if self.exceeded else self.proven) / self.limits
        return int(shares.argmax())

    def finding(self, curve: Curve) -> LimitFinding:
        """Return the share of the limits that the checked curve uses, and its violations."""
        joint, last = self.worst, len(curve) - 2
        interval = min(int(curve.parameter_of(self.times[joint]) * (last + 1)), last)
        share = float(self.proven[joint] / self.limits[joint])
        use = Use("torque", share, self.joint_names[joint], interval, float(self.limits[joint]))
        status = Status.OVERLOADED if self.exceeded else Status.NOT_PROVEN
        complaints = () if self.within else ((status, self.text),)
        return LimitFinding((use,), complaints, self.text, self.overloaded if self.exceeded else ())

    @property
    def text(self) -> str:
        """Findings in one sentence."""
        i, over = self.worst, self.overload
        name, limit, when = self.joint_names[i], self.limits[i], f"at {self.times[i]:.3f} s"
        if self.within:
            return (
                f"torques at most {at_most(100.0 * float(self.proven[i] / limit))} % of their limits ({name}, {when})"
            )
        if not self.exceeded:
            return (
                f"joint '{name}' needs a torque of {self.found[i]:.6g} {when}: too close to its limit {limit:g} to "
                "decide"
            )
        if np.isinf(self.found[i]):
            return f"joint '{name}' needs an infinite torque {when}: its velocity jumps there"
        if over is None:
            return f"joint '{name}' needs a torque of {self.found[i]:.4g} {when}, its limit is {limit:g}"
        return f"{over.message}, at {over.time:.3f} s: moving slower does not help"


class TorqueCheck:
    """A scene's limits on the joints' torques, with its loads."""

    def __init__(self, setup: Setup) -> None:
        """Resolve limits and loads. Raises InputError for those that do not match the robot."""
        self.limits = {"torque": setup.limits["torque"]}
        self.model, self.robot = setup.loaded_model, setup.robot
        self._around = setup.rates_around(1)
        self.loads = loads_in(self.model, setup.scene, setup.robot)

    def check(self, curve: Curve) -> LimitFinding:
        """Compare the torques along a timed curve with the limits; see `check_torques`. Where a velocity jumps, which
        it may at the first row and the last, the torque is infinite."""
        checked = check_torques(self.model, self.robot, curve, self.limits["torque"])
        jumps = curve.derivative.jumps(*self._around)  # (N, n)
        abrupt, rows = jumps.max(axis=0) > ROUNDING_JUMP, jumps.argmax(axis=0)
        if abrupt.any() and curve.times is not None:
            proven, found = (np.where(abrupt, np.inf, values) for values in (checked.proven, checked.found))
            times = np.where(abrupt, curve.times[rows], checked.times)
            checked = replace(checked, proven=proven, found=found, times=times)
        return replace(checked.finding(curve), loads=self.loads)

    def values(self, quantity: str, curve: Curve, interval: Rows, fraction: Array) -> Array:
        """Return the torques (k, n) on intervals (k,) at fractions (k,) of them."""
        q, v, a = (curve.over_time(order).at(interval, fraction) for order in range(3))
        data = self.model.createData()
        return np.array([pin.rnea(self.model, data, *row) for row in zip(self.robot.pin_q(q), v, a, strict=True)])

    def overload(self, q: Array) -> str | None:
        """Return the joint, in words, that gravity overloads most at q (n,); None if it overloads none."""
        limits = self.limits["torque"]
        torques = np.abs(pin.computeGeneralizedGravity(self.model, self.model.createData(), self.robot.pin_q(q)))
        joint = int((torques / limits).argmax())
        if torques[joint] <= limits[joint]:
            return None
        return Overload(self.robot.joint_names[joint], 0.0, float(torques[joint]), float(limits[joint])).message


def check_torques(model: pin.Model, robot: Robot, curve: Curve, limits: Array) -> TorquesFound:
    """Compare the torques along a timed curve with the joints' limits.

    Args:
        model: the robot's model with its loads (`loads.loaded_model`).
        robot: the robot.
        curve: of the robot's planned joints in their order, with times and at least velocities: straight lines have
            corners that no torque can drive.
        limits: largest |τ| (n,) [Nm] or [N].

    Raises:
        InputError: for a curve without times or velocities.
    """
    if curve.times is None or curve.degree == 1:
        raise InputError("trajectory: has no velocities, so it has no torques; the scene limits them (limits.torque)")
    chain, orders = Chain.of(model), [curve.over_time(order) for order in range(5)]
    step = max(SAMPLE_STEP, float(curve.widths.sum()) / MOST_AT_FIRST)
    count = np.maximum(np.ceil(curve.widths / step - 1e-9).astype(np.int64), 1)
    interval = np.repeat(np.arange(len(count)), count)
    first = np.arange(len(interval)) - np.repeat(np.cumsum(count) - count, count)
    start, end = first / count[interval], (first + 1) / count[interval]
    sampled = _Torques(model, robot, orders, limits)
    of_point = np.repeat(np.arange(len(count)), count + 1)  # both ends of every interval, and places within
    place = np.arange(len(of_point)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    torques, begins = sampled.at(of_point, place / count[of_point]), np.arange(len(interval)) + interval
    at_start, at_end = torques[begins], torques[begins + 1]

    proven = np.zeros(robot.n)
    for halving in range(MOST_HALVINGS + 1):
        width = (end - start) * curve.widths[interval]
        rates = np.stack([order.largest_on(interval, start, end) for order in orders])
        slack = (width**2 / 8)[:, None] * torque_curvature(model, chain, rates)
        ends = np.maximum(np.abs(at_start), np.abs(at_end))
        hopeful = halving < MOST_HALVINGS and sampled.samples < MOST_SAMPLES and not (sampled.found > limits).any()
        open_ = ~(ends + slack <= limits).all(axis=1) & hopeful
        proven = np.maximum(proven, (ends + slack)[~open_].max(axis=0, initial=0.0))
        if not open_.any():
            break
        interval, start, end = interval[open_], start[open_], end[open_]
        middle = 0.5 * (start + end)
        between = sampled.at(interval, middle)
        interval, start, end = np.tile(interval, 2), np.r_[start, middle], np.r_[middle, end]
        at_start, at_end = np.vstack([at_start[open_], between]), np.vstack([between, at_end[open_]])
    if (sampled.found > limits).any():
        sampled.look_for_overloads()
    return TorquesFound(
        joint_names=robot.joint_names,
        limits=limits,
        proven=proven,
        found=sampled.found,
        times=sampled.times,
        overload=sampled.overload,
        overloaded=tuple(sorted(sampled.overloaded)),
        samples=sampled.samples,
    )


class _Torques:
    """Torques at points of the curve, and the worst found there."""

    def __init__(self, model: pin.Model, robot: Robot, orders: list[Curve], limits: Array) -> None:
        self.model, self.data, self.robot, self.orders, self.limits = model, model.createData(), robot, orders, limits
        self.found, self.times = np.zeros(robot.n), np.zeros(robot.n)
        self.overload: Overload | None = None
        self.overloaded: set[int] = set()
        self.points: list[tuple[Rows, Array]] = []

    @property
    def samples(self) -> int:
        """The number of points at which torques were computed."""
        return sum(len(interval) for interval, _ in self.points)

    def at(self, interval: Rows, fraction: Array) -> Array:
        """Return the torques (k, n) on intervals (k,) at fractions (k,) of them."""
        q, v, a = (order.at(interval, fraction) for order in self.orders[:3])
        rows = zip(self.robot.pin_q(q), v, a, strict=True)
        torques = np.array([pin.rnea(self.model, self.data, *row) for row in rows]).reshape(-1, self.robot.n)
        self.points.append((interval, fraction))
        size = np.abs(torques)
        at = size.argmax(axis=0)
        largest = size[at, np.arange(len(at))]
        larger = largest > self.found
        self.found = np.where(larger, largest, self.found)
        self.times = np.where(larger, self._times(interval, fraction)[at], self.times)
        return torques

    def look_for_overloads(self) -> None:
        """Find where gravity alone exceeds a limit, at the same points."""
        interval, fraction = (np.concatenate(each) for each in zip(*self.points, strict=True))
        rows = self.robot.pin_q(self.orders[0].at(interval, fraction))
        gravity = np.array([pin.computeGeneralizedGravity(self.model, self.data, row) for row in rows])
        shares = np.abs(gravity) / self.limits
        self.overloaded.update(interval[(shares > 1.0).any(axis=1)].tolist())
        row, joint = (int(i) for i in np.unravel_index(int(shares.argmax()), shares.shape))
        if shares[row, joint] > 1.0:
            when = float(self._times(interval, fraction)[row])
            name, torque = self.robot.joint_names[joint], float(abs(gravity[row, joint]))
            self.overload = Overload(name, when, torque, float(self.limits[joint]))

    def _times(self, interval: Rows, fraction: Array) -> Array:
        """The times [s] of points."""
        curve = self.orders[0]
        start = np.zeros(len(curve)) if curve.times is None else curve.times
        return np.asarray(start[interval] + fraction * curve.widths[interval])
