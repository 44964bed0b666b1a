"""Ways through narrow places: two trees of free straight lines, from both ends, that grow until they meet.

They begin with the ways back from narrow ends, as far as these are free, so that most of what is drawn leads on from
where there is room. They are grown on the exact distances of the links' hulls (`free_loop.c`, `trees_loop.c`): every
line is proven to be free, by the gap in the middle of an interval and how far anything can move until its ends. So what
they find is a motion without contacts already, if not a smooth one; but for links whose bodies overlap so often that
their pair is left to the certificate (`CollisionModel.unresolved`), which may refuse it. One seeded generator makes all
random draws: the same seed gives the same ways. Without a C compiler there are none, and the roadmap's guesses have to
do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.loops import Record, library
from hdplan.planner.collision.collision_model import SELF_ACTIVATION
from hdplan.planner.collision.exact import ExactPairs
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.escape import ways_back
from hdplan.planner.search.roadmap import around_line
from hdplan.scenes.array_types import Array
from hdplan.scenes.shapes import Shape

SPARE = 5e-4  # [m] beyond the clearance that is kept; less where the ends have less to spare
KEPT = 0.5  # share of what the ends have to spare that is kept
FINEST = 5e-4  # [m] that anything moves in the smallest interval of a line that is looked at
LONGEST = 0.5  # of a line between two nodes [rad or m]
TURN = 128  # targets of the trees, before another guess has its turn
AT_ONCE = 4  # of them between two looks at whether time is up; even, as the trees grow in turn
MOST = 64  # nodes of each tree for a target, at most
SHORTCUTS = 24  # lines that are tried between two places of a way


def free_space(problem: Problem, required: float) -> Record | None:
    """Return the C struct `space` of a problem with exact distances, whose motion has to keep a clearance [m]; None
    where more counts than which configurations are free, as with path constraints or moving obstacles, and without a C
    compiler."""
    terms, robot, linkage = problem.terms, problem.robot, problem.robot.linkage
    if not library() or not problem.exact or terms.path or terms.moving_obstacles:
        return None
    less = problem.scene.planner.clearance - required
    chain, travel = Chain.of(robot.model), robot.unfolded.inner.T
    kept = []
    for term, activation in (
        (terms.obstacles, problem.scene.planner.activation),
        (terms.self_collision, SELF_ACTIVATION),
    ):
        if term is not None:
            assert isinstance(term.distance, ExactPairs)
            pairs, distance = term.pairs, term.distance
            asked = (pairs.margins - activation - less)[pairs.halfspace_body]
            floors, reach = _floors(problem, distance, asked), _reach(chain, distance, travel)
            around = ExactPairs(pairs, problem.bodies, distance.solids).record
            kept.append(
                Record("keeping", distance.record, around, pairs.tables, pairs.moves, reach, floors, pairs.radii)
            )
    m = problem.kinematics.n
    leader, factor, offset = (
        (np.arange(m), np.ones(m), np.zeros(m)) if linkage is None else (linkage.leader, linkage.factor, linkage.offset)
    )
    joints = (problem.kinematics.tree, robot.n, leader, factor, offset, *robot.inner)
    return Record("space", *joints, FINEST, tuple(kept))


def _floors(problem: Problem, distance: ExactPairs, asked: Array) -> Array:
    """The gap that each pair has to keep (P,) [m]: what is asked and SPARE, or less where an end has less to spare.
    Where the hulls of a pair overlap at an end, the links themselves do not: it is left to the certificate."""
    count = len(distance.pairs)
    sample, pair = (index.ravel() for index in np.indices((2, count)))
    found, _, _ = distance(problem.placed(np.stack([problem.start, problem.goal])), sample, pair)
    gap = (found + distance.pairs.margins[distance.pairs.halfspace_body][pair]).reshape(2, count).min(axis=0)
    return np.where(gap > asked, asked + np.minimum(SPARE, KEPT * (gap - asked)), -np.inf)


def _reach(chain: Chain, distance: ExactPairs, travel: Array) -> Array:
    """Ways of the bodies of each pair, seen from each other, per unit of each joint (m, P)."""
    pairs = distance.pairs
    first = _reach_of(chain, [(part.joint, part.body) for part in distance.parts], travel)
    second = _reach_of(chain, [(solid.joint, solid.shape) for solid in distance.solids], travel)
    moved = np.where(pairs.moves > 0, first[pairs.body], np.where(pairs.moves < 0, second[pairs.halfspace_body], 0.0))
    return np.ascontiguousarray(moved.T)


def _reach_of(chain: Chain, bodies: Sequence[tuple[int, Shape | ConvexBody | None]], travel: Array) -> Array:
    """Ways of bodies on joints per unit of each joint (B, m); 0 of those in the world."""
    found = np.zeros((len(bodies), len(chain.axes)))
    carried = [(row, j, body) for row, (j, body) in enumerate(bodies) if j > 0 and isinstance(body, ConvexBody)]
    around = np.array([chain.around(joint, body.vertices, body.radius) for _, joint, body in carried])
    if carried:
        found[[row for row, _, _ in carried]] = chain.reach_around(np.array([j for _, j, _ in carried]), around, travel)
    return found


def tree_ways(
    problem: Problem, required: float, seed: int, over: Callable[[], bool] = lambda: False
) -> Iterator[Array | None]:
    """Yield a way (N, n) as waypoints of a problem with exact distances, each time that two trees meet, and None after
    each TURN targets by which they did not, or once it is over. None at all where there is no free space to be had."""
    space = free_space(problem, required)
    if space is None:
        return
    roots = [free_part(space, way) for way in ways_back(problem)]
    for again in itertools.count():
        rng = np.random.default_rng((seed, again))
        trees = Trees(problem, space, rng, roots)
        while (way := trees.grow(TURN, over)) is None:
            yield None
        yield through(problem, shortened(space, way, rng))


class Trees:
    """A tree from the start and one from the goal."""

    def __init__(self, problem: Problem, space: Record, rng: np.random.Generator, roots: Sequence[Array] = ()) -> None:
        """Begin with the ends alone, or with ways (S, n) from them, whose lines are free."""
        self.problem, self.space, self.rng = problem, space, rng
        self.nodes = [*(roots or (problem.start[None], problem.goal[None]))]
        self.parents = [np.arange(-1, len(way) - 1) for way in self.nodes]

    def grow(self, targets: int, over: Callable[[], bool] = lambda: False) -> Array | None:
        """Grow towards so many targets, until it is over; return the way (C, n) between the ends, both included, if
        the trees meet."""
        drawn = around_line(self.problem, self.rng, targets)
        for first in range(0, targets, AT_ONCE):
            if over():
                break
            if (way := self._towards(drawn[first : first + AT_ONCE])) is not None:
                return way
        return None

    def _towards(self, targets: Array) -> Array | None:
        """The same for a few (k, n), in one loop of C, which nothing interrupts."""
        counts, joint = np.array([len(rows) for rows in self.parents]), np.empty(2, np.int64)
        room = [np.vstack([nodes, np.empty((MOST * len(targets), nodes.shape[1]))]) for nodes in self.nodes]
        rows = [np.append(parents, np.empty(MOST * len(targets), np.int64)) for parents in self.parents]
        loops = library()
        assert loops is not None
        loops.grow_trees(self.space.struct, LONGEST, targets, counts, room[0], rows[0], room[1], rows[1], joint)
        self.nodes = [nodes[:count] for nodes, count in zip(room, counts, strict=True)]
        self.parents = [parents[:count] for parents, count in zip(rows, counts, strict=True)]
        return np.vstack([self._to(0, joint[0])[::-1], self._to(1, joint[1])]) if joint[0] >= 0 else None

    def _to(self, side: int, row: int) -> Array:
        """The nodes from one back to its root."""
        rows = [row]
        while (parent := int(self.parents[side][rows[-1]])) >= 0:
            rows.append(parent)
        return self.nodes[side][rows]


def free_part(space: Record, way: Array) -> Array:
    """The part of a way (C, n) from its first end until the first line that is not proven to be free."""
    loops = library()
    assert loops is not None
    lines = itertools.takewhile(lambda line: loops.is_free(space.struct, *line), itertools.pairwise(way))
    return np.array([way[0], *(last for _, last in lines)])


def shortened(space: Record, way: Array, rng: np.random.Generator) -> Array:
    """Return a way (C, n) with fewer corners: past as many as a free straight line leads, and by such lines between
    random places of it."""
    loops = library()
    assert loops is not None
    way = _past_corners(loops, space, way)
    for _ in range(SHORTCUTS):
        length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
        places = np.sort(rng.uniform(0.0, length[-1], 2))
        first, last = (np.searchsorted(length, places, side="right") - 1).tolist()
        ends = np.stack([np.interp(places, length, column) for column in way.T], axis=1)
        if first < last and loops.is_free(space.struct, *ends):
            way = np.vstack([way[: first + 1], ends, way[last + 1 :]])
    return _past_corners(loops, space, way)


def _past_corners(loops: ModuleType, space: Record, way: Array) -> Array:
    """Way from each corner that is kept to one far ahead, by half as many corners each time that the line is not
    free."""
    kept, ahead = [0], len(way) - 1
    while kept[-1] < len(way) - 1:
        ahead = min(ahead, len(way) - 1 - kept[-1])
        while ahead > 1 and not loops.is_free(space.struct, way[kept[-1]], way[kept[-1] + ahead]):
            ahead //= 2
        kept.append(kept[-1] + ahead)
        ahead = 4 * ahead
    return way[kept]


def through(problem: Problem, way: Array) -> Array:
    """Return a way (C, n) as waypoints (N, n), its corners among them, the more on a line the longer it is; at equal
    steps where there are more corners than waypoints."""
    lines, spare = len(way) - 1, problem.waypoints - len(way)
    if spare < 0:
        return problem.polyline(way[1:-1])
    length = np.linalg.norm(np.diff(way, axis=0), axis=1)
    ends = np.round(np.cumsum(length) / length.sum() * spare).astype(np.int64)
    parts = 1 + np.diff(ends, prepend=0)
    rows = [way[k] + np.arange(parts[k])[:, None] / parts[k] * (way[k + 1] - way[k]) for k in range(lines)]
    return problem.clip(np.vstack([*rows, way[-1:]]))
