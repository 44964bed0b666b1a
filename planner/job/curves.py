"""The curve of a stage as poses of its link, and as a goal and constraints on the whole way, which the certificate
proves at every instant.

An arc is a polyline of chords. What they leave of it is taken from the tolerance of the position, so that a link within
what is left of the chords is within all of it of the arc. Turns are spread evenly over a curve's length.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hdplan.planner.job.line import as_constraints
from hdplan.planner.job.places import link_pose, pose_of
from hdplan.planner.job.world import World
from hdplan.planner.robot.link_frame import end_effector, link_frame
from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import TOOL, WORLD, Along, Circle, Curve, Line
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.path_constraints import MOST_POSES, MOST_TURN, Follow, PathConstraints
from hdplan.scenes.poses import Pose, Vector3, from_rpy
from hdplan.scenes.targets import Goals, PoseTarget

CHORD = 0.02  # share of a position's tolerance that the chords of an arc take
SHORTEST_RADIUS = 1e-6  # [m] of a radius, and of a chord
LEAST_LENGTH = 1e-9  # [m] of a curve, and of the change of its directions, below which it leads nowhere
HALF_TURN = 1e-3  # [rad] around half a turn, where a centre does not say which way


def along_curve(stage: Curve, world: World) -> dict[str, Any]:
    """Return the goal and the path constraints of a stage. Raises InputError for a link that does not move, a frame
    that there is not, an arc that is none, a curve that leads nowhere, and for poses that begin elsewhere."""
    robot = world.robot
    link = end_effector(robot, stage.kind) if stage.link is None else stage.link
    link_frame(robot, link, stage.kind)
    begins = link_pose(robot, world.q, link)
    lost = 0.0
    match stage:
        case Line():
            ends = _end(stage, world, begins)
            if _is_plain(stage):
                goal, path = as_constraints(stage, robot, link, begins, ends)
                return {"goal": goal, "path": path}
            poses = np.stack([begins, ends])
        case Circle():
            poses, lost = _arc(stage, world, begins, _end(stage, world, begins))
        case Along():
            poses = _frame(stage, world, begins) @ np.array([pose.matrix for pose in stage.poses])
            _check_beginning(stage, begins, poses[0])
        case _:
            raise TypeError(f"{stage.kind} is no curve")
    _check_length(stage, poses)
    target = PoseTarget(
        link,
        pose_of(poses[-1]),
        stage.position_tolerance,
        stage.orientation_tolerance,
        stage.free_rotation,
        field="goal",
    )
    follow = Follow(
        link,
        tuple(pose_of(pose) for pose in poses),
        stage.position_tolerance - lost,
        stage.orientation_tolerance,
        stage.free_rotation,
        stage.tool_speed,
        stage.tool_acceleration,
    )
    return {"goal": Goals((target,)), "path": PathConstraints(follow=follow)}


def _is_plain(stage: Line) -> bool:
    """Whether a line is one along which nothing turns, and nothing is said of the tool's speed."""
    turned = stage.turn is not None or stage.rpy is not None or stage.free_rotation != "none"
    return not turned and stage.tool_speed is None and stage.tool_acceleration is None


def _frame(stage: Line | Circle | Along, world: World, begins: Array) -> Array:
    """Return the pose (4, 4) of the frame in which a stage says where to go."""
    if stage.frame == WORLD:
        return np.eye(4)
    if stage.frame == TOOL:
        return begins
    if stage.frame not in world.things:
        known = [WORLD, TOOL, *world.things]
        raise InputError(f"{stage.kind}.frame: unknown {stage.frame!r}{nearest(stage.frame, known)}")
    return world.place(stage.frame)


def _end(stage: Line | Circle, world: World, begins: Array) -> Array:
    """Return the pose (4, 4) to which a stage leads."""
    ends, frame = begins.copy(), _frame(stage, world, begins)[:3, :3]
    if stage.to is not None:
        ends[:3, 3] = stage.to
        if stage.rpy is not None:
            ends[:3, :3] = _rotation(stage.rpy)
    else:
        ends[:3, 3] += frame @ np.array(stage.by)
        if stage.turn is not None:
            ends[:3, :3] = frame @ _rotation(stage.turn) @ frame.T @ begins[:3, :3]
    turn = scipy.spatial.transform.Rotation.from_matrix(ends[:3, :3] @ begins[:3, :3].T).magnitude()
    if turn > MOST_TURN:
        raise InputError(
            f"{stage.kind}.{'turn' if stage.to is None else 'rpy'}: turns by {turn:.3g} rad from the beginning; at "
            f"most {MOST_TURN:g} are allowed, as half a turn has no shortest way: give two stages"
        )
    return ends


def _rotation(rpy: Vector3) -> Array:
    return Pose((0.0, 0.0, 0.0), from_rpy(*rpy)).matrix[:3, :3]


