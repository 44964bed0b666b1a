"""Pairs of links that touch at all values of the joints between them: a proof, by balls inside both.

Inside each link lie balls B(c, r): c deep in the solid, r less than the distance to its surface; points of the surface
are balls of radius 0. Two balls have a point in common while |c − c'| < r + r', so the links touch at a configuration q
where that holds for one pair of balls, and also nearby: while each joint i between the two links stays within h_i of
q_i, the centre c' moves relative to the other link by at most

    s = Σ h_i ρ_i   with   ρ_i = d_i + Σ_{k after i} h_k ρ_k   for a joint that turns, ρ_i = 1 for one that slides,

where d_i is the distance of c' from the axis of joint i at q, and "after" counts from there to c'. So r + r' − |c − c'|
> s proves the whole cell |q_i − x_i| ≤ h_i. The box of all values that the joints may take is such a cell; one that is
not proven is halved. Lengths [m], angles [rad].
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import coal
import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.coal_shapes import mesh_of
from hdplan.planner.geometry.solids import Solid
from hdplan.planner.robot.pin_model import configuration_at, motion_axes
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import check_time
from hdplan.scenes.robot_files.link_pairs import LinkPair

if TYPE_CHECKING:
    from hdplan.planner.robot.robot import Robot

Balls = tuple[Array, Array]  # centres (m, 3), radii (m,)

OVERLAP_ROUNDING = 1e-6  # [m] by which balls must overlap beyond what is needed
POINTS = 512  # of a grid in a geometry's bounding box, tried as centres
MOST_BALLS = 40  # of one geometry
MOST_CORNERS = 200  # vertices of one mesh that count as balls of radius 0
MOST_TRIANGLES = 2000  # of a mesh that is examined
CENTRE_SPACING = 0.6  # of a ball's radius: centres within are not tried, as their balls are nearly in it
MOST_CELLS = 150  # examined for one pair; if they do not do, the pair is not proven


def always_touching(robot: Robot, pairs: Iterable[LinkPair], room: float) -> tuple[LinkPair, ...]:
    """Return the pairs of links that are proven to touch at all configurations, up to `room` [rad or m] beyond
    the limits of the joints. Of a pair that is not among them nothing is known."""
    known: dict[tuple[str, bool], Balls] = {}

    def balls(link: str, deep: bool) -> Balls:
        if (link, deep) not in known:
            known[link, deep] = _balls_in(robot, link, deep)
        return known[link, deep]

    found = []
    for a, b in pairs:
        for deep in (False, True):  # often the vertices of a mesh do, and what is inside it takes long to find
            check_time("loading the robot")
            if _always(robot, (a, b), (balls(a, deep), balls(b, deep)), room):
                found.append((a, b))
                break
    return tuple(found)


def _always(robot: Robot, pair: LinkPair, balls: tuple[Balls, Balls], room: float) -> bool:
    """Prove one pair by halving cells, or give up."""
    model, (a, b) = robot.model, (robot.link_joint[link] for link in pair)
    (centres_a, radii_a), (centres_b, radii_b) = balls
    if not len(radii_a) or not len(radii_b):
        return False
    above_a, above_b = _upward(model, a), _upward(model, b)
    between = [*(j for j in above_a if j not in above_b), *(j for j in reversed(above_b) if j not in above_a)]
    axes = {joint: motion_axes(model.joints[joint]) for joint in between}
    ranges = np.array([_range(model, joint, room) for joint in between]).reshape(-1, 2)
    if not np.isfinite(ranges).all():
        return False
    data, cells = model.createData(), [(ranges.mean(axis=1), np.ptp(ranges, axis=1) / 2)]
    for _ in range(MOST_CELLS):
        if not cells:
            return True
        middle, half = cells.pop()
        pin.forwardKinematics(model, data, configuration_at(model, zip(between, middle, strict=True)))
        at_a, at_b = _placed(data.oMi[a], centres_a), _placed(data.oMi[b], centres_b)
        moved, shares = np.zeros(len(at_b)), np.zeros((len(between), len(at_b)))
        for i in reversed(range(len(between))):  # from link b back to link a
            slide, turn = axes[between[i]]
            reach = np.ones(len(at_b))
            if not np.any(slide):
                place = data.oMi[between[i]]
                off = at_b - place.translation
                off = off - np.outer(off @ (place.rotation @ turn), place.rotation @ turn)
                reach = np.linalg.norm(off, axis=1) + moved
            shares[i] = half[i] * reach
            moved = moved + shares[i]
        overlap = radii_a[:, None] + radii_b - _apart(at_a, at_b) - OVERLAP_ROUNDING
        if overlap.max() <= 0.0:
            return False  # not even at this configuration
        left = overlap - moved
        if left.max() > 0.0:
            continue
        widest = int(np.argmax(shares[:, np.unravel_index(np.argmax(left), left.shape)[1]]))
        smaller = np.where(np.arange(len(half)) == widest, half / 2, half)
        cells += [(middle + side * (half - smaller), smaller) for side in (-1, 1)]
    return False


def _upward(model: pin.Model, joint: int) -> list[int]:
    """Return the joints from one up to the world, without the world."""
    found = []
    while joint > 0:
        found.append(joint)
        joint = int(model.parents[joint])
    return found


def _range(model: pin.Model, joint: int, room: float) -> tuple[float, float]:
    """Return the values that a joint may take: of one that turns, a whole turn at most."""
    kind = model.joints[joint]
    low, high = (float(ends[kind.idx_q]) for ends in (model.lowerPositionLimit, model.upperPositionLimit))
    turns = bool(np.any(motion_axes(kind)[1]))
    if kind.nq != 1 or (turns and high - low + 2 * room >= 2 * math.pi):
        return -math.pi, math.pi
    return low - room, high + room


def _placed(pose: pin.SE3, points: Array) -> Array:
    return np.asarray(points @ pose.rotation.T + pose.translation)


def _apart(one: Array, other: Array) -> Array:
    """Return all distances (m, k), within 1e-7 of the size of the two sets, which is less than OVERLAP_ROUNDING."""
    middle = one.mean(axis=0)
    one, other = one - middle, other - middle
    square = (one * one).sum(axis=1)[:, None] + (other * other).sum(axis=1) - 2 * one @ other.T
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


# --- balls -----------------------------------------------------------------------------------------------


def _balls_in(robot: Robot, link: str, deep: bool) -> Balls:
    """Return balls inside a link's solids, in the frame of its joint; `deep` ones in meshes too."""
    centres, radii = [np.empty((0, 3))], [np.empty(0)]
    for index in robot.link_geometry[link]:
        item = robot.collision.geometryObjects[index]
        own, within = _balls(item.geometry, deep)
        centres.append(_placed(item.placement, own))
        radii.append(within)
    return np.concatenate(centres), np.concatenate(radii)


