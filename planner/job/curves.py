"""The curve of a stage as poses of its link, and as a goal and constraints on the whole way, which the certificate
proves at every instant.

An arc is a polyline of chords. What they leave of it is taken from the tolerance of the position, so that a link within
what is left of the chords is within all of it of the arc. Turns are spread evenly over a curve's length.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from hdplan.planner.geometry.rotations import matrices_of, turn_of, vectors_of
from hdplan.planner.job.blends import CHORD_SHARE, Blend, Leg, UnblendedError
from hdplan.planner.job.places import link_pose, pose_of, poses_of
from hdplan.planner.job.world import Corner, World
from hdplan.planner.robot.link_frame import end_effector, link_frame
from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import TOOL, WORLD, Along, Circle, Curve, Line
from hdplan.scenes.errors import InputError, MisplacedError, nearest
from hdplan.scenes.job import Move
from hdplan.scenes.path_constraints import MOST_POSES, MOST_TURN, Follow, PathConstraints
from hdplan.scenes.poses import Pose, Vector3, from_rpy
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget

SHORTEST_RADIUS = 1e-6  # [m] of a radius, and of a chord
LEAST_LENGTH = 1e-9  # [m] of a curve, and of the change of its directions, below which it leads nowhere
HALF_TURN = 1e-3  # [rad] around half a turn, where a centre does not say which way


def along_curve(world: World, number: int) -> dict[str, Any]:
    """Return the goal and the path constraints of a stage. Raises InputError for a link that does not move, an unknown
    frame, a degenerate arc, a curve without length, poses that begin elsewhere, and blends that are not possible."""
    stage = world.curve(number)
    (poses, lost), link, free = blended_poses(world, number), link_of(stage, world), stage.free_rotation
    distance, angle = stage.position_tolerance, stage.orientation_tolerance
    target = PoseTarget(link, pose_of(poses[-1]), distance, angle, free, field="goal")
    angle *= 1.0 - CHORD_SHARE if stage.blend or world.corner is not None else 1.0
    rates = stage.tool_speed, stage.tool_acceleration
    follow = Follow(link, poses_of(poses), distance - lost, angle, free, *rates, *_comes_and_goes(world, number))
    return {"goal": Goals((target,)), "path": PathConstraints(follow=follow)}


def _comes_and_goes(world: World, number: int) -> tuple[float | None, float | None]:
    """Return the radii within which the link of a stage comes from a move, and goes over into one; None if it does not.
    Raises InputError for radii that are larger than the curve, or overlap."""
    stage, corner = world.curve(number), world.corner
    comes = corner.radius if corner is not None and not corner.curve else None
    goes = stage.blend if stage.blend and isinstance(world.job.stages[number + 1], Move) else None
    leg, _ = leg_of(world, number)
    with _blending():
        first = joint_before(world, leg)
        first_share = leg.leaves(comes) if comes else first.leaves if first else 0.0
        last = joint_behind(world, number, leg)
        last_share = 1.0 - leg.backwards.leaves(goes) if goes else last.enters if last else 1.0
    if first_share > last_share:
        raise InputError("blend: its radius and that of the stage before it overlap on this stage")
    return comes, goes


def link_of(stage: Curve, world: World) -> str:
    """Return the link that follows a curve. Raises InputError for one that does not move."""
    link = end_effector(world.robot, stage.kind) if stage.link is None else stage.link
    link_frame(world.robot, link, stage.kind)
    return link


def begins_at(stage: Curve, world: World) -> Array:
    """Return the pose (4, 4) of its link from which a curve leads: where it is, or would be without a blend."""
    link = link_of(stage, world)
    if world.corner is None:
        return link_pose(world.robot, world.q, link)
    if world.corner.link != link:
        raise InputError(
            f"{stage.kind}.link: is '{link}', and the stage before it is blended with '{world.corner.link}'"
        )
    if getattr(stage, "frame", WORLD) == TOOL and world.corner.free != "none":
        raise InputError(f"{stage.kind}.frame: 'tool' is not known after a blend, where the link is free about an axis")
    return world.corner.pose.matrix


def leg_of(world: World, number: int) -> tuple[Leg, float]:
    """Return the curve of a stage from its beginning to its end, as if nothing were blended, and how far its chords may
    be away from it [m]. Raises InputError as `along_curve`."""
    stage = world.curve(number)
    begins, lost = begins_at(stage, world), 0.0
    match stage:
        case Line():
            poses = np.stack([begins, _end(stage, world, begins)])
        case Circle():
            near = [each.position_tolerance for each in _blended_with(world, number)]
            poses, lost = _arc(stage, world, begins, _end(stage, world, begins), min(near))
        case Along():
            poses = _frame(stage, world, begins) @ np.array([pose.matrix for pose in stage.poses])
            _check_beginning(stage, begins, poses[0])
        case _:
            raise TypeError(f"{stage.kind} is not a curve")
    _check_length(stage, poses)
    return Leg(poses, stage.free_rotation, stage.tool_speed, stage.tool_acceleration), lost


def _blended_with(world: World, number: int) -> list[Curve]:
    """Return a curve with its blended neighbours."""
    stages, first = world.job.stages, max(number - 1, 0)
    near = {number, *(k for k in (first, number + 1) if getattr(stages[min(k, number)], "blend", 0.0))}
    return [each for k in near if isinstance(each := stages[k], Curve)]


def blended_poses(world: World, number: int) -> tuple[Array, float]:
    """Return the poses (N, 4, 4) that the link of a stage follows, from the middle of the blend before it to that of
    the blend after it, and how far the curve may be from their chords [m]. Raises InputError."""
    stage = world.curve(number)
    leg, lost = leg_of(world, number)
    distance = min(each.position_tolerance for each in _blended_with(world, number))
    fine = distance, stage.orientation_tolerance
    first, last, parts = 0.0, 1.0, []
    if (before := joint_before(world, leg)) is not None:
        first = before.leaves
        parts.append(before.chords(*fine, half=1)[:-1])
    after: list[Array] = []
    if (behind := joint_behind(world, number, leg)) is not None:
        last = behind.enters
        after.append(behind.chords(*fine, half=0)[1:])
    if first > last:
        raise InputError("blend: its radius and that of the stage before it overlap on this stage")
    if parts or after:
        lost += CHORD_SHARE * distance
    between = leg.places[(leg.places > first) & (leg.places < last)]
    parts.append(leg.at(np.array([first, *between, last])))
    return np.concatenate([*parts, *after]), lost


def joint_before(world: World, leg: Leg) -> Blend | None:
    """Return the blend in which a stage with this curve begins. Raises InputError."""
    corner = world.corner
    if corner is None or not corner.curve:
        return None
    if corner.free != leg.free:
        raise InputError(
            f"free_rotation: is '{leg.free}', and '{corner.free}' in the stage that is blended into this one"
        )
    with _blending():
        return Blend.of(
            Leg(np.array([pose.matrix for pose in corner.curve]), corner.free, *corner.rates), leg, corner.radius
        )


def joint_behind(world: World, number: int, leg: Leg) -> Blend | None:
    """Return the blend in which a stage with this curve ends. Raises InputError."""
    stage = world.curve(number)
    if not stage.blend or not isinstance(world.job.stages[number + 1], Curve):
        return None
    there = replace(world, corner=corner_of(world, number))
    second, _ = leg_of(there, number + 1)
    if leg.free != second.free:
        raise InputError(f"free_rotation: is '{leg.free}', and '{second.free}' in the stage into which it is blended")
    with _blending():
        return Blend.of(leg, second, stage.blend)


@contextmanager
def _blending() -> Iterator[None]:
    try:
        yield
    except UnblendedError as error:
        raise InputError(f"blend: {error}") from None


def corner_of(world: World, number: int) -> Corner | None:
    """Return the corner at which a stage that is blended into the next one would have ended; None between two moves, of
    which the second is to anywhere. Raises InputError for a move to several goals, before a curve."""
    stages = world.job.stages
    if not any(isinstance(each, Curve) for each in stages[number : number + 2]):
        return None
    stage, link = stages[number], radius_link(world, number)
    if isinstance(stage, Curve):
        leg, _ = leg_of(world, number)
        poses = poses_of(leg.poses)
        return Corner(stage.blend, link, poses[-1], leg.free, poses, (leg.speed, leg.acceleration))
    assert isinstance(stage, Move)
    if isinstance(stage.goal, JointTarget):
        q = world.robot.configuration(stage.goal)
        return Corner(stage.blend, link, pose_of(link_pose(world.robot, q, link)), "none")
    goal, *others = stage.goal.targets
    if not isinstance(goal, PoseTarget) or others or (goal.link or link) != link or goal.free_rotation == "all":
        raise InputError(f"blend: before a curve of {link} a move needs one goal: joints, or one pose of {link}")
    return Corner(stage.blend, link, goal.pose, goal.free_rotation)


def radius_link(world: World, number: int) -> str:
    """Return the link of which the radius of a blend is meant: that of the curve, or else that of a pose to which a
    move leads. Raises InputError."""
    stage, following = world.job.stages[number : number + 2]
    for each in (stage, following):
        if isinstance(each, Curve):
            return link_of(each, world)
    targets = () if isinstance(stage.goal, JointTarget) else stage.goal.targets  # type: ignore[union-attr]
    poses = [pose for each in targets if not isinstance(each, JointTarget) for pose in each.poses]
    return poses[0].link if poses and poses[0].link is not None else end_effector(world.robot, "blend")


def settled(corner: Corner, rotation: Array) -> Corner:
    """Return a corner whose free axis is turned as a link's rotation (3, 3) says, as nearly as it can be."""
    if corner.free == "none" or corner.curve:
        return corner
    axis = "xyz".index(corner.free)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    goal = corner.pose.matrix.copy()
    between = goal[:3, :3].T @ rotation
    angle = float(np.arctan2(between[j, i] - between[i, j], between[i, i] + between[j, j]))
    turn = matrices_of(angle * np.eye(3)[[axis]])[0]
    goal[:3, :3] = goal[:3, :3] @ turn
    return replace(corner, pose=pose_of(goal), free="none")


