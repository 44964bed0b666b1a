"""Constraints of a MoveIt motion plan request: the goal, by joints or by poses of links, and path constraints.

The keys are the fields of moveit_msgs/Constraints and its parts. A `Scene` cannot express all that MoveIt allows; it is
then narrower, so that whatever it allows MoveIt allows too, and a note says so:

* An orientation's tolerances bound the intrinsic angles a, b, c about x, y, z of the rotation R = Rx(a) Ry(b) Rz(c)
  from the desired to the link's orientation. A rotation by an angle t < π/2 has none above t. With z free (tolerance
  π or more) the link's z axis is off by θ, cos θ = cos a cos b, and with x free its x axis by cos θ = cos b cos c:
  θ ≤ t again keeps both angles below t. With y free there is no such cone, nor for the parameterization by rotation
  vectors.
* A position's region may be a sphere, or a box, whose inscribed sphere a goal takes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES, is_filled
from hdplan.scenes.moveit.frames import Frames
from hdplan.scenes.moveit.messages import read_message_pose, read_orientation, read_point, read_primitive
from hdplan.scenes.path_constraints import PathConstraints, Upright, Within
from hdplan.scenes.poses import UNIT_ERROR, Pose, Quaternion, Vector3, compose
from hdplan.scenes.shapes import Box, Shape, Sphere
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget

KINDS = ("joint_constraints", "position_constraints", "orientation_constraints")
AXES = ("x", "y", "z")
TOLERANCES = tuple(f"absolute_{axis}_axis_tolerance" for axis in AXES)
FREE_TOLERANCE = 3.14  # [rad] a tolerance of this or more leaves the axis free: π as people type it
WIDEST_CONE = 1.5  # [rad] below π/2, so that the argument above holds
LARGEST_BALL = 1.0  # [m] tolerance of a goal's position
SLANT = 1e-2  # [rad] by which an upright axis may be off; it is subtracted from the tolerance


def read_goal_constraints(section: Field, name: str, frames: Frames) -> JointTarget | Goals:
    """Read the single goal: joint values, which are met exactly whatever their tolerances, or poses of links.

    Raises:
        InputError: several goals, none, both kinds in one, or a pose that a scene cannot express.
    """
    goals = section.items()
    if len(goals) != 1:
        raise section.error(f"must hold one goal, found {len(goals)}; alternative goals are not supported yet")
    given = _given(goals[0])
    placed = [given[kind] for kind in ("position_constraints", "orientation_constraints") if kind in given]
    if placed and "joint_constraints" in given:
        raise placed[0].error("is given beside joint_constraints; a goal is given by joints or by a pose, not by both")
    if placed:
        return Goals((_pose_goal(given, name, frames),))  # type: ignore[arg-type]
    if "joint_constraints" not in given:
        raise goals[0].error("has no joint_constraints and no position_constraints, so there is no goal")
    return JointTarget(name, by_name=_joints(given["joint_constraints"], frames))


def read_path_constraints(section: Field, frames: Frames) -> PathConstraints:
    """Read path constraints: one link's axis upright, and one point of a link in a box.

    Raises:
        InputError: joint constraints, several of a kind, or one that a scene cannot express.
    """
    given = _given(section)
    if "joint_constraints" in given:
        raise given["joint_constraints"].error(
            "is not supported along the path: narrow the joints' ranges with limits.position"
        )
    orientation, position = given.get("orientation_constraints"), given.get("position_constraints")
    return PathConstraints(
        _upright(_only(orientation), frames) if orientation else None,
        _within(_only(position), frames) if position else None,
    )


def _given(constraints: Field) -> dict[str, Field]:
    """Return the constraints that are given, by kind."""
    keys = constraints.mapping(MESSAGES["Constraints"])
    return {kind: keys[kind] for kind in KINDS if kind in keys and is_filled(keys[kind].value)}


def _only(section: Field) -> Field:
    entries = section.items(of="constraints")
    if len(entries) != 1:
        raise section.error(f"must hold one constraint, found {len(entries)}")
    return entries[0]


def _joints(section: Field, frames: Frames) -> dict[str, float]:
    joints: dict[str, float] = {}
    for entry in section.items():
        joint = entry.mapping(MESSAGES["JointConstraint"], required=["joint_name", "position"])
        name = joint["joint_name"].text()
        if name in joints:
            raise entry.error(f"the joint {name!r} has a goal already")
        joints[name] = joint["position"].number(unit="rad or m")
        frames.check_base(name, joints[name], entry)
        for key in ("tolerance_above", "tolerance_below"):
            if key in joint:
                joint[key].number(low=0.0, unit="rad or m")
    return joints


class _Region(NamedTuple):
    """The region for a point of a link."""

    link: str
    point: Vector3  # in the link's frame [m]
    shape: Shape
    pose: Pose  # of the shape, in the world


def _region(entry: Field, frames: Frames) -> _Region:
    keys = entry.mapping(MESSAGES["PositionConstraint"], required=["link_name", "constraint_region"])
    region = keys["constraint_region"].mapping(MESSAGES["BoundingVolume"], required=["primitives"])
    shapes = region["primitives"].items(of="primitives")
    poses = region["primitive_poses"].items(of="poses") if "primitive_poses" in region else []
    if len(shapes) != 1 or len(poses) > 1:
        raise keys["constraint_region"].error(f"must be one primitive with its pose, found {len(shapes)}, {len(poses)}")
    return _Region(
        keys["link_name"].text(),
        read_point(keys["target_point_offset"]) if "target_point_offset" in keys else (0.0, 0.0, 0.0),
        read_primitive(shapes[0]),
        compose(frames.of_header(keys.get("header")), read_message_pose(poses[0] if poses else None)),
    )


class _Orientation(NamedTuple):
    """The orientation of a link."""

    link: str
    quaternion: Quaternion  # of the link, in the world
    tolerance: float  # [rad] of the angle to it, beside the free rotation
    free: str  # the axis of free rotation: none, x, y, z, or all


def _orientation(entry: Field, frames: Frames) -> _Orientation:
    keys = entry.mapping(MESSAGES["OrientationConstraint"], required=["link_name", "orientation", *TOLERANCES])
    tolerances = [keys[key].number(above=0.0, unit="rad") for key in TOLERANCES]
    turning = [axis for axis, tolerance in zip(AXES, tolerances, strict=True) if tolerance >= FREE_TOLERANCE]
    bounded = [tolerance for tolerance in tolerances if tolerance < FREE_TOLERANCE]
    by_vector = keys["parameterization"].integer(0, 1) if "parameterization" in keys else 0
    if len(turning) == 2 or turning == ["y"] or (len(turning) == 1 and by_vector):
        how = "a rotation vector" if by_vector else "Euler angles x, y, z"
        raise entry.error(
            f"leaves {' and '.join(turning)} free by {how}, which is not a cone of directions: x or z alone may be free"
        )
    tolerance = (
        min([WIDEST_CONE, *bounded]) if bounded else PoseTarget.orientation_tolerance
    )  # has no meaning if all are free
    if any(other > tolerance for other in bounded):
        entry.note(f"allows up to {max(bounded):g} rad about one axis; {tolerance:g} rad is used about all")
    free = "all" if len(turning) == 3 else "".join(turning) or "none"
    wanted = compose(frames.of_header(keys.get("header")), Pose(quaternion_xyzw=read_orientation(keys["orientation"])))
    quaternion = Pose().quaternion_xyzw if free == "all" else wanted.quaternion_xyzw  # has no meaning if all are free
    return _Orientation(keys["link_name"].text(), quaternion, tolerance, free)


def _pose_goal(given: dict[str, Field], name: str, frames: Frames) -> PoseTarget | AllOf:
    """Read the pose of one link, or poses of several links that are reached together."""
    if "position_constraints" not in given:
        raise given["orientation_constraints"].error("has no position_constraints beside it; a goal needs both")
    places = _by_link(given["position_constraints"])
    turns = _by_link(given["orientation_constraints"]) if "orientation_constraints" in given else {}
    for link, entry in turns.items():
        if link not in places:
            raise entry.error(f"turns {link!r}, which has no position_constraints beside it; a goal needs both")
    poses = [_link_pose(entry, turns.get(link), name, frames) for link, entry in places.items()]
    return poses[0] if len(poses) == 1 else AllOf(poses, name)


def _by_link(section: Field) -> dict[str, Field]:
    """Return constraints by the link that each is about, one for each."""
    found: dict[str, Field] = {}
    for entry in section.items(of="constraints"):
        link = entry.mapping(required=["link_name"])["link_name"].text()
        if link in found:
            raise entry.error(f"is about {link!r} again; a goal takes one such constraint for each link")
        found[link] = entry
    return found


def _link_pose(entry: Field, turned: Field | None, name: str, frames: Frames) -> PoseTarget:
    region = _region(entry, frames)
    if any(region.point):
        raise entry.error("has a target_point_offset, which is not supported in a goal: its pose is the link's")
    match region.shape:
        case Sphere(radius):
            tolerance = radius
        case Box(size):
            tolerance = min(size) / 2
            entry.note(f"allows a box; its inscribed sphere of radius {tolerance:g} m is used")
        case _:
            raise entry.error("has a region that is neither a box nor a sphere, which is not supported in a goal")
    turn = _Orientation(region.link, Pose().quaternion_xyzw, PoseTarget.orientation_tolerance, "all")
    if turned is not None:
        turn = _orientation(turned, frames)
    if tolerance > LARGEST_BALL:
        entry.note(f"allows a sphere of radius {tolerance:g} m; one of {LARGEST_BALL:g} m is used")
    pose = Pose(region.pose.position, turn.quaternion)
    return PoseTarget(region.link, pose, min(tolerance, LARGEST_BALL), turn.tolerance, turn.free, field=name)


def _upright(entry: Field, frames: Frames) -> Upright:
    turn = _orientation(entry, frames)
    if turn.free not in AXES:
        raise entry.error("must leave the link's x or z axis free and point it up or down; others are not supported")
    index = AXES.index(turn.free)
    direction = Pose(quaternion_xyzw=turn.quaternion).matrix[:3, index]
    slant = math.atan2(math.hypot(direction[0], direction[1]), abs(direction[2]))
    slant = 0.0 if slant <= UNIT_ERROR else slant  # what the last decimals of a quaternion make of the vertical
    if slant > SLANT or slant >= turn.tolerance:
        x, y, z = (np.round(direction, 3) + 0.0).tolist()
        found = f"keeps the link's {turn.free} axis along ({x:g}, {y:g}, {z:g})"
        raise entry.error(f"{found}; only up or down is supported")
    axis = [0.0, 0.0, 0.0]
    axis[index] = math.copysign(1.0, direction[2])
    return Upright(turn.link, (axis[0], axis[1], axis[2]), turn.tolerance - slant)


def _within(entry: Field, frames: Frames) -> Within:
    region = _region(entry, frames)
    if not isinstance(region.shape, Box):
        raise entry.error("has a region that is not a box, which is not supported along the path")
    return Within(region.link, region.shape.size, region.pose, region.point)
