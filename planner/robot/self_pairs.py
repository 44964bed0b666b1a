"""Pairs of a robot's links that are checked against each other, and why the others are not.

Excluded is what a file says, what cannot be helped (neighbours, links that move as one), and what is proven: pairs that
always touch (`lasting_contacts`), and, where no SRDF says it, pairs that never touch. Pairs that touch at every one of
CONTACT_SAMPLES configurations, which is no proof, are checked, and named in a note.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import coal
import numpy as np
import pinocchio as pin

from hdplan.planner.robot.pin_model import motion_axes
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import check_time
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.robot_files.description import Semantics, Tree
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.robot_spec import RobotSpec

if TYPE_CHECKING:
    from hdplan.planner.robot.robot import Robot


CONTACT_SAMPLES = 1000  # configurations at which a pair must touch before it is examined
LIMIT_EXCESS = 0.1  # [rad or m] beyond a limit, where a request or a named state may lie: descriptions differ
GAP_ROUNDING = 1e-6  # [m] by which balls must be apart beyond their radii
# Reasons for which pairs of links are not checked, beside those that files give.
NEIGHBOURS, MOVE_AS_ONE = "neighbours", "moving as one"
ALWAYS_TOUCHING, NEVER_TOUCHING = "always touching, which is proven", "never touching, which is proven"


def excluded(robot: Robot, tree: Tree, semantics: Semantics, spec: RobotSpec) -> dict[LinkPair, str]:
    """Return the pairs that are not checked, each with its reason: ignored, disabled, neighbours, or without relative
    motion.

    Neighbours have exactly one moving joint between them, and no other link with geometry: links that meet at a joint
    may overlap there. Links with two joints between them, or with another link fixed to one of them in between, may
    collide like any two. Held joints do not move. Pairs of `robot.check_pairs` are left out only if they move as one.
    Raises InputError for a link to ignore, or to check, that is unknown.
    """
    for key, named in (("ignore_pairs", spec.ignore_pairs), ("check_pairs", spec.check_pairs)):
        for link in (link for pair in named for link in pair):
            if link not in tree.links:
                raise InputError(f"robot.{key}: unknown link '{link}'{nearest(link, tree.links)}")
    joint, parents = robot.link_joint, robot.model.parents
    pairs = [link_pair(a, b) for a, b in itertools.combinations(robot.links, 2)]
    one_joint = [(a, b) for a, b in pairs if joint[a] == parents[joint[b]] or joint[b] == parents[joint[a]]]
    neighbours = [pair for pair in one_joint if not any(link in joint for link in tree.between(*pair))]
    found = {
        **{link_pair(*pair): "robot.ignore_pairs" for pair in spec.ignore_pairs},
        **dict.fromkeys(tree.excluded, "the MJCF"),
        **dict.fromkeys(semantics.disabled, "the SRDF"),
        **dict.fromkeys(neighbours, NEIGHBOURS),
    }
    for a, b in spec.check_pairs:
        found.pop(link_pair(a, b), None)
    return found | {(a, b): MOVE_AS_ONE for a, b in pairs if joint[a] == joint[b]}


def in_contact(robot: Robot, pairs: Iterable[LinkPair], samples: Array) -> tuple[LinkPair, ...]:
    """Return the pairs that touch at every one of some configurations (m, n)."""
    data, geometry_data = robot.model.createData(), pin.GeometryData(robot.collision)
    items = robot.collision.geometryObjects
    left = list(pairs)
    for q in robot.pin_q(samples):
        if not left:
            break
        check_time("loading the robot")
        pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry_data, q)
        left = [
            (a, b)
            for a, b in left
            if any(
                coal.collide(
                    items[i].geometry,
                    _transform(geometry_data.oMg[i]),
                    items[j].geometry,
                    _transform(geometry_data.oMg[j]),
                    coal.CollisionRequest(),
                    coal.CollisionResult(),
                )
                for i in robot.link_geometry[a]
                for j in robot.link_geometry[b]
            )
        ]
    return tuple(left)


def never_in_contact(model: pin.Model, geometry: pin.GeometryModel, held: Mapping[str, float]) -> tuple[LinkPair, ...]:
    """Return the pairs of links that cannot touch, whatever any joint of the whole robot does: a lower bound.

    Seen from the joint that carries both branches, each link stays within a ball: about its geometry, grown at every
    joint on the way. A revolute joint carries a ball of radius r, its centre at p, about its axis a: it stays within
    the ball about (a·p) a of radius r + |p - (a·p) a|. A prismatic one of range [l, u] leads to the ball about
    p + (l + u) / 2 a of radius r + (u - l) / 2; ranges are a little wider than the limits (LIMIT_EXCESS), and reach the
    values `held`. Where the two balls are apart, so are the links.
    """
    carried: dict[str, int] = {}
    balls: dict[str, tuple[Array, float]] = {}
    for item in geometry.geometryObjects:
        link = str(model.frames[item.parentFrame].name)
        item.geometry.computeLocalAABB()
        centre = item.placement.act(np.asarray(item.geometry.aabb_center, dtype=np.float64))
        ball = (centre, float(item.geometry.aabb_radius))
        carried[link] = int(item.parentJoint)
        balls[link] = _around(balls[link], ball) if link in balls else ball
    grown = {link: _along_the_way(model, carried[link], ball, held) for link, ball in balls.items()}
    found = []
    for a, b in itertools.combinations(grown, 2):
        above = max(set(grown[a]) & set(grown[b]))  # joints are numbered upwards from the world
        (p, r), (q, s) = grown[a][above], grown[b][above]
        if np.linalg.norm(p - q) > r + s + GAP_ROUNDING:
            found.append(link_pair(a, b))
    return tuple(found)


def _along_the_way(
    model: pin.Model, joint: int, ball: tuple[Array, float], held: Mapping[str, float]
) -> dict[int, tuple[Array, float]]:
    """Return the ball in the frame of its own joint, and of every joint below it down to the world, by index."""
    found = {joint: ball}
    while joint > 0:
        centre, radius = found[joint]
        slide, axis = motion_axes(model.joints[joint])
        if np.any(axis):
            on_axis = axis * (axis @ centre)
            radius += float(np.linalg.norm(centre - on_axis))
            centre = on_axis
        else:
            at = held.get(str(model.names[joint]), 0.0)
            index = model.joints[joint].idx_q
            low = min(float(model.lowerPositionLimit[index]) - LIMIT_EXCESS, at)
            high = max(float(model.upperPositionLimit[index]) + LIMIT_EXCESS, at)
            centre, radius = centre + slide * (low + high) / 2, radius + (high - low) / 2
        joint, placement = int(model.parents[joint]), model.jointPlacements[joint]
        found[joint] = placement.act(centre), radius
    return found


def _around(one: tuple[Array, float], other: tuple[Array, float]) -> tuple[Array, float]:
    """Return the smallest ball around two."""
    (p, r), (q, s) = one, other
    apart = float(np.linalg.norm(q - p))
    if apart + s <= r:
        return one
    if apart + r <= s:
        return other
    radius = (apart + r + s) / 2
    return p + (q - p) * ((radius - r) / apart), radius


def _transform(pose: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(pose.rotation, pose.translation)
