"""Ways on path constraints through narrow places, by two trees of short lines from both ends that grow until they meet.

What keeps an axis upright or a point in a box is a thin layer of joint space, in which hardly any straight line stays.
So each step towards a target is moved back onto the constraints (D. Berenson et al., "Manipulation planning on
constraint manifolds", 2009), for many targets at once. Lines are so short that they bend off the layer by little,
which their middles tell; that nothing is met along them is proven (`free_space`). The certificate judges what comes of
it.

One seeded generator makes all random draws: the same seed gives the same ways. Without a C compiler there are none.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.problem.path_terms import RelativeMeasure
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.corners import cut, lengths
from hdplan.planner.search.free_space import free_space, is_free
from hdplan.planner.search.roadmap import around_line, onto_path
from hdplan.planner.search.trees import to_root
from hdplan.scenes.array_types import Array, Mask, Rows

TURN, AT_ONCE = 256, 32  # targets of the trees, before another guess has its turn, and at once
SHORTEST, LONGEST = 0.05, 0.2  # of a line between two nodes [rad or m]
LONGEST_STRETCH = 2.0  # times as long a line may be once its end is on the constraints
BAND_SHARE = 0.9  # share of the band below the bound of a constraint that may be used up along a line
PULL_STEPS = 5  # steps that bring the end of a line back onto the constraints; what needs more is left
LEAST_STEP_SHARE = 0.2  # of a step that must be left once its end is on the constraints, for a branch to grow further
SHORTCUTS = 60  # that are tried between two nodes of a way
ARRIVED = 1e-9  # [rad or m]


def held_ways(
    problem: Problem, required: float, seed: int, over: Callable[[], bool] = lambda: False
) -> Iterator[Array | None]:
    """Yield a way (C, n) on the path constraints of a problem with exact distances, each time that two trees meet, and
    None after each TURN targets by which they did not, or once it is over. None at all where there is no free space to
    be had, and where a link keeps its pose relative to another one: that layer is thinner than any line."""
    space = free_space(problem, required)
    if space is None or any(isinstance(term.measure, RelativeMeasure) for term in problem.terms.path):
        return
    for again in itertools.count():
        trees = HeldTrees(problem, space, np.random.default_rng((seed, again)))
        while (way := trees.grow(TURN, over)) is None:
            yield None
        yield trees.finely(trees.shortened(way))


class HeldTrees:
    """A tree from the start and one from the goal, on the path constraints."""

    def __init__(self, problem: Problem, space: Record, rng: np.random.Generator) -> None:
        """Begin with the ends alone."""
        self.problem, self.space, self.rng = problem, space, rng
        self.nodes = [problem.start[None], problem.goal[None]]
        self.parents = [np.array([-1]), np.array([-1])]
        bound = min(float(term.measure.bound.min()) for term in problem.terms.path)
        # a line of that length bends off by a quarter of the bound, with a reach of 1 m
        self.step = min(max(math.sqrt(2.0 * bound), SHORTEST), LONGEST)

    def grow(self, targets: int, over: Callable[[], bool] = lambda: False) -> Array | None:
        """Grow in turn towards so many targets, and the other tree to what was reached, until it is over; return the
        way (C, n) between the ends, both included, if the trees meet."""
        for turn in range(targets // AT_ONCE):
            if over():
                break
            side = turn % 2
            reached, _ = self._extended(side, around_line(self.problem, self.rng, AT_ONCE))
            reached = np.unique(reached)
            met, arrived = self._extended(1 - side, self.nodes[side][reached])
            for one, other in zip(reached[arrived][:1].tolist(), met[arrived][:1].tolist(), strict=True):
                ways = [
                    to_root(self.nodes[side], self.parents[side], one)[::-1],
                    to_root(self.nodes[1 - side], self.parents[1 - side], other)[1:],
                ]
                return np.vstack(ways) if side == 0 else np.vstack(ways)[::-1]
        return None

    def shortened(self, way: Array) -> Array:
        """Return a way (C, n) with shorter pieces between some of its nodes."""
        for _ in range(SHORTCUTS):
            first, last = np.sort(self.rng.integers(len(way), size=2)).tolist()
            if last - first < 2:
                continue
            cut = self._direct(way[first], way[last])
            if cut is not None and lengths(cut)[-1] < lengths(way[first : last + 1])[-1]:
                way = np.vstack([way[:first], cut, way[last + 1 :]])
        return way

    def finely(self, way: Array) -> Array:
        """Return this way (C, n) with further nodes on long lines."""
        counts = np.ceil(2.0 * np.linalg.norm(np.diff(way, axis=0), axis=1) / self.step).astype(np.int64)
        return cut(way, np.maximum(counts, 1))

    def _extended(self, side: int, targets: Array) -> tuple[Rows, Mask]:
        """Return the last node (k,) of each branch, and which arrived, after steps from the nearest nodes towards
        targets (k, n) that go as far as they can."""
        at, going = self._nearest(side, targets), np.arange(len(targets))
        held, arrived = self._used(targets) <= 1.0, np.zeros(len(targets), np.bool_)
        while len(going):
            here, there = self.nodes[side][at[going]], targets[going]
            length = np.linalg.norm(there - here, axis=1)
            share = np.minimum(1.0, self.step / np.maximum(length, ARRIVED))[:, None]
            last = held[going] & (share[:, 0] == 1.0)
            there = np.where(last[:, None], there, self._onto(here + share * (there - here)))
            left = np.linalg.norm(targets[going] - there, axis=1)
            good = left <= length - LEAST_STEP_SHARE * np.minimum(self.step, length)
            good[good] = self._lines(here[good], there[good], last[good])
            going = going[good]
            at[going] = self._add(side, there[good], at[going])
            arrived[going] = last[good]
            going = going[left[good] > ARRIVED]
        return at, arrived

    def _direct(self, first: Array, last: Array) -> Array | None:
        """A way (C, n) between two configurations along the straight line, moved onto the constraints; None where there
        is none."""
        count = math.ceil(float(np.linalg.norm(last - first)) / self.step) + 1
        way = self._onto(first + np.linspace(0.0, 1.0, max(count, 2))[:, None] * (last - first))
        way[0], way[-1] = first, last
        ends = np.zeros(len(way) - 1, np.bool_)
        ends[-1] = True
        return way if self._lines(way[:-1], way[1:], ends).all() else None

    def _lines(self, first: Array, last: Array, given: Mask) -> Mask:
        """The straight lines (k, n) that may be taken, as a mask; the ends of some are `given`, which are good."""
        short = np.linalg.norm(last - first, axis=1) <= LONGEST_STRETCH * self.step
        found = short & (given | (self._used(last) <= BAND_SHARE)) & (self._used(0.5 * (first + last)) <= BAND_SHARE)
        for row in np.flatnonzero(found).tolist():
            found[row] = is_free(self.space, first[row], last[row])
        return np.asarray(found)

    def _onto(self, q: Array) -> Array:
        return np.clip(onto_path(self.problem, q, PULL_STEPS), *self.problem.robot.inner)

    def _used(self, q: Array) -> Array:
        """Share of the constraints' bands that is used up at configurations (k, n)."""
        placed = self.problem.placed(q)
        depths = [term.depth(placed) for term in self.problem.terms.path]
        return np.asarray(np.max(depths, axis=0) / self.problem.scene.planner.activation)

    def _nearest(self, side: int, targets: Array) -> Rows:
        nodes = self.nodes[side]
        return np.asarray(((nodes**2).sum(axis=1) - 2.0 * targets @ nodes.T).argmin(axis=1))

    def _add(self, side: int, nodes: Array, before: Rows) -> Rows:
        """Add nodes (k, n) behind others (k,); return their numbers."""
        first = len(self.nodes[side])
        self.nodes[side] = np.vstack([self.nodes[side], nodes])
        self.parents[side] = np.append(self.parents[side], before)
        return np.asarray(first + np.arange(len(nodes)))
