"""Lower bounds on the distance of two bodies over a whole interval of a motion, from coarse to exact.

For one interval and one pair A, B, with n a unit direction (world frame) and everything evaluated at the interval's
midpoint, the bounds of `motion_bounds` give, since the bracket is concave in s,

    d(A(s), B(s)) ≥ min_{s = ±1} [ min_{a ∈ A} n·(a + s a') − max_{b ∈ B} n·(b + s b') ] − R_A − R_B,   |s| ≤ 1,

two values of support functions, n·(a + s a') = (n + s n × Ω)·a + s n·U. For a pair whose joints have a common ancestor,
only the joints beyond it count: the motion is relative to it. Any n gives a valid bound; coal gives the best one. R
falls with the square of the interval's length. Coarser: the distance at the midpoint less the bodies' whole travel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hdplan.distance.compiled.c_library import Record
from hdplan.planner.certificate import bounds_loop, support_loop
from hdplan.planner.certificate.exact_proximity import DOUBTFUL, best_direction, direction
from hdplan.planner.certificate.intervals import Bodies, Index, Intervals, Pairs
from hdplan.planner.certificate.rounding import ROUNDING
from hdplan.planner.motion.motion_bounds import Array, Mask, Motion, cross


@dataclass(frozen=True, eq=False)
class Items:
    """Pairs on intervals that are still to be proven."""

    node: Index  # (i,) row of the intervals
    pair: Index  # (i,)
    bound: Array  # (i,) proven so far [m]
    normal: Array  # (i, 3) direction to try, from b to a; 0 where there is none yet
    motions: tuple[Motion, Motion] | None = None  # of the bodies a and b; computed when a bound needs them

    def __getitem__(self, rows: Mask | Index) -> Items:
        """Return some of them."""
        motions = self.motions and (self.motions[0][rows], self.motions[1][rows])
        return Items(self.node[rows], self.pair[rows], self.bound[rows], self.normal[rows], motions)

    def __len__(self) -> int:
        """The number of items."""
        return len(self.node)

    @classmethod
    def all(cls, nodes: int, pairs: Index) -> Items:
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
        rows, first = np.unique(pairs.a, return_inverse=True)  # the first bodies: links, few beside the obstacles
        center = nodes.center[:, rows]
        middle = 0.5 * (center.min(axis=0) + center.max(axis=0))  # (rows, 3)
        radius = (np.linalg.norm(center - middle, axis=2) + nodes.moved[:, rows]).max(axis=0) + bodies.radius[rows]
        still: Mask = np.logical_not(bodies.chain.carried_by[bodies.joint].any(axis=1) | bodies.drifting)
        b = pairs.b
        local = np.einsum("pba,pb->pa", nodes.rotation[0, b], middle[first] - nodes.center[0, b])
        outside = np.maximum(np.abs(local) - bodies.half[b], 0.0)
        return np.where(still[b], np.linalg.norm(outside, axis=1) - radius[first] - ROUNDING, -np.inf)

    def by_ball(self, nodes: Intervals, items: Items) -> tuple[Array, Array]:
        """Return a bound (i,) over the interval and the direction (i, 3) from b to a: from a's bounding ball to b's
        bounding box at the midpoint, less the travel of both."""
        a, b = self.pairs.a[items.pair], self.pairs.b[items.pair]
        drift = 0.0 if nodes.drift is None else nodes.drift.first[items.node, a] + nodes.drift.first[items.node, b]
        if loops := bounds_loop.library():
            bound, normal = bounds_loop.by_ball(loops, self._world, nodes.record, items.node, items.pair)
            return bound - drift - ROUNDING, normal
        rotation = nodes.rotation[items.node, b]
        local = np.einsum("iba,ib->ia", rotation, nodes.center[items.node, a] - nodes.center[items.node, b])
        away = local - np.clip(local, -self.bodies.half[b], self.bodies.half[b])
        distance = np.sqrt(np.einsum("ia,ia->i", away, away))
        inside = (distance == 0.0)[:, None]
        outward = np.einsum("iab,ib->ia", rotation, np.where(inside, local, away))
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        normal = np.where(length > 0.0, outward / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
        travel = np.einsum("in,in->i", nodes.speed[items.node, a], self.pairs.moves_a[items.pair])
        travel += np.einsum("in,in->i", nodes.speed[items.node, b], self.pairs.moves_b[items.pair])
        return distance - self.bodies.radius[a] - travel - drift - ROUNDING, normal

    @cached_property
    def _world(self) -> Record:
        """For the loops in C."""
        return bounds_loop.world(self.bodies, self.pairs)

    def with_motion(self, nodes: Intervals, items: Items) -> Items:
        """Return the items with their bodies' motions, which the bounds below need."""
        return replace(items, motions=(self._motion(nodes, items, False), self._motion(nodes, items, True)))

    def _motion(self, nodes: Intervals, items: Items, second: bool) -> Motion:
        """The motion of the first or the second body of each item's pair."""
        pairs = self.pairs
        body = (pairs.b if second else pairs.a)[items.pair]
        if loops := bounds_loop.library():
            motion = bounds_loop.motion(loops, self._world, nodes.record, items.node, items.pair, second)
        else:
            motion = nodes.motion(items.node, body, (pairs.moves_b if second else pairs.moves_a)[items.pair])
        return motion if nodes.drift is None else motion + nodes.drift[items.node, body]

    def by_plane(self, nodes: Intervals, items: Items, normal: Array) -> tuple[Array, Array]:
        """Return gap(n) at the midpoint and the bound over the interval (module's head); `normal` (i, 3) is unit."""
        motion_a, motion_b = _motions(items)
        near, far = (
            self._extremes(nodes, items.node, bodies[items.pair], motion, sign * normal)
            for bodies, motion, sign in ((self.pairs.a, motion_a, -1), (self.pairs.b, motion_b, 1))
        )
        gaps = -near - far  # (3, i) at s = 0, 1, −1
        second = motion_a.second + motion_b.second
        return gaps[0], np.maximum(gaps[1:].min(axis=0) - second, gaps[0] - travel_of(items)) - ROUNDING

    def by_best_plane(self, nodes: Intervals, items: Items) -> tuple[Array, Array, Array]:
        """Return the hulls' signed distance at the midpoints, the bound over the intervals and the directions."""
        pairs, pieces = self.pairs, self.bodies.pieces
        normals, said = np.empty((len(items), 3)), np.empty(len(items))
        for i, (node, pair) in enumerate(zip(items.node.tolist(), items.pair.tolist(), strict=True)):
            a, b = int(pairs.a[pair]), int(pairs.b[pair])
            found = direction(pieces[a].shape, nodes.transform(node, a), pieces[b].shape, nodes.transform(node, b))
            normals[i], said[i] = found.normal, found.distance
        values, bound = self.by_plane(nodes, items, normals)
        doubtful = np.flatnonzero(~((values > 0.0) & (said > 0.0) & (np.abs(values - said) < DOUBTFUL)))
        for i in doubtful.tolist():
            node, a, b = int(items.node[i]), int(pairs.a[items.pair[i]]), int(pairs.b[items.pair[i]])
            normals[i], _ = best_direction(pieces[a], nodes.pose(node, a), pieces[b], nodes.pose(node, b))
        if len(doubtful):
            values[doubtful], bound[doubtful] = self.by_plane(nodes, items[doubtful], normals[doubtful])
        return values, bound, normals

    def _extremes(self, nodes: Intervals, node: Index, body: Index, motion: Motion, normal: Array) -> Array:
        """Return max_{x ∈ body} n·(x + s x') for s = 0, 1, −1: (3, i)."""
        if loops := support_loop.library():
            places = nodes.rotation, nodes.origin
            return support_loop.extremes(
                loops, self.bodies.record, node, body, *places, normal, motion.omega, motion.velocity
            )
        turn, slide = cross(normal, motion.omega), np.einsum("ij,ij->i", normal, motion.velocity)
        directions = np.stack([normal, normal + turn, normal - turn])  # (3, i, 3)
        values = np.einsum("sij,ij->si", directions, nodes.origin[node, body])
        values[1] += slide
        values[2] -= slide
        local = np.einsum("iba,sib->sia", nodes.rotation[node, body], directions)
        order = np.argsort(body, kind="stable")
        cuts = np.flatnonzero(np.diff(body[order])) + 1
        for rows in np.split(order, cuts):
            piece = self.bodies.pieces[body[rows[0]]]
            values[:, rows] += piece.support(local[:, rows].reshape(-1, 3)).reshape(3, -1)
        return np.asarray(values)


def travel_of(items: Items) -> Array:
    """Return how far the two bodies of each item move against each other at most (i,) [m]."""
    motion_a, motion_b = _motions(items)
    return motion_a.first + motion_b.first


def _motions(items: Items) -> tuple[Motion, Motion]:
    if items.motions is None:
        raise ValueError("items without motions: see Bounds.with_motion")
    return items.motions