def turns_with_tool(stage: Curve) -> bool:
    """True if a curve leads elsewhere where the tool begins it with another turn about the axis that is free on it."""
    if stage.free_rotation == "none" or getattr(stage, "frame", WORLD) != TOOL:
        return False
    if not isinstance(stage, Line) or stage.turn is not None or stage.by is None:
        return True
    return bool(np.delete(np.array(stage.by), "xyz".index(stage.free_rotation)).any())


def _frame(stage: Line | Circle | Along, world: World, begins: Array) -> Array:
    """Return the pose (4, 4) of the frame in which a stage says where to go."""
    if stage.frame == WORLD:
        return np.eye(4)
    if stage.frame == TOOL:
        return begins
    if world.corner is not None and stage.frame in {each.name for each in world.held}:
        raise InputError(f"{stage.kind}.frame: '{stage.frame}' is held, and has no place of its own after a blend")
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
    turn = turn_of(ends[:3, :3] @ begins[:3, :3].T)
    if turn > MOST_TURN:
        raise MisplacedError(
            f"{stage.kind}.{'turn' if stage.to is None else 'rpy'}: turns by {turn:.3g} rad from the beginning; at "
            f"most {MOST_TURN:g} are allowed, as half a turn has no shortest way: give two stages"
        )
    return ends


