"""Lower bounds on the distance of two bodies over a whole interval of a motion, from coarse to exact.

For one interval and one pair A, B, with n a unit direction (world frame) and everything evaluated at the interval's
midpoint, the bounds of `motion_bounds` give, since the bracket is concave in s,

    d(A(s), B(s)) ≥ min_{s = ±1} [ min_{a ∈ A} n·(a + s a') − max_{b ∈ B} n·(b + s b') ] − R_A − R_B,   |s| ≤ 1,

two values of support functions, n·(a + s a') = (n + s n × Ω)·a + s n·U. For a pair whose joints have a common ancestor,
only the joints beyond it count: the motion is relative to it. Any n gives a valid bound; coal gives the best one. R
falls with the square of the interval's length. Coarser: the distance at the midpoint less the bodies' whole travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.distance.compiled.loops import Record, twin_of
from hdplan.planner.certificate import bounds_loop
from hdplan.planner.certificate.exact_proximity import DOUBTFUL_DIFFERENCE, best_direction, directions
from hdplan.planner.certificate.intervals import Bodies, Intervals, Pairs
from hdplan.planner.certificate.rounding import ROUNDING
from hdplan.planner.geometry.cells import grouped
from hdplan.planner.motion.motion_bounds import Motion, cross
from hdplan.scenes.array_types import Array, Mask, Rows

GROUPED_FROM = 500  # bodies that stand, from which on it is worth while to bound groups of them
GROUP_EDGE = 0.25  # [m] edge of the cubes whose bodies make a group


@dataclass(frozen=True, eq=False)
class Items:
    """Pairs on intervals that are still to be proven."""

    node: Rows  # (i,) row of the intervals
    pair: Rows  # (i,)
    bound: Array  # (i,) proven so far [m]
    normal: Array  # (i, 3) direction to try, from b to a; 0 where there is none yet

    def __getitem__(self, rows: Mask | Rows) -> Items:
        """Return some of them."""
        return Items(self.node[rows], self.pair[rows], self.bound[rows], self.normal[rows])

    def __len__(self) -> int:
        """The number of items."""
        return len(self.node)

    @classmethod
    def all(cls, nodes: int, pairs: Rows) -> Items:
        """Return every pair on every one of `nodes` intervals, with nothing known about them."""
        size = nodes * len(pairs)
        node, pair = np.repeat(np.arange(nodes), len(pairs)), np.tile(pairs, nodes)
        return cls(node, pair, np.full(size, -np.inf), np.zeros((size, 3)))


class Bounds:
    """The bounds for the pairs of one set of bodies; each is proven, the later ones are tighter and cost more."""

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Take the bodies and their pairs."""
        self.bodies, self.pairs = bodies, pairs

    def over_all(self, nodes: Intervals) -> Array:
        """Return a bound (P,) [m] for each pair over all the intervals: the distance from a ball that contains the
        first body's whole motion to the second's box; −inf where the second moves as well."""
        bodies, pairs = self.bodies, self.pairs
        links, first = self._first
        rows = nodes.row(np.arange(len(nodes.interval))[:, None], links)  # (k, links)
        center = nodes.center[rows]
        middle = 0.5 * (center.min(axis=0) + center.max(axis=0))  # (links, 3)
        radius = (np.linalg.norm(center - middle, axis=2) + nodes.moved[rows]).max(axis=0) + bodies.radius[links]
        still: Mask = np.logical_not(bodies.chain.carried_by[bodies.joint].any(axis=1) | bodies.drifting)
        b = pairs.b
        second = nodes.row(0, b)
        local = np.einsum("pba,pb->pa", nodes.rotation[second], middle[first] - nodes.center[second])
        outside = np.maximum(np.abs(local) - bodies.half[b], 0.0)
        bound = np.where(still[b], np.linalg.norm(outside, axis=1) - radius[first] - ROUNDING, -np.inf)
        return bound if bodies.sizes is None else bound - bodies.sizes.most(nodes, pairs)

    def by_groups(self, nodes: Intervals) -> tuple[Array, Rows] | None:
        """Return bounds (k, c) [m] over each interval, of bodies' bounding balls to balls around groups of what stands,
        and which of these columns bounds each pair (P,), −1 for none; None where little stands."""
        if self._grouped is None:
            return None
        middles, radii, column = self._grouped
        links, _ = self._first
        rows = nodes.row(np.arange(len(nodes.interval))[:, None], links)  # (k, links)
        away = np.linalg.norm(nodes.center[rows][:, :, None] - middles, axis=3) - radii  # (k, links, groups)
        bound = away - (nodes.moved[rows] + self.bodies.radius[links])[:, :, None] - ROUNDING
        if self.bodies.sizes is not None:
            bound -= float(self.bodies.sizes.most(nodes, self.pairs).max())
        return bound.reshape(len(nodes.interval), -1), column

    @cached_property
    def _grouped(self) -> tuple[Array, Array, Rows] | None:
        """Balls around static bodies, by cubes of a grid: their middles (g, 3) and radii (g,) [m], and the column of
        each pair's first body and group (P,)."""
        bodies, (_, first) = self.bodies, self._first
        still = ~(bodies.chain.carried_by[bodies.joint].any(axis=1) | bodies.drifting)
        standing = np.flatnonzero(still & np.isin(np.arange(len(still)), self.pairs.b))
        if len(standing) < GROUPED_FROM:
            return None
        center, radius = bodies.standing[2][standing], bodies.radius[standing]
        order, begin = grouped(center, GROUP_EDGE)
        low = np.minimum.reduceat((center - radius[:, None])[order], begin)
        middles = 0.5 * (low + np.maximum.reduceat((center + radius[:, None])[order], begin))
        group = np.repeat(np.arange(len(begin)), np.diff(np.append(begin, len(order))))
        reach = np.linalg.norm(center[order] - middles[group], axis=1) + radius[order]
        of_body = np.full(len(still), -1)
        of_body[standing[order]] = group
        own = np.where(self.pairs.group == 0, of_body[self.pairs.b], -1)
        return middles, np.maximum.reduceat(reach, begin), np.where(own < 0, -1, first * len(begin) + own)

    def by_ball(self, nodes: Intervals, items: Items) -> tuple[Array, Array]:
        """Return a bound (i,) over the interval and the direction (i, 3) from b to a: from a's bounding ball to b's
        bounding box at the midpoint, less the travel of both."""
        bound, normal = self._by_ball(nodes, items)
        drift = self.elsewhere(nodes, items)
        if nodes.drift is not None:
            row, other = (nodes.row(items.node, body[items.pair]) for body in (self.pairs.a, self.pairs.b))
            drift = nodes.drift.first[row] + nodes.drift.first[other] + drift
        return bound - drift - ROUNDING, normal

    @twin_of(bounds_loop.by_ball)
    def _by_ball(self, nodes: Intervals, items: Items) -> tuple[Array, Array]:
        """The same, without what bodies drift and rounding may take."""
        a, b = self.pairs.a[items.pair], self.pairs.b[items.pair]
        row, other = nodes.row(items.node, a), nodes.row(items.node, b)
        rotation = nodes.rotation[other]
        local = np.einsum("iba,ib->ia", rotation, nodes.center[row] - nodes.center[other])
        away = local - np.clip(local, -self.bodies.half[b], self.bodies.half[b])
        distance = np.sqrt(np.einsum("ia,ia->i", away, away))
        inside = (distance == 0.0)[:, None]
        outward = np.einsum("iab,ib->ia", rotation, np.where(inside, local, away))
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        normal = np.where(length > 0.0, outward / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
        most = np.abs(nodes.delta) + nodes.deviation
        reach = nodes.reach[row] * self.pairs.moves_a[items.pair] + nodes.reach[other] * self.pairs.moves_b[items.pair]
        travel = np.einsum("in,in->i", most[items.node], reach)
        return distance - self.bodies.radius[a] - travel, normal

    @cached_property
    def _first(self) -> tuple[Rows, Rows]:
        """The first bodies of all pairs, links, few beside the obstacles; and which of them is in each pair."""
        links, first = np.unique(self.pairs.a, return_inverse=True)
        return links, first

    @cached_property
    def world(self) -> Record:
        """The record of the bodies for the loops in C."""
        return bounds_loop.world(self.bodies, self.pairs)

    def by_plane(self, nodes: Intervals, items: Items, normal: Array) -> tuple[Array, Array, Array]:
        """Return gap(n) at the midpoint, the bound over the interval (module's head) and how far the two bodies move
        against each other at most [m]; `normal` (i, 3) is unit."""
        gap, bound, travel = self._by_plane(nodes, items, normal)
        return gap, bound - self.elsewhere(nodes, items) - ROUNDING, travel

    @twin_of(bounds_loop.by_plane)
    def _by_plane(self, nodes: Intervals, items: Items, normal: Array) -> tuple[Array, Array, Array]:
        """The same, without what rounding may take."""
        pairs, node = self.pairs, items.node
        a, b = pairs.a[items.pair], pairs.b[items.pair]
        motion_a = nodes.motion(node, a, pairs.moves_a[items.pair])
        motion_b = nodes.motion(node, b, pairs.moves_b[items.pair])
        gaps = -self._extremes(nodes, node, a, motion_a, -normal) - self._extremes(nodes, node, b, motion_b, normal)
        travel = motion_a.first + motion_b.first
        bound = np.maximum(gaps[1:].min(axis=0) - (motion_a.second + motion_b.second), gaps[0] - travel)
        return gaps[0], bound, travel

    def elsewhere(self, nodes: Intervals, items: Items) -> Array | float:
        """Return by how much pairs (i,) may be closer because their bodies are not quite at their nominal poses [m]."""
        sizes = self.bodies.sizes
        return 0.0 if sizes is None else sizes.elsewhere(nodes, self.pairs, items.node, items.pair)

    def unknown(self, nodes: Intervals, items: Items) -> Array:
        """Return by how much pairs may be closer at the midpoints (i,) [m], errors of the joints included."""
        sizes = self.bodies.sizes
        if sizes is None:
            return np.zeros(len(items))
        return np.asarray(sizes.at_middle(nodes, self.pairs, items.node, items.pair).sum(axis=0))

    def by_best_plane(self, nodes: Intervals, items: Items) -> tuple[Array, Array, Array, Array]:
        """Return the hulls' signed distance at the midpoints, the bound over the intervals, how far the bodies move at
        most, and the directions."""
        pieces = self.bodies.pieces
        a, b = self.pairs.a[items.pair], self.pairs.b[items.pair]
        normals, proposed = self._proposed(nodes, items)
        values, bound, travel = self.by_plane(nodes, items, normals)
        doubtful = np.flatnonzero(
            ~((values > 0.0) & (proposed > 0.0) & (np.abs(values - proposed) < DOUBTFUL_DIFFERENCE))
        )
        for i in doubtful.tolist():
            node, one, other = int(items.node[i]), int(a[i]), int(b[i])
            normals[i], _ = best_direction(pieces[one], nodes.pose(node, one), pieces[other], nodes.pose(node, other))
        if len(doubtful):
            values[doubtful], bound[doubtful], _ = self.by_plane(nodes, items[doubtful], normals[doubtful])
        return values, bound, travel, normals

    def overlapping(self, nodes: Intervals, items: Items, depth: float) -> tuple[Array, Mask]:
        """Return gap(n) of the hulls for coal's first directions at the midpoints (i,), and where they surely overlap
        by `depth` [m]: much sooner known than by how much."""
        normals, proposed = self._proposed(nodes, items)
        values, *_ = self.by_plane(nodes, items, normals)
        return values, (values < -depth) & (proposed < -depth)

    def _proposed(self, nodes: Intervals, items: Items) -> tuple[Array, Array]:
        """Return the directions that coal proposes at the midpoints, and its signed distances."""
        pieces, a, b = self.bodies.pieces, self.pairs.a[items.pair], self.pairs.b[items.pair]
        return directions(
            (pieces[one].shape, nodes.transform(row), pieces[other].shape, nodes.transform(beside))
            for one, row, other, beside in zip(
                *(each.tolist() for each in (a, nodes.row(items.node, a), b, nodes.row(items.node, b))), strict=True
            )
        )

    def _extremes(self, nodes: Intervals, node: Rows, body: Rows, motion: Motion, normal: Array) -> Array:
        """Return max_{x ∈ body} n·(x + s x') for s = 0, 1, −1: (3, i)."""
        row = nodes.row(node, body)
        turn, slide = cross(normal, motion.omega), np.einsum("ij,ij->i", normal, motion.velocity)
        directions = np.stack([normal, normal + turn, normal - turn])  # (3, i, 3)
        values = np.einsum("sij,ij->si", directions, nodes.origin[row])
        values[1] += slide
        values[2] -= slide
        local = np.einsum("iba,sib->sia", nodes.rotation[row], directions)
        order = np.argsort(body, kind="stable")
        cuts = np.flatnonzero(np.diff(body[order])) + 1
        for rows in np.split(order, cuts) if len(order) else []:
            piece = self.bodies.pieces[body[rows[0]]]
            values[:, rows] += piece.support(local[:, rows].reshape(-1, 3)).reshape(3, -1)
        return np.asarray(values)
