"""Maps of a scene, voxel grids and octomaps, as the boxes that a world has of them.

How occupied cells are put together to boxes, the proof may say: here it is shown that each occupied cell is in just one
of them, and no other cell in any.

An octomap's tree begins with a cube about the origin, of 2^16 cells along an edge. Bit 0 of a child's number says
whether it is on the upper side along x, bit 1 along y, bit 2 along z.
"""

from __future__ import annotations

import base64
import itertools
import struct
from pathlib import Path
from typing import Any

import numpy as np

from . import images, scene as scenes
from .balls import EPS, Ball, need
from .text import Files, mapping, number, values

VOXELS, OCTOMAP = "file occupied size origin", "file content unknown"
ROOT = 1 << 16  # cells along an edge of the tree's root
BINARY, FULL = b"# Octomap OcTree binary file", b"# Octomap OcTree file"
OCCUPIED, INNER = 2, 3  # of a child's two bits in a binary tree; 1 is free, 0 unknown
MOST_CELLS = 64_000_000
WHOLE = 1e-6  # of a cell's edge, by which boxes may be off whole cells
CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
CORNERS.setflags(write=False)


def boxes_of(kind: str, value: Any, what: str, folder: Path, files: Files, claimed: Any) -> dict[str, Any]:
    """The shape of a map, put together of cells as a proof `claimed` (8 k, 3)."""
    grid, first, edge, origin = (_voxels if kind == "voxels" else _octomap)(value, what, folder, files)
    need(len(claimed) % 8 == 0 and len(claimed) > 0, f"{what}: the proof has no boxes")
    cells = (claimed.reshape(-1, 8, 3) - origin.mid) / edge.mid - first
    low, high = (np.rint(x).astype(np.int64) for x in (cells.min(axis=1), cells.max(axis=1)))
    sides = low[:, None] + CORNERS * (high - low)[:, None]
    whole = np.abs(cells - sides).max() <= WHOLE and (low >= 0).all() and (high <= grid.shape).all()
    need(whole, f"{what}: the proof's boxes must be whole cells, in the order of their corners")
    found = np.zeros(grid.shape, dtype=np.int8)
    for (x, y, z), (right, back, top) in zip(low.tolist(), high.tolist(), strict=True):
        part = found[x:right, y:back, z:top]
        need(part.size and not part.any(), f"{what}: the proof has boxes that are empty, or overlap")
        part[...] = 1
    need((found == grid).all(), f"{what}: the proof's boxes are not just the occupied cells")
    points = origin + Ball((sides + first).reshape(-1, 3).astype(np.float64)) * edge
    parts = np.arange(len(claimed)).reshape(-1, 8)
    return {"points": points.mid, "parts": parts, "sweep": np.zeros((1, 3)), "off": float(points.rad.max())}


def _voxels(value: Any, what: str, folder: Path, files: Files) -> tuple[Any, Any, Ball, Ball]:
    """Cells (x, y, z), the number of the first, a cell's edge and the place of the cell of number 0."""
    section = mapping(value, what, VOXELS)
    need(("file" in section) != ("occupied" in section), f"{what}: either file or occupied")
    if "file" in section:
        path = folder / scenes.word(section["file"], what)
        data = files.read(f"voxels {path.name}", path)
        need(path.suffix.lower() in (".npy", ".npz"), f"{what}: a grid of another kind")
        grid = images.table(path, data, "occupied")
    else:
        grid = np.array(section["occupied"])
        need(grid.dtype.kind in "biuf", f"{what}: cells of 0 and 1 are expected")
    need(grid.ndim == 3 and 0 < grid.size <= MOST_CELLS and np.isin(grid, (0, 1)).all(), f"{what}: cells of 0 and 1")
    need(grid.any(), f"{what}: holds no occupied cell")
    edge = scenes.one(section.get("size"), f"{what}.size")
    at = values(section.get("origin", [0.0] * 3), 3, f"{what}.origin")
    need(edge > 0, f"{what}.size: above 0")
    return grid != 0, np.zeros(3, dtype=np.int64), Ball(edge, EPS * edge), Ball(at, EPS * np.abs(at))


