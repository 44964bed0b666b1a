"""Points that a ball inside a link cannot pass: in the obstacles that stand, and beyond the link's reach.

Every point of an obstacle lies in it: on its triangles, between points of its hull, or in the middle of a ball of a
cloud. That there are gaps between the points only makes openings larger than they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.exact_proximity import Piece
from hdplan.planner.certificate.intervals import Body
from hdplan.planner.geometry.division import divided
from hdplan.planner.geometry.meshes import FLAT_RATIO, TriangleMesh, thinness
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.once import made_once

POINT_SPACING = 1.0  # of a radius: the longest edge between points of one obstacle
MOST_POINTS = 5_000  # points of one obstacle above which they are thinned
CELL = 0.3  # of a radius: of those in a cube of this edge one is kept
CIRCLE_CORNERS = 40  # corners in place of a circle
RADII_BEYOND_REACH = 2.0  # radii beyond the reach up to which there are points
OUTER_SPACING = 0.13  # of the reach, between points beyond it
OUTER_REACH = 3.0  # times the reach that these are beyond it
POINT_ROUNDING = 1e-6  # [m] by which the balls around points are smaller


@dataclass(frozen=True, eq=False)
class Reach:
    """A cylinder, in the world, in which a point of a link stays at all joint values."""

    origin: Array  # (3,)
    axis: Array  # (3,) unit
    radius: float  # [m]
    low: float  # along the axis, from the origin [m]
    high: float

    def outside(self, points: Array) -> Array:
        """Return the distances (k,) of points (k, 3) from the reach [m]; 0 inside."""
        beside = points - self.origin
        along = beside @ self.axis
        across = np.linalg.norm(beside - along[:, None] * self.axis, axis=1) - self.radius
        above = np.maximum(along - self.high, self.low - along)
        return np.asarray(np.hypot(np.maximum(across, 0.0), np.maximum(above, 0.0)))

    @classmethod
    def of(cls, chain: Chain, joint: int, point: Array, travel: Array) -> Reach | None:
        """Return that of a point (3,) in the frame of a joint, by how far the joints go (n, 2); None if they continue
        without end."""
        *_, (last, (radius, low, high)) = chain.inward(joint, chain.around(joint, point[None], 0.0), travel)
        if not np.isfinite([radius, low, high]).all():
            return None
        stands = chain.model.jointPlacements[last + 1]
        return cls(stands.translation.copy(), stands.rotation @ chain.axes[last], radius, low, high)

    @property
    def around(self) -> tuple[Array, Array]:
        """Points (k, 3) outside on all sides, and how far (k,) [m]."""
        tall = self.high - self.low
        size = max(self.radius, 0.5 * tall)
        step, out = OUTER_SPACING * size, OUTER_REACH * size
        count = 1 + int(np.pi * (self.radius / step) ** 2)
        turns, away = np.pi * (3.0 - 5**0.5) * np.arange(count), self.radius * np.sqrt((np.arange(count) + 0.5) / count)
        disc = np.column_stack([away * np.cos(turns), away * np.sin(turns)])
        angles = np.linspace(0.0, 2.0 * np.pi, 6 + int(2.0 * np.pi * self.radius / step), endpoint=False)
        ring = (self.radius + out) * np.column_stack([np.cos(angles), np.sin(angles)])
        heights = np.linspace(self.low, self.high, 2 + int(tall / step))
        flat = np.concatenate([disc, disc, np.tile(ring, (len(heights), 1))])
        lids = np.repeat([self.low - out, self.high + out], count)
        along = np.concatenate([lids, np.repeat(heights, len(ring))])
        first = np.eye(3)[np.abs(self.axis).argmin()]
        one = np.cross(self.axis, first)
        one /= np.linalg.norm(one)
        other = np.cross(self.axis, one)
        points = self.origin + flat @ np.stack([one, other]) + along[:, None] * self.axis
        return points, self.outside(points) - POINT_ROUNDING


def off_ends(points: Array, ends: Array) -> Array:
    """Return the distances (k,) of points (k, 3) from the nearest of some ends (e, 3) [m]."""
    return np.asarray(np.min([np.linalg.norm(points - end, axis=1) for end in ends], axis=0))


def points_of(body: Body, keep: float, reach: Reach | None, ends: Array, most: float) -> tuple[Array, Array]:
    """Return points (k, 3) [m] in the world of an obstacle that stands, and how far (k,) [m] the centre of a ball must
    be from each to be `keep` from the obstacle. Points beyond its reach are left out, and those more than `most` times
    `keep` off its `ends` (e, 3)."""
    rotation, origin = body.placement[:3, :3], body.placement[:3, 3]

    def near(points: Array, around: Array) -> Mask:
        found = off_ends(points, ends) <= around + most * keep
        return found if reach is None else found & (reach.outside(points) <= around + RADII_BEYOND_REACH * keep)

    piece = body.piece
    center = rotation @ piece.center + origin
    if not near(center[None], np.array([piece.radius])).all():
        return np.empty((0, 3)), np.empty(0)
    if piece.grains is not None:
        points, radii = piece.grains[:, :3] @ rotation.T + origin, keep + piece.grains[:, 3]
    else:
        radius = keep + piece.ball
        points = piece.vertices @ rotation.T + origin
        if piece.radius > CELL * keep:
            points = divided(_triangles(piece) @ rotation.T + origin, POINT_SPACING * radius, near).reshape(-1, 3)
        radii = np.full(len(points), radius)
    kept = near(points, np.zeros(len(points)))
    points, radii = points[kept], radii[kept]
    points, first = np.unique(points, axis=0, return_index=True)
    radii = radii[first]
    if len(points) > MOST_POINTS:
        _, first = np.unique(np.floor(points / (CELL * radii[:, None])), axis=0, return_index=True)
        points, radii = points[first], radii[first]
    return points, radii - POINT_ROUNDING


@made_once(256)
def _triangles(piece: Piece) -> Array:
    """Return triangles (m, 3, 3) of a piece without the ball that sweeps it, in its frame: its surface, or one that it
    contains."""
    if piece.surface is not None:
        return np.asarray(piece.surface.mesh.vertices[piece.surface.mesh.triangles])
    points = np.concatenate([piece.vertices + offset for offset in _swept(piece)])
    if len(points) > 3 and thinness(points) > FLAT_RATIO:
        hull = TriangleMesh.hull(points)
        return np.asarray(hull.vertices[hull.triangles])
    fan = np.stack(
        [np.zeros(len(points), dtype=np.int64), np.arange(len(points)), np.arange(1, len(points) + 1)], axis=1
    )
    return np.asarray(points[fan % len(points)])


def _swept(piece: Piece) -> Iterator[Array]:
    """Yield points (3,) of the disc or ellipsoid that sweeps a piece, or its centre."""
    angles = 2.0 * np.pi * np.arange(CIRCLE_CORNERS) / CIRCLE_CORNERS
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(CIRCLE_CORNERS)])
    if piece.disc:
        yield from piece.disc * around
    elif piece.radii is not None:
        tilts = np.linspace(-0.5 * np.pi, 0.5 * np.pi, CIRCLE_CORNERS // 2)
        for tilt in tilts:
            yield from piece.radii * (np.cos(tilt) * around + [0.0, 0.0, np.sin(tilt)])
    else:
        yield np.zeros(3)
