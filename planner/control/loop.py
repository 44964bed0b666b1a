"""The loop between a motion and an arm, simulated or real: commands, measurements and errors.

In every period the reference one period ahead is sent; what is measured is held against the reference of that moment.
An arm that is farther off than it may be is stopped: what was proven says nothing of where it is then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

import numpy as np

from hdplan.planner.control.arm import Arm
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import StageMark, Trajectory
from hdplan.planner.replanning.command import Command, Mode
from hdplan.planner.replanning.replanner import Replanner
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, listed
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.sizes import Tracking
from hdplan.scenes.values import Number, checked, functions, instance

ERROR_DIGITS = 3  # of measured errors, rounded up
STEP_WAIT_SHARE = 0.25  # of a period of the arm, for which a step is awaited before the reference is sent without it
SAME_COMMAND = 1e-6  # [rad] or [m] between two commands at one time, from rounding
CLOCK_POLL = 1e-4  # [s] between two looks at the arm's clock meanwhile

Reference = Callable[[float], tuple[Array, Array] | None]
"""Positions and velocities (2, n), now and one period from now; None: it is over."""


@dataclass(frozen=True, eq=False)
class Executed(ReadOnly):
    """The motion of an arm as it was measured: one row for every period."""

    joint_names: tuple[str, ...]  # (n,)
    times: Array  # (k,) [s] from the beginning
    positions: Array  # (k, n) measured [rad] or [m]
    velocities: Array  # (k, n) measured
    errors: Array  # (k, n) commanded less measured positions
    velocity_errors: Array  # (k, n)
    why: str  # reason of a stop before the end; empty without one
    commands: tuple[Command, ...] = ()  # of each step of a replanner

    @property
    def tracking(self) -> Tracking:
        """The largest errors of each joint, rounded up: the `robot.tracking` with which a scene's proof covers the
        executed motion. Other motions may have other errors."""
        return measured_tracking(self.errors, self.velocity_errors)

    @property
    def trajectory(self) -> Trajectory:
        """The measured motion: times, positions and velocities. Raises InputError for fewer than two rows."""
        return Trajectory(self.joint_names, self.positions, {}, self.times, self.velocities)


class Loop:
    """Moves an arm along motions that were planned.

    loop = control.Loop(arm)
    done = loop.follow(result.trajectory)
    print(done.tracking)
    """

    def __init__(self, arm: Arm, most: float = 0.05) -> None:
        """Take an arm, and how far [rad or m] a joint may be off before the arm is stopped.

        Raises InputError for a distance that is no positive number.
        """
        self.arm = arm
        self.most = checked(Number(high=1e3, above=0.0, unit="rad or m"), most, "most")

    def follow(self, motion: Trajectory, begins: Callable[[StageMark], None] | None = None) -> Executed:
        """Follow a motion with times, from where the arm stands to its end: of a plan, of a job, of another planner.

        For a job, only the arm's joints are sent; `begins` handles everything else, such as fingers and outputs: it is
        called with each stage (`Trajectory.stages`) when the stage begins.

        Raises InputError for a motion without times or of other joints, and for an arm that is farther than `most` from
        the beginning of the motion; nothing has been sent then.
        """
        instance(motion, Trajectory, "motion")
        if begins is not None:
            functions(begins=begins)
        if motion.times is None:
            raise InputError("motion: times: missing; an arm needs them")
        ours, theirs = self.arm.joint_names, motion.joint_names
        if not set(ours) <= set(theirs) or (len(ours) < len(theirs) and not motion.stages):
            raise InputError(f"motion: joint_names: must be those of the arm: {listed(ours)}; found {listed(theirs)}")
        columns = [theirs.index(joint) for joint in ours]
        away = motion.positions[0, columns] - self.arm.state()[0]
        if not np.abs(away).max() <= self.most:
            joint = _worst(away)
            raise InputError(
                f"motion: joint '{ours[joint]}' is {abs(away[joint]):.3g} from where the motion begins, at most "
                f"{self.most:g} is allowed: move it there first"
            )
        due = [(float(motion.times[mark.row] - motion.times[0]), mark) for mark in motion.stages]
        return self.along(motion.curve.columns(columns), due, begins)

    def along(
        self,
        curve: Curve,
        stages: Sequence[tuple[float, StageMark]] = (),
        begins: Callable[[StageMark], None] | None = None,
    ) -> Executed:
        """Follow a curve with times of the arm's joints, in its order, with stages that begin at times [s] from its
        beginning; not checked."""
        assert curve.times is not None
        first, last, period = float(curve.times[0]), float(curve.times[-1]), self.arm.period
        waiting = list(stages) if begins is not None else []

        def reference(t: float) -> tuple[Array, Array] | None:
            while waiting and begins is not None and t >= waiting[0][0] - 0.5 * period:
                begins(waiting.pop(0)[1])
            if first + t > last + 0.5 * period:
                return None
            place = curve.place_of(np.clip(first + t + np.array([0.0, period]), first, last))
            return curve.at(*place), curve.over_time(1).at(*place)

        return self._run(reference)

    def replan(self, replanner: Replanner, seconds: float, see: Callable[[float], None] | None = None) -> Executed:
        """Execute a replanner's commands until the arm arrives, or for a time [s]; then, and on any error, follow its
        current motion until the arm stands.

        `see`, if given, is called with the time of the arm's clock before each step, for a simulation that provides the
        pictures; on a robot the camera's thread calls `replanner.update`. The replanner's clock is the arm's.

        Raises InputError for a replanner of other joints; and, once the arm stands, the error that `see` or the
        replanner raised.
        """
        instance(replanner, Replanner, "replanner")
        seconds = checked(Number(high=1e6, above=0.0, unit="s"), seconds, "seconds")
        if tuple(replanner.robot.joint_names) != tuple(self.arm.joint_names):
            ours, theirs = ", ".join(self.arm.joint_names), ", ".join(replanner.robot.joint_names)
            raise InputError(f"replanner: plans {theirs}; the arm has {ours}")
        began, period, due = self.arm.time(), self.arm.period, 0.0
        if replanner.latency < period:
            raise InputError(
                f"replanner: latency: must be at least the period of the arm, {period:g} s, found "
                f"{replanner.latency:g} s: a command is sent that much later than it is made"
            )
        commands: list[Command] = []
        failed: list[Exception] = []
        pending: Future[Command] | None = None

        def reference(t: float) -> tuple[Array, Array] | None:
            nonlocal due, pending
            now = began + t
            over = bool(failed) or (bool(commands) and (t >= seconds or commands[-1].mode is Mode.ARRIVED))
            if over and pending is None and now >= commands[-1].time + (commands[-1].motion.duration or 0.0):
                return None
            try:
                if pending is None and not over and t >= due - 0.5 * period:
                    if see is not None:
                        see(now)
                    if commands:
                        replanner.state(*self.arm.state(), at=now)
                    pending, due = beside.submit(replanner.step, now), max(due + replanner.period, t)
                if pending is not None and self._awaited(
                    pending, now + STEP_WAIT_SHARE * period if commands else np.inf
                ):
                    step, pending = pending, None
                    command = step.result()
                    if not commands or self._joins(commands[-1], command, now, replanner.lags):
                        commands.append(command)
            except Exception as error:
                if not commands:
                    raise
                failed.append(error)  # what is held is proven until the arm stands
            found = commands[-1].at(now + np.array([0.0, period]))
            return found.positions, found.velocities

        with ThreadPoolExecutor(1, thread_name_prefix="hdplan-step") as beside:
            done = self._run(reference, commands)
        if failed:
            raise failed[0]
        return done

    def _awaited(self, pending: Future[Command], until: float) -> bool:
        """Return whether a step is done, as soon as it is or the arm's clock reaches a time: a simulated one stands
        still until then, and a real arm needs its next reference."""
        while not pending.done() and self.arm.time() < until:
            wait([pending], CLOCK_POLL)
        return pending.done()

    def _joins(self, old: Command, new: Command, now: float, lags: Array) -> bool:
        """Return whether the arm may go over to a new command: where both are the same, or both stand, and the arm is
        as near to the new one as to the old one, or within its lags (n,). A command that comes so late that its motion
        has left the old one is passed over: the arm brakes along the old one, and the replanner, which then measures
        that it is off, continues from where it stands."""
        one, other = old.at(now), new.at(now)
        if np.abs(one.positions - other.positions).max() <= SAME_COMMAND:
            return True
        if one.velocities.any() or other.velocities.any():
            return False
        q = self.arm.state()[0]
        return bool((np.abs(other.positions - q) <= np.maximum(np.abs(one.positions - q), lags)).all())

    def _run(self, reference: Reference, commands: Sequence[Command] = ()) -> Executed:
        """Send references until they end, or until the arm is too far off; on any error the arm is stopped."""
        began, rows, why, ended = self.arm.time(), list[tuple[Array, ...]](), "", False
        times: list[float] = []
        try:
            while not why:
                t = self.arm.time() - began
                wanted = reference(t)
                if wanted is None:
                    break
                q, v = (np.array(each, dtype=np.float64) for each in self.arm.state())
                times.append(t)
                rows.append((q, v, wanted[0][0] - q, wanted[1][0] - v))
                if not (away := np.abs(rows[-1][2])).max() <= self.most:
                    joint = _worst(away)
                    name = self.arm.joint_names[joint]
                    why = f"joint '{name}' is {away[joint]:.3g} off its motion, at most {self.most:g} is allowed"
                    break
                self.arm.send(wanted[0][1], wanted[1][1])
            ended = not why
        finally:
            if not ended:
                self.arm.stop()
        q, v, errors, velocity_errors = (np.array(each) for each in zip(*rows, strict=True))
        return Executed(
            tuple(self.arm.joint_names), np.array(times), q, v, errors, velocity_errors, why, tuple(commands)
        )


def _worst(away: Array) -> int:
    """Return the joint that is farthest off, or of which nothing was measured."""
    return int(np.argmax(np.where(np.isnan(away), np.inf, np.abs(away))))


def measured_tracking(errors: Array, velocity_errors: Array) -> Tracking:
    """Return the sizes within which errors (k, n) of positions and velocities were, rounded up."""
    return Tracking(_up(errors), _up(velocity_errors))


def _up(errors: Array) -> tuple[float, ...]:
    """Return the largest absolute errors (n,) of rows (k, n), rounded up to ERROR_DIGITS digits."""
    most = np.abs(errors).max(axis=0)
    unit = 10.0 ** (np.floor(np.log10(np.maximum(most, 1e-12))) + 1 - ERROR_DIGITS)
    return tuple((np.ceil(most / unit * (1 + 1e-9)) * unit).tolist())