def _octomap(value: Any, what: str, folder: Path, files: Files) -> tuple[Any, Any, Ball, Ball]:
    """Boxes of the leaves of a tree, as of `_voxels`; what the tree does not know is free, or occupied in the box of
    all it knows."""
    section = mapping(value, what, OCTOMAP)
    need(("file" in section) != ("content" in section), f"{what}: either file or content")
    unknown = section.get("unknown", "free")
    need(unknown in ("free", "occupied"), f"{what}.unknown: free or occupied")
    if "file" in section:
        path = folder / scenes.word(section["file"], what)
        data = files.read(f"octomap {path.name}", path)
    else:
        data = base64.b64decode(scenes.word(section["content"], what), validate=True)
    head, mark, tree = data.partition(b"\ndata\n")
    first, *lines = head.decode("ascii").split("\n")
    need(mark and first.strip().encode() in (BINARY, FULL), f"{what}: is not an octomap")
    words = [line.split() for line in lines if not line.startswith("#")]
    kinds = [x[0] for x in words if x]
    need(kinds.count("id") == kinds.count("res") == 1, f"{what}: says not once what it is")
    of = {x[0]: x[1] for x in words if len(x) == 2}
    need(of.get("id") == "OcTree", f"{what}: a tree of another kind")
    edge = number(of.get("res"), f"{what}: res")
    need(0 < edge <= 1e6, f"{what}: res")
    leaves = np.array(list((_binary if first.strip().encode() == BINARY else _full)(tree, what)), dtype=np.int64)
    need(len(leaves), f"{what}: is empty")
    shown = leaves if unknown == "occupied" else leaves[leaves[:, 4] == 1]
    need(len(shown), f"{what}: holds no occupied cell")
    low, high = shown[:, :3].min(axis=0), (shown[:, :3] + shown[:, 3:4]).max(axis=0)
    need(np.prod((high - low).astype(float)) <= MOST_CELLS, f"{what}: spans too many cells")
    grid = np.full(high - low, unknown == "occupied")
    for x, y, z, size, taken in (shown - [*low, 0, 0]).tolist():
        grid[x : x + size, y : y + size, z : z + size] = taken
    return grid, low - ROOT // 2, Ball(edge, EPS * edge), Ball(np.zeros(3))


def _children(x: int, y: int, z: int, half: int) -> list[tuple[int, int, int, int]]:
    return [(x + half * (i & 1), y + half * (i >> 1 & 1), z + half * (i >> 2)) + (half,) for i in range(8)]


def _binary(tree: bytes, what: str) -> Any:
    """The leaves (x, y, z, size, occupied) of nodes of two bytes, with two bits for each child."""
    at, waiting = 0, [(0, 0, 0, ROOT)]
    while waiting:
        x, y, z, size = waiting.pop()
        need(size > 1 and at + 2 <= len(tree), f"{what}: is cut short, or has nodes below the smallest cells")
        bits = int.from_bytes(tree[at : at + 2], "little")
        at += 2
        inner = []
        for i, child in enumerate(_children(x, y, z, size // 2)):
            kind = bits >> 2 * i & 3
            if kind == INNER:
                inner.append(child)
            elif kind:
                yield (*child, int(kind == OCCUPIED))
        waiting += reversed(inner)
    need(at == len(tree), f"{what}: holds more than its tree")


def _full(tree: bytes, what: str) -> Any:
    """The leaves of nodes of a number, at least 0 if they are occupied, and a byte with a bit for each child."""
    at, waiting = 0, [(0, 0, 0, ROOT)]
    while waiting:
        x, y, z, size = waiting.pop()
        need(at + 5 <= len(tree), f"{what}: is cut short")
        (odds,), bits = struct.unpack_from("<f", tree, at), tree[at + 4]
        at += 5
        need(size > 1 or not bits, f"{what}: has nodes below the smallest cells")
        need(np.isfinite(odds), f"{what}: a probability must be a number")
        if not bits:
            yield x, y, z, size, int(odds >= 0)
        waiting += reversed([child for i, child in enumerate(_children(x, y, z, size // 2)) if bits >> i & 1])
    need(at == len(tree), f"{what}: holds more than its tree")
