"""The paper's robot experiment: a Panda of boxes enters a corridor of three boxes, under three distances.

Section IV-C of the paper, with details from its published code: the corridor, the nine boxes of the links, start and
target, K = 0.4, regularization 0.01, η = 0.5, T = 0.01 s, 35 s, link pairs at least two joints apart. Text and code
differ in ε (1e-4; 9e-4), in how far the obstacles are grown (5e-2 "in all directions"; 5e-2 in total, half of it on
each side), and in how often an edge counts among the normals (once; four times): `VARIANTS` has them all. The paper's
task function is used unchanged. The controller is the published one, without any look-ahead.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_obstacle
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.control.barrier_safety import refuse_unsafe
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.control.barriers import Barriers
from hdplan.planner.control.controller import Controller, Step
from hdplan.planner.control.rollout import Run, fast_energy, simulate, total_variation
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.control.tasks import least_squares
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch, kinematics_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import read_only
from hdplan.scenes.poses import Pose, Vector3
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.targets import JointTarget

START = (1.0582, -1.3811, 0.3629, -1.9647, -0.959, 1.4881, -0.1534)  # [rad]
WALLS: dict[str, tuple[Vector3, Vector3]] = {  # centre and sides [m]
    "left wall": ((0.53, 0.16, 0.45), (0.35, 0.05, 0.9)),
    "right wall": ((0.53, -0.16, 0.45), (0.35, 0.05, 0.9)),
    "roof": ((0.53, 0.0, 0.925), (0.35, 0.35, 0.05)),
}
TARGET = read_only(np.array([[0.0, 0.0, 1.0, 0.64], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.75], [0.0, 0.0, 0.0, 1.0]]))
TOOL = 0.177  # [m] of the tool's frame along the last joint's axis, turned by −45° as the hand is
DURATION = 60.0  # [s]; the published run ends after 35 s
CRITICAL_PHASE = 5.0  # [s] the phase that the paper plots
REACHED_POSE = 0.02, 0.175  # [m] and [rad] within which the target counts as reached: the task creeps towards its end
JUMP = 0.02  # [m] in one period: a point of application that moves farther has jumped
SWEPT = 20.0  # [s] of the runs in which one setting is changed
EXACT_EVERY, MESH_EVERY = 0.02, 0.1  # [s] between exact distances of the boxes, and of the real meshes


@dataclass(frozen=True)
class Variant:
    """One setting of the experiment."""

    name: str
    settings: ControlSettings
    growth: float = 0.0  # of the obstacles' boxes on each side [m]

    @property
    def refused(self) -> str | None:
        """Why the controller would refuse the obstacles' barrier as provably not safe; None if it would not."""
        b, settings = self.settings.barriers, self.settings
        try:
            refuse_unsafe(
                b.distance, settings.margin, self.growth, b.gamma, b.shaping_length, b.normals, settings.rate,
                settings.period,
            )  # fmt: skip
        except InputError as error:
            return str(error)
        return None

    @property
    def clearance(self) -> float | None:
        """True clearance [m] to obstacles that Δ ≥ δ proves at a sample: a lower bound; None if nothing is proven."""
        return replace(self.settings, barriers=replace(self.settings.barriers, growth=self.growth)).clearance


def _hdsdf(name: str, epsilon: float, growth: float, normals: str) -> Variant:
    barriers = BarrierSettings("hdsdf-boxes", 2, epsilon**0.5, 0.0, 0.0, normals)
    return Variant(name, published(barriers, -5e-3, -1e-4), growth)


def published(barriers: BarrierSettings, margin: float, self_margin: float) -> ControlSettings:
    """Return the experiment's controller with these barriers and margins [m]."""
    return ControlSettings(barriers, margin, self_margin, 0.5, 0.01, look_ahead=False, as_published=True)


