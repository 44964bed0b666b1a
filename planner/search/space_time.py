"""First guesses where obstacles move: the cheapest ways through a roadmap in space and time.

The roadmap in space (`roadmap`) is travelled in STEPS equal steps of the path parameter u, to each of which the time
law gives a time. A motion waits at a node for a step, or takes an edge in one or several of them, so that time never
goes back (a time-expanded graph; along a single line it is the path-velocity decomposition of Kant & Zucker 1986). A
move of length ℓ over a share Δ of u costs

    ½ ℓ²/Δ + PENALTY_WEIGHT Δ mean((depth/DOUBLING_DEPTH)²)

with the depths inside margins where the obstacles are by then, and those that the solver gives to velocities near their
limits: to first order what the solver makes of it. The first way keeps to the straight line, and waits or hurries on
it. The roadmap grows with every guess, and a move that has been tried costs more from then on, at about its time.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.velocity_penalty import LEVER, PENALIZED_SHARE
from hdplan.planner.search.roadmap import DOUBLING_DEPTH, WORN_FACTOR, Roadmap
from hdplan.planner.solvers.solution import CLEAR_SHARE, DETOUR_WEIGHT
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.once import read_only

TIME_STEPS = 30  # even, as the time law is steepest in the middle
EDGE_STEPS = read_only(np.array([1, 2, 3, 4, 6, 8, 12, 16]))  # steps that an edge may take
PIECES, LEAPS = 12, 4  # of the straight line; so many of them at once are edges, too
PENALTY_WEIGHT = DETOUR_WEIGHT * DOUBLING_DEPTH**2 / 2  # of being DOUBLING_DEPTH inside a margin all along
# [rad or m] between configurations at which an edge is scored; how many
LOOK_SPACING, FEWEST_LOOKS, MOST_LOOKS = 0.1, 3, 48
WORN_STEPS = 3  # steps before and after a move that has been tried in which its edge costs more
TINY_SQUARE = 1e-12  # [rad² or m²]


def timed_ways(problem: Problem, seed: int, first: Array, last: Array) -> Iterator[Array]:
    """Yield guesses (N, n) without end; `first` and `last` (C, n) are the ways back from narrow ends."""
    roadmap = TimedRoadmap(problem, np.random.default_rng(seed), first, last)
    while True:
        yield roadmap.timed_way()
        roadmap.grow()


class Move(NamedTuple):
    """A part of a way: along an edge, or none, to a node, over some steps."""

    edge: int | None
    node: int
    first: int
    last: int


class TimedRoadmap(Roadmap):
    """A roadmap, and what it costs to move along its edges at any time."""

    def __init__(self, problem: Problem, rng: np.random.Generator, first: Array, last: Array) -> None:
        """Begin with the straight line between the ways back from the ends."""
        super().__init__(problem, rng)
        assert problem.terms.moving_obstacles is not None
        self.moving = problem.terms.moving_obstacles
        self.parameters = np.linspace(0.0, 1.0, TIME_STEPS + 1)
        path_speeds = self.moving.law(self.moving.law.time_at(self.parameters))[1]  # du/dt [1/s]
        self.path_speeds = _over_takes(path_speeds[None], 1)[0]  # (S, T) greatest of each move
        self.edges = np.empty((0, 2), dtype=np.int64)
        self._string(_pieces(problem.start, problem.goal))
        if len(first) or len(last):
            first, last = np.vstack([problem.start, first]), np.vstack([last, problem.goal])
            self._string(np.vstack([first[1:], _pieces(first[-1], last[0]), last[:-1]]))
        self.costs = self._costs(self.edges, FEWEST_LOOKS)
        self.close = np.zeros(len(self.edges), dtype=np.bool_)  # whether an edge has been scored at all times
        self.waits = np.empty((0, TIME_STEPS + 1))  # (C, S + 1) (depth/DOUBLING_DEPTH)² of each node at each step
        self.penalties = np.empty((0, 2, TIME_STEPS, len(EDGE_STEPS)))  # (E, 2, S, T) their means over moves, both ways
        self.worn = np.empty((0, TIME_STEPS))  # (E, S) factors

    def _string(self, between: Array) -> None:
        """Add nodes (C, n) that lead from the start to the goal, each connected to the next LEAPS."""
        count = len(self.nodes)
        self.nodes = np.vstack([self.nodes, between])
        string = np.array([0, *range(count, len(self.nodes)), 1])
        leaps = [np.stack([string[:-leap], string[leap:]], axis=1) for leap in range(1, LEAPS + 1)]
        self.edges = np.vstack([self.edges, np.sort(np.concatenate(leaps), axis=1)])

    def _clear(self, configurations: Array) -> Mask:
        """Mask of the configurations (B, n) that are as clear as a motion has to be: beside what stands under the
        robot's base, none may be clearer."""
        return self.problem.depth(configurations) <= CLEAR_SHARE * self.problem.scene.planner.activation

    def timed_way(self) -> Array:
        """The cheapest way as waypoints (N, n), which costs more afterwards. Only edges on a way that would be taken
        are scored at all times, as in `Roadmap.way`."""
        self._extend()
        edge_costs = self._edge_costs(np.arange(len(self.edges)))
        while True:
            way = self._cheapest(edge_costs)
            taken = {move.edge for move in way if move.edge is not None}
            rough = np.array([edge for edge in sorted(taken) if not self.close[edge]], dtype=np.int64)
            if not len(rough):
                break
            self.penalties[rough], self.close[rough] = self._penalties(rough), True
            edge_costs[rough] = self._edge_costs(rough)
        corners = self.nodes[[0, *(move.node for move in way)]]
        passed = self.parameters[[0, *(move.last for move in way)]]
        self._wear(_between_corners(passed, corners, self.parameters))
        return self.problem.clip(_between_corners(passed, corners, np.linspace(0.0, 1.0, self.problem.waypoints)))

    def _wear(self, way: Array) -> None:
        """Let edges cost more whose middles a way (S + 1, n) passes, at about that time: those that it takes, and those
        beside them on the same line."""
        steps, middles = np.diff(way, axis=0), self.nodes[self.edges].mean(axis=1)
        gaps = middles[:, None] - way[:-1]  # (E, S, n)
        along = np.einsum("esj,sj->es", gaps, steps) / np.maximum(np.einsum("sj,sj->s", steps, steps), TINY_SQUARE)
        near = np.linalg.norm(gaps - np.clip(along, 0.0, 1.0)[..., None] * steps, axis=2) < LOOK_SPACING
        padded = np.pad(near, ((0, 0), (WORN_STEPS, WORN_STEPS)))
        self.worn[sliding_window_view(padded, 2 * WORN_STEPS + 1, axis=1).any(axis=-1)] *= WORN_FACTOR

    def _extend(self) -> None:
        """Score new nodes at every step, and new edges by their ends and by what stands."""
        new = self.nodes[len(self.waits) :]
        self.waits = np.vstack([self.waits, self._depths(new)])
        edges = self.edges[len(self.worn) :]
        lengths = self._lengths(edges)
        standing = self.costs[len(self.worn) :] / np.where(lengths > 0.0, lengths, np.inf)
        after = np.minimum(np.arange(TIME_STEPS)[:, None] + EDGE_STEPS, TIME_STEPS)
        ends = self.waits[edges]  # (E, 2, S + 1)
        means = (ends[:, :, :TIME_STEPS, None] + ends[:, ::-1][:, :, after]) / 2
        self.penalties = np.concatenate([self.penalties, means + np.maximum(standing - 1, 0.0)[:, None, None, None]])
        self.worn = np.vstack([self.worn, np.ones((len(edges), TIME_STEPS))])

    def _penalties(self, edges: Rows) -> Array:
        """The mean (depth/DOUBLING_DEPTH)² of moves along edges (E,) -> (E, 2, S, T): there and back, beginning at
        every step."""
        counts = np.clip(np.ceil(self._lengths(self.edges[edges]) / LOOK_SPACING), FEWEST_LOOKS, MOST_LOOKS).astype(
            np.int64
        )
        first, last = (np.repeat(self.nodes[ends], counts, axis=0) for ends in self.edges[edges].T)
        fractions = np.concatenate([_fractions(count) for count in counts.tolist()])
        depths = self._depths(first + fractions[:, None] * (last - first))
        found = []
        for looks in np.split(depths, np.cumsum(counts)[:-1]):  # (m, S + 1)
            (look, before, share) = _between(len(looks))
            found.append(((1 - share) * looks[look, before] + share * looks[look, before + 1]).mean(axis=-1))
        return np.stack(found)

    def _depths(self, configurations: Array) -> Array:
        """(depth/DOUBLING_DEPTH)² of configurations (B, n) at every step (B, S + 1)."""
        batch, steps = len(configurations), len(self.parameters)
        kinematics = self.problem.placed(configurations)
        again = np.repeat(np.arange(batch), steps)
        repeated = KinematicsBatch(kinematics.placements[again], kinematics.columns[again])
        moving = self.moving.depth(repeated, np.tile(self.parameters, batch)).reshape(batch, steps)
        depths: Array = (np.maximum(moving, self.problem.depth(configurations)[:, None]) / DOUBLING_DEPTH) ** 2
        return depths

    def _lengths(self, edges: Rows) -> Array:
        lengths: Array = np.linalg.norm(self.nodes[edges[:, 1]] - self.nodes[edges[:, 0]], axis=1)
        return lengths

    def _edge_costs(self, edges: Rows) -> Array:
        """Costs (E, 2, S, T) of edges (E,) by what moves; infinite for what would take longer than the motion."""
        ends, shares = self.edges[edges], EDGE_STEPS / TIME_STEPS
        travel = np.abs(self.nodes[ends[:, 1]] - self.nodes[ends[:, 0]]) / self.problem.setup.limits["velocity"]
        fast = travel.max(axis=1)[:, None, None] * self.path_speeds / shares  # (E, S, T) share of the greatest velocity
        beyond = (LEVER * np.maximum(fast - PENALIZED_SHARE, 0.0) / DOUBLING_DEPTH) ** 2
        smooth = self._lengths(ends)[:, None] ** 2 / shares / 2
        edge_cost: Array = smooth[:, None, None] + PENALTY_WEIGHT * shares * (self.penalties[edges] + beyond[:, None])
        edge_cost *= _over_takes(self.worn[edges], 0)[:, None]
        edge_cost[:, :, np.arange(TIME_STEPS)[:, None] + EDGE_STEPS > TIME_STEPS] = np.inf
        return edge_cost

    def _cheapest(self, edge_costs: Array) -> list[Move]:
        """The cheapest way from the start at the first step to the goal at the last one."""
        tail, head = self.edges.T.ravel(), self.edges[:, ::-1].T.ravel()  # there, then back
        edge_cost = edge_costs.transpose(1, 0, 2, 3).reshape(len(tail), TIME_STEPS, len(EDGE_STEPS))
        stay = PENALTY_WEIGHT / TIME_STEPS * (self.waits[:, 1:] + self.waits[:, :-1]) / 2
        width = TIME_STEPS + 1 + EDGE_STEPS[-1]  # moves that would end too late cost infinitely much
        costs = np.full((len(self.nodes), width), np.inf)
        costs[0, 0] = 0.0
        for step in range(TIME_STEPS):
            costs[:, step + 1] = np.minimum(costs[:, step + 1], costs[:, step] + stay[:, step])
            into = (head * width)[:, None] + step + EDGE_STEPS
            np.minimum.at(costs.ravel(), into.ravel(), (costs[tail, step, None] + edge_cost[:, step]).ravel())
        node, step, way = 1, TIME_STEPS, list[Move]()
        while step > 0:
            if costs[node, step - 1] + stay[node, step - 1] == costs[node, step]:
                way.append(Move(None, node, step - 1, step))
                step -= 1
                continue
            into, begins = np.flatnonzero(head == node), step - EDGE_STEPS[step >= EDGE_STEPS]
            reached = costs[tail[into][:, None], begins] + edge_cost[into[:, None], begins, np.arange(len(begins))]
            arc, take = np.unravel_index(int(reached.argmin()), reached.shape)
            way.append(Move(int(into[arc] % len(self.edges)), node, int(begins[take]), step))
            node, step = int(tail[into[arc]]), int(begins[take])
        return way[::-1]


