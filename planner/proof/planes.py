"""Separating planes along a motion: for every pair of pieces, a tree of intervals with a direction at each leaf.

Directions are proposed by boxes and by coal, and judged by the certificate's fast bounds (`spans`). An interval without
one is halved, as the kernel halves it. What is found the kernel examines before it is written.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np

from hdplan.planner.certificate.exact_proximity import directions, outermost
from hdplan.planner.certificate.interval_bounds import Items
from hdplan.planner.certificate.intervals import Intervals
from hdplan.planner.geometry.coal_shapes import convex_hull, triangle_tree
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.geometry.rotations import slight_turns
from hdplan.planner.proof.spans import STRAY_DISTANCE, Spans
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.deadline import check_time
from hdplan.scenes.lazy_imports import scipy
from hdplan.verify.kernel import half
from hdplan.verify.world import Piece, World

COARSE, FINE = 2.0**6, 2.0**22  # directions are written as whole numbers of at most this: guesses, and coal's
SHORTEST_INTERVAL = 2.0**-17  # of an interval between two rows: below it, a pair cannot be proven
COMMON = 4  # levels of the trees, on whose intervals bodies are placed at once
DIVIDED_TWICE = 60  # items that are divided twice before they are examined again
AT_ONCE = 20_000  # leaves examined together
NEAR_MOTION = 0.3  # [m] by which two bodies may move against each other for a direction of their middle to be of use
KERNEL_ROUNDING = 1e-9  # [m] by which the kernel's own bound may be less, as it counts roundings
NUDGE = 1e-5  # [rad] of slightly turned poses
FLAT_RATIO = 1e-4  # thickness, as a share of the size, below which coal gets a thicker hull


@dataclass(frozen=True, eq=False)
class Leaves:
    """Leaves of the trees of some pairs, in the order of the pairs and of the motion."""

    pair: Rows  # (L,)
    depth: Rows  # (L,)
    normal: Array  # (L, 3) whole numbers


@dataclass(frozen=True)
class Obstruction:
    """A pair that planes cannot keep apart: its hulls are too close, or it would need intervals that are too short."""

    pair: int
    row: float
    distance: float  # [m] of the hulls there, or the bound


class Planes:
    """Proposes planes between the pieces of one world."""

    def __init__(self, world: World) -> None:
        """Take the pieces."""
        self.world = world
        made = [_coal_shape(piece.corners.tobytes(), piece.sweep.tobytes()) for piece in world.pieces]
        self.shapes = [shape for shape, _ in made]
        self.swollen = np.array([swollen for _, swollen in made])  # (g,) [m] how much larger than the pieces
        self.flat = np.array([isinstance(shape, coal.BVHModelBase) for shape in self.shapes], dtype=bool)
        self.spans = Spans(world, self.shapes)

    def separate(self, chosen: Rows, floor: Array) -> tuple[Leaves, list[Obstruction]]:
        """Return planes that keep the chosen pairs (k,) `floor` (P,) [m] apart over the whole motion, and the pairs for
        which there are none; the leaves of those are not complete."""
        rows, none = len(self.world.control.mid), np.zeros(len(chosen))
        spans = _Placed(self.spans, rows)
        parts = chosen, none, none + float(rows), np.zeros(len(chosen), dtype=np.int64), np.zeros((len(chosen), 3))
        pair, low, high, depth, normal = _halved(*parts)  # few pairs are far apart over the whole motion
        done = [(pair[:0], low[:0], depth[:0], normal[:0])]
        lost, gone = dict[int, Obstruction](), np.zeros(len(self.world.pairs), dtype=bool)
        while len(pair):
            check_time("writing the proof")
            bound, distance = np.full(len(pair), -np.inf), np.full(len(pair), np.inf)
            for begin in range(0, len(pair), AT_ONCE):
                part = slice(begin, begin + AT_ONCE)
                nodes, node = spans.at(low[part], high[part])
                normal[part], bound[part], distance[part] = self._examine(
                    nodes, Items(node, pair[part], bound[part], normal[part]), floor[pair[part]] + KERNEL_ROUNDING
                )
            good = bound >= floor[pair] + KERNEL_ROUNDING
            done.append((pair[good], low[good], depth[good], normal[good]))
            short = ~good & (high - low <= SHORTEST_INTERVAL)
            for i in np.flatnonzero(~good & ((distance < floor[pair]) | short)).tolist():
                lost.setdefault(int(pair[i]), Obstruction(int(pair[i]), low[i], min(distance[i], bound[i])))
                gone[pair[i]] = True
            left = ~good & ~gone[pair]
            parts = _halved(pair[left], low[left], high[left], depth[left], normal[left])
            if len(parts[0]) < DIVIDED_TWICE:  # a round takes a millisecond, however few are left
                parts = _halved(*parts)
            pair, low, high, depth, normal = parts
        ended: list[Any] = [np.concatenate(each) for each in zip(*done, strict=True)]
        order = np.lexsort((ended[1], ended[0]))
        return Leaves(*(each[order] for each in (ended[0], *ended[2:]))), list(lost.values())

    def _examine(self, nodes: Intervals, items: Items, floor: Array) -> tuple[Array, Array, Array]:
        """Return the best directions found, of the interval above, of the bodies' boxes, or else coal's; their bounds;
        and, where coal was called, a distance that the hulls do not exceed somewhere on the interval."""
        bounds, pairs = self.spans.bounds, self.spans.pairs
        normal, distance = items.normal.copy(), np.full(len(items), np.inf)
        if len(rows := np.flatnonzero(~normal.any(axis=1))):
            normal[rows] = whole(bounds.by_ball(nodes, items[rows])[1], COARSE)
        _, bound, travel = bounds.by_plane(nodes, items, unit(normal))
        rows = np.flatnonzero((bound < floor) & (travel - 2.0 * STRAY_DISTANCE < NEAR_MOTION))
        if len(rows):
            better, distance[rows] = self._directions(nodes, items[rows], floor[rows])
            better = whole(better, FINE)
            _, value, _ = bounds.by_plane(nodes, items[rows], unit(better))
            use = value > bound[rows]
            normal[rows[use]], bound[rows[use]] = better[use], value[use]
            for body in (pairs.a, pairs.b):  # how far off the middle of the interval
                reach = nodes.reach[nodes.row(items.node[rows], body[items.pair[rows]])]
                distance[rows] += (nodes.deviation[items.node[rows]] * reach).sum(axis=1)
        return normal, bound, distance

    def _directions(self, nodes: Intervals, items: Items, floor: Array) -> tuple[Array, Array]:
        """Return coal's directions at the middles of intervals and about the distances of the hulls, examined again
        where coal is to be doubted."""
        of = self.spans.pairs.a[items.pair], self.spans.pairs.b[items.pair]
        (a, row_a), (b, row_b) = ((each.tolist(), nodes.row(items.node, each).tolist()) for each in of)
        normal, distance = directions(
            (self.shapes[x], nodes.transform(row), self.shapes[y], nodes.transform(other))
            for x, row, y, other in zip(a, row_a, b, row_b, strict=True)
        )
        distance += self.swollen[of[0]] + self.swollen[of[1]]
        trees = self.flat[of[0]] | self.flat[of[1]]  # which have no normals
        for i in np.flatnonzero(~(distance >= floor) | trees).tolist():
            normal[i], distance[i] = self._direction(nodes, a[i], b[i], row_a[i], row_b[i], floor[i])
        return normal, distance

    def _direction(
        self, nodes: Intervals, a: int, b: int, row_a: int, row_b: int, doubted: float
    ) -> tuple[Array, float]:
        """Return coal's direction from b to a at the middle of an interval, and about the distance of the two hulls.

        coal is sometimes wrong where bodies are parallel: where it says less than `doubted`, slightly turned poses are
        tried too, and the farthest gap counts.
        """
        one, other, swollen = self.shapes[a], self.shapes[b], float(self.swollen[a] + self.swollen[b])
        turn_a, turn_b, at_a, at_b = *nodes.rotation[[row_a, row_b]], *nodes.origin[[row_a, row_b]]
        best, farthest = np.array([0.0, 0.0, 1.0]), -np.inf
        for turn in _TURNS:
            result, place = coal.DistanceResult(), nodes.transform(row_a)
            if turn is not _TURNS[0]:
                place = coal.Transform3s(turn_a @ turn, at_a)
            distance = float(coal.distance(one, place, other, nodes.transform(row_b), _REQUEST, result))
            distance += swollen
            apart = np.array(result.getNearestPoint1()) - np.array(result.getNearestPoint2())
            trees = self.flat[a] or self.flat[b]  # which have no normals
            normal = apart if trees and apart.any() else -np.array(result.normal)
            normal = normal / (float(np.linalg.norm(normal)) or 1.0)
            if turn is _TURNS[0] and distance >= doubted:
                return normal, distance
            near = normal @ at_a - _reach(self.world.pieces[a], -normal @ turn_a)
            gap = float(near - normal @ at_b) - _reach(self.world.pieces[b], normal @ turn_b)
            if gap > farthest:
                best, farthest = normal, gap
        return best, farthest + swollen


class _Placed:
    """The pieces on spans of a motion, those of the first COMMON levels of all trees at once."""

    def __init__(self, spans: Spans, rows: int) -> None:
        self.spans, low, high = spans, np.zeros(1), np.full(1, float(rows))
        levels = []
        for _ in range(COMMON):
            middle = half(low, high)
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            levels.append(low + 1j * high)
        self.common = np.unique(np.concatenate(levels))
        self.nodes = spans.on(self.common.real.copy(), self.common.imag.copy())

    def at(self, low: Array, high: Array) -> tuple[Intervals, Rows]:
        """Return them on spans (i,), and which of those that are placed each one is."""
        ends, node = np.unique(low + 1j * high, return_inverse=True)
        place = np.minimum(np.searchsorted(self.common, ends), len(self.common) - 1)
        if (self.common[place] == ends).all():
            return self.nodes, place[node.ravel()]
        return self.spans.on(ends.real.copy(), ends.imag.copy()), node.ravel()


def _halved(pair: Rows, low: Array, high: Array, depth: Rows, normal: Array) -> tuple[Rows, Array, Array, Rows, Array]:
    """Return items with their intervals halved, as the kernel halves them."""
    middle = half(low, high)
    return (
        *(np.concatenate([pair, pair]), np.concatenate([low, middle]), np.concatenate([middle, high])),
        *(np.concatenate([depth + 1, depth + 1]), np.concatenate([normal, normal])),
    )


def _reach(piece: Piece, direction: Array) -> float:
    """Return the greatest value of direction · x over a piece, in its frame."""
    return float((piece.corners @ direction).max() + np.linalg.norm(piece.sweep * direction))


def unit(directions: Array) -> Array:
    """Return directions (k, 3) of length 1."""
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


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
    if len(corners) < 3 or extents[1] < FLAT_RATIO * extents[0]:  # a line, or a point: a thin body around it
        swell = FLAT_RATIO * (float(extents[0]) or 1.0)
        around = swell * np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
        return convex_hull((corners[:, None] + around).reshape(-1, 3)), 2.0 * swell
    if extents[2] < FLAT_RATIO * extents[0]:  # flat: coal is better at triangles than at thin bodies
        ring = corners[scipy.spatial.ConvexHull((corners - middle) @ axes[:2].T).vertices]
        fan = [[0, i, i + 1] for i in range(1, len(ring) - 1)]
        return triangle_tree(TriangleMesh(ring, np.array(fan))), 2.0 * FLAT_RATIO * float(extents[0])
    if (hull := convex_hull(corners)) is not None:
        return hull, 0.0
    return convex_hull(outermost(corners)), 0.0  # coal cannot hold it: the farthest corners will do


_REQUEST = coal.DistanceRequest()
_TURNS = [np.eye(3), *slight_turns(3, NUDGE)]
