"""Clouds of points and depth images of a scene, as the balls that a world has of them.

A pixel (u, v), column and row, of depth z saw the point ((u - cx) z / fx, (v - cy) z / fy, z). Two neighbours are of
one surface if their depths differ by at most STEEPEST of their own widths z / fx (or z / fy), of the nearer one. With
ways a and b to neighbours along its row and its column, a pixel stands for the parallelogram p +- a / 2 +- b / 2, and
its ball reaches as far as the longest of the diagonals of all of these; where there is no neighbour along a row, the
other one's way is taken, or, without both, (z / fx, 0, 0), and so with columns. What was not seen is no obstacle.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from . import images, point_files, scene as scenes
from .balls import EPS, Ball, inverse, joined, need, up
from .text import Files, listing, mapping, values

CLOUD = "file points radius voxel drop_nan ignore_robot ignore"
DEPTH = "file image intrinsics scale range radius voxel ignore_robot ignore"
TABLES = (".npy", ".npz")  # of points
STEEPEST = 5.0
NEARLY = 1.0 + 1e-12  # by which depths may be beyond the range, and steps steeper, as they are rounded
MOST_POINTS = 5_000_000  # of points


def balls_of(kind: str, value: Any, what: str, folder: Path, files: Files) -> tuple[Ball, Any] | None:
    """Centres (m, 3) in the frame of the camera, and radii (m,); None of a file that the checker does not read."""
    section = mapping(value, what, CLOUD if kind == "cloud" else DEPTH)
    given = "points" if kind == "cloud" else "image"
    need(("file" in section) != (given in section), f"{what}: either file or {given}")
    if "voxel" in section:
        need(0 < scenes.one(section["voxel"], f"{what}.voxel") <= 1, f"{what}.voxel: 0 to 1 m")
    if "file" in section:
        path = folder / scenes.word(section["file"], what)
        data = files.read(f"{kind} {path.name}", path)
        if kind == "cloud" and path.suffix.lower() in point_files.KINDS:
            if (table := point_files.table(path, data)) is None:
                return None
        elif path.suffix.lower() not in (TABLES if kind == "cloud" else images.KINDS):
            return None
        else:
            table = images.table(path, data, "points" if kind == "cloud" else "depth")
    else:
        rows = listing(section[given], what)
        need(rows and all(type(x) is list and len(x) == len(rows[0]) for x in rows), f"{what}: rows of numbers")
        table = np.array([values(x, len(rows[0]), what) for x in rows])
    need(table.ndim == 2 and table.size, f"{what}: a table of numbers is expected")
    return (_points if kind == "cloud" else _pixels)(section, table, what)


def _points(section: dict[str, Any], table: Any, what: str) -> tuple[Ball, Any]:
    need(table.shape[1] == 3 and len(table) <= MOST_POINTS, f"{what}: at most {MOST_POINTS} points (m, 3) are expected")
    seen = np.isfinite(table).all(axis=1)
    need(section.get("drop_nan", False) is True or seen.all(), f"{what}: points that are not finite")
    radius = section.get("radius")
    radii = values(radius, len(table), what) if type(radius) is list else np.full(len(table), scenes.one(radius, what))
    need(seen.any() and 0 < radii.min() <= radii.max() <= 1, f"{what}.radius: above 0, and at most 1 m")
    return Ball(table[seen]), radii[seen]


def _pixels(section: dict[str, Any], image: Any, what: str) -> tuple[Ball, Any]:
    scale, more = scenes.one(section.get("scale", 0.001), f"{what}.scale"), scenes.one(section.get("radius", 0.0), what)
    fx, fy, cx, cy = values(section.get("intrinsics"), 4, f"{what}.intrinsics").tolist()
    low, high = values(section.get("range", [0.1, 3.0]), 2, f"{what}.range").tolist()
    need(scale > 0 and fx > 0 and fy > 0 and 0 <= low < high and 0 <= more <= 1, f"{what}: numbers of a camera")
    image = np.where(np.isfinite(image), image, 0.0)
    z = Ball(image) * Ball(scale, EPS * scale)
    seen = (image > 0) & (z.mid * NEARLY >= low) & (z.mid <= high * NEARLY)
    need(seen.any(), f"{what}: has no pixel within its range")
    widths = [z * inverse(Ball(f, EPS * f)) for f in (fx, fy)]
    centre = zip(image.shape[::-1], (cx, cy), strict=True)
    columns, rows = (Ball(np.arange(n)) - Ball(c, EPS * abs(c)) for n, c in centre)
    place = joined([x[..., None] for x in (widths[0] * columns[None], widths[1] * rows[:, None], z)], 2)
    across, down = (_ways(place, seen, widths[axis], axis) for axis in (0, 1))
    longest = np.zeros(np.count_nonzero(seen))
    for a in across:
        for b in down:
            for diagonal in (a + b, a - b):
                longest = np.maximum(longest, _length(diagonal.size))
    return place[seen], up(longest / 2 + more * (1 + EPS))


def _length(x: Any) -> Any:
    """Norm, with sums in one order: a proof has the digest of these numbers, on any machine."""
    x = x * x
    return up(np.sqrt(up(x[:, 0] + x[:, 1] + x[:, 2])))


def _ways(place: Ball, seen: Any, width: Ball, axis: int) -> list[Ball]:
    """The ways (m, 3) from the pixels before those that saw something, and to those after, along a row (0) or column
    (1)."""
    one, other = (np.s_[:, :-1], np.s_[:, 1:]) if axis == 0 else (np.s_[:-1], np.s_[1:])
    step = place[other] - place[one]
    near = np.minimum(width.mid[one], width.mid[other])
    met = seen[one] & seen[other] & (np.abs(step.mid[..., 2]) <= STEEPEST * near * NEARLY)
    facing = [Ball(np.zeros(seen.shape))] * 3
    facing[axis] = width
    sides = []
    for mine, theirs in ((other, one), (one, other)):  # from the one before, to the one after
        way = joined([x[..., None] for x in facing], 2)
        for part in (theirs, mine):  # the second one counts
            way.mid[part][met], way.rad[part][met] = step.mid[met], step.rad[met]
        sides.append(way[seen])
    return sides


def shape_of(centres: Ball, radii: Any, rows: Any) -> dict[str, Any]:
    """Balls, some `rows` of all, as a world has them."""
    points, radii = centres[rows], radii[rows]
    parts, sweep = np.arange(len(radii))[:, None], np.repeat(radii[:, None], 3, axis=1)
    return {"points": points.mid, "parts": parts, "sweep": sweep, "off": float(points.rad.max(initial=0.0))}
