"""A controller that keeps clear: joint velocities by a quadratic program with control barrier functions.

At every period T it solves, for the joint velocity u (n,) [rad/s or m/s],

    minimize    ½ uᵀ H u + fᵀ u                     the task: least at the nominal velocity (`control_tasks`)
    subject to  ∂Δ_k/∂q · u + ∂Δ_k/∂t ≥ −η (Δ_k − δ_k)         for every pair of bodies k (`barriers`)
                −η (q − q_min) ≤ u ≤ η (q_max − q),  |u| ≤ v   joint limits as barriers, velocity limits

(paper, section ``sec:real-experiment``; Ames et al., "Control barrier functions: theory and applications", ECC 2019).
Where the program has no solution the robot is stopped, u = 0, and the step says so.

What it guarantees is derived in `barrier_rules`. The barrier's inequality is linear in u and holds at one instant; over
a period the distance bends. So each command is looked at once more at its end: it is taken only if every Δ_k(q + u T)
stays at or above δ_k, or at least does not fall where it is below already; otherwise it is halved, and stopped at last.
Then Δ_k ≥ δ_k at every sample for all time once it holds at the first, whatever the distance's kinks, against obstacles
that stand; standing still is always allowed. Below its margin Δ says too little, as outer bodies may overlap where the
links do not: there the exact distance of the links' hulls is kept from falling below NEAR as well, by a barrier and by
the same look. Against an obstacle that moves, standing still may not be enough: then the command that is best at its
end is taken, and the step says that it gives way.

Settings that are provably not safe are refused by name (`barrier_rules.refuse_unsafe`). A controller like this is no
planner: it can come to rest where no velocity brings it on, short of its target.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from time import perf_counter

import daqp
import numpy as np
from numpy.typing import NDArray

from hdplan.planner.barrier_rules import guaranteed_clearance, refuse_unsafe
from hdplan.planner.barriers import BarrierRows, Barriers, BarrierSettings, scene_barriers
from hdplan.planner.control_tasks import Task
from hdplan.planner.joint_limits import velocity_limits
from hdplan.planner.robot import Robot
from hdplan.planner.scene_robot import load_scene_robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.model import Scene

Array = NDArray[np.float64]

SHARES = (1.0, 0.5, 0.25, 0.0)  # of a command that are tried in turn
ROUNDING = 1e-12  # [m] granted to a distance that may not fall
NEAR = 0.01  # [m] below which the exact distance of a pair that is inside its margin may not fall
VANISHED = 1e-12  # a gradient shorter than this is none: no velocity changes that distance
UNBOUNDED = 1e30  # DAQP's infinity
SOLVED = (1, 2)  # DAQP's exit flags of a solution, exact or to its tolerance


class Mode(Enum):
    """What became of a period."""

    MOVING = "moving"  # the command is the program's
    SHORTENED = "shortened"  # a part of it: the whole would have come too close
    INFEASIBLE = "infeasible"  # stopped: no velocity meets all barriers
    STOPPED = "stopped"  # no part of the command keeps every distance
    GIVING_WAY = "giving way"  # an obstacle comes, and no command keeps every distance: the best one


MODES = {share: Mode.SHORTENED for share in SHARES} | {1.0: Mode.MOVING, 0.0: Mode.STOPPED}


STANDING = (Mode.INFEASIBLE, Mode.STOPPED)  # for lack of a safe command


@dataclass(frozen=True)
class ControlSettings:
    """How a controller works."""

    barriers: BarrierSettings = field(default_factory=BarrierSettings)
    margin: float = -2.5e-4  # δ between robot and obstacles [m]: where the barrier stops
    self_margin: float = -2.5e-4  # the same between links [m]
    rate: float = 2.0  # η: how fast a barrier may be approached, the part per second [1/s]
    period: float = 0.005  # T: commands are held as long [s]
    speed: float = 1.0  # share of the robot's velocity limits that is used
    look_ahead: bool = True  # whether commands are looked at once more at their end
    as_published: bool = False  # takes settings that are provably not safe, to show what they do

    def __post_init__(self) -> None:
        """Refuse, by name, what is out of range and what is provably not safe."""
        for name, low, high in (("rate", 0.0, 1e3), ("period", 0.0, 1.0), ("speed", 0.0, 1.0)):
            if not low < getattr(self, name) <= high:
                raise InputError(f"control.{name}: found {getattr(self, name):g}, allowed is up to {high:g}, above 0")
        for name in ("margin", "self_margin"):
            if not np.isfinite(getattr(self, name)):
                raise InputError(f"control.{name}: found {getattr(self, name)}, allowed is a finite length")
        if not self.as_published:
            self.refuse_unsafe()

    def refuse_unsafe(self) -> None:
        """Raise InputError for settings that are provably not safe."""
        b = self.barriers
        for margin, growth in ((self.margin, b.growth), (self.self_margin, b.self_growth)):
            refuse_unsafe(b.distance, margin, growth, b.gamma, b.shaping_length, b.normals, self.rate, self.period)

    @property
    def clearance(self) -> float | None:
        """True clearance [m] to obstacles that Δ ≥ δ proves at a sample; None if nothing is proven."""
        return self._proven(self.margin, self.barriers.growth)

    @property
    def self_clearance(self) -> float | None:
        """The same between links."""
        return self._proven(self.self_margin, self.barriers.self_growth)

    def _proven(self, margin: float, growth: float) -> float | None:
        b = self.barriers
        return guaranteed_clearance(b.distance, margin, growth, b.gamma, b.shaping_length, b.normals)


@dataclass(frozen=True, eq=False)
class Step:
    """The command of one period."""

    velocity: Array  # (n,) u [rad/s or m/s]
    mode: Mode
    rows: BarrierRows  # Δ and its derivatives at the start of the period
    slack: float  # least Δ − δ there [m]; inf without pairs
    closest: int  # the pair of the least, a row of Barriers.names; −1 without pairs
    proven: float | None  # a lower bound of the true clearance to obstacles over the whole period [m]; None: no proof
    distance_seconds: float
    program_seconds: float

    @property
    def stopped(self) -> bool:
        """Whether the robot stands for lack of a safe command."""
        return self.mode in STANDING


class Controller:
    """Steps a robot toward a task, clear of obstacles and of itself."""

    def __init__(
        self, robot: Robot, barriers: Barriers, settings: ControlSettings, limits: Array | None = None
    ) -> None:
        """Take the pairs; settings' barriers must be those that `barriers` were laid out with. limits: (n,) the
        greatest speeds [rad/s or m/s], by default the URDF's."""
        self.robot, self.barriers, self.settings = robot, barriers, settings
        count, outer = len(barriers.names), barriers.obstacle_pairs
        self._margins = np.where(np.arange(count) < outer, settings.margin, settings.self_margin)
        self._clearance = settings.clearance
        self.fastest = settings.speed * (np.array(robot.model.velocityLimit) if limits is None else limits)  # (n,)

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
        settings, robot = settings or ControlSettings(), robot or load_scene_robot(scene)
        given = scene.limits if scene.limits.velocity is not None else replace(scene.limits, velocity="urdf")
        limits = velocity_limits(replace(scene, limits=given), robot)
        return cls(robot, scene_barriers(scene, robot, settings.barriers), settings, limits)

    def step(self, q: Array, task: Task, time: float = 0.0) -> Step:
        """Return the command at configuration q (n,) and a time [s]."""
        began = perf_counter()
        rows = self.barriers.evaluate(q, time)
        slacks = rows.value - self._margins
        inside = np.flatnonzero(slacks < 0.0) if self.settings.look_ahead else np.empty(0, dtype=np.int64)
        near = self.barriers.nearness(q, time, inside)
        measured = perf_counter() - began
        began = perf_counter()
        wanted = self._program(q, rows, near, task, time)
        solved = perf_counter() - began
        began = perf_counter()
        velocity, mode, kept = self._looked_at(q, wanted, rows, near, inside, time)
        closest = int(np.argmin(slacks)) if len(slacks) else -1
        return Step(
            velocity,
            mode,
            rows,
            float(slacks[closest]) if len(slacks) else np.inf,
            closest,
            self._proven(velocity, rows, kept),
            measured + perf_counter() - began,
            solved,
        )

    def _program(self, q: Array, rows: BarrierRows, near: BarrierRows, task: Task, time: float) -> Array | None:
        """Return the solution of the quadratic program (n,), or None if there is none.

        By DAQP, a dual active-set solver: for 7 joints, bounds and 60 rows it took 0.02 ms where quadprog took 0.04,
        PIQP 0.11, ProxQP 0.47 and OSQP 1.6 (benchmarks/control.py), with quadprog's answers to 1e-13.
        """
        settings, robot = self.settings, self.robot
        lower = np.maximum(-self.fastest, -settings.rate * (q - robot.lower))
        upper = np.minimum(self.fastest, settings.rate * (robot.upper - q))
        bound = np.concatenate(
            [
                -settings.rate * (rows.value - self._margins) - rows.drift,
                -settings.rate * np.maximum(near.value - NEAR, 0.0) - near.drift,
            ]
        )
        gradient = np.concatenate([rows.gradient, near.gradient])
        length = np.linalg.norm(gradient, axis=1)
        # a row that no velocity within the limits can break is left out: exact, and most are
        least = np.minimum(gradient * lower, gradient * upper).sum(axis=1)
        kept = (least < bound) & (length > VANISHED)
        matrix = gradient[kept] / length[kept, None]  # the solver's tolerance then means the same for all
        hessian, linear = task.objective(q, time)
        if np.any(lower > upper):
            return None
        solution, _, flag, _ = daqp.solve(
            hessian,
            linear,
            np.ascontiguousarray(matrix),
            np.concatenate([upper, np.full(len(matrix), UNBOUNDED)]),
            np.concatenate([lower, bound[kept] / length[kept]]),
            np.zeros(len(lower) + len(matrix), dtype=np.int32),
        )
        return np.array(solution) if flag in SOLVED else None

    def _looked_at(
        self,
        q: Array,
        wanted: Array | None,
        rows: BarrierRows,
        near: BarrierRows,
        inside: NDArray[np.int64],
        time: float,
    ) -> tuple[Array, Mode, bool]:
        """Return what is commanded of the program's solution, and whether every Δ that was δ or more still is at its
        end, as far as that was looked at."""
        nothing = np.zeros_like(q)
        if wanted is None:
            return nothing, Mode.INFEASIBLE, not self.barriers.movers
        if not self.settings.look_ahead:
            return wanted, Mode.MOVING, False
        period, floor = self.settings.period, np.minimum(rows.value, self._margins) - ROUNDING
        certain = self.barriers.certain(rows, wanted, period) & (floor <= 0.0)
        looked = np.flatnonzero(~certain)
        tried: list[tuple[float, Array]] = []
        for share in SHARES:
            if share == 0.0 and not self.barriers.movers:
                return nothing, Mode.STOPPED, True  # nothing changes
            velocity = share * wanted
            ahead, then = q + period * velocity, time + period
            after = self.barriers.evaluate(ahead, then, looked)
            worst = float(np.min(after.value - floor[looked], initial=np.inf))
            if len(near.value):
                least = np.minimum(near.value, NEAR) - ROUNDING
                worst = min(worst, float(np.min(self.barriers.nearness(ahead, then, inside).value - least)))
            tried.append((worst, velocity))
            if worst >= 0.0:
                return velocity, MODES[share], True
        return max(tried, key=lambda each: each[0])[1], Mode.GIVING_WAY, False

    def _proven(self, velocity: Array, rows: BarrierRows, kept: bool) -> float | None:
        """Return the proven clearance over the period: that of its ends, less the way to the middle of it."""
        outer = rows.value[: self.barriers.obstacle_pairs]
        if self._clearance is None or not kept or self.barriers.movers or (outer < self.settings.margin).any():
            return None
        return self._clearance - 0.5 * self.settings.period * float(np.abs(velocity) @ self.barriers.levers)
