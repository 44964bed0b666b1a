"""One motion as the viewer shows it: joint values, clearance and the hand's path, sampled along it.

Trajectory -> `ShownMotion`. Path parameters run from 0 to 1; distances are exact for the robot's real meshes at the
samples [m], but no lower bound between them: that is for the certificate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.limit_checks import limit_checks
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.clearances import exact
from hdplan.planner.pictures.quantities import Rate, rates
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene

SAMPLES = 101  # at least, over the whole motion; of up to twice as many waypoints each is among them
POSTURES = 7  # of the robot along a motion, for a camera
TIP = 0.01  # [m] depth of the part of the last link whose middle is its tip


@dataclass(frozen=True, eq=False)
class Share:
    """Share of the limits on one quantity of the joint that takes most."""

    quantity: str  # "velocity", "acceleration", "jerk", "torque"
    times: Array  # (k,) [s]
    values: Array  # (k,) of 1


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """A trajectory with the data for the panels and the path."""

    name: str
    trajectory: Trajectory
    curve: Curve  # its joints in the order of the robot's planned ones
    parameter: Array  # (K,) path parameters of the samples
    joints: Array  # (K, n) [rad] or [m] there
    tip: Array  # (K, 3) [m] the tip there
    clearance: Array  # (K,) [m] robot to obstacles there, inf without obstacles, NaN where it was not measured
    self_clearance: Array  # (K,) [m] between links there, inf without pairs, NaN where it was not measured
    shares: tuple[Share, ...] | None  # of the scene's limits on rates and torques, None where it was not measured
    certificate: Certificate = field(repr=False)
    scene: Scene = field(repr=False)  # in which clearances and certificate hold, and in no other

    @property
    def measured(self) -> bool:
        """True if its clearances are known."""
        return not np.isnan(self.clearance[0])

    @classmethod
    def of(
        cls,
        name: str,
        trajectory: Trajectory,
        certifier: Certifier,
        certificate: Certificate | None = None,
        measured: bool = True,
    ) -> ShownMotion:
        """Sample a trajectory; certify it, if that has not been done. Its clearances, which take longer than the
        certificate, are only `measured` on request. Raises InputError if its joints do not fit the robot."""
        robot = certifier.robot
        curve = curve_of(robot, trajectory)
        if certificate is None:
            certificate = certifier.certify(trajectory)
        parameter = sample_parameters(len(curve))
        joints = curve.at_parameter(parameter)
        if measured:
            nothing = np.full(len(parameter), np.inf)
            places, between_links = exact(certifier, joints, curve.time_of(parameter))
            to_obstacles = np.array([place.distance for place in places]) if places else nothing
            between_links = between_links if len(between_links) else nothing
            shares: tuple[Share, ...] | None = tuple(shares_of(trajectory, certifier.setup))
        else:
            to_obstacles = between_links = np.full(len(parameter), np.nan)
            shares = None
        tip = Tip.of(robot).path(joints)
        known = (to_obstacles, between_links, shares, certificate, certifier.setup.requested)
        return cls(name, trajectory, curve, parameter, joints, tip, *known)


@dataclass(frozen=True, eq=False)
class Tip:
    """The point by which a motion is drawn and the goal is dragged, carried by the last planned joint."""

    robot: Robot
    joint: int
    offset: Array  # (3,) [m] in that joint's frame

    @classmethod
    def of(cls, robot: Robot) -> Tip:
        """Take the middle of the farthest part of what the last joint carries, along the axis of that joint's frame in
        which it reaches out."""
        planned = {0, *(robot.coordinates + 1).tolist()}  # what follows may hang beside the arm
        last = max((joint for joint in robot.link_joint.values() if joint in planned), default=max(planned))
        items = [item for item in robot.collision.geometryObjects if item.parentJoint == last]
        points = [_corners(item) for item in items]
        if not points or last == 0:
            return cls(robot, max(planned), np.zeros(3))
        cloud = np.concatenate(points)
        middle = cloud.mean(axis=0)
        axis = int(np.abs(middle).argmax())
        along = np.sign(middle[axis]) * cloud[:, axis]
        end = cloud[along >= along.max() - TIP]
        return cls(robot, last, 0.5 * (end.min(axis=0) + end.max(axis=0)))

    def placement(self, q: Array) -> pin.SE3:
        """Return the tip's placement in the world: the last joint's axes at the tip."""
        data = self.robot.model.createData()
        pin.forwardKinematics(self.robot.model, data, self.robot.pin_q(q))
        return data.oMi[self.joint] * pin.SE3(np.eye(3), self.offset)

    def pose(self, q: Array) -> Pose:
        """Return the tip's placement as a pose."""
        return as_pose(self.placement(q))

    def path(self, joints: Array) -> Array:
        """Return the tip's positions (K, 3) at configurations (K, n)."""
        data = self.robot.model.createData()
        points = np.empty((len(joints), 3))
        for row, q in enumerate(self.robot.pin_q(joints)):
            pin.forwardKinematics(self.robot.model, data, q)
            points[row] = data.oMi[self.joint].act(self.offset)
        return points


