"""Triangle meshes of the attacker's: hostile shapes, written and read by code of its own; inside by winding numbers."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array

Index = NDArray[np.int64]
Mesh = tuple[Array, Index]

KINDS = ("box", "inverted", "open", "star", "hollow", "nested", "touching", "apart", "channel", "ball", "plate", "room")
BOX = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
    + [[1, 5, 7], [1, 7, 3]]
)


def box(size: Array, centre: Array | None = None) -> Mesh:
    """Return a box, its triangles counter-clockwise seen from outside."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    return corners + (0.0 if centre is None else centre), BOX


def ball(radius: Array, rings: int) -> Mesh:
    """Return a ball of latitudes; `radius` (rings + 1, 2 rings) may vary over it: a star."""
    polar = np.pi * np.arange(1, rings) / rings
    around = np.pi * np.arange(2 * rings) / rings
    ways = np.array([[np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)] for p in polar for a in around])
    points = np.vstack([ways * radius[1:rings].reshape(-1, 1), [[0, 0, radius[0, 0]], [0, 0, -radius[-1, 0]]]])
    width, top = 2 * rings, len(points) - 2
    faces = []
    for a in range(width):
        b = (a + 1) % width
        faces += [[top, a, b], [top + 1, (rings - 2) * width + b, (rings - 2) * width + a]]
        for row in range(rings - 2):
            up, down = row * width, (row + 1) * width
            faces += [[up + a, down + a, down + b], [up + a, down + b, up + b]]
    return points, np.array(faces)


def joined(*meshes: Mesh) -> Mesh:
    """Return meshes as one."""
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    faces = [triangles + start for (_, triangles), start in zip(meshes, starts[:-1], strict=True)]
    return np.vstack([points for points, _ in meshes]), np.vstack(faces)


def inverted(mesh: Mesh) -> Mesh:
    """Return it inside out."""
    return mesh[0], mesh[1][:, ::-1]


def hostile(kind: str, rng: np.random.Generator, size: float) -> Mesh:
    """Return a mesh of one of the `KINDS`, about `size` [m] across."""
    edges = size * rng.uniform(0.4, 1.0, 3)
    match kind:
        case "inverted":
            return inverted(box(edges))
        case "open":
            points, faces = box(edges)
            return points, np.delete(faces, rng.integers(0, 12, rng.integers(1, 4)), axis=0)
        case "star":
            rings = int(rng.integers(3, 6))
            return ball(0.5 * size * rng.uniform(0.35, 1.0, (rings + 1, 2 * rings)), rings)
        case "hollow":
            return joined(box(edges), inverted(box(edges * rng.uniform(0.3, 0.95))))
        case "nested":
            inner = box(edges * rng.uniform(0.2, 0.9))
            return joined(box(edges), inner if rng.random() < 0.5 else inverted(inner), box(edges * 0.1))
        case "touching":
            half = edges * [0.5, 1.0, 1.0]
            return joined(box(half, half * [-0.5, 0, 0]), box(half, half * [0.5, 0, 0]))
        case "apart":
            part = edges * [0.3, 1.0, 1.0]
            return joined(box(part, edges * [-0.35, 0, 0]), box(part, edges * [0.35, 0, 0]))
        case "channel":
            a, b = rng.uniform(0.2, 0.4, 2)
            outline = np.array([[0, 0], [1, 0], [1, 1], [1 - a, 1], [1 - a, b], [a, b], [a, 1], [0, 1]]) - 0.5
            return prism(
                outline * edges[:2], edges[2], [[0, 1, 4], [0, 4, 5], [0, 5, 7], [5, 6, 7], [1, 2, 4], [2, 3, 4]]
            )
        case "ball":
            rings = int(rng.integers(3, 5))
            return ball(np.full((rings + 1, 2 * rings), 0.5 * size), rings)
        case "plate":
            return box(edges * [1.0, 1.0, rng.choice([1e-1, 1e-2, 1e-3])])
        case "room":
            thick = 0.05 * size
            return joined(box(edges + thick), inverted(box(edges)))
        case _:
            return box(edges)


def prism(outline: Array, height: float, caps: list[list[int]]) -> Mesh:
    """Return a prism over a counter-clockwise outline (n, 2) whose triangles are `caps`."""
    count, triangles = len(outline), np.array(caps)
    low, high = (np.column_stack([outline, np.full(count, z)]) for z in (-height / 2, height / 2))
    sides = [[i, (i + 1) % count, count + i] for i in range(count)]
    sides += [[(i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    return np.vstack([low, high]), np.vstack([triangles[:, ::-1], triangles + count, sides])


def write(path: Path, mesh: Mesh) -> None:
    """Write it as its ending says: .obj, .stl (binary) or .ply (ASCII)."""
    points, faces = mesh
    if path.suffix == ".stl":
        begin = b"siege".ljust(80, b" ") + struct.pack("<I", len(faces))
        triangles = [np.zeros(3, dtype="<f4").tobytes() + points[f].astype("<f4").tobytes() + b"\0\0" for f in faces]
        path.write_bytes(begin + b"".join(triangles))
    elif path.suffix == ".ply":
        head = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
        head += [f"property double {axis}" for axis in "xyz"]
        head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
        rows = [" ".join(map(repr, p)) for p in points.tolist()] + [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
        path.write_text("\n".join([*head, *rows]) + "\n")
    else:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
        path.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist())]) + "\n")


def read(path: Path) -> Mesh:
    """Read what `write` wrote, and binary STL of any other."""
    if path.suffix.lower() == ".stl":
        data = path.read_bytes()
        (count,) = struct.unpack("<I", data[80:84])
        corners = np.frombuffer(data[84 : 84 + 50 * count], dtype=np.uint8).reshape(count, 50)[:, 12:48].tobytes()
        return np.frombuffer(corners, dtype="<f4").astype(float).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)
    lines = [line.split() for line in path.read_text().splitlines()]
    if path.suffix.lower() == ".ply":
        counts = [int(line[2]) for line in lines if line[:1] == ["element"]]
        rows = lines[lines.index(["end_header"]) + 1 :]
        points = np.array(rows[: counts[0]], dtype=float)
        return points, np.array(rows[counts[0] : sum(counts)], dtype=np.int64)[:, 1:]
    points = np.array([line[1:4] for line in lines if line[:1] == ["v"]], dtype=float)
    return points, np.array([line[1:4] for line in lines if line[:1] == ["f"]], dtype=np.int64) - 1


def closed(mesh: Mesh) -> bool:
    """True if every edge is met as often one way as the other, equal points taken as one."""
    _, index = np.unique(mesh[0], axis=0, return_inverse=True)
    corners = index.ravel()[mesh[1]]
    a, b = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    there, back = (np.sort(x * (len(mesh[0]) + 1) + y) for x, y in ((a, b), (b, a)))
    return bool(np.array_equal(there, back))


def windings(mesh: Mesh, points: Array) -> Array:
    """Return the winding numbers of a mesh around points (k, 3): sums of its triangles' solid angles over 4π."""
    corners = mesh[0][mesh[1]][None] - points[:, None, None]
    a, b, c = corners[:, :, 0], corners[:, :, 1], corners[:, :, 2]
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    volume = np.einsum("kfi,kfi->kf", a, np.cross(b, c))
    dots = [np.einsum("kfi,kfi->kf", x, y) for x, y in ((a, b), (b, c), (c, a))]
    below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    return np.asarray(2.0 * np.arctan2(volume, below).sum(axis=1) / (4.0 * np.pi))
