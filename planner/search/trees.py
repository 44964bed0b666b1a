"""Two trees of free straight lines, from both ends, that grow until they meet: ways through narrow places.

They begin with the ways back from narrow ends, as far as these are free, so that most of what is drawn leads on from
where there is room. They are grown in free space by exact geometry (`trees_loop.c`), so what they find is a motion
without contacts already, if not a smooth one.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from hdplan.distance.compiled.loops import C, Record
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.roadmap import around_line
from hdplan.scenes.array_types import Array, Rows

LONGEST_LINE = 0.5  # of a line between two nodes [rad or m]
AT_ONCE = 4  # targets between two checks whether time is up; even, as the trees grow in turn
MOST_NODES = 64  # nodes of each tree for a target, at most


class Trees:
    """A tree from the start and one from the goal."""

    def __init__(
        self,
        problem: Problem,
        space: Record,
        rng: np.random.Generator,
        roots: Sequence[Array] = (),
        draw: Callable[[int], Array] | None = None,
    ) -> None:
        """Begin with the ends alone, or with ways (S, n) from them, whose lines are free. `draw` returns so many
        targets (k, n), by default those of `around_line`."""
        self.space, self.draw = space, draw or functools.partial(around_line, problem, rng)
        self.nodes = [*(roots or (problem.start[None], problem.goal[None]))]
        self.parents = [np.arange(-1, len(way) - 1) for way in self.nodes]

    def grow(self, targets: int, over: Callable[[], bool] = lambda: False) -> Array | None:
        """Grow towards so many targets, until it is over; return the way (C, n) between the ends, both included, if
        the trees meet."""
        drawn = self.draw(targets)
        for first in range(0, targets, AT_ONCE):
            if over():
                break
            if (way := self._towards(drawn[first : first + AT_ONCE])) is not None:
                return way
        return None

    def _towards(self, targets: Array) -> Array | None:
        """Lines towards a few configurations (k, n), in one loop of C, which nothing interrupts."""
        counts, joint = np.array([len(rows) for rows in self.parents]), np.empty(2, np.int64)
        room = [np.vstack([nodes, np.empty((MOST_NODES * len(targets), nodes.shape[1]))]) for nodes in self.nodes]
        rows = [np.append(parents, np.empty(MOST_NODES * len(targets), np.int64)) for parents in self.parents]
        C.grow_trees(self.space.struct, LONGEST_LINE, targets, counts, room[0], rows[0], room[1], rows[1], joint)
        self.nodes = [nodes[:count] for nodes, count in zip(room, counts, strict=True)]
        self.parents = [parents[:count] for parents, count in zip(rows, counts, strict=True)]
        if joint[0] < 0:
            return None
        first, last = map(to_root, self.nodes, self.parents, joint.tolist())
        return np.vstack([first[::-1], last])


def to_root(nodes: Array, parents: Rows, row: int) -> Array:
    """Return the nodes (k, n) of a tree from one back to its root, whose parent is -1."""
    rows = [row]
    while (parent := int(parents[rows[-1]])) >= 0:
        rows.append(parent)
    return nodes[rows]
