"""Proof that two bodies of a robot never meet: a lower bound of their distance over all configurations within the
limits.

Robot, outer bodies, pairs of them -> for each pair a distance [m] that it keeps at every configuration within the
limits. Only the joints between the two count. Over a box of their values, of centre c and half widths h, and along any
unit vector n (the normal between the bodies at c, from B to A), their distance obeys

    d(q) ≥ min_{v ∈ A} (n·v − Σ_j e_j(v)) − max_{v ∈ B} (n·v + Σ_j e_j(v)) − both radii

over the bodies' vertices v at c. Of the joints that move v, joint j alone moves it at the velocity v_j at c, and shifts
it along n by no more than

    e_j = min( s_j |v_j|,  h_j |n·v_j| + ½ h_j² |v_j| + s_j |v_j| min(2, Σ_{i<j} h_i) )

with s_j = 2 sin(h_j / 2); a prismatic joint has s_j = h_j, no second term, and does not count in the sum over i. Proof:
move the joints one after another, the one nearest to the bodies' common root first. When joint j moves, those beyond it
are still at c, so it moves v along a chord of length s_j |v_j| at most, off its tangent by ½ h_j² |v_j| at most; and
the joints before it, i < j, have rotated this chord by the sum of their angles at most. Only the vertices matter: a
plane that has all of them on one side also has their hull there. The balls that sweep the bodies are invariant under
rotation.

Boxes are halved (branch and bound) until the least bound is close to the least distance found, the bodies come too
close for any gain, or the pair's share of the budget is spent: a two-handed robot has thousands of pairs. Pairs with
few joints between them come first, as they are proven fastest. There are no random draws; the result is cached on disk
by the content of the input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdplan.distance.compiled.cache import content_key, finite, store
from hdplan.distance.compiled.loops import C, twin_of
from hdplan.planner.collision.broad_phase import body_pairs
from hdplan.planner.collision.euclidean import FclPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.shipped_bodies import known_result
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.robot.content import Parts, tree_content
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask, Rows

VERSION = "4"  # to be changed with anything that changes a bound, so that old cache entries are not used
MOST_BOXES, BUDGET = 4000, 300_000  # boxes evaluated for a pair, and for all pairs of a robot
BATCH = 64  # of them halved at once
TIGHT_SHARE = 0.9  # share of the least distance found at which a bound is good enough
BOUND_ROUNDING = 1e-6  # [m] subtracted from a bound for rounding errors


def distances_kept(
    robot: Robot,
    kinematics: Kinematics,
    bodies: Sequence[LinkBody],
    planes: Sequence[HalfspaceBody],
    pairs: Sequence[tuple[int, int]],
    wanted: float,
) -> Array:
    """Return for each pair (row of `bodies`, row of `planes`, the same bodies) a distance (P,) [m] that it keeps within
    the robot's limits: a lower bound, or 0 where nothing above `wanted` [m] is proven."""
    if not pairs:
        return np.zeros(0)
    key = content_key(VERSION, *content_of(robot, bodies, pairs), np.float64(wanted).tobytes())
    known = known_result("separation", key, lambda value: finite(value).reshape(len(pairs)))
    if known is None:
        assembled = body_pairs(bodies, planes, pairs, 0.0, kinematics.supports)
        search = Search(robot, kinematics, bodies, pairs, FclPairs(assembled, bodies, planes))
        known, left = np.zeros(len(pairs)), BUDGET
        order = np.argsort(np.count_nonzero(assembled.moves, axis=1), kind="stable").tolist()
        for done, row in enumerate(order):
            known[row], looked = search.bound(row, wanted, min(MOST_BOXES, left // (len(order) - done)))
            left -= looked
        store("separation", key, known.tolist())
    return known


def _least_bound(search: Search, pair: int, low: Array, high: Array, wanted: float, most: int) -> tuple[float, int]:
    """The best box first, each halved alone. The normal is that of GJK (E. G. Gilbert, D. W. Johnson, S. S. Keerthi,
    1988) on the bodies' vertices. Its distance only decides which boxes to halve: the bound holds along any normal."""
    a, b = (search.bodies[index] for index in search.pairs[pair])
    hulls = (each for side in (a, b) for each in (side.joint, np.ascontiguousarray(side.body.vertices)))
    given = map(np.ascontiguousarray, (search.distance.pairs.moves[pair], low, high))
    bound, looked = C.separation(
        search.kinematics.tree.struct, *hulls, a.body.radius + b.body.radius, *given, wanted, TIGHT_SHARE, max(most, 0)
    )
    return float(bound), int(looked)


@dataclass(frozen=True, eq=False)
class Search:
    """Branch and bound over the joint limits."""

    robot: Robot
    kinematics: Kinematics
    bodies: Sequence[LinkBody]
    pairs: Sequence[tuple[int, int]]
    distance: FclPairs  # of the same pairs: exact, or a lower bound

    def bound(self, pair: int, wanted: float, most: int) -> tuple[float, int]:
        """Return the bound of one pair [m], 0 if it is not above `wanted`, and how many boxes were evaluated: about
        `most` at most."""
        least, looked = self.least_bound(pair, *_ranges(self.robot, self.kinematics), wanted, most)
        proven = least - BOUND_ROUNDING
        return (proven if proven > wanted else 0.0), looked

    @twin_of(_least_bound)
    def least_bound(self, pair: int, low: Array, high: Array, wanted: float, most: int) -> tuple[float, int]:
        """Return the least bound [m] over ranges of the joints (n,), and how many boxes were evaluated."""
        between = self.distance.pairs.moves[pair] != 0.0
        centres, halves = ((low + high) / 2)[None], np.where(between, (high - low) / 2, 0.0)[None]
        distances, bounds, widest = self._look(pair, centres, halves)
        least, looked = float(distances[0]), 1
        while bounds.min() < TIGHT_SHARE * least and least > wanted and looked < most:
            order = np.argsort(bounds, kind="stable")
            count = min(BATCH, int(np.count_nonzero(bounds < TIGHT_SHARE * least)))
            halved, kept, rows = order[:count], order[count:], np.arange(count)
            half, shift = halves[halved], np.zeros((count, self.robot.n))
            half[rows, widest[halved]] /= 2
            shift[rows, widest[halved]] = half[rows, widest[halved]]
            inner = np.vstack([centres[halved] - shift, centres[halved] + shift])
            distances, inner_bounds, inner_widest = self._look(pair, inner, np.vstack([half, half]))
            looked += len(distances)
            least = min(least, float(distances.min()))
            centres, halves = np.vstack([centres[kept], inner]), np.vstack([halves[kept], half, half])
            bounds, widest = np.append(bounds[kept], inner_bounds), np.append(widest[kept], inner_widest)
        return float(bounds.min()), looked

    def _look(self, pair: int, centres: Array, halves: Array) -> tuple[Array, Array, Rows]:
        """Return the distance at the centres of K boxes, the bound over each of them (K,) [m], and the joint (K,) that
        contributes most to the difference."""
        assembled, kinematics = self.distance.pairs, self.kinematics.evaluate(centres)
        distances, wrenches, _ = self.distance(kinematics, np.arange(len(centres)), np.full(len(centres), pair))
        shifts = np.zeros_like(halves)
        gap = np.zeros(len(centres))
        for index, joint, sign in (
            (self.pairs[pair][0], assembled.joint_a[pair], 1.0),
            (self.pairs[pair][1], assembled.joint_b[pair], -1.0),
        ):
            body, normal = self.bodies[index].body, sign * wrenches[:, :3]
            turn, origin = kinematics.rotations[:, joint], kinematics.translations[:, joint]
            vertices = np.einsum("kij,vj->kvi", turn, body.vertices) + origin[:, None]
            moving = np.flatnonzero(assembled.moves[pair] == sign)
            towards = _shifts(vertices, normal, halves[:, moving], kinematics.columns[:, moving])
            heights = (vertices @ normal[:, :, None])[..., 0] - towards.sum(axis=2)
            lowest = heights.argmin(axis=1)
            rows = np.arange(len(centres))
            gap += heights[rows, lowest] - body.radius
            shifts[:, moving] = towards[rows, lowest]
        return distances, gap, shifts.argmax(axis=1)


def _shifts(vertices: Array, normal: Array, half: Array, columns: Array) -> Array:
    """Return e_j (K, V, m) of vertices (K, V, 3) for joints of half widths (K, m) and unit velocities (K, m, 6)."""
    linear, angular = columns[:, None, :, :3], columns[:, None, :, 3:]
    velocity = linear + np.cross(angular, vertices[:, :, None])
    turns = _turns(columns)
    chord = np.where(turns, 2 * np.sin(np.minimum(half, np.pi) / 2), half)
    before = np.cumsum(half * turns, axis=1) - half * turns
    speed, along = np.linalg.norm(velocity, axis=3), np.abs(np.einsum("kvmi,ki->kvm", velocity, normal))
    bend = 0.5 * half**2 * turns + chord * np.minimum(before, 2.0)
    shifts: Array = np.minimum(chord[:, None] * speed, half[:, None] * along + bend[:, None] * speed)
    return shifts


def _turns(columns: Array) -> Mask:
    """True if joints of unit velocities (..., 6) are revolute; the others are prismatic."""
    return np.asarray(np.linalg.norm(columns[..., 3:], axis=-1) > 0.5)


def _ranges(robot: Robot, kinematics: Kinematics) -> tuple[Array, Array]:
    """The limits (n,) of each joint; one full turn of a joint that can turn farther."""
    at_rest = kinematics.evaluate(np.clip(np.zeros(robot.n), robot.lower, robot.upper))
    whole = _turns(at_rest.columns[0]) & (robot.upper - robot.lower >= 2 * np.pi)
    return np.where(whole, -np.pi, robot.lower), np.where(whole, np.pi, robot.upper)


def content_of(robot: Robot, bodies: Sequence[LinkBody], pairs: Sequence[tuple[int, int]]) -> Parts:
    """All that determines the bounds: the kinematic tree with its limits, the bodies, and the pairs."""
    parts = [robot.lower.tobytes(), robot.upper.tobytes(), *tree_content(robot.model)]
    if robot.linkage is not None:
        parts += [robot.linkage.matrix.tobytes(), robot.linkage.offset.tobytes()]
    for index in sorted({index for pair in pairs for index in pair}):
        body = bodies[index]
        vertices = np.round(body.body.vertices, 9) + 0.0  # machines differ in later digits: less than BOUND_ROUNDING
        parts += [str(index), str(body.joint), vertices.tobytes(), np.float64(body.body.radius).tobytes()]
    return [*parts, np.array(pairs).tobytes()]