def as_pose(place: pin.SE3) -> Pose:
    """Return a placement as a pose of a scene."""
    x, y, z, w = pin.Quaternion(place.rotation).coeffs().tolist()
    return Pose(tuple(place.translation.tolist()), (x, y, z, w))


def few_of(joints: Array) -> Array:
    """Return configurations (POSTURES, n) at equal steps along those of a motion (K, n)."""
    return np.asarray(joints[np.linspace(0, len(joints) - 1, POSTURES).astype(int)])


def millimetres(distance: float) -> str:
    """Return a distance in words."""
    return f"{distance * 1e3:.1f} mm" if distance >= 0.0 else f"{-distance * 1e3:.1f} mm deep"


def shortened(text: str, most: int = 80) -> str:
    """Return a text of at most so many characters, both ends of a longer one: names may be of any length."""
    side = (most - 1) // 2
    return text if len(text) <= most else f"{text[:side]}…{text[-side:]}"


def rates_of(trajectory: Trajectory, setup: Setup) -> tuple[Rate, ...]:
    """Return the rates of a trajectory, with their limits in a scene; none for a path without times."""
    return rates(trajectory.of_joints(setup.robot.joint_names, setup.robot.locked), tuple(limit_checks(setup)))


def moments_of(rate: Rate) -> Array:
    """Return the moment of each value of a rate (k,) [s]: the middle of the time over which it holds, if it does."""
    between = len(rate.times) > len(rate.values)  # each value holds from one time to the next
    return 0.5 * (rate.times[1:] + rate.times[:-1]) if between else rate.times


def shares_of(trajectory: Trajectory, setup: Setup) -> Iterator[Share]:
    """Yield the shares of the scene's limits that a trajectory takes; none for a path without times."""
    for rate in rates_of(trajectory, setup):
        if rate.limits is not None and len(rate.values):
            yield Share(rate.quantity, moments_of(rate), np.abs(rate.values / rate.limits).max(axis=1))


def sample_parameters(waypoints: int) -> Array:
    """Return path parameters at equal steps, SAMPLES of them or a few more, every waypoint among them; fewer than there
    are waypoints where these lie close."""
    if waypoints > 2 * SAMPLES:
        return np.linspace(0.0, 1.0, 2 * SAMPLES)
    per_interval = max(1, -(-(SAMPLES - 1) // (waypoints - 1)))
    return np.linspace(0.0, 1.0, per_interval * (waypoints - 1) + 1)


def _corners(item: pin.GeometryObject) -> Array:
    """Return points (m, 3) that span a geometry, in its joint's frame."""
    shape = item.geometry
    shape.computeLocalAABB()
    low, high = np.asarray(shape.aabb_local.min_), np.asarray(shape.aabb_local.max_)
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = low + signs * (high - low)
    if hasattr(shape, "vertices"):
        corners = np.asarray(shape.vertices())
    return np.asarray(corners @ item.placement.rotation.T + item.placement.translation)