AS_SAFE = "HD-SDF, as safe"  # grown until it keeps the same clearance as the Euclidean run
VARIANTS = (
    Variant("Euclidean", published(BarrierSettings("euclidean", growth=0.0, self_growth=0.0), 0.03, 1e-4)),
    Variant("GDF", published(BarrierSettings("gdf", growth=0.0, self_growth=0.0), 2e-3, 1e-4)),
    _hdsdf("HD-SDF, code", 9e-4, 0.025, "paper-multiset"),
    _hdsdf(AS_SAFE, 1e-4, 0.033, "paper"),
    _hdsdf("HD-SDF, ε 9e-4, 2.5 cm", 9e-4, 0.025, "paper"),
    _hdsdf("HD-SDF, ε 1e-4, 2.5 cm", 1e-4, 0.025, "paper"),
    _hdsdf("HD-SDF, ε 9e-4, 5 cm", 9e-4, 0.05, "paper"),
    _hdsdf("HD-SDF, text", 1e-4, 0.05, "paper"),
)
NAMES = tuple(variant.name for variant in VARIANTS)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of one variant."""

    variant: Variant
    run: Run
    reached: float | None  # when the target was reached [s]
    clearances: Array  # exact distance of the links' boxes to the obstacles as they are, every EXACT_EVERY [m]
    between_links: Array  # the same between the links' boxes [m]
    mesh_clearance: float  # least exact distance of the real meshes to the obstacles [m]
    missing: float  # how far the tool is from its target at the end [m]
    way: float  # the farthest that any point of the robot can have moved in half a period [m]
    jumps: Array  # (N,) whether the point where the nearest pair's barrier acts jumped in this period

    def variation(self, seconds: float, joint: int | None = None) -> float:
        """Return the total variation [rad/s] of the commands up to `seconds`, of all joints or of one."""
        return total_variation(self._commands(seconds, joint))

    def energy(self, seconds: float, joint: int | None = None) -> float:
        """Return the energy above 5 Hz of the same [rad²/s]."""
        return fast_energy(self._commands(seconds, joint), self.run.period)

    def jump_rate(self, seconds: float) -> float:
        """Return the rate at which the point jumped [1/s], up to `seconds`."""
        return float(self.jumps[: round(seconds / self.run.period)].mean()) / self.run.period

    def _commands(self, seconds: float, joint: int | None) -> Array:
        commands = self.run.velocities[: round(seconds / self.run.period)]
        return commands if joint is None else commands[:, joint]


def sweep() -> tuple[tuple[str, Variant], ...]:
    """Return the variants with one setting changed, by name; the first is the base of all changes."""
    base = VARIANTS[NAMES.index("HD-SDF, ε 1e-4, 2.5 cm")]
    exact = VARIANTS[0]
    found = [("HD-SDF: η 0.5, δ −5 mm, shaping 1 cm, 100 Hz", base)]

    def add(words: str, variant: Variant, barriers: BarrierSettings | None = None, **changes: Any) -> None:
        settings = replace(variant.settings, barriers=barriers or variant.settings.barriers, **changes)
        found.append((words, replace(variant, settings=settings)))

    for rate in (2.0, 5.0, 20.0):
        add(f"η {rate:g} /s", base, rate=rate)
    for margin in (0.0, -1e-6, -1e-3, -2e-2, 5e-3):
        add(f"δ {margin * 1e3:g} mm", base, margin=margin)
    for length in (1e-3, 3e-3, 3e-2, 6e-2):
        add(f"shaping {length * 1e3:g} mm", base, replace(base.settings.barriers, shaping_length=length))
    for period in (1e-3, 0.05, 0.2):
        add(f"{1 / period:g} Hz", base, period=period)
    add("look-ahead", base, look_ahead=True)
    add("Euclidean: η 0.5, δ 30 mm, 100 Hz", exact)
    for rate in (2.0, 5.0, 20.0):
        add(f"Euclidean, η {rate:g} /s", exact, rate=rate)
    for period in (1e-3, 0.05, 0.2):
        add(f"Euclidean, {1 / period:g} Hz", exact, period=period)
    add("Euclidean, look-ahead", exact, look_ahead=True)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class AxesTask:
    """The published task: r = [p − p*; 1 − x*·x; 1 − y*·y; 1 − z*·z] → 0 by min ‖J_r u + K r‖² + λ ‖u‖²."""

    kinematics: Kinematics
    joint: int  # that carries the tool
    placement: Array  # (4, 4) of the tool in the joint's frame
    wanted: Array  # (4, 4) where it is to be
    gain: float = 0.4  # K [1/s]
    regularization: float = 0.01  # λ

    def objective(self, q: Array, time: float) -> tuple[Array, Array]:
        """The quadratic at q."""
        state = self.kinematics.evaluate(q)
        tool = self._placed(state)
        moved = self.kinematics.supports[self.joint][:, None]
        turning = state.angular[0] * moved
        linear = (state.linear[0] + np.cross(state.angular[0], tool[:3, 3])) * moved
        axes, wanted = tool[:3, :3].T, self.wanted[:3, :3].T  # one axis per row
        residual = np.append(tool[:3, 3] - self.wanted[:3, 3], 1.0 - np.einsum("ij,ij->i", axes, wanted))
        jacobian = np.vstack([linear.T, -np.cross(axes, wanted) @ turning.T])
        return least_squares(jacobian, -self.gain * residual, self.regularization)

    def at(self, q: Array) -> Array:
        """The tool's pose (4, 4)."""
        return self._placed(self.kinematics.evaluate(q))

    def _placed(self, state: KinematicsBatch) -> Array:
        pose = np.eye(4)
        pose[:3, :3] = state.rotations[0, self.joint]
        pose[:3, 3] = state.translations[0, self.joint]
        return np.asarray(pose @ self.placement)

    def met(self, q: Array, time: float) -> bool:
        """True if the tool is within REACHED_POSE of its target."""
        tool = self.at(q)
        cosine = (np.trace(tool[:3, :3].T @ self.wanted[:3, :3]) - 1.0) / 2.0
        angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return float(np.linalg.norm(tool[:3, 3] - self.wanted[:3, 3])) <= REACHED_POSE[0] and angle <= REACHED_POSE[1]


