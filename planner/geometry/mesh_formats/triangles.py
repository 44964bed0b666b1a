"""The result of every reader of a mesh format, and polygons, strips and fans cut into it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.errors import InputError

Triangles = tuple[Array, Rows]  # vertices (m, 3) in the file's unit, corners (F, 3): rows of vertices

COORDINATE_ROUNDING = 1e-5  # of the largest coordinate: about what six written digits leave open
NEAR_POLYGON = 10.0  # times a polygon's own largest coordinate, beyond which the rest of the file does not count
WHOLE_TURN = 2.0 * np.pi - 1e-6  # [rad]
RESTART = -1  # in a list of strips, where others hold vertices
HALF_TURN = np.pi - 1e-3  # [rad] as readers find it that calculate in single precision


def fans(vertices: Array, counts: Rows, corners: Rows, place: Callable[[int], str]) -> Rows:
    """Cut polygons into triangles (F, 3) that meet in the polygon's first corner.

    `counts` (P,): corners of each polygon, 3 or more; `corners` (sum of counts,): rows of vertices; `place` names
    polygon k in errors. The fan is the polygon, however others cut it, where the polygon is flat and seen whole from
    its first corner, as every convex one is. A quadrilateral may also be bent, as others cut it the same way. Readers
    disagree about the surface of any other: InputError.
    """
    starts = np.cumsum(counts) - counts
    if (absent := (corners < 0) | (corners >= len(vertices))).any():
        at = int(absent.argmax())
        polygon = int(np.searchsorted(starts, at, side="right")) - 1
        raise InputError(
            f"{place(polygon)}: a face has vertex {corners[at]} (counted from 0); there are {len(vertices)} vertices"
        )
    ears = counts - 2
    polygon_of = np.repeat(np.arange(len(counts)), ears)
    second = starts[polygon_of] + 1 + np.arange(len(polygon_of)) - (np.cumsum(ears) - ears)[polygon_of]
    triangles = corners[np.stack([starts[polygon_of], second, second + 1], axis=1)]
    if len(many := np.flatnonzero(counts > 3)):
        clear = _seen_whole(vertices, triangles[counts[polygon_of] > 3], ears[many], np.abs(vertices[corners]).max())
        four = counts[many] == 4
        clear[four] |= _bent(vertices[corners[starts[many[four], None] + np.arange(4)]])
        if (wrong := ~clear).any():
            at = int(many[wrong.argmax()])
            raise InputError(
                f"{place(at)}: a face of {counts[at]} corners is not flat and convex; readers disagree about its "
                "surface: export it as triangles"
            )
    return np.asarray(triangles)


def strips(vertices: Array, counts: Rows, corners: Rows, place: Callable[[int], str]) -> Rows:
    """Return the triangles (F, 3) of strips, in which RESTART ends one and begins another.

    `counts` (S,): corners of each list of strips, RESTART among them; `corners`, `vertices` and `place` as in `fans`.
    Strips of one or two corners, and vertices that are not there, are refused: InputError.
    """
    listed = np.repeat(np.arange(len(counts)), counts)
    kept = corners != RESTART
    strip_of = (np.cumsum(~kept) + listed)[kept]  # a number that grows from strip to strip
    starts = np.flatnonzero(np.diff(strip_of, prepend=-1))
    lengths = np.diff(starts, append=len(strip_of))
    if (short := lengths < 3).any():
        at = int(short.argmax())
        raise InputError(f"{place(int(listed[kept][starts[at]]))}: a strip has at least 3 corners, not {lengths[at]}")
    found = [strip(each) for each in np.split(corners[kept], starts[1:])] if len(starts) else []
    of_lists = np.repeat(listed[kept][starts], lengths - 2)
    triangles = np.concatenate([np.empty((0, 3), dtype=np.int64), *found])
    return fans(vertices, np.full(len(triangles), 3), triangles.ravel(), lambda k: place(int(of_lists[k])))


def strip(corners: Rows) -> Rows:
    """Return the triangles (n - 2, 3) of a strip: each shares an edge with the one before, every second is turned."""
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    triangles[1::2, 1:] = triangles[1::2, :0:-1]
    return triangles


def fan(corners: Rows) -> Rows:
    """Return the triangles (n - 2, 3) of a fan around its first corner."""
    return np.stack([np.broadcast_to(corners[:1], len(corners) - 2), corners[1:-1], corners[2:]], axis=1)


def _seen_whole(vertices: Array, triangles: Rows, ears: Rows, largest: float) -> Mask:
    """Return, for each polygon, whether it is flat and lies whole in sight of their first corner, up to rounding: there
    no triangle of the fan runs backwards, and together they make less than a whole turn."""
    starts = np.cumsum(ears) - ears
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    with np.errstate(all="ignore"):  # what is not finite is not in sight
        own = np.maximum.reduceat(np.abs(vertices[triangles]).max(axis=(1, 2)), starts)
        tolerance = COORDINATE_ROUNDING * np.minimum(largest, NEAR_POLYGON * own)
        doubled = np.cross(b - a, c - a)
        normals = np.add.reduceat(doubled, starts)
        normal = np.repeat(normals / np.linalg.norm(normals, axis=1, keepdims=True), ears, axis=0)
        above = np.maximum(*(np.abs(np.einsum("ij,ij->i", x - a, normal)) for x in (b, c)))
        area = np.einsum("ij,ij->i", doubled, normal)
        longest = np.max([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)], axis=0)
        backwards = np.where(area < 0.0, -area / longest, 0.0)
        turn = np.add.reduceat(np.arctan2(area, np.einsum("ij,ij->i", b - a, c - a)), starts)
        flat = np.maximum.reduceat(above, starts) <= tolerance
        return np.asarray(flat & (np.add.reduceat(backwards, starts) <= tolerance) & (turn < WHOLE_TURN))


def _bent(quads: Array) -> Mask:
    """Return which quadrilaterals (Q, 4, 3), flat or not, every reader cuts from the first corner to the third: the
    halves look to the same side, whichever way it is cut, and no other corner is as wide as a half turn."""
    a, b, c, d = np.moveaxis(quads, 1, 0)

    def half(at: Array, one: Array, other: Array) -> tuple[Array, Array]:
        normal = np.cross(one - at, other - at)
        return normal, np.arctan2(np.linalg.norm(normal, axis=1), np.einsum("ij,ij->i", one - at, other - at))

    with np.errstate(all="ignore"):
        (abc, _), (acd, _), (bcd, left), (bda, right) = half(a, b, c), half(a, c, d), half(b, c, d), half(b, d, a)
        same = (np.einsum("ij,ij->i", abc, acd) > 0.0) & (np.einsum("ij,ij->i", bcd, bda) > 0.0)
        return np.asarray(same & (left + right < HALF_TURN) & (half(d, a, b)[1] + half(d, b, c)[1] < HALF_TURN))
