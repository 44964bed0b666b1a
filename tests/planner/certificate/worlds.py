"""Worlds within a scene's sizes, sampled: Pinocchio's kinematics and coal's own distances of the robot's geometry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

import hdplan
from hdplan import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Robot, Scene, Sphere, Trajectory, Uncertainty
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.robot.tracking import tracking
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.shapes import Shape

from ..urdf import joint_text, link_text

Ends = tuple[Array, Array]  # two points, or a rotation and an origin

BRANCHED = (
    link_text("base"),
    link_text("turret", box="0.3 0.2 0.1"),
    link_text("mast", cylinder=(0.05, 0.4), at="0 0 0.3", rpy="0.3 0 0"),
    link_text("left", box="0.4 0.06 0.08", at="0.2 0 0"),
    link_text("right", sphere=0.1, at="0.2 0 0"),
    joint_text("turn", "base", "turret", at="0.1 0 0.2", rpy="0.1 0.2 0", limits=(-3, 3)),
    joint_text("lift", "turret", "mast", "0.1 0 1", kind="prismatic", at="0 0 0.1", rpy="0.2 0 0.4", limits=(-0.5, 1)),
    joint_text("swing", "mast", "left", "1 1 0", kind="continuous", at="0 0.2 0.5", rpy="0 0.5 0"),
    joint_text("nod", "mast", "right", "0 1 0.2", at="0 -0.2 0.5", limits=(-2, 2)),
)


def coal_shape(shape: Shape) -> coal.CollisionGeometry:
    """A shape for coal, built here, not by the code under test."""
    match shape:
        case Box(size):
            return coal.Box(*size)
        case Sphere(radius):
            return coal.Sphere(radius)
        case Ellipsoid(radii):
            return coal.Ellipsoid(*radii)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case Capsule(radius, length):
            return coal.Capsule(radius, length)
        case Points(points):
            cloud = coal.StdVec_Vec3s()
            cloud.extend([np.array(point) for point in points])
            return coal.Convex.convexHull(cloud, True, "Qt")
        case Mesh(file, scale):
            return coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(file), np.array(scale))
    raise TypeError(shape)


@dataclass
class Near:
    """The two closest bodies of a world."""

    distance: float
    a: int = -1  # of the robot's geometries
    b: int = -1  # an obstacle
    points: tuple[Array, Array] = (np.zeros(3), np.zeros(3))


class Worlds:
    """All worlds within the sizes of a scene, along one motion."""

    def __init__(self, scene: Scene, robot: Robot, trajectory: Trajectory) -> None:
        """Read the obstacles."""
        self.scene, self.robot, self.curve = scene, robot, curve_of(robot, trajectory)
        self.shapes = [coal_shape(each.shape) for each in scene.obstacles]
        self.motions = [ObstacleMotion.of(each) for each in scene.obstacles]
        self.lag = tracking(scene, robot)
        self.base = scene.robot.calibration or hdplan.Calibration()
        self.data = robot.model.createData()

    def sampled(self, rng: np.random.Generator, count: int) -> Iterator[tuple[float, float]]:
        """Yield least distances to obstacles and between links in worlds at the edge of the sizes: random ones, and
        each again with all that is unknown turned to where it brings the closest bodies together."""
        for _ in range(count):
            where = float(rng.uniform())
            time = float(self.curve.time_of(where)) if self.curve.times is not None else 0.0
            q = self.curve.at_parameter(np.array([where]))[0]
            off = rng.choice([-1.0, 1.0], len(q)) * self.lag
            poses = []
            for each, pose in zip(self.scene.obstacles, self._poses(time), strict=True):
                sizes = each.uncertainty or Uncertainty()
                shift, turn = _displaced(rng, sizes.position + sizes.speed * time, sizes.orientation)
                pose[:3, :3], pose[:3, 3] = turn @ pose[:3, :3], pose[:3, 3] + shift
                poses.append(pose)
            base = _displaced(rng, self.base.position, self.base.orientation)
            yield self.nearest(q + off, base, poses).distance, self.between_links(q + off)
            near = self.nearest(q, (np.zeros(3), np.eye(3)), self._poses(time))
            yield self._worst(q, time, near), self.between_links(q - off)

    def _poses(self, time: float) -> list[Array]:
        return [motion.at(np.array([time]))[0] for motion in self.motions]

    def _worst(self, q: Array, time: float, near: Near) -> float:
        """The distance with the closest obstacle moved towards the closest link, and every joint, too."""
        on_link, on_other = near.points
        way = (on_other - on_link) / max(float(np.linalg.norm(on_other - on_link)), 1e-12)
        if not np.isfinite(near.distance):
            return near.distance
        pin.computeJointJacobians(self.robot.model, self.data, self._full(q))
        joint = self.robot.collision.geometryObjects[near.a].parentJoint
        frame = pin.getJointJacobian(self.robot.model, self.data, joint, pin.ReferenceFrame.WORLD)
        off = np.sign(self.robot.fold(way @ (frame[:3] + np.cross(frame[3:].T, on_link).T))) * self.lag
        poses = self._poses(time)
        sizes, pose = self.scene.obstacles[near.b].uncertainty or Uncertainty(), poses[near.b]
        axis = np.cross(on_other - pose[:3, 3], -way)
        axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
        pose[:3, :3] = pin.exp3(sizes.orientation * axis) @ pose[:3, :3]
        pose[:3, 3] -= (sizes.position + sizes.speed * time) * way
        return self.nearest(q + off, (self.base.position * way, np.eye(3)), poses).distance

    def _full(self, q: Array) -> Array:
        return np.asarray(self.robot.unfolded.pin_q(self.robot.expand(q)[None])[0])

    def _placed(self, q: Array) -> list[tuple[Array, Array]]:
        placed = self.robot.collision.createData()
        pin.updateGeometryPlacements(self.robot.model, self.data, self.robot.collision, placed, self._full(q))
        return [(np.array(each.rotation), np.array(each.translation)) for each in placed.oMg]

    def nearest(self, q: Array, base: tuple[Array, Array], poses: list[Array]) -> Near:
        """The closest link and obstacle in one world."""
        origin, best, (shift, turn) = np.array(self.robot.base.position), Near(np.inf), base
        for a, (rotation, at) in enumerate(self._placed(q)):
            item = self.robot.collision.geometryObjects[a]
            there = turn @ rotation, turn @ (at - origin) + origin + shift
            for b, shape in enumerate(self.shapes):
                if not item.parentJoint and not self.scene.obstacles[b].moves:
                    continue  # both stand
                found, points = _distance(item.geometry, there, shape, (poses[b][:3, :3], poses[b][:3, 3]))
                if found < best.distance:
                    best = Near(found, a, b, points)
        return best

    def between_links(self, q: Array) -> float:
        """The least distance of two links that are compared."""
        items, own = self.robot.collision.geometryObjects, self.robot.link_geometry
        places = self._placed(q)
        pairs = [(a, b) for one, other in self.robot.self_pairs for a in own[one] for b in own[other]]
        return min(
            (_distance(items[a].geometry, places[a], items[b].geometry, places[b])[0] for a, b in pairs), default=np.inf
        )


def _distance(a: object, one: Ends, b: object, other: Ends) -> tuple[float, Ends]:
    result = coal.DistanceResult()
    places = coal.Transform3s(*one), coal.Transform3s(*other)
    found = coal.distance(a, places[0], b, places[1], coal.DistanceRequest(True), result)
    return found, (np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2()))


def _displaced(rng: np.random.Generator, far: float, angle: float) -> tuple[Array, Array]:
    """A shift and a turn of these sizes, in random directions."""
    way, axis = rng.normal(size=(2, 3))
    return far * way / np.linalg.norm(way), pin.exp3(angle * axis / np.linalg.norm(axis))