def corridor_scene() -> Scene:
    """Return the experiment as a scene: its start, and as its goal the start again, as the target is a pose."""
    locked = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    start, goal = JointTarget("start", START), JointTarget("goal", START)
    return Scene("corridor", Path("corridor"), RobotSpec("panda", locked=locked), _obstacles(0.0), start, goal)


def tool_task(robot: Robot) -> AxesTask:
    """Return the experiment's task: the published tool's frame at TARGET."""
    tool = np.eye(4)
    tool[:3, :3], tool[2, 3] = _turn_z(-np.pi / 4), TOOL
    return AxesTask(kinematics_of(robot), robot.n, tool, TARGET)


def run_variant(variant: Variant, duration: float = DURATION) -> Outcome:
    """Run one variant, and measure it with the exact distance along the way."""
    scene = corridor_scene()
    setup = Setup.of(scene)
    robot = setup.robot
    kinematics, bodies, self_pairs = kinematics_of(robot), link_boxes(), link_box_pairs()
    barriers = Barriers(robot, kinematics, bodies, self_pairs, _planes(variant.growth), variant.settings.barriers)
    exact = Barriers(robot, kinematics, bodies, self_pairs, _planes(0.0), VARIANTS[0].settings.barriers)
    task = tool_task(robot)
    certifier = Certifier(setup)
    watch = _Watch(barriers, exact, certifier, variant.settings.period)
    run = simulate(Controller(robot, barriers, variant.settings), np.array(START), task, duration, until_met=False,
                   watch=watch)  # fmt: skip
    missing = float(np.linalg.norm(task.at(run.positions[-1])[:3, 3] - TARGET[:3, 3]))
    return Outcome(
        variant, run, run.met, np.array(watch.clearances), np.array(watch.between), min(watch.meshes), missing,
        0.5 * run.period * float((np.abs(run.velocities) @ barriers.levers).max(initial=0.0)), np.array(watch.jumps),
    )  # fmt: skip


