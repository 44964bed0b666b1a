"""Separating planes along a motion: for every pair of pieces, a tree of intervals with a direction at each leaf.

The kernel's own bound (`hdplan.verify.kernel.Motion`) says whether a direction suffices on an interval, so that what
is written is accepted; here directions are only proposed. An interval without one is halved, as the kernel halves it.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np

from hdplan.planner.geometry.coal_shapes import convex_hull, triangle_tree
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.deadline import check_time
from hdplan.scenes.lazy_imports import scipy
from hdplan.verify.kernel import Motion, half
from hdplan.verify.world import Piece, World

COARSE, FINE = 2.0**6, 2.0**22  # directions are written as whole numbers of at most this: guesses, and coal's
SHORTEST = 2.0**-17  # of an interval between two rows: below it, a pair cannot be proven
FEW = 300  # items that are divided twice before they are examined again
AT_ONCE = 20_000  # leaves examined together
NEAR = 0.3  # [m] by which two bodies may move against each other for a direction of their middle to be of use
NUDGE = 1e-5  # [rad] of slightly turned poses
FLAT = 1e-4  # thickness, as a share of the size, below which coal gets a thicker hull


@dataclass(frozen=True, eq=False)
class Leaves:
    """Leaves of the trees of some pairs, in the order of the pairs and of the motion."""

    pair: Rows  # (L,)
    depth: Rows  # (L,)
    normal: Array  # (L, 3) whole numbers
    bound: Array  # (L,) [m] proven by each


@dataclass(frozen=True)
class Obstruction:
    """A pair that planes cannot keep apart: its hulls are too close, or it would need intervals that are too short."""

    pair: int
    row: float
    distance: float  # [m] of the hulls there, or the bound


class Planes:
    """Proposes and checks planes between the pieces of one world."""

    def __init__(self, world: World) -> None:
        """Take the pieces."""
        self.world = world
        self.shapes = [_coal_shape(piece.corners.tobytes(), piece.sweep.tobytes()) for piece in world.pieces]
        pieces = world.pieces
        self.joint = np.array([piece.joint for piece in pieces])
        self.turn, self.at = (np.array([piece.pose[i].mid for piece in pieces]) for i in (0, 1))
        boxes = [(x.corners.min(axis=0) - x.sweep, x.corners.max(axis=0) + x.sweep) for x in pieces]
        self.middles = np.array([(x.corners.min(axis=0) + x.corners.max(axis=0)) / 2 for x in pieces])
        self.boxes = np.array(boxes).transpose(1, 0, 2)  # (2, G, 3) corners of each piece's box

    def separate(self, chosen: Rows, floor: Array) -> tuple[Leaves, list[Obstruction]]:
        """Return planes that keep the chosen pairs (k,) `floor` (P,) [m] apart over the whole motion, and the pairs for
        which there are none; the leaves of those are not complete."""
        rows, none = len(self.world.control.mid), np.zeros(len(chosen))
        parts = chosen, none, none + float(rows), np.zeros(len(chosen), dtype=np.int64), np.zeros((len(chosen), 3))
        pair, low, high, depth, normal = _halved(*_halved(*parts))  # few pairs are far apart over the whole motion
        done = [(pair[:0], low[:0], depth[:0], normal[:0], low[:0])]
        lost: dict[int, Obstruction] = {}
        while len(pair):
            check_time("writing the proof")
            bound, distance = np.full(len(pair), -np.inf), np.full(len(pair), np.inf)
            for begin in range(0, len(pair), AT_ONCE):
                part = slice(begin, begin + AT_ONCE)
                spans, node = np.unique(np.stack([low[part], high[part]], axis=1), axis=0, return_inverse=True)
                motion = Motion(self.world, spans)
                normal[part], bound[part], distance[part] = self._examine(
                    motion, node.ravel(), self.world.pairs[pair[part]], normal[part], floor[pair[part]]
                )
            good = bound >= floor[pair]
            done.append((pair[good], low[good], depth[good], normal[good], bound[good]))
            short = ~good & (high - low <= SHORTEST)
            for i in np.flatnonzero(~good & ((distance < floor[pair]) | short)).tolist():
                lost.setdefault(int(pair[i]), Obstruction(int(pair[i]), low[i], min(distance[i], bound[i])))
            left = ~good & ~np.isin(pair, list(lost))
            parts = _halved(pair[left], low[left], high[left], depth[left], normal[left])
            if len(parts[0]) < FEW:  # a round takes some milliseconds, however few are left
                parts = _halved(*parts)
            pair, low, high, depth, normal = parts
        ended: list[Any] = [np.concatenate(each) for each in zip(*done, strict=True)]
        order = np.lexsort((ended[1], ended[0]))
        return Leaves(*(each[order] for each in (ended[0], *ended[2:]))), list(lost.values())

    def _examine(
        self, motion: Motion, node: Rows, bodies: Rows, normal: Array, floor: Array
    ) -> tuple[Array, Array, Array]:
        """Return the best directions found, of the interval above, of the bodies' boxes, or else coal's; their bounds;
        and, where coal was asked, a distance that the hulls do not exceed somewhere on the interval."""
        rows = np.flatnonzero(~normal.any(axis=1))
        normal, distance = normal.copy(), np.full(len(node), np.inf)
        if len(rows):
            normal[rows] = whole(self._outward(motion, node[rows], *bodies[rows].T), COARSE)
        bound = motion.gaps(node, bodies, normal)
        travel, astray = np.zeros(len(node)), np.zeros(len(node))  # [m] over the interval, and off its middle
        for body in bodies.T:
            moves = self.joint[body] >= 0
            reach = motion.reach[node[moves], self.world.slot[body[moves]]]
            travel[moves] += (motion.most[node[moves]] * reach).sum(axis=1)
            astray[moves] += (motion.off[node[moves]] * reach).sum(axis=1)
        rows = np.flatnonzero((bound < floor) & (travel < NEAR))
        if len(rows):
            found = [self._direction(motion, node[i], bodies[i, 0], bodies[i, 1], floor[i]) for i in rows.tolist()]
            better, distance[rows] = whole(np.array([each for each, _ in found]), FINE), [each for _, each in found]
            value = motion.gaps(node[rows], bodies[rows], better)
            use = value > bound[rows]
            normal[rows[use]], bound[rows[use]] = better[use], value[use]
        return normal, bound, distance + astray

    def _poses(self, motion: Motion, node: Rows, body: Rows) -> tuple[Array, Array]:
        """Return rotations (k, 3, 3) and origins (k, 3) of bodies at the middles of intervals."""
        joint = self.joint[body]
        turn, at = motion.turn.mid[node, joint], motion.at.mid[node, joint]
        return turn @ self.turn[body], (turn @ self.at[body, :, None])[:, :, 0] + at

    def _outward(self, motion: Motion, node: Rows, a: Rows, b: Rows) -> Array:
        """Return the directions (k, 3) from the boxes of bodies b to the centres of bodies a."""
        (turn_a, at_a), (turn_b, at_b) = self._poses(motion, node, a), self._poses(motion, node, b)
        gap = (turn_a @ self.middles[a, :, None])[:, :, 0] + at_a - at_b
        local = (gap[:, None] @ turn_b)[:, 0]
        away = local - np.clip(local, *self.boxes[:, b])
        away = np.where(away.any(axis=1, keepdims=True), away, local)
        return np.asarray((turn_b @ away[:, :, None])[:, :, 0])

    def _direction(self, motion: Motion, node: int, a: int, b: int, doubted: float) -> tuple[Array, float]:
        """Return coal's direction from b to a at the middle of an interval, and about the distance of the two hulls.

        coal is sometimes wrong where bodies are parallel: where it says less than `doubted`, slightly turned poses are
        tried too, and the farthest gap counts.
        """
        (one, swollen), (other, more) = self.shapes[a], self.shapes[b]
        (turn_a, turn_b), (at_a, at_b) = self._poses(motion, np.array([node, node]), np.array([a, b]))
        best, farthest = np.array([0.0, 0.0, 1.0]), -np.inf
        for turn in _TURNS:
            result, poses = (
                coal.DistanceResult(),
                (coal.Transform3s(turn_a @ turn, at_a), coal.Transform3s(turn_b, at_b)),
            )
            distance = float(coal.distance(one, poses[0], other, poses[1], _REQUEST, result)) + swollen + more
            apart = np.array(result.getNearestPoint1()) - np.array(result.getNearestPoint2())
            trees = isinstance(one, coal.BVHModelBase) or isinstance(other, coal.BVHModelBase)  # they have no normals
            normal = apart if trees and apart.any() else -np.array(result.normal)
            normal = normal / (float(np.linalg.norm(normal)) or 1.0)
            if turn is _TURNS[0] and distance >= doubted:
                return normal, distance
            near = normal @ at_a - _reach(self.world.pieces[a], -normal @ turn_a)
            gap = float(near - normal @ at_b) - _reach(self.world.pieces[b], normal @ turn_b)
            if gap > farthest:
                best, farthest = normal, gap
        return best, farthest + swollen + more


def _halved(pair: Rows, low: Array, high: Array, depth: Rows, normal: Array) -> tuple[Rows, Array, Array, Rows, Array]:
    """Return items with their intervals halved, as the kernel halves them."""
    middle = np.array([half(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True)])
    return (
        *(np.tile(pair, 2), np.concatenate([low, middle]), np.concatenate([middle, high])),
        *(np.tile(depth + 1, 2), np.tile(normal, (2, 1))),
    )


def _reach(piece: Piece, direction: Array) -> float:
    """Return the greatest value of direction · x over a piece, in its frame."""
    return float((piece.corners @ direction).max() + np.linalg.norm(piece.sweep * direction))


def whole(directions: Array, full: float) -> Array:
    """Return directions (k, 3) as whole numbers, the largest of which is `full`."""
    largest = np.abs(directions).max(axis=1, keepdims=True)
    good = np.isfinite(largest) & (largest > 0.0)
    return np.asarray(np.where(good, np.rint(full * directions / np.where(good, largest, 1.0)), [0.0, 0.0, full]))


@functools.lru_cache(maxsize=4096)  # the bodies of a robot are those of the last proof
def _coal_shape(corner_bytes: bytes, sweep_bytes: bytes) -> tuple[Any, float]:
    """Return a shape of coal that is about the hull of corners (m, 3), swept by an ellipsoid (3,), as it only proposes
    directions, and how much larger it is [m]."""
    corners, sweep = np.frombuffer(corner_bytes).reshape(-1, 3), np.frombuffer(sweep_bytes)
    if sweep.any() and (corners[:, :2].any() or corners[:, 2].sum()):  # balls of a cloud: coal gets their centres
        shape, larger = _coal_shape(corner_bytes, np.zeros(3).tobytes())
        return shape, larger - float(sweep.max())
    if sweep.any():
        length = float(np.ptp(corners[:, 2]))
        if length == 0.0:
            return coal.Ellipsoid(*sweep), 0.0
        return (coal.Capsule(sweep[0], length) if sweep[2] else coal.Cylinder(sweep[0], length)), 0.0
    middle = corners.mean(axis=0)
    _, extents, axes = np.linalg.svd(corners - middle, full_matrices=False)
    if len(corners) < 3 or extents[1] < FLAT * extents[0]:  # a line, or a point: a thin body around it
        swell = FLAT * (float(extents[0]) or 1.0)
        around = swell * np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
        return convex_hull((corners[:, None] + around).reshape(-1, 3)), 2.0 * swell
    if extents[2] < FLAT * extents[0]:  # flat: coal is better at triangles than at thin bodies
        ring = corners[scipy.spatial.ConvexHull((corners - middle) @ axes[:2].T).vertices]
        fan = [[0, i, i + 1] for i in range(1, len(ring) - 1)]
        return triangle_tree(TriangleMesh(ring, np.array(fan))), 2.0 * FLAT * float(extents[0])
    if (hull := convex_hull(corners)) is not None:
        return hull, 0.0
    directions = np.random.default_rng(0).normal(size=(250, 3))  # coal cannot hold it: the farthest corners will do
    return convex_hull(corners[np.unique((directions @ corners.T).argmax(axis=1))]), 0.0


def _slightly(x: float, y: float, z: float) -> Array:
    """Return the rotation by a small vector [rad], to first order."""
    return np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])


_REQUEST = coal.DistanceRequest()
_TURNS = [_slightly(*(NUDGE * np.array(way))) for way in ((0, 0, 0), (1, 2, -1), (-2, 1, 1), (1, -1, 2))]
