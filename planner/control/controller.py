"""A controller that avoids collisions: joint velocities from a quadratic program with control barrier functions.

In every period T it solves, for the joint velocity u (n,) [rad/s or m/s],

    minimize    ½ uᵀ H u + fᵀ u                     the task: least at the nominal velocity (`tasks`)
    subject to  a row for every pair of bodies       barriers (`program_rows`)
                low ≤ u ≤ high                      joint limits, limits of velocity, acceleration and jerk (`window`)

(paper, section IV-C; Ames et al., "Control barrier functions: theory and applications", ECC 2019). The barriers are
those of the places where the robot can come to rest: the last command is an argument of `step`, and how the robot
brakes from it is known (`braking`). Where the robot is, the paper's rows are kept as well,
∂Δ/∂q · u + ∂Δ/∂t ≥ −η (Δ − δ). These guide: their rate is a tenth of that of the others, so that they are felt first,
and they are as smooth as the distance, whereas the others depend on how each joint brakes.

For static obstacles η is η / (1 − (D̃_k/R)²) while the separation D̃_k is less than the horizon R, and from
there on a pair has no row, so that only near pairs are examined. Δ_k ≥ δ_k is kept by any rate κ(q) ≥ 0 that is
bounded near Δ_k = δ_k, as Δ_k − δ_k falls no faster than exp(−∫κ dt) then; there D̃_k is far below R.

If not all constraints can be met, the command is chosen by these priorities (`quadratic_program`):

1. The limits of velocity, acceleration and jerk; no joint comes to rest further beyond a limit; and for static
   obstacles and self pairs, no Δ_k falls below δ_k, or below what it is already bound to be. Braking satisfies all of
   this, so it is feasible. Links that overlap with obstacles are exempt where nothing moves (`sight`).
2. Moving obstacles: their barriers are violated as little as possible, least where contact is nearest.
3. Pairs inside their margins and joints beyond their limits recover as the constraints above demand, or as fast as they
   can.

The step names the pairs whose barrier its command does not meet (`Step.gave`).

What the controller guarantees is derived in `barrier_safety`. The barrier's inequality is linear in u and holds at one
instant, so each command is checked on its whole way to rest (`look_ahead`). Then, against static obstacles, Δ_k ≥ δ_k
holds at every sample for all time once it holds on the way to rest of the first, whatever the distance's kinks.
Inside a margin the HD-SDF's shaping is inverted (`barrier_safety.straightened`), as it gives no direction on its flat
spot. Against a moving obstacle braking may not be enough: then the command that is best is taken.

Settings that are provably not safe are refused by name (`barrier_safety.refuse_unsafe`). Such a controller is not a
planner: it can get stuck short of its target, where no velocity leads closer. A `Controller` has no state between its
steps, so threads may share one; a task may have a state (`follow.FollowTask`), and then belongs to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.control.barriers import Barriers, setup_barriers
from hdplan.planner.control.braking import MOST_PERIODS, Command, Rates
from hdplan.planner.control.look_ahead import LookAhead, Mode
from hdplan.planner.control.moment import BarrierRows
from hdplan.planner.control.program_rows import joint_constraints, pair_constraints
from hdplan.planner.control.quadratic_program import SoftConstraints, best_velocity
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.control.sight import Seen, Sight
from hdplan.planner.control.tasks import Ranked, Task, together
from hdplan.planner.control.window import Window
from hdplan.planner.robot.joint_limits import DERIVATIVES, joint_limits, urdf_velocities
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.arrays import joint_numbers, quadratic
from hdplan.scenes.attached import Attached
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle, Seen as SeenShape, obstacles_of
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.shapes import Solid
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import Number, checked, instance, is_row, require_fields, wrong

FARTHEST_JOINT = 8.0 * np.pi  # [rad] or [m] up to which joints without limits are taken to count
MISSED_BARRIER = 1e-4  # [m/s] by which a barrier is violated before it is reported

require_fields(
    Scene,
    "robot obstacles attached self_collision limits "  # are kept; of the limits not those of torque
    "start goal path payload timing "  # are the task's, and are checked on the motion that was executed
    "planner from_request name source notes job",  # a job is refused by `Setup`
)


@dataclass(frozen=True, eq=False)
class Step:
    """The command of one period."""

    velocity: Array  # (n,) u [rad/s or m/s]
    acceleration: Array  # (n,) from the last command to this one [rad/s² or m/s²]
    mode: Mode
    rows: BarrierRows  # Δ and its derivatives at the start of the period, of the pairs within the horizon
    pairs: Rows  # those pairs, rows of Barriers.names
    slack: float  # least Δ − δ there [m]; inf without pairs
    closest: int  # the pair with the least slack, a row of Barriers.names; −1 without pairs
    gave: tuple[int, ...]  # the pairs whose barrier the command does not meet, rows of Barriers.names
    overlapping: tuple[int, ...]  # the pairs whose hulls overlap on the way on which the robot brakes, rows of the same
    proven: float | None
    """A lower bound of the true clearance from moving links to obstacles, and from fixed links to moving obstacles,
    over the whole period [m]; None: no proof.
    """
    distance_seconds: float
    program_seconds: float

    def __repr__(self) -> str:
        """Describe the command and its origin."""
        command = ", ".join(f"{value:.3g}" for value in self.velocity)
        return f"<Step: {self.mode.value} at [{command}]>"

    @property
    def stopped(self) -> bool:
        """True if the robot brakes for lack of a safe command."""
        return self.mode is Mode.STOPPED

    @property
    def command(self) -> Command:
        """The state that the next step needs."""
        return Command(self.velocity, self.acceleration)


class Controller:
    """Steps a robot toward a task, without collisions with obstacles or itself."""

    def __init__(
        self,
        robot: Robot,
        barriers: Barriers,
        settings: ControlSettings,
        limits: Mapping[str, Array] | None = None,
        setup: Setup | None = None,
    ) -> None:
        """Take the pairs; the settings' barriers must be those with which `barriers` were made. limits: the greatest
        velocity, acceleration and jerk (n,), by name; `braking.Rates.of` replaces missing ones; the velocity
        is the URDF's by default. setup: whose pairs they are, for `update`. Raises InputError for invalid limits, and
        for limits from which joints brake for more than `braking.MOST_PERIODS`."""
        self.robot, self.barriers, self.settings = robot, barriers, settings
        self.setup, self._limits = setup, limits
        self.sight = Sight(barriers, settings)
        self._clearance = barriers.clearance(settings.margin)
        found = {"velocity": urdf_velocities(robot), **(limits or {})}
        found = {
            name: joint_numbers(f"limits.{name}", found[name], robot.joint_names, positive=True)
            for name in DERIVATIVES.keys() & found.keys()
        }
        found["velocity"] = settings.speed * found["velocity"]
        farthest = np.maximum(np.abs(robot.inner[0]), np.abs(robot.inner[1]))
        rise = 0.0 if settings.as_published else settings.rise
        self.rates = Rates.of(found, settings.period, rise, np.minimum(farthest, FARTHEST_JOINT))
        try:
            self.rates.braked(self.rates.velocity, np.zeros(robot.n))
        except InputError:
            raise InputError(
                f"control.period: {settings.period:g} s is too short for these limits of acceleration and jerk: from "
                f"full speed joints brake for more than {MOST_PERIODS} periods"
            ) from None

    def __repr__(self) -> str:
        """Return its robot and the number of its pairs, for display."""
        return f"<Controller of {self.robot.name}: every {self.settings.period:g} s, {self.barriers!r}>"

    @property
    def assured(self) -> float | None:
        """Clearance [m] to obstacles proven at every time, at any speed within the limits, once Δ ≥ δ: that of the
        samples, less the farthest travel to the middle of a period; None without proof, 0 or less if it fails."""
        clearance = self._clearance
        if clearance is None or not self.settings.look_ahead or len(self.barriers.movers):
            return None
        return clearance - 0.5 * self.settings.period * float(self.rates.velocity @ self.barriers.levers)

    @classmethod
    def of(cls, scene: Scene, settings: ControlSettings | None = None, robot: Robot | None = None) -> Controller:
        """Return the controller of a scene. Raises InputError as `scene_barriers`, for the scene's robot, and for a
        joint that neither scene nor URDF gives a speed limit."""
        settings = ControlSettings() if settings is None else settings
        instance(settings, ControlSettings, "settings")
        setup = Setup.of(scene, robot)
        scene, robot = setup.scene, setup.robot
        given = scene.limits if scene.limits.velocity is not None else replace(scene.limits, velocity="urdf")
        limits = joint_limits(derived(scene, limits=replace(given, torque=None)), robot)
        return cls(robot, setup_barriers(setup, settings.barriers), settings, limits, setup)

    def update(
        self,
        obstacles: Sequence[Obstacle | Solid | SeenShape] | None = None,
        attached: Sequence[Attached] | None = None,
        q: ArrayLike | None = None,
    ) -> Controller:
        """Return the controller of the same robot in an updated world: other obstacles (clouds, moving ones with their
        measured velocities), or other held objects; None: as before. The last command remains valid. q (n,): the
        robot's configuration at that moment, around which clouds leave points out (`Cloud.ignore_robot`).

        Raises InputError for a controller that was not made of a scene, for a cloud that needs q if there is none, and
        for all reasons of `Controller.of`.
        """
        if self.setup is None:
            raise InputError("update: this controller was not made of a scene; use Controller.of")
        requested = self.setup.requested
        if obstacles is None:
            world = tuple(map(_as_left, requested.obstacles))
        else:
            world = checked(obstacles_of, obstacles, "obstacles")
            around = [each.name for each in world if _as_left(each) is not each]
            if around and q is None:
                raise InputError(f"q: is needed: cloud '{around[0]}' leaves out points around the robot")
        requested = derived(requested, obstacles=world)
        if q is not None:
            at = joint_numbers("q", q, self.robot.joint_names)
            requested = derived(requested, start=JointTarget("q", tuple(at.tolist())))
        if attached is not None:  # the robot carries something else: its links' bodies are others
            if not is_row(attached):
                raise wrong("a list of held objects", attached).within("attached")
            return Controller.of(derived(requested, attached=tuple(attached)), self.settings)
        setup = self.setup.seeing(requested)
        barriers = setup_barriers(setup, self.settings.barriers, self.barriers.hulls)
        return Controller(self.robot, barriers, self.settings, self._limits, setup)

    def step(
        self, q: Array, task: Task | Sequence[Task | Ranked], time: float = 0.0, last: Command | None = None
    ) -> Step:
        """Return the command at configuration q (n,) and a time [s], after the last command: that of the previous step
        (`Step.command`), or the measured state of a moving robot; at rest by default. For several tasks see
        `tasks.together`.

        Raises InputError, before anything is commanded, for a q, a time, a command or a task's objective that is not
        finite or has a wrong shape, and for a last command from which joints brake for more than
        `braking.MOST_PERIODS`.
        """
        joints = self.robot.joint_names
        q, time = joint_numbers("q", q, joints), checked(Number(unit="s"), time, "time")
        began = perf_counter()
        window = self.window(q, last)
        seen = self.sight.look(window, time)
        constraints = self._constraints(window, seen)
        distances = perf_counter() - began
        hessian, linear = quadratic(together(task).objective(q, time), joints)
        command = best_velocity(hessian, linear, *window.box, constraints)
        velocity = window.brake[0] if command is None else command
        mode, kept = Mode.STOPPED if command is None else Mode.MOVING, False
        if self.settings.look_ahead:
            checking = perf_counter()
            ahead = LookAhead(self.sight, window, time, seen)
            velocity, mode, kept = ahead.checked(velocity, hessian, linear, constraints)
            distances += perf_counter() - checking
        pairs = np.concatenate([constraint.pairs for constraint in seen.constraints])
        missed = (constraints.matrix @ velocity < constraints.target - MISSED_BARRIER)[: len(pairs)]
        gave = tuple(sorted(set(pairs[missed].tolist())))
        if gave and mode is not Mode.STOPPED:
            mode = Mode.GIVING_WAY
        slacks = seen.here.value - self.sight.margins[seen.pairs]
        closest = int(np.argmin(slacks)) if len(slacks) else -1  # a row of `pairs`
        return Step(
            velocity,
            (velocity - window.last.velocity) / self.settings.period,
            mode,
            seen.here,
            seen.pairs,
            float(slacks[closest]) if len(slacks) else np.inf,
            int(seen.pairs[closest]) if len(slacks) else -1,
            gave,
            tuple(np.flatnonzero(seen.near < 0.0).tolist()),
            self._proven(velocity, seen, kept, time),
            distances,
            perf_counter() - began - distances,
        )

    def window(self, q: Array, last: Command | None) -> Window:
        """Return the velocities of the next period from which every joint can brake within its limits."""
        joints = self.robot.joint_names
        if last is None:
            last = Command.rest(len(q))
        else:
            instance(last, Command, "last")
            last = Command(
                joint_numbers("last.velocity", last.velocity, joints),
                joint_numbers("last.acceleration", last.acceleration, joints),
            )
        return Window(q, last, self.rates, self.robot.lower, self.robot.upper, self.settings.rate)

    def _constraints(self, window: Window, seen: Seen) -> SoftConstraints:
        """Return the rows: of pairs where the robot comes to rest, and here, and of joints beyond limits."""
        robot, coming = self.robot, self.barriers.coming
        base, here = window.brake[0], np.ones(robot.n)
        gains = window.gains[min(max(len(window.stopping) - 2, 0), len(window.gains) - 1)]
        rows = [pair_constraints(each, gains, base, coming[each.pairs]) for each in seen.constraints]
        rows.append(pair_constraints(seen.approach, here, np.zeros(robot.n), coming[seen.approach.pairs]))
        beyond = np.maximum(window.q - robot.upper, robot.lower - window.q)  # [rad] or [m]
        rows.append(joint_constraints(self.settings.rate * beyond, window.q > robot.upper, self.rates.velocity, base))
        return reduce(SoftConstraints.with_rows, rows)

    def _proven(self, velocity: Array, seen: Seen, kept: bool, time: float) -> float | None:
        """Return the proven clearance over the period: that at its ends, less the travel to its middle."""
        outer, margin = seen.pairs < self.barriers.obstacle_pairs, self.settings.margin
        if self._clearance is None or not kept or (seen.here.value[outer] < margin).any():
            return None
        ends = time + np.array([0.0, self.settings.period])
        if self.barriers.of_fixed_links(ends, self.sight.needed[0]) < margin:
            return None
        speed = float(np.abs(velocity) @ self.barriers.levers) + self.barriers.obstacle_speed
        return self._clearance - 0.5 * self.settings.period * speed


def _as_left(obstacle: Obstacle) -> Obstacle:
    """Return a cloud that leaves out points around links or others as it is once they are left out; itself if not."""
    shape = obstacle.shape
    if not isinstance(shape, Cloud) or not (shape.ignore_robot > 0.0 or shape.ignore):
        return obstacle
    return replace(obstacle, shape=replace(shape, ignore_robot=0.0, ignore=()))