def _pieces(first: Array, last: Array) -> Array:
    """Configurations (C, n) that divide a straight line into PIECES."""
    return np.linspace(first, last, PIECES + 1)[1:-1]


def _fractions(count: int) -> Array:
    """Places of configurations along an edge at which it is scored (m,)."""
    return (np.arange(count) + 0.5) / count


@functools.cache
def _between(count: int) -> tuple[Rows, Rows, Array]:
    """For moves along an edge there and back, from each step, in each number of steps: which of an edge's `count`
    configurations are passed, after which step, and how far on to the next one (2, S, T, m)."""
    along = np.stack([_fractions(count), 1 - _fractions(count)])[:, None, None]
    at = np.minimum(np.arange(TIME_STEPS)[:, None, None] + EDGE_STEPS[:, None] * along, TIME_STEPS)
    before = np.minimum(at.astype(np.int64), TIME_STEPS - 1)
    return np.arange(count), before, at - before


def _between_corners(passed: Array, corners: Array, wanted: Array) -> Array:
    """Places at `wanted` path parameters of a way that passes corners (C, n) at ascending ones (C,)."""
    return np.stack([np.interp(wanted, passed, column) for column in corners.T], axis=1)


def _over_takes(values: Array, more: int) -> Array:
    """The greatest of each row's values (E, S + more) over a move's steps (E, S, T), as far as the motion goes."""
    longer = np.pad(values, ((0, 0), (0, int(EDGE_STEPS[-1]))), mode="edge")
    windows = (sliding_window_view(longer, take + more, axis=1).max(axis=-1) for take in EDGE_STEPS.tolist())
    return np.stack([window[:, :TIME_STEPS] for window in windows], axis=-1)
