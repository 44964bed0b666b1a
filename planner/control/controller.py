"""A controller that keeps clear: joint velocities by a quadratic program with control barrier functions.

At every period T it solves, for the joint velocity u (n,) [rad/s or m/s],

    minimize    ½ uᵀ H u + fᵀ u                     the task: least at the nominal velocity (`tasks`)
    subject to  ∂Δ_k/∂q · u + ∂Δ_k/∂t ≥ −η (Δ_k − δ_k)         for every pair of bodies k (`barriers`)
                −η (q − q_min) ≤ u ≤ η (q_max − q),  |u| ≤ v   joint limits as barriers, velocity limits

(paper, section IV-C; Ames et al., "Control barrier functions: theory and applications", ECC 2019).
Where not all of it can be met, there still is a best command, by this order (`quadratic_program`):

1. The velocity limits; no joint goes further beyond a limit; and of what stands, and of the links among themselves, no
   Δ_k falls below δ_k, or falls at all where it is below already. Standing still keeps all this, so it can be kept.
2. What comes: its barriers are missed by as little as can be, least where it would touch soonest.
3. Pairs inside their margins, and joints beyond their limits, come back as the equations above want it, or as fast as
   they can.

The step names the pairs whose barrier its command does not meet (`Step.gave`).

What it guarantees is derived in `barrier_safety`. The barrier's inequality is linear in u and holds at one instant;
over a period the distance bends. So each command is looked at once more at its end: it is taken only if every Δ_k(q + u
T) stays at or above δ_k, or at least does not fall where it is below already; otherwise the program is solved again
with the rows that fell as they are at that end, then with the joints held that move those pairs, and at last the robot
is stopped. Then Δ_k ≥ δ_k at every sample for
all time once it holds at the first, whatever the distance's kinks, against obstacles that stand; standing still is
always allowed. Below its margin Δ says too little, as outer bodies may overlap where the links do not: there the exact
distance of the links' hulls is kept from falling below NEAR as well, by a barrier and by the same look. And there the
HD-SDF's shaping is undone (`barrier_safety.straightened`), as on its flat spot it gives no direction back. Against an
obstacle that moves, standing still may not be enough: then the command that is best at its end is taken.

Settings that are provably not safe are refused by name (`barrier_safety.refuse_unsafe`). A controller like this is no
planner: it can come to rest where no velocity brings it on, short of its target. A `Controller` has no state between
its steps, so threads may share one; a task may have some (`follow.FollowTask`), and then belongs to one thread.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.control.barrier_safety import straightened, sufficient_separation
from hdplan.planner.control.barriers import BarrierRows, Barriers, scene_barriers
from hdplan.planner.control.quadratic_program import Wishes, best_velocity
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.control.tasks import Task
from hdplan.planner.robot.joint_limits import joint_limits
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.arrays import joint_numbers, quadratic
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import Number, checked, instance

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

LOOKS = 4  # at a command's end, the first included
ROUNDING = 1e-12  # [m] granted to a distance that may not fall
SPARE = 1e-7  # [m] that a corrected command is to end above that: more than the program's tolerance
NEAR = 0.01  # [m] below which the exact distance of a pair that is inside its margin may not fall
MISSED = 1e-4  # [m/s] by which a barrier is missed before it is said
COMING, RECOVERING = 1e3, 30.0  # price of what is missed beside what comes, and of a way back to a margin [s/m or s]
SOON = 0.01  # [m] from what comes, below which its price rises no more


class Mode(Enum):
    """What became of a period."""

    MOVING = "moving"  # every barrier is met, the command is the best
    CORRECTED = "corrected"  # the same, but for a first one that would have ended too close
    GIVING_WAY = "giving way"  # not every barrier can be met: the best command, `Step.gave` says which it misses
    STOPPED = "stopped"  # no command was found that keeps what stands far enough away


@dataclass(frozen=True, eq=False)
class Step:
    """The command of one period."""

    velocity: Array  # (n,) u [rad/s or m/s]
    mode: Mode
    rows: BarrierRows  # Δ and its derivatives at the start of the period
    slack: float  # least Δ − δ there [m]; inf without pairs
    closest: int  # the pair of the least, a row of Barriers.names; −1 without pairs
    gave: tuple[int, ...]  # the pairs whose barrier the command does not meet, rows of Barriers.names
    proven: float | None
    """a lower bound of the true clearance of the links that move to the obstacles, over the whole period [m]; None: no
    proof"""
    distance_seconds: float
    program_seconds: float

    @property
    def stopped(self) -> bool:
        """Whether the robot stands for lack of a safe command."""
        return self.mode is Mode.STOPPED


class Controller:
    """Steps a robot toward a task, clear of obstacles and of itself."""

    def __init__(
        self, robot: Robot, barriers: Barriers, settings: ControlSettings, limits: Array | None = None
    ) -> None:
        """Take the pairs; settings' barriers must be those that `barriers` were laid out with. limits: (n,) the
        greatest speeds [rad/s or m/s], by default the URDF's. Raises InputError for limits that are none."""
        self.robot, self.barriers, self.settings = robot, barriers, settings
        count, outer = len(barriers.names), barriers.obstacle_pairs
        self._margins = np.where(np.arange(count) < outer, settings.margin, settings.self_margin)
        b = settings.barriers
        sure = [
            sufficient_separation(margin, b.gamma, b.shaping_length, barriers.corners)
            for margin in (settings.margin, settings.self_margin)
        ]
        bent = [
            margin - straightened(margin, b.gamma, b.shaping_length)[0]
            for margin in (settings.margin, settings.self_margin)
        ]
        self._bent = np.where(np.arange(count) < outer, *bent)  # δ − u(δ) [m]
        self._sure = np.where(np.arange(count) < outer, *sure)  # D̃ [m] from which on Δ ≥ δ is certain
        self._clearance = barriers.clearance(settings.margin)
        given = robot.model.velocityLimit if limits is None else limits
        self.fastest = settings.speed * joint_numbers("limits", given, robot.joint_names, positive=True)  # (n,)

    def __repr__(self) -> str:
        """Say whose controller it is, and what it keeps apart."""
        return f"<Controller of {self.robot.name}: every {self.settings.period:g} s, {self.barriers!r}>"

    @property
    def assured(self) -> float | None:
        """Clearance [m] to obstacles proven at every time, at any speed within the limits, once Δ ≥ δ: that of the
        samples, less the farthest way to the middle of a period; None without proof, not above 0 where it fails."""
        clearance = self._clearance
        if clearance is None or not self.settings.look_ahead or self.barriers.movers:
            return None
        return clearance - 0.5 * self.settings.period * float(self.fastest @ self.barriers.levers)

    @classmethod
    def of(cls, scene: Scene, settings: ControlSettings | None = None, robot: Robot | None = None) -> Controller:
        """Return the controller of a scene. Raises InputError as `scene_barriers`, for the scene's robot, and for a
        joint that neither scene nor URDF gives a speed limit."""
        settings = ControlSettings() if settings is None else settings
        instance(settings, ControlSettings, "settings")
        robot = Setup.of(scene, robot).robot
        given = scene.limits if scene.limits.velocity is not None else replace(scene.limits, velocity="urdf")
        limits = joint_limits(replace(scene, limits=given), robot)["velocity"]
        return cls(robot, scene_barriers(scene, robot, settings.barriers), settings, limits)

    def step(self, q: Array, task: Task, time: float = 0.0) -> Step:
        """Return the command at configuration q (n,) and a time [s].

        Raises InputError, before anything is commanded, for a q, a time or a task's objective that is not finite or
        has another shape.
        """
        q, time = joint_numbers("q", q, self.robot.joint_names), checked(Number(unit="s"), time, "time")
        began = perf_counter()
        rows = self.barriers.evaluate(q, time)
        slacks = rows.value - self._margins
        inside = np.flatnonzero(slacks < 0.0) if self.settings.look_ahead else np.empty(0, dtype=np.int64)
        near = self.barriers.nearness(q, time, inside)
        now = _Now(q, time, self._straight(rows, np.arange(len(slacks)), inside), near, inside)
        distances = perf_counter() - began
        hessian, linear = quadratic(task.objective(q, time), self.robot.joint_names)
        wishes = self._wishes(now)
        command = best_velocity(hessian, linear, *self._box(q), wishes)
        mode, kept = Mode.MOVING, False
        if command is not None and self.settings.look_ahead:
            command, mode, kept, looking = self._looked_at(command, now, hessian, linear, wishes)
            distances += looking
        velocity = np.zeros_like(q) if command is None else command
        pairs = np.append(np.arange(len(slacks)), now.near_pairs)
        missed = (wishes.matrix @ velocity < wishes.wish - MISSED)[: len(pairs)]
        gave = tuple(sorted(set(pairs[missed].tolist())))
        if command is None:
            mode, kept = Mode.STOPPED, not self.barriers.movers
        elif gave:
            mode = Mode.GIVING_WAY
        closest = int(np.argmin(slacks)) if len(slacks) else -1
        return Step(
            velocity,
            mode,
            rows,
            float(slacks[closest]) if len(slacks) else np.inf,
            closest,
            gave,
            self._proven(velocity, rows, kept),
            distances,
            perf_counter() - began - distances,
        )

    def _box(self, q: Array) -> tuple[Array, Array]:
        """Return the least and greatest velocities (n,), standing still among them, for joints beyond a limit too."""
        rate, robot, fastest = self.settings.rate, self.robot, self.fastest
        return np.clip(rate * (robot.lower - q), -fastest, 0.0), np.clip(rate * (robot.upper - q), 0.0, fastest)

    def _straight(self, rows: BarrierRows, pairs: Rows, inside: Rows) -> BarrierRows:
        """Return the rows of `pairs`, ascending, with Δ of those inside their margins as u(Δ) − u(δ) + δ, by the u that
        the HD-SDF shapes: it grows as Δ does and is δ where Δ is, but has a slope on the flat spot too."""
        b, found = self.settings.barriers, np.flatnonzero(np.isin(pairs, inside))
        if not b.distance.startswith("hdsdf") or not len(found):
            return rows
        straight = [straightened(value, b.gamma, b.shaping_length) for value in rows.value[found].tolist()]
        separation, slope = np.array(straight).T
        steep = np.divide(1.0, slope, out=np.zeros_like(slope), where=slope > 0.0)
        value, gradient, drift = rows.value.copy(), rows.gradient.copy(), rows.drift.copy()
        value[found] = separation + self._bent[pairs[found]]
        gradient[found] *= steep[:, None]
        drift[found] *= steep
        return replace(rows, value=value, gradient=gradient, drift=drift)

    def _wishes(self, now: _Now) -> Wishes:
        """Return the barriers as rows: of all pairs, of those inside their margins, of joints beyond their limits."""
        rate, rows, near = self.settings.rate, now.rows, now.near
        drift = np.concatenate([rows.drift, near.drift])
        wish = -rate * np.concatenate([rows.value - self._margins, np.maximum(near.value - NEAR, 0.0)]) - drift
        gap = np.concatenate([rows.separation, near.value])
        coming = np.concatenate([self.barriers.coming, self.barriers.coming[now.near_pairs]])
        beyond = np.maximum(now.q - self.robot.upper, self.robot.lower - now.q)  # [rad] or [m]
        joints = np.flatnonzero(beyond > 0.0)
        back = np.eye(len(beyond))[joints] * np.where(now.q > self.robot.upper, -1.0, 1.0)[joints, None]
        return _wished(
            np.concatenate([rows.gradient, near.gradient, back]),
            np.append(wish, np.minimum(rate * beyond, self.fastest)[joints]),
            np.append(np.where(coming, SOON / np.maximum(gap, SOON), 0.0), np.zeros(len(joints))),
        )

    def _looked_at(
        self, velocity: Array, now: _Now, hessian: Array, linear: Array, wishes: Wishes
    ) -> tuple[Array | None, Mode, bool, float]:
        """Return what is commanded once its end was looked at, None for nothing; whether every Δ that was δ or more
        still is there, as far as that was looked at; and the seconds that distances took.

        Where a pair ends below its floor, the program is solved again with that pair's row as it is at that end u₀ T,

            Δ(q + u₀ T) + T ∂Δ/∂q(q + u₀ T) · (u − u₀) ≥ floor,

        or, where that has no solution, with the joints held that move it.
        """
        period, seconds = self.settings.period, 0.0
        box, asked = self._box(now.q), wishes
        floors = np.concatenate([np.minimum(now.rows.value, self._margins), np.minimum(now.near.value, NEAR)])
        best: tuple[float, Array] | None = None
        for look in range(LOOKS):
            began = perf_counter()
            looked = np.flatnonzero(~self.barriers.certain(now.rows, velocity, period, self._sure))
            ahead, then = now.q + period * velocity, now.time + period
            after = self._straight(self.barriers.evaluate(ahead, then, looked), looked, now.inside)
            near = self.barriers.nearness(ahead, then, now.inside)
            seconds += perf_counter() - began
            rows = np.append(looked, len(self._margins) + np.arange(len(near.value)))
            coming = self.barriers.coming[np.append(looked, now.near_pairs)]
            over = np.append(after.value, near.value) - floors[rows]
            fallen = over < -ROUNDING
            if not fallen.any():
                return velocity, Mode.CORRECTED if look else Mode.MOVING, True, seconds
            if not (fallen & ~coming).any() and (best is None or over.min() > best[0]):
                best = float(over.min()), velocity
            if look == LOOKS - 1:
                break
            gradient = np.concatenate([after.gradient, near.gradient])[fallen]
            wish = gradient @ velocity + (SPARE - over[fallen]) / period
            hold = np.where(coming[fallen], -np.inf, wish)
            wishes = wishes.with_rows(Wishes(gradient, wish, hold, np.full(len(wish), COMING)))
            corrected = best_velocity(hessian, linear, *box, wishes)
            if corrected is None:  # a crest, from where every way leads down: the joints that move these pairs stand
                moving = (gradient != 0.0).any(axis=0)
                box, wishes = (np.where(moving, 0.0, box[0]), np.where(moving, 0.0, box[1])), asked
                corrected = best_velocity(hessian, linear, *box, wishes)
            if corrected is None:
                break
            velocity = corrected
        return None if best is None else best[1], Mode.CORRECTED, False, seconds

    def _proven(self, velocity: Array, rows: BarrierRows, kept: bool) -> float | None:
        """Return the proven clearance over the period: that of its ends, less the way to the middle of it."""
        outer = rows.value[: self.barriers.obstacle_pairs]
        if self._clearance is None or not kept or self.barriers.movers or (outer < self.settings.margin).any():
            return None
        return self._clearance - 0.5 * self.settings.period * float(np.abs(velocity) @ self.barriers.levers)


class _Now(NamedTuple):
    """Robot and barriers at the start of a period."""

    q: Array  # (n,)
    time: float  # [s]
    rows: BarrierRows  # straight where they are inside their margins
    near: BarrierRows  # exact distances of the pairs inside their margins; none where those are not known
    inside: Rows  # those pairs

    @property
    def near_pairs(self) -> Rows:
        """The pairs of `near`."""
        return self.inside[: len(self.near.value)]


def _wished(matrix: Array, wish: Array, urgency: Array) -> Wishes:
    """Return rows that are wished; urgency (m,): of what comes, up to 1; 0 for what stands, which holds at least where
    it is."""
    coming = urgency > 0.0
    hold = np.where(coming, -np.inf, np.minimum(wish, 0.0))
    return Wishes(matrix, wish, hold, np.where(coming, COMING * urgency, RECOVERING))