def _rotation(rpy: Vector3) -> Array:
    return Pose((0.0, 0.0, 0.0), from_rpy(*rpy)).matrix[:3, :3]


def _arc(stage: Circle, world: World, begins: Array, ends: Array, tolerance: float) -> tuple[Array, float]:
    """Return poses (N, 4, 4) on an arc, and how far it may be from their chords [m], a share of a tolerance."""
    one, other = begins[:3, 3], ends[:3, 3]
    given = np.array(stage.interim if stage.center is None else stage.center)
    point = given if stage.to is not None else one + _frame(stage, world, begins)[:3, :3] @ given
    if stage.center is None:
        center, angle, axis = _through(one, point, other)
    else:
        center, angle, axis = _around(one, point, other, stage.position_tolerance)
    arm = one - center
    radius = float(np.linalg.norm(arm))
    allowed = min(CHORD_SHARE * tolerance, 0.1 * radius)
    chord = 4.0 * np.arcsin(np.sqrt(0.5 * allowed / radius))  # the angle of an arc that is so far from its chord
    if angle > (MOST_POSES - 1) * chord:
        raise InputError(
            f"circle.position_tolerance: {tolerance:g} m on an arc of radius {radius:.4g} m takes more "
            f"than {MOST_POSES} chords: allow more"
        )
    count = max(2, int(np.ceil(angle / chord)) + 1)
    shares = np.linspace(0.0, 1.0, count)
    turn = vectors_of((ends[:3, :3] @ begins[:3, :3].T)[None])
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = matrices_of(shares[:, None] * turn) @ begins[:3, :3]
    poses[:, :3, 3] = center + matrices_of(shares[:, None] * angle * axis) @ arm
    return poses, radius * (1.0 - np.cos(0.5 * angle / (count - 1)))