def _arc(stage: Circle, world: World, begins: Array, ends: Array) -> tuple[Array, float]:
    """Return poses (N, 4, 4) on an arc, and how far it may be from their chords [m]."""
    one, other = begins[:3, 3], ends[:3, 3]
    said = np.array(stage.interim if stage.center is None else stage.center)
    point = said if stage.to is not None else one + _frame(stage, world, begins)[:3, :3] @ said
    if stage.center is None:
        center, angle, axis = _through(one, point, other)
    else:
        center, angle, axis = _around(one, point, other, stage.position_tolerance)
    arm = one - center
    radius = float(np.linalg.norm(arm))
    allowed = min(CHORD * stage.position_tolerance, 0.1 * radius)
    chord = 4.0 * np.arcsin(np.sqrt(0.5 * allowed / radius))  # the angle of an arc that is so far from its chord
    if angle > (MOST_POSES - 1) * chord:
        raise InputError(
            f"circle.position_tolerance: {stage.position_tolerance:g} m on an arc of radius {radius:.4g} m takes more "
            f"than {MOST_POSES} chords: allow more"
        )
    count = max(2, int(np.ceil(angle / chord)) + 1)
    shares = np.linspace(0.0, 1.0, count)
    rotations = scipy.spatial.transform.Rotation
    turn = rotations.from_matrix(ends[:3, :3] @ begins[:3, :3].T).as_rotvec()
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = rotations.from_rotvec(shares[:, None] * turn).as_matrix() @ begins[:3, :3]
    poses[:, :3, 3] = center + rotations.from_rotvec(shares[:, None] * angle * axis).as_matrix() @ arm
    return poses, radius * (1.0 - np.cos(0.5 * angle / (count - 1)))


def _through(one: Array, point: Array, other: Array) -> tuple[Array, float, Array]:
    """Return centre, angle and axis of the arc from a point through a second to a third."""
    a, b = point - one, other - one
    normal = np.cross(a, b)
    square = float(normal @ normal)
    sides = [float(np.linalg.norm(each)) for each in (a, b, b - a)]
    if min(sides) < SHORTEST_RADIUS or square < (SHORTEST_RADIUS * max(sides)) ** 2:
        raise InputError("circle.interim: lies on one line with the two ends, or at one of them: no circle leads there")
    center = one + (np.cross(np.cross(a, b), a) * (b @ b) + np.cross(b, np.cross(a, b)) * (a @ a)) / (2.0 * square)
    axis = normal / np.sqrt(square)
    return center, _angle(one - center, other - center, axis), axis


def _around(one: Array, center: Array, other: Array, tolerance: float) -> tuple[Array, float, Array]:
    """Return centre, angle and axis of the shorter arc around a centre, which is moved between its ends where they are
    not quite equally far from it."""
    way = other - one
    length = float(np.linalg.norm(way))
    first, last = (float(np.linalg.norm(end - center)) for end in (one, other))
    if length < SHORTEST_RADIUS or min(first, last) < SHORTEST_RADIUS:
        raise InputError(
            "circle.center: the two ends, or one of them and the centre, are one point: no circle is there"
        )
    if abs(first - last) > tolerance:
        raise InputError(
            f"circle.center: is {first * 1e3:.4g} mm from where the circle begins and {last * 1e3:.4g} mm from where "
            f"it ends: they may differ by the tolerance, {tolerance * 1e3:g} mm"
        )
    center = center + way / length * float((0.5 * (one + other) - center) @ way / length)
    normal = np.cross(one - center, other - center)
    across = float(np.linalg.norm(normal))
    angle = float(np.arctan2(across, (one - center) @ (other - center)))
    if np.pi - angle < HALF_TURN:
        raise InputError("circle.center: lies between the two ends, and does not say which way: give 'interim'")
    return center, angle, normal / across


def _angle(one: Array, other: Array, axis: Array) -> float:
    """Return the angle from a vector to another about an axis, above 0 and below a whole turn."""
    return float(np.arctan2(np.cross(one, other) @ axis, one @ other) % (2.0 * np.pi))


def _check_length(stage: Curve, poses: Array) -> None:
    """Refuse poses (N, 4, 4) that are all the same, to a link that is free about an axis in the direction of that."""
    turned = slice(3) if stage.free_rotation == "none" else "xyz".index(stage.free_rotation)
    if max(np.ptp(poses[:, :3, 3], axis=0).max(), np.ptp(poses[:, :3, turned], axis=0).max()) < LEAST_LENGTH:
        raise InputError(f"{stage.kind}: has no length: the link is to stay where it is")


def _check_beginning(stage: Along, begins: Array, first: Array) -> None:
    """Refuse poses of which the first is not where the link is."""
    off = float(np.linalg.norm(begins[:3, 3] - first[:3, 3]))
    between = scipy.spatial.transform.Rotation.from_matrix(first[:3, :3].T @ begins[:3, :3])
    turned = float(between.magnitude())
    if stage.free_rotation != "none":
        axis = "xyz".index(stage.free_rotation)
        turned = float(np.arccos(np.clip(begins[:3, axis] @ first[:3, axis], -1.0, 1.0)))
    if off > stage.position_tolerance or turned > stage.orientation_tolerance:
        raise InputError(
            f"along.poses: the first is {off * 1e3:.3g} mm and {turned:.3g} rad away from where the link is; "
            f"{stage.position_tolerance * 1e3:g} mm and {stage.orientation_tolerance:g} rad are allowed: lead the "
            "stage before it there"
        )