def _balls(geometry: Any, deep: bool) -> Balls:
    """Return balls inside one geometry, the largest first."""
    corners = np.empty((0, 3))
    if isinstance(geometry, coal.BVHModelBase):
        mesh = mesh_of(geometry)
        corners = mesh.vertices[:: max(1, len(mesh.vertices) // MOST_CORNERS)]
        solid, points = Solid(mesh), np.empty((0, 3))
        if deep and len(mesh.triangles) <= MOST_TRIANGLES and not solid.open:
            points = _grid(*solid.box)
            points = points[[solid.holds(point) for point in points]]
        depths = np.array([_distance(point, mesh.vertices[mesh.triangles]) for point in points])
    else:
        geometry.computeLocalAABB()
        box = geometry.aabb_local
        points = _grid(np.ravel(box.min_), np.ravel(box.max_))
        depths = _depths(geometry, points)
    centres, radii = corners, np.zeros(len(corners))
    for i in np.argsort(-depths).tolist():
        if depths[i] <= OVERLAP_ROUNDING or len(radii) >= MOST_BALLS + len(corners):
            break
        if (np.linalg.norm(centres - points[i], axis=1) >= CENTRE_SPACING * radii).all():
            centres, radii = np.vstack([centres, points[i]]), np.append(radii, depths[i] - OVERLAP_ROUNDING)
    return centres, radii


def _grid(low: Array, high: Array) -> Array:
    """Return about POINTS points spread over a box, its middle among them."""
    size = np.maximum(high - low, 1e-3 * (high - low).max())
    counts = np.maximum(np.round(size * (POINTS / size.prod()) ** (1 / 3)), 1).astype(int)
    counts = np.minimum(counts + 1 - counts % 2, 25)  # odd
    steps = [low[k] + size[k] * (np.arange(counts[k]) + 0.5) / counts[k] for k in range(3)]
    return np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)


def _depths(geometry: Any, points: Array) -> Array:
    """Return lower bounds on the depths (m,) of points inside a solid, negative outside."""
    x, y, z = points.T
    match geometry:
        case coal.Box():
            return np.asarray((geometry.halfSide - np.abs(points)).min(axis=1))
        case coal.Sphere():
            return np.asarray(geometry.radius - np.linalg.norm(points, axis=1))
        case coal.Ellipsoid():
            return np.asarray((1.0 - np.linalg.norm(points / geometry.radii, axis=1)) * min(geometry.radii))
        case coal.Cylinder():
            return np.asarray(np.minimum(geometry.radius - np.hypot(x, y), geometry.halfLength - np.abs(z)))
        case coal.Capsule():
            beyond = np.maximum(np.abs(z) - geometry.halfLength, 0.0)
            return np.asarray(geometry.radius - np.sqrt(x * x + y * y + beyond * beyond))
    return np.full(len(points), -1.0)  # of other shapes nothing is known


def _distance(point: Array, triangles: Array) -> float:
    """Return the distance of a point from triangles (F, 3, 3): from their planes where it lies above them, else from
    their edges."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    found, sides = np.inf, []
    normal = _cross(b - a, c - a)
    for start, end in ((a, b), (b, c), (c, a)):
        along, to = end - start, point - start
        share = np.clip((to * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-300), 0.0, 1.0)
        found = min(found, float(((to - share[:, None] * along) ** 2).sum(axis=1).min()))
        sides.append((_cross(along, to) * normal).sum(axis=1) >= 0.0)
    size = np.linalg.norm(normal, axis=1)
    above = sides[0] & sides[1] & sides[2] & (size > 0.0)
    heights = np.abs(((point - a) * normal).sum(axis=1))[above] / size[above]
    return min(math.sqrt(found), float(heights.min(initial=np.inf)))


def _cross(a: Array, b: Array) -> Array:
    """Return cross products (F, 3), several times faster than NumPy's."""
    return np.stack([a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)
