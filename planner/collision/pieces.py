"""Halfspace bodies as arrays for the tables of pairs, without an object for each cell of a cloud."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, overload

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.symbolic.halfspaces import FAR_OFFSET
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.shapes import Shape

DIRECTION_TOLERANCE = 1e-9  # between directions that count as the same


class Planes(NamedTuple):
    """The planes of those pieces that have equally many, K."""

    pieces: Rows  # (k,) ascending
    normals: Array  # (k, K, 3)
    supports: Array  # (k, K) [m]


@dataclass(frozen=True, eq=False)
class Pieces(ReadOnly, Sequence[HalfspaceBody]):
    """B halfspace bodies, each made an object on first use."""

    names: tuple[str, ...]  # (B,) as the fields of `HalfspaceBody`
    joints: Rows  # (B,)
    planes: tuple[Planes, ...]  # by their number, ascending
    boxes: Array  # (B, 4, 4)
    half_sizes: Array  # (B, 3) [m]
    shapes: tuple[Shape | ConvexBody | None, ...]  # (B,)
    placements: Array  # (B, 4, 4)
    known: tuple[Array, ...] | None = None  # `directions`, of parts of which they were known

    @classmethod
    def of(cls, bodies: Sequence[HalfspaceBody]) -> Pieces:
        """Stack bodies; itself if they are pieces."""
        if isinstance(bodies, Pieces):
            return bodies
        counts = np.array([len(body.supports) for body in bodies], dtype=np.int64)
        planes = []
        for count in sorted(set(counts.tolist())):
            own = np.flatnonzero(counts == count)
            normals = np.array([bodies[b].normals for b in own.tolist()])
            planes.append(Planes(own, normals, np.array([bodies[b].supports for b in own.tolist()])))
        return cls(
            tuple(body.name for body in bodies),
            np.array([body.joint for body in bodies], dtype=np.int64),
            tuple(planes),
            np.array([body.box for body in bodies]).reshape(-1, 4, 4),
            np.array([body.half_size for body in bodies]).reshape(-1, 3),
            tuple(body.shape for body in bodies),
            np.array([body.placement for body in bodies]).reshape(-1, 4, 4),
        )

    @classmethod
    def joined(cls, parts: Sequence[Pieces]) -> Pieces:
        """Put pieces one after another."""
        parts = [part for part in parts if len(part)] or parts[:1]
        if len(parts) == 1:
            return parts[0]
        first, known = np.cumsum([0, *(len(part) for part in parts)]), None
        if any(part.known is not None for part in parts):
            known = _distinct(each for part in parts for each in part.directions)
        found: dict[int, list[Planes]] = {}
        for begin, part in zip(first.tolist(), parts, strict=False):
            for own in part.planes:
                found.setdefault(own.supports.shape[1], []).append(own._replace(pieces=own.pieces + begin))
        return cls(
            sum((part.names for part in parts), ()),
            np.concatenate([part.joints for part in parts]),
            tuple(Planes(*map(np.concatenate, zip(*found[count], strict=True))) for count in sorted(found)),
            np.concatenate([part.boxes for part in parts]),
            np.concatenate([part.half_sizes for part in parts]),
            sum((part.shapes for part in parts), ()),
            np.concatenate([part.placements for part in parts]),
            known,
        )

    @cached_property
    def directions(self) -> tuple[Array, ...]:
        """The sets of `HalfspaceBody.directions` that occur, to DIRECTION_TOLERANCE: one for all cells of a cloud."""
        if self.known is not None:
            return self.known
        found: list[Array] = []
        for own in self.planes:
            boxes = self.boxes[own.pieces]
            reach = own.supports - np.einsum("bki,bi->bk", own.normals, boxes[:, :3, 3])
            used = reach < np.linalg.norm(self.half_sizes[own.pieces], axis=1)[:, None] + FAR_OFFSET / 2
            left = np.where(used[..., None], own.normals @ boxes[:, :3, :3], 0.0)
            while len(left):
                found.append(left[0][left[0].any(axis=1)])
                left = left[(np.abs(left - left[0]) > DIRECTION_TOLERANCE).any(axis=(1, 2))]
        return tuple(found)

    def on(self, joints: Rows) -> Pieces:
        """Return these pieces carried by joints (B,)."""
        return replace(self, joints=joints)

    def __len__(self) -> int:
        """The number of pieces."""
        return len(self.names)

    @overload
    def __getitem__(self, index: int) -> HalfspaceBody: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[HalfspaceBody, ...]: ...
    def __getitem__(self, index: int | slice) -> HalfspaceBody | tuple[HalfspaceBody, ...]:
        """Make one of them, or some."""
        if isinstance(index, slice):
            return tuple(self[b] for b in range(*index.indices(len(self))))
        b = range(len(self))[index]
        own, row = next((own, row[0]) for own in self.planes if len(row := np.flatnonzero(own.pieces == b)))
        return HalfspaceBody(
            self.names[b],
            int(self.joints[b]),
            own.normals[row],
            own.supports[row],
            self.boxes[b],
            self.half_sizes[b],
            self.shapes[b],
            self.placements[b],
        )


def _distinct(sets: Iterable[Array]) -> tuple[Array, ...]:
    """Return sets of directions, each once, to DIRECTION_TOLERANCE."""
    found: list[Array] = []
    for each in sets:
        if not any(one.shape == each.shape and np.abs(one - each).max() <= DIRECTION_TOLERANCE for one in found):
            found.append(each)
    return tuple(found)
