"""Free space by exact geometry: a motion's requirements as a C struct, which tests straight lines.

They are measured by the exact distances of the links' hulls (`free_loop.c`): every line that is reported free is
proven to be, by the gap in the middle of an interval and how far anything can move until its ends; but for links whose
bodies overlap so often that their pair is left to the certificate (`CollisionModel.unresolved`), which may refuse it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.loops import C, Record
from hdplan.planner.collision.collision_model import SELF_ACTIVATION
from hdplan.planner.collision.exact import ExactPairs
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.problem.problem import Problem
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.shapes import Shape

SPARE_CLEARANCE = 5e-4  # [m] beyond the clearance that is kept; less where the ends have less to spare
KEPT_SHARE = 0.5  # share of what the ends have to spare that is kept
FINEST_MOTION = 5e-4  # [m] that anything moves in the smallest examined interval of a line


def free_space(problem: Problem, required: float) -> Record | None:
    """Return the C struct `space` of a problem with exact distances, whose motion has to keep a clearance [m]; None
    where obstacles move, and without a C compiler. It knows of no path constraints."""
    terms, robot, linkage = problem.terms, problem.robot, problem.robot.linkage
    if C is None or not problem.exact or terms.moving_obstacles:
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
            needed = (pairs.margins - activation - less)[pairs.halfspace_body]
            floors, reach = _floors(problem, distance, needed), _reach(chain, distance, travel)
            around = ExactPairs(pairs, problem.bodies, distance.solids).record
            kept.append(
                Record("keeping", distance.record, around, pairs.tables, pairs.moves, reach, floors, pairs.radii)
            )
    m = problem.kinematics.n
    leader, factor, offset = (
        (np.arange(m), np.ones(m), np.zeros(m)) if linkage is None else (linkage.leader, linkage.factor, linkage.offset)
    )
    joints = (problem.kinematics.tree, robot.n, leader, factor, offset, *robot.inner)
    return Record("space", *joints, FINEST_MOTION, tuple(kept))


def with_these_alone(space: Record, joints: Mask) -> Record:
    """This space for lines that move these joints (n,) alone, as if what others move were not there."""
    tree, n, leader, *rest, kept = space.fields
    assert isinstance(leader, np.ndarray)
    assert isinstance(kept, tuple)
    moving = joints[leader]

    def left(pairs: Record) -> Record:
        *before, moves, reach, floors, radii = pairs.fields
        assert isinstance(moves, np.ndarray)
        assert isinstance(floors, np.ndarray)
        counts = (moves[:, moving] != 0.0).any(axis=1) & (moves[:, ~moving] == 0.0).all(axis=1)
        return Record(pairs.kind, *before, moves, reach, np.where(counts, floors, -np.inf), radii)

    return Record(space.kind, tree, n, leader, *rest, tuple(map(left, kept)))


def _floors(problem: Problem, distance: ExactPairs, needed: Array) -> Array:
    """The gap that each pair has to keep (P,) [m]: the required one and SPARE_CLEARANCE, or less where an end has less
    to spare. Where the hulls of a pair overlap at an end, the links themselves do not: it is left to the
    certificate."""
    count = len(distance.pairs)
    sample, pair = (index.ravel() for index in np.indices((2, count)))
    found, _, _ = distance(problem.placed(np.stack([problem.start, problem.goal])), sample, pair)
    gap = (found + distance.pairs.margins[distance.pairs.halfspace_body][pair]).reshape(2, count).min(axis=0)
    return np.where(gap > needed, needed + np.minimum(SPARE_CLEARANCE, KEPT_SHARE * (gap - needed)), -np.inf)


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


def is_free(space: Record, first: Array, last: Array) -> bool:
    """True if a straight line between two configurations (n,) is proven to be free."""
    return bool(C.is_free(space.struct, first, last))


def free_part(space: Record, way: Array) -> Array:
    """The part of a way (C, n) from its first end until the first line that is not proven to be free."""
    lines = itertools.takewhile(lambda line: is_free(space, *line), itertools.pairwise(way))
    return np.array([way[0], *(last for _, last in lines)])
