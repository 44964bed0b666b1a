"""A controller that avoids collisions: joint velocities from a quadratic program with control barrier functions.

In every period T it solves, for the joint velocity u (n,) [rad/s or m/s],

    minimize    ½ uᵀ H u + fᵀ u                     the task: least at the nominal velocity (`tasks`)
    subject to  ∂Δ_k/∂q · u + ∂Δ_k/∂t ≥ −η (Δ_k − δ_k)         for every pair of bodies k (`barriers`)
                −η (q − q_min) ≤ u ≤ η (q_max − q),  |u| ≤ v   joint limits as barriers, velocity limits

For obstacles that stand still, η is η / (1 − (D̃_k/R)²) while the separation D̃_k is less than the horizon R, and from
there on a pair has no row, so that only what is near is looked at. Δ_k ≥ δ_k is kept by any rate κ(q) ≥ 0 that is
bounded near Δ_k = δ_k, as Δ_k − δ_k falls no faster than exp(−∫κ dt) then; there D̃_k is far below R.

(paper, section IV-C; Ames et al., "Control barrier functions: theory and applications", ECC 2019).
If not all constraints can be met, the command is chosen by these priorities (`quadratic_program`):

1. The velocity limits; no joint moves further beyond a limit; and for static obstacles and self pairs, no Δ_k falls
   below δ_k, or falls at all where it is already below. Standing still satisfies all of this, so it is feasible.
2. Moving obstacles: their barriers are violated as little as possible, least where contact is nearest.
3. Pairs inside their margins and joints beyond their limits recover as the constraints above demand, or as fast as they
   can.

The step names the pairs whose barrier its command does not meet (`Step.gave`).

What the controller guarantees is derived in `barrier_safety`. The barrier's inequality is linear in u and holds at one
instant; over a period the distance is not linear. So each command is checked at its end: it is accepted only if every
Δ_k(q + u T) stays at or above δ_k, or at least does not fall if it is already below; otherwise the program is solved
again with the rows that fell linearized at that end, then with the joints held that move those pairs, and at last the
robot is stopped. Then, against static obstacles, Δ_k ≥ δ_k holds at every sample for all time once it holds at the
first, whatever the distance's kinks; standing still is always allowed. Below its margin Δ is of little use, as outer
bodies may overlap where the links do not: there the exact distance of the links' hulls is also kept from falling below
NEAR, by a barrier and by the same check. And there the HD-SDF's shaping is inverted (`barrier_safety.straightened`), as
it gives no direction on its flat spot. Against a moving obstacle standing still may not be enough: then the command
that is best at its end is taken.

Settings that are provably not safe are refused by name (`barrier_safety.refuse_unsafe`). Such a controller is not a
planner: it can get stuck short of its target, where no velocity leads on. A `Controller` has no state between its
steps, so threads may share one; a task may have a state (`follow.FollowTask`), and then belongs to one thread.
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
from hdplan.planner.robot.joint_limits import joint_limits, urdf_velocities
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.arrays import joint_numbers, quadratic
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.values import Number, checked, instance, require_fields

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

CHECKS = 4  # of a command's end, including the first
ROUNDING = 1e-12  # [m] by which a distance that must not fall may do so
SPARE = 1e-7  # [m] by which a corrected command should end above that: more than the program's tolerance
NEAR = 0.01  # [m] below which the exact distance of a pair that is inside its margin must not fall
MISSED = 1e-4  # [m/s] by which a barrier is violated before it is reported
COMING, RECOVERING = 1e3, 30.0  # prices of violations, for moving obstacles and for recovery to a margin [s/m or s]
FREE = 1e-9  # share of a rate that leaves no row a bound: in place of 0, so that numbers stay finite
SOON = 0.01  # [m] from a moving obstacle, below which its price is constant

require_fields(
    Scene,
    "robot obstacles attached self_collision limits "  # are kept; of the limits those of position and velocity
    "start goal path payload timing "  # are the task's, and are checked on the motion that was executed
    "planner from_request name source notes job",  # a job is refused by `Setup`
)


class Mode(Enum):
    """The outcome of a period."""

    MOVING = "moving"  # every barrier is met, the command is optimal
    CORRECTED = "corrected"  # the same, in place of a first command that would have ended too close
    GIVING_WAY = "giving way"  # not every barrier can be met: the best command; `Step.gave` lists those it violates
    STOPPED = "stopped"  # no command was found that stays far enough from static obstacles


@dataclass(frozen=True, eq=False)
class Step:
    """The command of one period."""

    velocity: Array  # (n,) u [rad/s or m/s]
    mode: Mode
    rows: BarrierRows  # Δ and its derivatives at the start of the period, of the pairs within the horizon
    pairs: Rows  # those pairs, rows of Barriers.names
    slack: float  # least Δ − δ there [m]; inf without pairs
    closest: int  # the pair with the least slack, a row of Barriers.names; −1 without pairs
    gave: tuple[int, ...]  # the pairs whose barrier the command does not meet, rows of Barriers.names
    proven: float | None
    """A lower bound of the true clearance from moving links to obstacles, over the whole period [m]; None: no proof.
    """
    distance_seconds: float
    program_seconds: float

    def __repr__(self) -> str:
        """Say what the command is, and how it came about."""
        command = ", ".join(f"{value:.3g}" for value in self.velocity)
        return f"<Step: {self.mode.value} at [{command}]>"

    @property
    def stopped(self) -> bool:
        """Whether the robot stands still for lack of a safe command."""
        return self.mode is Mode.STOPPED


class Controller:
    """Steps a robot toward a task, without collisions with obstacles or itself."""

    def __init__(
        self, robot: Robot, barriers: Barriers, settings: ControlSettings, limits: Array | None = None
    ) -> None:
        """Take the pairs; the settings' barriers must be those with which `barriers` were made. limits: (n,) the
        greatest speeds [rad/s or m/s], by default the URDF's. Raises InputError for invalid limits."""
        self.robot, self.barriers, self.settings = robot, barriers, settings
        count, outer = len(barriers.names), barriers.obstacle_pairs
        self._horizon = np.inf if settings.as_published else settings.horizon
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
        self._sure = np.where(np.arange(count) < outer, *sure)  # D̃ [m] above which Δ ≥ δ is certain
        if barriers.standing.any() and not self._horizon > sure[0]:
            raise InputError(
                f"control.horizon: {settings.horizon:g} m is too near for a margin of {settings.margin:g} m, more than "
                f"{sure[0]:.3g} m is needed"
            )
        self._clearance = barriers.clearance(settings.margin)
        given = urdf_velocities(robot) if limits is None else limits
        self.fastest = settings.speed * joint_numbers("limits", given, robot.joint_names, positive=True)  # (n,)

    def __repr__(self) -> str:
        """Say for which robot it is, and what it keeps apart."""
        return f"<Controller of {self.robot.name}: every {self.settings.period:g} s, {self.barriers!r}>"

    @property
    def assured(self) -> float | None:
        """Clearance [m] to obstacles proven at every time, at any speed within the limits, once Δ ≥ δ: that of the
        samples, less the farthest travel to the middle of a period; None without proof, 0 or less if it fails."""
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
        setup = Setup.of(scene, robot)
        scene, robot = setup.scene, setup.robot
        given = scene.limits if scene.limits.velocity is not None else replace(scene.limits, velocity="urdf")
        limits = joint_limits(derived(scene, limits=given), robot)["velocity"]
        return cls(robot, scene_barriers(scene, robot, settings.barriers), settings, limits)

    def step(self, q: Array, task: Task, time: float = 0.0) -> Step:
        """Return the command at configuration q (n,) and a time [s].

        Raises InputError, before anything is commanded, for a q, a time or a task's objective that is not finite or
        has a wrong shape.
        """
        q, time = joint_numbers("q", q, self.robot.joint_names), checked(Number(unit="s"), time, "time")
        began = perf_counter()
        seen = self.barriers.within(q, time, self._horizon)
        rows = self.barriers.evaluate(q, time, seen)
        slacks = rows.value - self._margins[seen]
        inside = seen[slacks < 0.0] if self.settings.look_ahead else np.empty(0, dtype=np.int64)
        near = self.barriers.nearness(q, time, inside)
        now = _Now(q, time, seen, self._straight(rows, seen, inside), near, inside)
        distances = perf_counter() - began
        hessian, linear = quadratic(task.objective(q, time), self.robot.joint_names)
        wishes = self._wishes(now)
        command = best_velocity(hessian, linear, *self._box(q), wishes)
        mode, kept = Mode.MOVING, False
        if command is not None and self.settings.look_ahead:
            command, mode, kept, checking = self._checked(command, now, hessian, linear, wishes)
            distances += checking
        velocity = np.zeros_like(q) if command is None else command
        pairs = np.append(seen, now.near_pairs)
        missed = (wishes.matrix @ velocity < wishes.wish - MISSED)[: len(pairs)]
        gave = tuple(sorted(set(pairs[missed].tolist())))
        if command is None:
            mode, kept = Mode.STOPPED, not self.barriers.movers
        elif gave:
            mode = Mode.GIVING_WAY
        closest = int(np.argmin(slacks)) if len(slacks) else -1  # a row of `seen`
        return Step(
            velocity,
            mode,
            rows,
            seen,
            float(slacks[closest]) if len(slacks) else np.inf,
            int(seen[closest]) if len(slacks) else -1,
            gave,
            self._proven(velocity, rows, seen, kept),
            distances,
            perf_counter() - began - distances,
        )

    def _box(self, q: Array) -> tuple[Array, Array]:
        """Return the least and greatest velocities (n,), which allow standing still even for joints beyond a limit."""
        rate, robot, fastest = self.settings.rate, self.robot, self.fastest
        return np.clip(rate * (robot.lower - q), -fastest, 0.0), np.clip(rate * (robot.upper - q), 0.0, fastest)

    def _straight(self, rows: BarrierRows, pairs: Rows, inside: Rows) -> BarrierRows:
        """Return the rows of `pairs`, ascending, with Δ of those inside their margins as u(Δ) − u(δ) + δ, where
        u is the separation before shaping: it grows with Δ and is δ where Δ is, but also has a slope on the flat spot.
        """
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
        """Return the rows: of all pairs, of those inside their margins, of joints beyond their limits."""
        rate, rows, near = self.settings.rate, now.rows, now.near
        drift = np.concatenate([rows.drift, near.drift])
        slack = np.concatenate([rows.value - self._margins[now.seen], np.maximum(near.value - NEAR, 0.0)])
        rates = np.append(self._rates(rows, now.seen), np.full(len(near.value), rate))
        wish = -rates * slack - drift
        gap = np.concatenate([rows.separation, near.value])
        coming = self.barriers.coming[np.append(now.seen, now.near_pairs)]
        beyond = np.maximum(now.q - self.robot.upper, self.robot.lower - now.q)  # [rad] or [m]
        joints = np.flatnonzero(beyond > 0.0)
        back = np.eye(len(beyond))[joints] * np.where(now.q > self.robot.upper, -1.0, 1.0)[joints, None]
        return _wished(
            np.concatenate([rows.gradient, near.gradient, back]),
            np.append(wish, np.minimum(rate * beyond, self.fastest)[joints]),
            np.append(np.where(coming, SOON / np.maximum(gap, SOON), 0.0), np.zeros(len(joints))),
        )

    def _checked(
        self, velocity: Array, now: _Now, hessian: Array, linear: Array, wishes: Wishes
    ) -> tuple[Array | None, Mode, bool, float]:
        """Return the command after checks of its end, or None; its mode; whether every Δ that was δ or more is proven
        to be so at that end; and the seconds spent on distances.

        If a pair ends below its floor, the program is solved again with that pair's row linearized at that end u₀ T,

            Δ(q + u₀ T) + T ∂Δ/∂q(q + u₀ T) · (u − u₀) ≥ floor,

        or, if that has no solution, with the joints held that move it.
        """
        period, seconds = self.settings.period, 0.0
        box, asked = self._box(now.q), wishes
        separation = np.full(len(self._margins), self._horizon)  # of what is not seen, at least
        separation[now.seen] = now.rows.separation
        floors = np.append(self._margins, np.minimum(now.near.value, NEAR))
        floors[now.seen] = np.minimum(now.rows.value, self._margins[now.seen])
        best: tuple[float, Array] | None = None
        for check in range(CHECKS):
            began = perf_counter()
            doubtful = np.flatnonzero(~self.barriers.certain(separation, velocity, period, self._sure))
            ahead, then = now.q + period * velocity, now.time + period
            after = self._straight(self.barriers.evaluate(ahead, then, doubtful), doubtful, now.inside)
            near = self.barriers.nearness(ahead, then, now.inside)
            seconds += perf_counter() - began
            rows = np.append(doubtful, len(self._margins) + np.arange(len(near.value)))
            coming = self.barriers.coming[np.append(doubtful, now.near_pairs)]
            over = np.append(after.value, near.value) - floors[rows]
            fallen = over < -ROUNDING
            if not fallen.any():
                return velocity, Mode.CORRECTED if check else Mode.MOVING, True, seconds
            if not (fallen & ~coming).any() and (best is None or over.min() > best[0]):
                best = float(over.min()), velocity
            if check == CHECKS - 1:
                break
            gradient = np.concatenate([after.gradient, near.gradient])[fallen]
            wish = gradient @ velocity + (SPARE - over[fallen]) / period
            hold = np.where(coming[fallen], -np.inf, wish)
            wishes = wishes.with_rows(Wishes(gradient, wish, hold, np.full(len(wish), COMING)))
            corrected = best_velocity(hessian, linear, *box, wishes)
            if corrected is None:  # a crest, from where every way leads down: hold the joints that move these pairs
                moving = (gradient != 0.0).any(axis=0)
                box, wishes = (np.where(moving, 0.0, box[0]), np.where(moving, 0.0, box[1])), asked
                corrected = best_velocity(hessian, linear, *box, wishes)
            if corrected is None:
                break
            velocity = corrected
        return None if best is None else best[1], Mode.CORRECTED, False, seconds

    def _rates(self, rows: BarrierRows, seen: Rows) -> Array:
        """Return the rate of each row [1/s]: η, and for what stands still as in the module's equation."""
        share = np.minimum(np.maximum(rows.separation, 0.0) / self._horizon, 1.0)
        return self.settings.rate / np.where(self.barriers.standing[seen], np.maximum(1.0 - share**2, FREE), 1.0)

    def _proven(self, velocity: Array, rows: BarrierRows, seen: Rows, kept: bool) -> float | None:
        """Return the proven clearance over the period: that at its ends, less the travel to its middle."""
        outer = rows.value[seen < self.barriers.obstacle_pairs]
        if self._clearance is None or not kept or self.barriers.movers or (outer < self.settings.margin).any():
            return None
        return self._clearance - 0.5 * self.settings.period * float(np.abs(velocity) @ self.barriers.levers)


class _Now(NamedTuple):
    """Robot and barriers at the start of a period."""

    q: Array  # (n,)
    time: float  # [s]
    seen: Rows  # pairs within the horizon
    rows: BarrierRows  # of these, straightened for pairs inside their margins
    near: BarrierRows  # exact distances of the pairs inside their margins; empty if not known
    inside: Rows  # those pairs

    @property
    def near_pairs(self) -> Rows:
        """The pairs of `near`."""
        return self.inside[: len(self.near.value)]


def _wished(matrix: Array, wish: Array, urgency: Array) -> Wishes:
    """Return the rows of the program; urgency (m,): up to 1 for moving obstacles; 0 for the rest, which at least must
    not get worse."""
    coming = urgency > 0.0
    hold = np.where(coming, -np.inf, np.minimum(wish, 0.0))
    return Wishes(matrix, wish, hold, np.where(coming, COMING * urgency, RECOVERING))
