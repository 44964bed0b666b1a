"""Task and answer of every planner of `peers`, and how long and how smooth a path is."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
import pinocchio as pin
from problems import LIMITS, with_pose_goal

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.exact_proximity import Piece, link_pieces, obstacle_pieces
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from hdplan.scenes.scene import Scene

MARGIN = 0.005  # [m] that the peers keep, since they look at samples alone
ENDS_KEEP = 0.5  # share of the ends' distance that they keep where that is less
PIECES = (31, 63, 127, 255)  # equal joint-space steps of a path that is timed: hdplan's own, and finer
STEPS = 31  # equal joint-space steps of a path whose smoothness is measured: as many as hdplan's own by default


@dataclass(frozen=True)
class Body:
    """A convex body: a piece of a link or of an obstacle."""

    name: str  # unique
    piece: Piece
    joint: int  # index of the joint of the robot's model that carries it, 0: fixed to the world
    pose: Array  # (4, 4) in that joint's frame, or in the world


@dataclass(frozen=True, eq=False)
class Task:
    """One problem, the same for all planners."""

    scene: Scene
    robot: Robot
    start: Array  # (n,) joint values
    goal: Array  # (n,); with a pose as the goal, one configuration that reaches it, which no planner gets
    hand: str | None  # the link whose pose is the goal; None: the goal is `goal`
    bodies: tuple[Body, ...]  # convex hulls of the links' and the obstacles' pieces
    pairs: tuple[tuple[int, int], ...]  # of bodies, by index, that must stay apart: that the certificate compares

    @classmethod
    def of(cls, scene: Scene, hand: str | None = None) -> Task:
        """Load the scene's robot and list the bodies; with a hand, its pose at the goal is the goal. Raises
        InputError."""
        robot = load_scene_robot(scene)
        setup = Setup.of(scene, robot)
        query = setup.query
        bodies: list[Body] = []
        links: dict[str, list[int]] = {}
        for link, geometries in robot.link_geometry.items():
            for item in (robot.collision.geometryObjects[index] for index in geometries):
                for piece in link_pieces(item.geometry, item.name):
                    links.setdefault(link, []).append(len(bodies))
                    name = f"{item.name}/{len(bodies)}"
                    bodies.append(Body(name, piece, int(item.parentJoint), item.placement.homogeneous))
        own = len(bodies)
        for obstacle in setup.scene.obstacles:
            for piece in obstacle_pieces(obstacle):
                bodies.append(Body(f"{obstacle.name}/{len(bodies)}", piece, 0, obstacle.pose.matrix))
        pairs = [(a, b) for a, b in product(range(own), range(own, len(bodies))) if bodies[a].joint]
        pairs += [pair for a, b in robot.self_pairs for pair in product(links[a], links[b])]
        requested = with_pose_goal(scene, hand) if hand else scene
        return cls(requested, robot, query.start, query.goal, hand, tuple(bodies), tuple(pairs))

    @cached_property
    def certifier(self) -> Certifier:
        """The judge of paths: the continuous certificate, with the real meshes."""
        return Certifier(Setup.of(self.scene, self.robot))

    @cached_property
    def timed_scene(self) -> Scene:
        """The scene within LIMITS."""
        return dataclasses.replace(self.scene, limits=LIMITS)

    @cached_property
    def timed_certifier(self) -> Certifier:
        """The judge of motions, who proves the limits too."""
        return Certifier(Setup.of(self.timed_scene, self.robot))

    def timed(self, path: Array) -> Trajectory | None:
        """Return the fastest certified motion along a path (N, n), by hdplan's own retiming; None without any.

        That takes a path's waypoints for the control points of a B-spline, which rounds the corners, the more the
        farther they are apart: so the path is cut into PIECES equal steps, few or many.
        """
        best: Trajectory | None = None
        shortest = np.inf
        retimer = Retimer(Setup.of(self.timed_scene, self.robot))
        for steps in PIECES:
            try:
                motion = retimer(Trajectory(self.robot.joint_names, evenly(path, steps))).trajectory
            except hdplan.HdplanError:
                continue
            duration = np.inf if motion.duration is None else motion.duration
            if duration >= shortest:
                continue
            if self.timed_certifier.certify(motion).certified:
                best, shortest = motion, duration
        return best

    @cached_property
    def margin(self) -> float:
        """Distance [m] that the peers keep between the bodies of every pair."""
        model, data = self.robot.model, self.robot.model.createData()
        geometry = self.geometry()
        found = pin.GeometryData(geometry)
        closest = MARGIN / ENDS_KEEP
        for q in self.robot.pin_q(np.stack([self.start, self.goal])):
            pin.computeDistances(model, data, geometry, found, q)
            closest = min(closest, *(result.min_distance for result in found.distanceResults))
        return max(0.0, ENDS_KEEP * closest)

    @property
    def lower(self) -> Array:
        """Lower joint limits (n,), widened to the ends, which may lie beyond by rounding; of a joint that turns for
        ever, half a turn beyond the ends."""
        ends = np.minimum(self.start, self.goal)
        return np.where(np.isinf(self.robot.lower), ends - np.pi, np.minimum(self.robot.lower, ends))

    @property
    def upper(self) -> Array:
        """Upper joint limits (n,), likewise."""
        ends = np.maximum(self.start, self.goal)
        return np.where(np.isinf(self.robot.upper), ends + np.pi, np.maximum(self.robot.upper, ends))

    @property
    def excused(self) -> list[tuple[int, int]]:
        """The pairs of bodies that may touch: all that are not in `pairs`."""
        kept = {frozenset(pair) for pair in self.pairs}
        return [pair for pair in combinations(range(len(self.bodies)), 2) if frozenset(pair) not in kept]

    def geometry(self) -> pin.GeometryModel:
        """Return bodies and pairs as Pinocchio's geometry, the robot's links and the world in one."""
        model = pin.GeometryModel()
        for body in self.bodies:
            model.addGeometryObject(pin.GeometryObject(body.name, body.joint, 0, pin.SE3(body.pose), body.piece.shape))
        for pair in self.pairs:
            model.addCollisionPair(pin.CollisionPair(*pair))
        return model


@dataclass(frozen=True, eq=False)
class Answer:
    """Answer of a planner."""

    path: Array | None  # (N, n) configurations joined by straight lines; None if it claims no solution
    setup: float  # [s] of the processor, to make robot and obstacles known to the planner
    seconds: float  # [s] of the processor, since then
    motion: Trajectory | None = None  # along the path, from a planner that gives one within LIMITS itself


@dataclass(frozen=True)
class Shape:
    """How long and how smooth a path is, whatever its time law: see `measure`."""

    length: float  # Σ |q_(i+1) − q_i| [rad]
    acceleration: float  # ∫ |q''|² ds [rad²]
    jerk: float  # ∫ |q'''|² ds [rad²]


def measure(path: Array) -> Shape:
    """Measure a path (N, n): its own length; and its smoothness once it is run through in unit time at equal speed.

    For the latter it is cut into STEPS steps of equal joint-space length, h = 1 / STEPS; with q_i at the cuts,

        ∫ |q''|² ds ≈ h Σ |(q_(i+1) − 2 q_i + q_(i−1)) / h²|²,   ∫ |q'''|² ds ≈ h Σ |(third difference) / h³|².

    A corner has no finite acceleration: how much one counts depends on STEPS, so figures compare paths, no more.
    A path that does not move has zeros.
    """
    even, h = evenly(path, STEPS), 1.0 / STEPS
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    acceleration, jerk = (h * float(np.sum((np.diff(even, n, axis=0) / h**n) ** 2)) for n in (2, 3))
    return Shape(length, acceleration, jerk)


def evenly(path: Array, steps: int) -> Array:
    """Return a path (N, n) cut into steps of equal length: (steps + 1, n)."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, travelled[-1], steps + 1)
    even = np.stack([np.interp(at, travelled, column) for column in path.T], axis=1)
    even[0], even[-1] = path[0], path[-1]
    return even
