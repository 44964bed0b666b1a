"""The replanner: at each moment it holds a motion that is proven until the robot stands.

What is proven, and when. The motion that is held, H, is rows on a grid of the clock, up to standstill. `step` seeks
another one, N, that leaves H at a row t₁ = t + period + latency: it continues along the nominal motion for one more
period, and then brakes along the same way (`failsafe`). N is certified from t₁ until it stands, against the last
picture, in every world within the sizes of the scene: what was seen at t₀ with a speed v is anywhere within v (τ − t₀)
of there at the time τ (`picture`). Only then H becomes H until t₁ and N after it. In every other case, a late call, no
picture, no proof, an error, H stays as it is: it brakes.

The invariant. *At every time, what is left of H was certified until standstill, against a picture that holds for all
that can have happened since.* H is not certified again as pictures come in, for a newer one, of t₀′, only shows one of
the worlds that the older one, of t₀, allowed: v (τ − t₀) = v (t₀′ − t₀) + v (τ − t₀′). What this rests on is what the
scene says of the world: that nothing is faster than its `uncertainty.speed`, that the joints are within
`robot.tracking` of the command, and that nothing that was in no picture comes into reach before a motion ends. What
comes to a robot that stands is not its contact.

Ways are sought beside the steps (`outlook`), and only say where to go. They are not trusted.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.replanning.command import Command, Mode
from hdplan.planner.replanning.failsafe import FailsafeMotions
from hdplan.planner.replanning.held import Grid, Held
from hdplan.planner.replanning.nominal import Course, Nominal, Rows
from hdplan.planner.replanning.picture import Picture, Sightings
from hdplan.planner.replanning.ways import Ways
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.tracking import tracking
from hdplan.scenes.array_types import Array
from hdplan.scenes.arrays import joint_numbers
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.deadline import time_limit
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.obstacles import Obstacle, Seen
from hdplan.scenes.poses import AnyPose
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.shapes import Solid
from hdplan.scenes.targets import AnyGoal, Goals, JointTarget
from hdplan.scenes.values import Number, checked, describe, functions, instance

ROWS_PER_PERIOD = 4  # of the grid in a period: what begins at a row waits for it
MEASURED_EXCESS = 1e-6  # [rad] or [m] by which a measured joint may be off beyond `robot.tracking`, from rounding
AT_REST = 1e-2  # [rad/s] or [m/s] of a measured joint, below which a robot that is off its motion counts as standing
FIRST_HORIZON = 0.5  # [s] until one was measured
HORIZON_KEPT = 0.95  # share of the horizon that is kept from one step to the next, as motions near an end are short
LATEST_TIME = 1e10  # [s] on any clock: later, times are no longer apart
PROOF_SHARE = 0.8  # of a period, for the proofs of a step


class Measured(NamedTuple):
    """A state of the joints."""

    at: float  # [s] on the clock
    q: Array  # (n,) [rad or m]
    dq: Array  # (n,) [rad/s or m/s]


class Replanner:
    """Moves a robot to its goal in a world that cameras keep updating, never without a proven stop.

        replanner = hdplan.Replanner(scene)
        replanner.update(obstacles=seen, at=t_of_the_picture)     # from the camera's thread
        replanner.state(q, dq)                                    # the measured state
        command = replanner.step(t)                               # every period; safe to execute to its end

    All times are on one clock, such as `time.monotonic()`. `update`, `state`, `aim` and `step` may be called from
    several threads.
    """

    def __init__(
        self,
        scene: Scene,
        robot: Robot | None = None,
        *,
        at: float = 0.0,
        period: float = 0.04,
        latency: float = 0.01,
        settling: float = 0.0,
        clock: Callable[[], float] | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Prepare it; the robot stands at the scene's start, and its goal is the scene's.

        Args:
            scene: robot, limits, sizes, what stands around it for ever, start and goal. `limits.acceleration` is
                needed, as it says how fast the robot may slow down; no `timing.duration`.
            robot: the scene's robot, if it is already loaded.
            at: when the scene's own obstacles were where it says [s].
            period: [s] between two steps. A step that takes longer holds what was proven before.
            latency: [s] after a step until the robot executes its command.
            settling: [s] for which joints may still move, within `robot.tracking`, once the command stands.
            clock: tells the time [s]; by default time continues from a step's `t` as the processor's does.
            executor: the executor of the search for ways; by default a thread of the replanner's own.

        Raises InputError for errors in the scene or robot, and for a scene that says when its motion has to end.
        """
        instance(scene, Scene, "scene")
        self._period = checked(Number(1e-3, 1.0, unit="s"), period, "period")
        self._latency = checked(Number(0.0, 1.0, unit="s"), latency, "latency")
        self._settling = checked(Number(0.0, 10.0, unit="s"), settling, "settling")
        if clock is not None:
            functions(clock=clock)
        if executor is not None:
            instance(executor, Executor, "executor")
        at = _moment(at, "at")
        if scene.limits.acceleration is None:
            raise InputError(
                f"{scene.source}: limits.acceleration: is missing, which says how fast the robot may slow down"
            )
        if scene.timing is not None and scene.timing.duration is not None:
            raise InputError(
                f"{scene.source}: timing.duration: applies to one motion, and here there are many: leave it out"
            )
        if scene.path.follow is not None:
            raise InputError(f"{scene.source}: path.follow: applies to whole motions; a replanner ends them anywhere")
        setup = Setup.of(scene, robot)
        _check_goal(setup)
        self.robot = setup.robot
        start = self.robot.configuration(scene.start, scene.from_request)
        self._scene, self._clock = setup.requested, clock
        self._grid = Grid(at, self._period / ROWS_PER_PERIOD)
        self._lags = tracking(scene, self.robot)
        self._speeds = setup.limits["velocity"] + tracking(scene, self.robot, "velocity")
        self._motions = FailsafeMotions(setup.limits, self._grid.h, ROWS_PER_PERIOD + 1)
        self._held = Held.standing(self._grid, 0, start)
        self._course: Course | None = None
        self._ways = Ways(self.robot, executor)
        self._now = -math.inf  # of the last step
        self._stepped = math.inf, 0.0  # its time, and the processor's then [s]: none yet
        self._closed = False
        self._off = ""  # how the robot is not where it is to be
        self._measured: Measured | None = None  # a state that no step has used yet
        self._measured_at = -math.inf  # when the last one was [s]
        self._hopeful = True  # whether the last step could prove a motion
        self._clearance: float | None = None
        self._proven_at, self._horizon = at, FIRST_HORIZON
        self._seen = Sightings.of(setup.scene, at)
        self._steps, self._updates = threading.RLock(), threading.RLock()
        self._picture = Picture(self._seen, self.robot, start)

    def __repr__(self) -> str:
        """Return its robot, for display."""
        return f"<Replanner of {self.robot.name}: every {self._period:g} s>"

    @property
    def period(self) -> float:
        """[s] between two steps."""
        return float(self._period)

    @property
    def latency(self) -> float:
        """[s] after a step until the robot executes its command."""
        return float(self._latency)

    @property
    def lags(self) -> Array:
        """[rad or m] by which the joints (n,) may be off a command: the scene's `robot.tracking`."""
        return self._lags.copy()

    def __enter__(self) -> Replanner:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End its thread."""
        self.close()

    def close(self) -> None:
        """End the replanner's own thread; the last command stays safe, and no step follows."""
        with self._steps:
            self._closed = True
            self._ways.close()

    def update(
        self,
        obstacles: Sequence[Obstacle | Solid | Seen] | None = None,
        cloud: Cloud | Obstacle | None = None,
        poses: Mapping[str, AnyPose] | None = None,
        *,
        at: float,
    ) -> None:
        """Take a picture of the world; arguments that are left out keep their last values.

        Args:
            obstacles: all obstacles besides the scene's own, in place of those of the last picture; one with the name
                of a scene's obstacle replaces it. `motion` may hold its measured steady velocity and spin, and
                `uncertainty` how far it may be off its pose, and how fast it may leave after `at`.
            cloud: the points of a camera, in place of the last cloud.
            poses: new poses of known obstacles, by name.
            at: time of the exposure [s], not of its arrival.

        The work is done here and not in a step, so call `update` in the camera's thread. Raises InputError for
        obstacles that no scene can have, unknown names, and a picture that is older than the last one or of the future;
        nothing has changed then.
        """
        at = self._past(_moment(at, "at"))
        with self._updates:
            seen = self._seen.updated(at, obstacles, cloud, poses)
            picture = Picture(seen, self.robot, self._held.at(at)[0])
            self._seen, self._picture = seen, picture

    def aim(self, goal: AnyGoal) -> None:
        """Take another goal, in any form that a scene's has. The robot keeps to its way until one to the new goal is
        found. Raises InputError for a goal that does not fit the robot."""
        scene = self._scene.with_goal(goal)
        scene = derived(self._scene, goal=scene.goal)
        setup = Setup.of(scene, self.robot)
        _check_goal(setup)
        with self._steps:
            self._refuse_closed()
            self._scene = setup.requested
            self._ways.forget(reaches=False)
            if not self._off and self._now > -math.inf:  # the next step may then have a way already
                row = self._grid.after(self._now + self._period + self._latency)
                self._ask(row, moves=self._hopeful and self._now < self._grid.time(self._held.last))

    def state(self, q: ArrayLike, dq: ArrayLike, at: float | None = None) -> None:
        """Take the measured state of the joints: positions q and velocities dq (n,), at a time [s], by default that of
        the last step.

        A robot that is not within `robot.tracking` of its motion brakes along it, and continues from the place where it
        then stands. Raises InputError for wrong numbers of values, NaN, and values that the joints cannot have; the
        current motion stays in force. A state that is older than the last one, or of the future, raises it, too.
        """
        joints = self.robot.joint_names
        found, rates = joint_numbers("q", q, joints), joint_numbers("dq", dq, joints)
        over = np.maximum(self.robot.lower - found, found - self.robot.upper) - self._lags - MEASURED_EXCESS
        if (i := int(over.argmax())) >= 0 and over[i] > 0.0:
            low, high = self.robot.lower[i], self.robot.upper[i]
            raise InputError(f"q: joint '{joints[i]}' is at {found[i]:g}, its range is [{low:g}, {high:g}]")
        over = np.abs(rates) - self._speeds * (1.0 + MEASURED_EXCESS) - MEASURED_EXCESS
        if over[i := int(over.argmax())] > 0.0:
            raise InputError(f"dq: joint '{joints[i]}' is at {rates[i]:g}, its limit is {self._speeds[i]:g}")
        with self._steps:
            last = max(self._now, self._grid.origin, self._measured_at)
            when = last if at is None else self._past(_moment(at, "at"))
            if when < self._measured_at:
                last = self._measured_at
                raise InputError(f"at: must be no earlier than the last state, {last:.6g} s, found {when:.6g} s")
            self._measured, self._measured_at = Measured(when, found, rates), when

    def step(self, t: float) -> Command:
        """Return the command for now, t [s]: the current motion, extended by a piece if that could be proven.

        Raises InputError for a time that is not a number, or earlier than the last step, and after `close`.
        """
        began = time.perf_counter()
        t = _moment(t, "t")
        with self._steps:
            self._refuse_closed()
            if t < self._now:
                raise InputError(f"t: must be no earlier than the last step, {self._now:.6g} s, found {t:.6g} s")
            self._now, self._stepped = t, (t, began)
            self._compare(self._time(t, began))
            picture, row = self._picture, self._grid.after(t + self._period + self._latency)
            why, moves = self._hindrance(picture, self._time(t, began)), False
            if not why:
                self._course = self._ways.hear(t, self._held, self._course, row)
                moves, why = self._go_on(picture, row, t, began)
            if not self._off:
                self._ask(row, moves)
            return self._command(t, why, time.perf_counter() - began)

    def _past(self, at: float) -> float:
        """Return a time at which something was seen or measured. Raises InputError for one that is more than a period
        beyond now, as all that is true would then be older; without a clock, the first step tells the time."""
        if at > (now := self._time(*self._stepped)) + self._period:
            simulated = "" if self._clock else "; in a simulation, `clock` gives the time"
            raise InputError(f"at: must be no later than now, {now:.6g} s, found {at:.6g} s{simulated}")
        return at

    def _refuse_closed(self) -> None:
        if self._closed:
            raise InputError("the replanner is closed: its last command stays safe; continue with a new replanner")

    def _ask(self, row: int, moves: bool) -> None:
        """Request a check of the way, for a course that continues from a row of the clock."""
        self._ways.ask(self._scene, self._seen, self._now, self._horizon, self._held, self._course, row, moves)

    # --- a step -------------------------------------------------------------------------------------------------------

    def _compare(self, now: float) -> None:
        """See how far the robot is off its motion, by the last state unless that is of the future; if it has come to
        rest there, it stands there."""
        measured = self._measured
        if measured is None or measured.at > now:
            return
        self._measured, self._off = None, ""
        expected = self._held.at(measured.at)[0]
        q = self.robot.nearest_turn(measured.q, expected)  # an encoder may begin each turn at 0
        away = np.abs(q - expected) - self._lags - MEASURED_EXCESS
        i = int(away.argmax())
        if away[i] <= 0.0:
            return
        joint, off, allowed = self.robot.joint_names[i], away[i] + self._lags[i], self._lags[i]
        self._off = f"joint '{joint}' is {off:.3g} off its motion, robot.tracking.position is {allowed:g}"
        if measured.at >= self._grid.time(self._held.last) and np.abs(measured.dq).max() <= AT_REST:
            inside = np.clip(q, self.robot.lower, self.robot.upper)
            self._held = Held.standing(self._grid, self._grid.after(measured.at), inside)
            self._course, self._off = None, ""
            self._ways.forget(reaches=True)

    def _hindrance(self, picture: Picture, now: float) -> str:
        """Return the reason why nothing can be proven in this step; nothing if something may."""
        if self._off:
            return self._off
        if self._measured is not None:
            return f"the state was measured at {self._measured.at:.6g} s, after this step"
        if picture.at > now:
            return f"the picture was taken at {picture.at:.6g} s, after this step"
        if picture.lost:
            return f"'{picture.lost[0]}' was not seen for so long that it may be anywhere"
        return ""

    def _go_on(self, picture: Picture, row: int, t: float, began: float) -> tuple[bool, str]:
        """Prove a motion from a row of the clock on, and hold it. Return whether one was, and why none was, if one is
        needed."""
        if self._course is None:
            return False, self._ways.why or "no way was found yet"
        courses = [self._course]
        if (course := self._ways.waiting(self._held, self._course, row)) is not None:
            courses.insert(0, course)
        elif self._course.arrives and row >= self._held.last:
            return False, "" if self._ways.reaches else self._ways.why or "no way was found yet"
        why, hopeful, self._hopeful = "", self._hopeful, False
        for course in courses:
            for motion in self._motions.of(course.nominal, course.at(row), hopeful):
                if not motion.moves:
                    if course is not self._course and row >= self._held.last:
                        self._course = course
                        self._ways.taken()
                    return False, ""
                certificate = self._proof(picture, row, motion.rows, course.nominal, began)
                stands = self._grid.time(row + len(motion.law) - 1) + self._settling
                self._horizon = max(stands - picture.at, HORIZON_KEPT * self._horizon)
                if isinstance(certificate, str) or not certificate.certified:
                    why = certificate if isinstance(certificate, str) else certificate.text
                    continue
                if not self._time(t, began) <= t + self._period:
                    return False, "the step took longer than its period"
                if course is not self._course:
                    self._ways.taken()
                self._held, self._course = self._held.joined(row, motion.rows), Course(course.nominal, row, motion.law)
                self._clearance, self._proven_at, self._hopeful = certificate.clearance, picture.at, True
                return True, ""
        return False, why or "no motion along the way keeps the limits"

    def _proof(self, picture: Picture, row: int, rows: Rows, nominal: Nominal, began: float) -> Certificate | str:
        """Return the certificate of a motion that begins at a row, or why there was no time for it."""
        left = None if self._clock is not None else PROOF_SHARE * self._period - (time.perf_counter() - began)
        if left is not None and left <= 0.0:
            return "the step took longer than its period"
        try:
            with time_limit(left):
                return picture.prove(rows, self._grid.time(row), self._grid.h, self._settling, nominal.required)
        except HdplanError as error:
            return str(error)

    def _time(self, t: float, began: float) -> float:
        """Return the time [s] in a step of t that began then (time.perf_counter())."""
        return _moment(self._clock(), "clock()") if self._clock is not None else t + time.perf_counter() - began

    def _command(self, t: float, why: str, seconds: float) -> Command:
        stands = t >= self._grid.time(self._held.last)
        mode = Mode.MOVING
        if stands:
            mode = Mode.ARRIVED if self._ways.arrives(self._course) else Mode.STANDING
        if mode is Mode.MOVING and why:
            mode = Mode.BRAKING
        position, velocity, acceleration = self._held.at(t)
        ahead, clearance = self._held.ahead(self.robot, t), None if stands else self._clearance
        return Command(t, position, velocity, acceleration, ahead, mode, why, clearance, self._proven_at, seconds)


def _check_goal(setup: Setup) -> None:
    """Raise InputError for a goal that does not fit the robot, and for ends at which it moves."""
    setup.refuse_moving_ends("a replanner begins and ends at rest")
    goal = setup.scene.goal
    for target in goal.targets if isinstance(goal, Goals) else (goal,):
        if isinstance(target, JointTarget):
            setup.robot.configuration(target, setup.scene.from_request)


def _moment(t: float, name: str) -> float:
    """Return a time on the clock. Raises InputError for anything else."""
    if isinstance(t, bool) or not isinstance(t, (int, float, np.integer, np.floating)) or not abs(t) <= LATEST_TIME:
        raise InputError(f"{name}: must be a finite time [s], found {describe(t)}")
    return float(t)
