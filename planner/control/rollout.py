"""A controller run in simulation: the joints follow the commanded velocity exactly, held over each period.

q_{k+1} = q_k + T u_k. Measures of the commands, the distances and the time are here too.

Velocities that are held jump, and no joint can follow a jump. `Run.executed` is the motion of joints that follow the
commanded positions smoothly, one period behind: the cubic B-spline with these positions as control points (Farin,
Curves and Surfaces for CAGD, chapter 8). It stays within the hull of the last four, its velocity lies between commanded
ones, and its acceleration is at most their greatest difference over T: nothing overshoots, and nothing jumps.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hdplan.planner.control.braking import Command
from hdplan.planner.control.controller import Controller, Step
from hdplan.planner.control.look_ahead import Mode
from hdplan.planner.control.tasks import Ranked, Task, together
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.array_types import Array
from hdplan.scenes.arrays import joint_numbers
from hdplan.scenes.values import Number, checked, instance

FAST = 5.0  # [Hz] of commands that shake the robot


@dataclass(frozen=True, eq=False)
class Run:
    """N periods of a controller."""

    period: float  # T [s]
    positions: Array  # (N + 1, n) [rad or m]
    velocities: Array  # (N, n) commanded [rad/s or m/s]
    modes: tuple[Mode, ...]  # (N,)
    slacks: Array  # (N,) least Δ − δ at the start of each period [m]
    proven: float | None  # true clearance to obstacles proven over all periods [m]; None if one has no proof
    distance_seconds: Array  # (N,) spent on distances
    program_seconds: Array  # (N,) spent on the task and the quadratic program
    met: float | None  # time at which the task was completed [s]; None: it was not
    gave: Counter[tuple[str, str]]  # number of periods in which a pair's barrier was not met
    begin: float = 0.0  # start of the first period [s]
    after: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (B, n) the places where it then brakes until rest

    def __repr__(self) -> str:
        """Return its duration and whether it completed its task, for display."""
        met = "task not completed" if self.met is None else f"task completed at {self.met:g} s"
        return f"<Run: {len(self.modes)} periods of {self.period:g} s, {met}>"

    @property
    def times(self) -> Array:
        """The start of each period and the end of the last (N + 1,) [s]."""
        return self.begin + np.arange(len(self.positions), dtype=np.float64) * self.period

    def executed(self, joint_names: tuple[str, ...], locked: Mapping[str, float]) -> Trajectory:
        """Return the motion of joints that follow smoothly, from rest to rest: N + B + 3 rows, T [s] apart,

            r_k = (q_{k−2} + 4 q_{k−1} + q_k)/6,   ṙ_k = (u_{k−2} + u_{k−1})/2,   r̈_k = (u_{k−1} − u_{k−2})/T

        with the first and last q repeated and u = 0 beyond them: the quintics between rows are that spline, exactly.
        After the last period the robot brakes. An interval that differs from the next, or a position, by a rounding
        counts as jerk: T is rounded so that all times are exact, and each row takes one rounding.
        """
        way = np.concatenate([self.positions, self.after.reshape(-1, self.positions.shape[1])])
        q = np.concatenate([way[:1], way[:1], way, *2 * [way[-1:]]])
        grid = np.spacing(abs(self.begin) + len(q) * self.period)
        period, begin = (float(np.rint(each / grid) * grid) for each in (self.period, self.begin))
        steps = np.diff(q, axis=0)
        u = steps / period
        rows = q[1:-1] + np.diff(steps, axis=0) / 6.0
        rows[[0, -1]] = way[[0, -1]]  # to the last bit
        times = begin + np.arange(len(rows), dtype=np.float64) * period
        return Trajectory(joint_names, rows, locked, times, 0.5 * (u[:-1] + u[1:]), np.diff(u, axis=0) / period)

    @property
    def step_seconds(self) -> Array:
        """The computing time of each step (N,) [s]."""
        return self.distance_seconds + self.program_seconds

    @property
    def counted(self) -> Counter[Mode]:
        """The number of periods in each mode."""
        return Counter(self.modes)


def simulate(
    controller: Controller,
    start: Array,
    task: Task | Sequence[Task | Ranked],
    duration: float,
    *,
    begin: float = 0.0,
    until_met: bool = True,
    watch: Callable[[float, Array, Step], None] | None = None,
) -> Run:
    """Run a controller from `start` (n,), at time `begin` [s], for at most `duration` [s], or until its task is done.

    until_met: whether to end as soon as the task is done; otherwise the whole duration is run.
    watch: called in each period with the time, the configuration and the step. Raises InputError for an invalid start,
    duration or begin.
    """
    instance(controller, Controller, "controller")
    task = together(task)
    duration = checked(Number(low=0.0, unit="s"), duration, "duration")
    begin = checked(Number(unit="s"), begin, "begin")
    period, q = controller.settings.period, joint_numbers("start", start, controller.robot.joint_names).copy()
    positions, steps, met, last = [q], [], None, Command.rest(len(q))
    for index in range(round(duration / period)):
        time = begin + index * period
        if met is None and task.met(q, time):
            met = time
            if until_met:
                break
        step = controller.step(q, task, time, last)
        if watch is not None:
            watch(time, q, step)
        q, last = q + period * step.velocity, step.command
        positions.append(q)
        steps.append(step)
    proofs = [step.proven for step in steps]
    return Run(
        period,
        np.array(positions),
        np.array([step.velocity for step in steps]).reshape(-1, len(q)),
        tuple(step.mode for step in steps),
        np.array([step.slack for step in steps]),
        None if None in proofs else min([np.inf, *(proof for proof in proofs if proof is not None)]),
        np.array([step.distance_seconds for step in steps]),
        np.array([step.program_seconds for step in steps]),
        met,
        Counter(controller.barriers.names[pair] for step in steps for pair in step.gave),
        begin,
        controller.window(q, last).stopping[1:],
    )


def total_variation(commands: Array) -> float:
    """Return Σ_k |u_{k+1} − u_k| of commands (N,) or (N, n), over all joints."""
    return float(np.abs(np.diff(commands, axis=0)).sum())


def fast_energy(commands: Array, period: float) -> float:
    """Return the energy ∫ |u|² dt of commands (N,) or (N, n) at frequencies above FAST: [rad²/s].

    By Parseval's theorem, after subtracting the straight line from the first to the last command, so that the step
    between the ends does not count.
    """
    values = commands.reshape(len(commands), -1)
    if len(values) < 2:
        return 0.0
    line = np.linspace(values[0], values[-1], len(values))
    spectrum = np.fft.rfft(values - line, axis=0)
    fast = np.fft.rfftfreq(len(values), period) > FAST
    twice = np.full(len(spectrum), 2.0)  # a real signal's spectrum counts twice, except at its ends
    twice[0] = 1.0
    if len(values) % 2 == 0:
        twice[-1] = 1.0
    return float((twice[fast, None] * np.abs(spectrum[fast]) ** 2).sum() * period / len(values))
