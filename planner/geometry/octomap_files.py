"""Files of octomaps: .bt, which knows free and occupied, and .ot, which has a probability for each cell.

The tree's root is a cube about the origin, of edge 2¹⁶ cells; each node has up to eight children, of which bit 0 of the
number says whether it is on the upper side along x, bit 1 along y and bit 2 along z (A. Hornung et al., "OctoMap",
Autonomous Robots 2013, and its file formats).
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

import numpy as np

from hdplan.scenes.array_types import Mask, Rows
from hdplan.scenes.errors import InputError
from hdplan.scenes.number_text import read_number

DEPTH = 16  # of the tree
FREE, OCCUPIED, INNER = 1, 2, 3  # of a child's two bits in a .bt file; 0 is unknown
BINARY, FULL = "# Octomap OcTree binary file", "# Octomap OcTree file"  # first lines of .bt and .ot


class Leaves(NamedTuple):
    """The leaves of an octomap, in cells counted from the lower corner of the root."""

    resolution: float  # [m] edge of a cell
    low: Rows  # (k, 3) the lower corner
    size: Rows  # (k,) cells along an edge
    occupied: Mask  # (k,) or else free


def read_octomap(content: bytes) -> Leaves:
    """Read the leaves of an octomap's file. Raises InputError for content that is damaged, or of another kind."""
    head, _, data = content.partition(b"\ndata\n")
    lines = head.decode("ascii", errors="replace").splitlines()
    kind = lines[0].strip() if lines else ""
    if kind not in (BINARY, FULL):
        raise InputError(f"begins neither with '{BINARY}' nor with '{FULL}'")
    header = dict(line.split(None, 1) for line in lines if not line.startswith("#") and len(line.split()) == 2)
    if header.get("id") != "OcTree":
        raise InputError(f"is a tree of kind '{header.get('id', '')}'; OcTree is read")
    try:
        resolution = read_number(header["res"])
    except (KeyError, ValueError):
        resolution = 0.0
    if not 0.0 < resolution <= 1e6:
        raise InputError(f"has the resolution '{header.get('res', '')}'; a number greater than 0 [m] is needed")
    try:
        found = _binary(data) if kind == BINARY else _full(data)
    except (IndexError, struct.error):
        raise InputError("is cut short") from None
    if not found:
        raise InputError("is empty")
    rows = np.array(found, dtype=np.int64)
    return Leaves(resolution, rows[:, :3], rows[:, 3], rows[:, 4].astype(bool))


Leaf = tuple[int, int, int, int, bool]  # lower corner, edge, occupied


def _binary(data: bytes) -> list[Leaf]:
    """Walk the tree: each inner node is two bytes, with two bits for each child."""
    found: list[Leaf] = []
    at, left = 0, [(0, 0, 0, 1 << DEPTH)]  # nodes whose bytes come next, the last first
    while left and data:
        x, y, z, size = left.pop()
        bits, half = data[at] | data[at + 1] << 8, size // 2
        at += 2
        inner = []
        for child in range(8):
            kind = bits >> 2 * child & 3
            if not kind:
                continue
            corner = (x + half * (child & 1), y + half * (child >> 1 & 1), z + half * (child >> 2))
            if kind == INNER:
                inner.append((*corner, half))
            else:
                found.append((*corner, half, kind == OCCUPIED))
        if inner and half <= 1:
            raise InputError("has nodes below the smallest cells")
        left.extend(reversed(inner))
    return found


def _full(data: bytes) -> list[Leaf]:
    """Walk the tree: each node is its log-odds, a float, and a byte with a bit for each child."""
    found: list[Leaf] = []
    at, left = 0, [(0, 0, 0, 1 << DEPTH)]
    while left and data:
        x, y, z, size = left.pop()
        (odds,), bits, half = struct.unpack_from("<f", data, at), data[at + 4], size // 2
        at += 5
        if not bits:
            if math.isnan(odds):
                raise InputError("has a cell whose probability is not a number")
            found.append((x, y, z, size, odds >= 0.0))
            continue
        if size <= 1:
            raise InputError("has nodes below the smallest cells")
        children = [child for child in range(8) if bits >> child & 1]
        left.extend(
            (x + half * (child & 1), y + half * (child >> 1 & 1), z + half * (child >> 2), half)
            for child in reversed(children)
        )
    return found