def _through(one: Array, point: Array, other: Array) -> tuple[Array, float, Array]:
    """Return centre, angle and axis of the arc from a point through a second to a third."""
    a, b = point - one, other - one
    normal = np.cross(a, b)
    square = float(normal @ normal)
    sides = [float(np.linalg.norm(each)) for each in (a, b, b - a)]
    if min(sides) < SHORTEST_RADIUS or square < (SHORTEST_RADIUS * max(sides)) ** 2:
        raise MisplacedError(
            "circle.interim: lies on one line with the two ends, or at one of them: no circle leads there"
        )
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
        raise MisplacedError(
            "circle.center: the two ends, or one of them and the centre, are one point: no circle is there"
        )
    if abs(first - last) > tolerance:
        raise MisplacedError(
            f"circle.center: is {first * 1e3:.4g} mm from where the circle begins and {last * 1e3:.4g} mm from where "
            f"it ends: they may differ by the tolerance, {tolerance * 1e3:g} mm"
        )
    center = center + way / length * float((0.5 * (one + other) - center) @ way / length)
    normal = np.cross(one - center, other - center)
    across = float(np.linalg.norm(normal))
    angle = float(np.arctan2(across, (one - center) @ (other - center)))
    if np.pi - angle < HALF_TURN:
        raise MisplacedError("circle.center: lies between the two ends, and leaves the direction open: give 'interim'")
    return center, angle, normal / across


def _angle(one: Array, other: Array, axis: Array) -> float:
    """Return the angle from a vector to another about an axis, above 0 and below a whole turn."""
    return float(np.arctan2(np.cross(one, other) @ axis, one @ other) % (2.0 * np.pi))


def _check_length(stage: Curve, poses: Array) -> None:
    """Refuse poses (N, 4, 4) that are all the same, to a link that is free about an axis in the direction of that."""
    turned = slice(3) if stage.free_rotation == "none" else "xyz".index(stage.free_rotation)
    if max(np.ptp(poses[:, :3, 3], axis=0).max(), np.ptp(poses[:, :3, turned], axis=0).max()) < LEAST_LENGTH:
        raise MisplacedError(f"{stage.kind}: has no length: the link is to stay where it is")


def _check_beginning(stage: Along, begins: Array, first: Array) -> None:
    """Refuse poses of which the first is not where the link is."""
    off = float(np.linalg.norm(begins[:3, 3] - first[:3, 3]))
    turned = turn_of(first[:3, :3].T @ begins[:3, :3])
    if stage.free_rotation != "none":
        axis = "xyz".index(stage.free_rotation)
        turned = float(np.arccos(np.clip(begins[:3, axis] @ first[:3, axis], -1.0, 1.0)))
    if off > stage.position_tolerance or turned > stage.orientation_tolerance:
        raise MisplacedError(
            f"along.poses: the first is {off * 1e3:.3g} mm and {turned:.3g} rad away from where the link is; "
            f"{stage.position_tolerance * 1e3:g} mm and {stage.orientation_tolerance:g} rad are allowed: lead the "
            "stage before it there"
        )