@dataclass
class _Watch:
    """Observes the periods of a run."""

    barriers: Barriers
    exact: Barriers
    certifier: Certifier
    period: float  # [s]
    clearances: list[float] = field(default_factory=list)
    between: list[float] = field(default_factory=list)
    meshes: list[float] = field(default_factory=list)
    jumps: list[bool] = field(default_factory=list)
    last: tuple[int, Array] | None = None  # the nearest pair, and where its barrier acts

    def __call__(self, time: float, q: Array, step: Step) -> None:
        """Observe one period."""
        outer, period = self.exact.obstacle_pairs, len(self.jumps)
        if period % max(1, round(EXACT_EVERY / self.period)) == 0:
            true = self.exact.evaluate(q).value
            self.clearances.append(float(true[:outer].min()))
            self.between.append(float(true[outer:].min()))
        if period % max(1, round(MESH_EVERY / self.period)) == 0:
            place = self.certifier.nearest(q)[0]
            assert place is not None  # there are obstacles
            self.meshes.append(place.distance)
        nearest = int(np.argmin(step.rows.value[:outer]))
        kinematics = self.barriers.kinematics.evaluate(q)
        wrench = self.barriers.groups[0].distance(kinematics, np.zeros(1, np.int64), np.array([nearest]))[1][0]
        force, torque = np.split(wrench, 2)
        square = float(force @ force)
        point = np.cross(force, torque) / square if square > 0 else np.zeros(3)  # of the line of action
        self.jumps.append(
            self.last is not None and self.last[0] == nearest and float(np.linalg.norm(point - self.last[1])) > JUMP
        )
        self.last = nearest, point


@functools.cache
def link_boxes() -> tuple[LinkBody, ...]:
    """Return the nine boxes of the published robot, in the frames of the Panda's joints. They do not contain the links'
    meshes: most are some 20 % narrower."""
    along, across = np.pi / 2, -np.pi / 4
    places = (  # joint; turn about x and way along x from its frame to the published one; then the box in that: way,
        # turn about x and about z; sides [m]
        (1, -along, 0.0, (0, 0, 0), 0, 0, (0.112, 0.112, 0.28)),
        (2, along, 0.0, (0, 0, 0.18), 0, 0, (0.1106, 0.1106, 0.25)),
        (3, along, 0.0825, (0, 0, 0), 0, 0, (0.1092, 0.1092, 0.24)),
        (4, -along, -0.0825, (0, 0, 0.13), 0, 0, (0.1092, 0.1092, 0.2)),
        (5, along, 0.0, (0, 0.28 - 0.383, -0.09), -along - 0.24, 0, (0.08, 0.05, 0.23)),
        (5, along, 0.0, (0, 0, -0.03), 0, 0, (0.102, 0.102, 0.198)),
        (6, along, 0.088, (0, 0, 0.02), 0, 0, (0.09, 0.09, 0.21)),
        (7, 0.0, 0.0, (0, 0, TOOL - 0.05), 0, across, (0.05, 0.21, 0.1)),
        (7, 0.0, 0.0, (0.03, 0.03, TOOL - 0.095), 0, 0, (0.1, 0.09, 0.034)),
    )
    bodies = []
    for joint, turn, way, position, about_x, about_z, sides in places:
        corners = ConvexBody.box(sides).vertices @ (_turn_x(about_x) @ _turn_z(about_z)).T + position
        corners = (corners + [way, 0.0, 0.0]) @ _turn_x(turn).T
        bodies.append(LinkBody(f"panda_link{joint}", joint, ConvexBody.from_points(corners)))
    return tuple(bodies)


def link_box_pairs() -> Sequence[tuple[int, int]]:
    """Return the pairs of boxes that must not collide: those at least two joints apart."""
    bodies = link_boxes()
    return [(a, b) for a in range(len(bodies)) for b in range(len(bodies)) if bodies[b].joint >= bodies[a].joint + 2]


def _obstacles(growth: float) -> tuple[Obstacle, ...]:
    return tuple(
        Obstacle(name, Box((x + 2 * growth, y + 2 * growth, z + 2 * growth)), Pose(centre))
        for name, (centre, (x, y, z)) in WALLS.items()
    )


def _planes(growth: float) -> list[HalfspaceBody]:
    return [piece for obstacle in _obstacles(growth) for piece in from_obstacle(obstacle)[0]]


def _turn_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _turn_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
