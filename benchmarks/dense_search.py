"""A dense search: two trees of small steps on the constraints, each checked by exact distances, until they meet.

It is slow, knows nothing of the planner's guesses, roadmap or solver, and finds in a minute what a request leaves open:
it shares the planner's terms, with the exact distance of the links' hulls, but judges nothing; that is the
certificate's business. The steps are those of RRT-Connect with projection (Berenson et al., "Manipulation planning on
constraint manifolds", ICRA 2009), many targets at once.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.problem.assemble import exactly
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.roadmap import onto_path
from hdplan.scenes.array_types import Array, Mask

STEP = 0.05  # [rad] or [m] of an edge, at most; its middle is tested, too
TARGETS = 32  # at once
USED = 0.95  # share of the band of clearance, or of a constraint, that may be used up
LEAST = 0.2  # of a step that must be left after the projection, for a branch to grow further
CUTS = 200  # tries to shorten a way


class Tree:
    """Configurations, each with its predecessor."""

    def __init__(self, root: Array) -> None:
        """Begin with one."""
        self.nodes, self.before = root[None], np.array([-1])

    def add(self, nodes: Array, before: NDArray[np.int64]) -> NDArray[np.int64]:
        """Add configurations (k, n); return their numbers."""
        first = len(self.nodes)
        self.nodes, self.before = np.vstack([self.nodes, nodes]), np.append(self.before, before)
        return first + np.arange(len(nodes))

    def nearest(self, targets: Array) -> Array:
        """Return the nodes nearest to targets (k, n)."""
        apart = (targets**2).sum(axis=1)[:, None] + (self.nodes**2).sum(axis=1) - 2.0 * targets @ self.nodes.T
        return np.asarray(apart.argmin(axis=1))

    def way(self, node: int) -> Array:
        """Return the way (m, n) from the root to a node."""
        found = []
        while node >= 0:
            found.append(self.nodes[node])
            node = int(self.before[node])
        return np.array(found[::-1])


class DenseSearch:
    """The search for one problem."""

    def __init__(self, problem: Problem, seconds: float, seed: int = 0) -> None:
        """Search for so many seconds at most."""
        self.problem, self.rng = exactly(problem), np.random.default_rng(seed)
        self.deadline = time.perf_counter() + seconds

    def run(self) -> Array | None:
        """Return a way (m, n) from start to goal in small steps; None where time is up."""
        grows, other = Tree(self.problem.start), Tree(self.problem.goal)
        forward = True
        while time.perf_counter() < self.deadline:
            targets = self.problem.robot.draw(self.rng, TARGETS)
            reached = self._extended(grows, targets)
            if len(reached):
                ends = self._extended(other, grows.nodes[reached])
                for node, end in self._met(grows, reached, other, ends):
                    first, last = grows.way(node), other.way(end)[::-1]
                    way = np.vstack([first, last] if forward else [last[::-1], first[::-1]])
                    return self._shortened(way)
            grows, other, forward = other, grows, not forward
        return None

    def _met(self, grows: Tree, reached: Array, other: Tree, ends: Array) -> list[tuple[int, int]]:
        for node in reached.tolist():
            end = int(other.nearest(grows.nodes[node][None])[0])
            if np.linalg.norm(other.nodes[end] - grows.nodes[node]) <= STEP:
                return [(node, end)]
        return []

    def _extended(self, tree: Tree, targets: Array) -> Array:
        """Step from the nearest nodes towards targets (k, n) as far as it goes; return the last node of each branch
        that grew."""
        at = tree.nearest(targets)
        going, grown = np.arange(len(targets)), np.zeros(len(targets), dtype=bool)
        while len(going) and time.perf_counter() < self.deadline:
            here = tree.nodes[at[going]]
            way = targets[going] - here
            length = np.linalg.norm(way, axis=1, keepdims=True)
            there = self._onto(here + way * np.minimum(1.0, STEP / np.maximum(length, 1e-12)))
            left = np.linalg.norm(targets[going] - there, axis=1)
            good = (left < length[:, 0] - LEAST * np.minimum(STEP, length[:, 0])) & self._edges(here, there)
            going, there = going[good], there[good]
            at[going] = tree.add(there, at[going])
            grown[going] = True
            going = going[left[good] > 1e-9]
        return np.asarray(at[grown])

    def _onto(self, q: Array) -> Array:
        return onto_path(self.problem, q) if self.problem.terms.path else q

    def _edges(self, first: Array, last: Array) -> Mask:
        """True where edges are no longer than two steps, and free at their middles and ends."""
        short = np.abs(last - first).max(axis=1) <= 2.0 * STEP
        depth = self.problem.depth(np.vstack([last, 0.5 * (first + last)])).reshape(2, -1).max(axis=0)
        return np.asarray(short & (depth <= USED * self.problem.scene.planner.activation))

    def _shortened(self, way: Array) -> Array:
        """Cut corners of a way (m, n), CUTS times, by steps on the constraints."""
        for _ in range(CUTS):
            if len(way) < 4 or time.perf_counter() > self.deadline:
                break
            i, j = sorted(self.rng.choice(len(way), 2, replace=False).tolist())
            if j - i < 2:
                continue
            count = int(np.ceil(np.linalg.norm(way[j] - way[i]) / STEP)) + 1
            if count >= j - i + 1:
                continue
            cut = self._onto(way[i] + np.linspace(0.0, 1.0, count)[:, None] * (way[j] - way[i]))
            cut[0], cut[-1] = way[i], way[j]
            if self._edges(cut[:-1], cut[1:]).all():
                way = np.vstack([way[:i], cut, way[j + 1 :]])
        return way
