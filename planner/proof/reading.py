"""A proof read again, for display: for two bodies at a moment of the motion, the leaf that holds, and its plane.

The plane's direction is the leaf's; it is carried by the last body that carries both, and moves along its normal so as
to stay in the middle between the two (docs/proof.md). Everything is computed by the checker's own kinematics.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import check_file, read_file
from hdplan.verify import RejectedError, verify
from hdplan.verify.checking import check
from hdplan.verify.kernel import NARROWEST, Motion, leaves, unpack
from hdplan.verify.world import World

CORNER_TOLERANCE = 1e-4  # [m] within which corners are equally far along a direction


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane between two convex pieces at a moment, in the world frame."""

    point: Array  # (3,) [m] in the middle between the two
    normal: Array  # (3,) of length 1, from the second body to the first
    gap: float  # [m] between the two along the normal, at this moment: a lower bound of their distance
    bound: float  # [m] proven for the whole leaf
    leaf: int  # its number among those of the pair, from 0
    leaves: int  # of the pair
    span: tuple[float, float]  # rows of the motion between which the leaf holds


class ReadProof:
    """An accepted proof of one motion."""

    def __init__(
        self, scene: Path, motion: Path, proof: Path | bytes, request: Path | None = None, robot: str | None = None
    ) -> None:
        """Read a proof's file, or its content; of a MoveIt scene with its request and robot. Raises InputError for what
        is no proof of this motion in this scene. A file is checked in a process of its own first, within bounds of
        time and memory, as anybody may have written it."""
        name = "the proof" if isinstance(proof, bytes) else proof
        try:
            if not isinstance(proof, bytes):
                with naming(name):
                    check_file(proof)
                verify(scene, motion, proof, request, robot)
            data = proof if isinstance(proof, bytes) else read_file(proof)
            _, read = check(scene, motion, data, request, robot)
            _, _, cuts, trees = unpack(data)
            self.world = World(read, cuts)
        except RejectedError as error:
            raise InputError(f"{name}: is not a proof of {motion} in {scene}: {error}") from None
        counts, depths, normals, *_ = trees
        self.rows = len(self.world.control.mid)
        self._first = np.cumsum(counts) - counts
        self._counts, self._depths = counts, depths
        self._normals: Array = normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def row(self, curve: Curve, parameter: float) -> float:
        """Return the row at which the motion is, as the proof counts them: obstacles that move may add rows."""
        times = self.world.times
        if times is None:
            return parameter * (len(curve) - 1)
        return float(np.interp(float(curve.time_of(parameter)), times, np.arange(len(times))))

    def pairs(self, link: str, other: str, to_obstacle: bool) -> list[int]:
        """Return the pairs of pieces of a link or held object and another one, or an obstacle, which may have the name
        of a link; none if they are not compared."""
        bodies = [(piece.name, piece.kind == "obstacle") for piece in self.world.pieces]
        wanted = {(link, False), (other, to_obstacle)}
        return [p for p, (a, b) in enumerate(self.world.pairs.tolist()) if {bodies[a], bodies[b]} == wanted]

    def spans(self, pair: int) -> list[tuple[float, float]]:
        """Return the leaves of a pair of pieces, as intervals of rows."""
        own = slice(int(self._first[pair]), int(self._first[pair] + self._counts[pair]))
        spans, node, _ = leaves(self._counts[[pair]], self._depths[own], self.rows)
        return [(low, high) for low, high in spans[node].tolist()]

    def planes(self, pairs: list[int], row: float) -> list[Plane]:
        """Return the planes between pairs of pieces at a row of the motion, 0 to `rows`."""
        spans, held = [], []
        for pair in pairs:
            own = self.spans(pair)
            leaf = next((i for i, (_, high) in enumerate(own) if row < high), len(own) - 1)
            spans.append(own[leaf])
            held.append((leaf, len(own)))
        at = min(max(row, 0.0), self.rows - NARROWEST)
        motion = Motion(self.world, np.array([*spans, (at, at + NARROWEST)]))  # the last one is now
        bodies = self.world.pairs[pairs]
        directions = self._normals[[int(self._first[p]) + leaf for p, (leaf, _) in zip(pairs, held, strict=True)]]
        bounds = motion.gaps(np.arange(len(pairs)), bodies, directions).tolist()
        found = []
        for node, (leaf, count) in enumerate(held):
            normal = self._carried(motion, node, bodies[node], directions[node])
            near = _outermost(self.world, motion, bodies[node, 0], -normal)
            far = _outermost(self.world, motion, bodies[node, 1], normal)
            gap = float(normal @ (near - far))
            found.append(Plane(0.5 * (near + far), normal, gap, bounds[node], leaf, count, spans[node]))
        return found

    def closest(self, link: str, other: str, to_obstacle: bool, row: float) -> Plane | None:
        """Return the plane between two bodies at a row: of several pieces, that between the two that it finds closest.
        None for bodies that are not compared."""
        pairs = self.pairs(link, other, to_obstacle)
        return min(self.planes(pairs, row), key=lambda plane: plane.gap) if pairs else None

    def _carried(self, motion: Motion, node: int, bodies: Rows, direction: Array) -> Array:
        """Turn a leaf's direction, in the world at its middle, with the last body that carries both to where it is."""
        world = self.world
        carries = world.carried[[world.pieces[body].joint for body in bodies]].all(axis=0)
        if not carries.any():
            return direction
        turn = motion.turn.mid[:, int(np.flatnonzero(carries)[-1])]
        return np.asarray(turn[-1] @ turn[node].T @ direction)


def _outermost(world: World, motion: Motion, body: int, direction: Array) -> Array:
    """Return the middle of the points of a piece that are farthest along a direction (3,), now."""
    piece = world.pieces[body]
    turn = motion.turn.mid[-1, piece.joint]
    at = turn @ piece.pose[1].mid + motion.at.mid[-1, piece.joint]
    turn = turn @ piece.pose[0].mid
    local = turn.T @ direction
    heights = piece.corners @ local
    point = piece.corners[heights > heights.max() - CORNER_TOLERANCE].mean(axis=0)
    point += (heights.max() - point @ local) * local
    size = float(np.linalg.norm(piece.sweep * local))
    return np.asarray(turn @ (point + (piece.sweep**2 * local / size if size else 0.0)) + at)
