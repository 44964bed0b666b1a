"""First guesses: the straight line, then the cheapest paths through a roadmap that grows with every guess.

The roadmap's nodes are random collision-free configurations, denser near the straight line. An edge costs its length,
and more where bodies come too close along it; a path that has been tried costs more the next time. So a guess may pass
through obstacles, but not far, and no two guesses are alike (a soft form of the probabilistic roadmap, Kavraki et al.
1996). Where the scene has path constraints, configurations are first moved onto them. One seeded generator makes all
random draws: the same seed gives the same guesses.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.escape import escapes
from hdplan.planner.solvers.solution import CLEAR_SHARE, DETOUR_WEIGHT, is_narrow
from hdplan.scenes.array_types import Array, Mask, Rows

NODES = 48  # configurations drawn for each guess; the clear ones are kept
SPREADS = (0.3, 0.6, 1.0)  # shares of the joint ranges by which they may deviate from the straight line
NEIGHBOURS = 8  # nearest nodes to which a new one is connected
LOOKS, CLOSE_LOOKS = 6, 48  # configurations at which an edge is scored; the latter on a path to be taken
DOUBLING_DEPTH = 0.01  # [m] inside the margin at which a piece of an edge costs twice as much
FREE_SHARE = 0.8  # share of the activation that a node may use up where distances are exact
WORN_FACTOR = 3.0  # factor on the cost of an edge that has been tried
PULL_STEPS = 30  # steps that bring a configuration onto the path constraints


def seeds(problem: Problem, seed: int) -> Iterator[Array]:
    """Yield guesses (N, n) without end: the straight line, that by the ways back from narrow ends, if there are any,
    and then those of the roadmap, every third of them by these ways. Where an end is so narrow that a clear motion is
    excused there, the cheaper of the first two begins. Where obstacles move, those of the roadmap in time follow the
    straight line."""
    straight, timed = problem.polyline(), problem.terms.moving_obstacles is not None
    choose = not timed and is_narrow(problem)
    if not choose:
        yield straight
    first, last = escapes(problem)
    last = last[::-1]
    if timed:
        from hdplan.planner.search.space_time import timed_ways  # imported here, as few scenes have any

        yield from timed_ways(problem, seed, first, last)
    begin, end = (first[-1] if len(first) else problem.start), (last[0] if len(last) else problem.goal)
    roadmaps, found = [Roadmap(problem, np.random.default_rng(seed))], [straight] if choose else []
    if len(first) or len(last):
        found.append(problem.polyline(np.vstack([first, last])))
        roadmaps = [*roadmaps * 2, Roadmap(replace(problem, start=begin, goal=end), np.random.default_rng(seed))]
    yield from sorted(found, key=lambda guess: problem.evaluate(guess, DETOUR_WEIGHT).cost)
    for roadmap in itertools.cycle(roadmaps):
        roadmap.grow()
        between = roadmap.way()
        yield problem.polyline(between if roadmap is roadmaps[0] else np.vstack([first, between, last]))


def onto_path(problem: Problem, q: Array, pulls: int = PULL_STEPS) -> Array:
    """Move configurations (B, n) onto the path constraints, by so many steps of damped least squares at most: random
    ones almost never satisfy them."""
    from hdplan.planner.kinematics.inverse import damped_step  # imported here, as few scenes have path constraints
    from hdplan.planner.problem.path_terms import to_path

    for _ in range(pulls):
        missing, slope = to_path(problem.terms.path, problem.placed(q))
        if not missing.any():
            break
        q = damped_step(problem.robot, q, missing, problem.robot.fold(slope))
    return q


def around_line(problem: Problem, rng: np.random.Generator, count: int) -> Array:
    """Return random configurations (count, n) within the limits, denser near the straight line."""
    robot, along = problem.robot, rng.uniform(size=(count, 1))
    middle = problem.start + along * (problem.goal - problem.start)
    spread = rng.choice(SPREADS, size=(count, 1))
    drawn = robot.nearest_turn(robot.draw(rng, count), middle)
    return np.clip(middle + spread * (drawn - middle), robot.lower, robot.upper)


class Roadmap:
    """Configurations connected by straight lines, and the cost of each line; nodes 0 and 1 are start and goal."""

    def __init__(self, problem: Problem, rng: np.random.Generator) -> None:
        """Begin with the straight line alone."""
        self.problem, self.rng = problem, rng
        self.nodes = np.stack([problem.start, problem.goal])
        self.edges = np.array([[0, 1]])
        self.costs = WORN_FACTOR * self._costs(self.edges, CLOSE_LOOKS)  # it has been tried
        self.close = np.ones(1, dtype=np.bool_)  # whether an edge has been scored closely

    def grow(self) -> None:
        """Add the clear ones among NODES random configurations, each connected to its nearest neighbours."""
        drawn = around_line(self.problem, self.rng, NODES)
        if self.problem.terms.path:
            drawn = onto_path(self.problem, drawn)
        before = len(self.nodes)
        self.nodes = np.vstack([self.nodes, drawn[self._clear(drawn)]])
        apart = np.linalg.norm(self.nodes[before:, None] - self.nodes[None], axis=2)
        apart[np.arange(len(apart)), before + np.arange(len(apart))] = np.inf
        nearest = np.argsort(apart, axis=1, kind="stable")[:, :NEIGHBOURS]
        edges = np.stack([np.repeat(before + np.arange(len(apart)), nearest.shape[1]), nearest.ravel()], axis=1)
        edges = np.unique(np.sort(edges, axis=1), axis=0)
        if len(edges):
            self.edges = np.vstack([self.edges, edges])
            self.costs = np.append(self.costs, self._costs(edges, LOOKS))
            self.close = np.append(self.close, np.zeros(len(edges), dtype=np.bool_))

    def _clear(self, configurations: Array) -> Mask:
        """Mask of the configurations (B, n) that become nodes: those outside all margins, or, if there are none, as
        beside what stands under the robot's base, those that are as clear as a motion has to be. Where distances are
        exact, those that are free."""
        depth = self.problem.depth(configurations)
        if self.problem.exact:
            return np.asarray(depth <= FREE_SHARE * self.problem.scene.planner.activation)
        clear: Mask = depth == 0.0
        return clear if clear.any() else depth <= CLEAR_SHARE * self.problem.scene.planner.activation

    def way(self) -> Array:
        """The nodes (C, n) between start and goal on the cheapest path, which costs more afterwards.

        Only a path that would be taken is scored closely, and it is taken if it is still the cheapest then (the lazy
        evaluation of Bohlin & Kavraki, 2000): few samples may miss a thin bar.
        """
        while True:
            way = cheapest_way(self.edges, self.costs, len(self.nodes))
            steps = np.sort(np.stack([way[:-1], way[1:]], axis=1), axis=1)
            taken = (self.edges[:, None] == steps[None]).all(axis=2).any(axis=1)
            if self.close[taken].all():
                break
            rough = np.flatnonzero(taken & ~self.close)
            self.costs[rough], self.close[rough] = self._costs(self.edges[rough], CLOSE_LOOKS), True
        self.costs[taken] *= WORN_FACTOR
        between: Array = self.nodes[way[-2:0:-1]]
        return between

    def _costs(self, edges: Rows, count: int) -> Array:
        """Length of each edge (E, 2), times 1 + the mean squared depth at `count` points along it, in units of
        DOUBLING_DEPTH."""
        first, last = self.nodes[edges[:, 0]], self.nodes[edges[:, 1]]
        fractions = (np.arange(count)[:, None] + 0.5) / count
        looks = first[:, None] + fractions * (last - first)[:, None]
        depth = self.problem.depth(looks.reshape(-1, first.shape[1])).reshape(-1, count)
        costs: Array = np.linalg.norm(last - first, axis=1) * (1 + np.mean((depth / DOUBLING_DEPTH) ** 2, axis=1))
        return costs


def cheapest_way(edges: Rows, costs: Array, count: int) -> list[int]:
    """Return the nodes on the cheapest way from node 1 back to node 0, of so many that edges (E, 2) connect, by the
    relaxation of all edges at once (Bellman and Ford); ways have few edges, so that it takes few rounds."""
    heads, tails = np.concatenate([edges, edges[:, ::-1]]).T
    order = np.argsort(heads, kind="stable")
    heads, tails, costs = heads[order], tails[order], np.tile(costs, 2)[order]
    begins = np.flatnonzero(np.diff(heads, prepend=-1))  # of the edges that lead to the same node
    reached, several = heads[begins], np.diff(begins, append=len(heads))
    least, before = np.full(count, np.inf), np.zeros(count, np.int64)
    least[0] = 0.0
    while True:
        total = least[tails] + costs
        found = np.minimum.reduceat(total, begins)
        if not (better := found < least[reached]).any():
            break
        taken = np.flatnonzero((total == np.repeat(found, several)) & np.repeat(better, several))
        before[heads[taken]] = tails[taken]
        least[reached[better]] = found[better]
    way = [1]
    while way[-1] != 0:
        way.append(int(before[way[-1]]))
    return way
