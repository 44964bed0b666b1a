"""Problems as arrays, of which the cost in JAX is made: several of one robot are one array with one axis more.

Their structure decides what is computed, and the tables hold the values. A problem with fewer pairs, samples or moving
obstacles than another one is filled with pairs a metre apart and samples that weigh nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from hdplan.planner.problem.clearance import PairTerm
from hdplan.planner.problem.problem import Problem
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import read_only

NO_PLACE = 2**31 - 1  # of a pair that only fills a table


class Structure(NamedTuple):
    """Common part of the problems of one array."""

    waypoints: int  # N
    joints: int  # n that are planned
    parents: tuple[int, ...]  # of all joints of the model but the world
    coordinates: tuple[int, ...]  # which of the m values moves each of them
    turning: tuple[bool, ...]  # or sliding
    leaders: tuple[int, ...]  # which planned joint each of the m values follows
    gamma: int


class PairTable(NamedTuple):
    """P pairs of a body of V vertices with a body of K planes."""

    frames: Rows  # (P, 2) that carry the two
    vertices: Array  # (P, V, 3) [m]
    weights: Array  # (P, V) how often each counts: 0 for a slot that repeats one
    radius: Array  # (P,) [m]
    planes: Array  # (P, 4, K) unit normals by coordinate, and supports enlarged by the margin [m]
    place: Rows  # (P,) among all pairs of the problem


class Tables(NamedTuple):
    """The numbers of one problem; those of R problems have R in front of every shape."""

    placed: Array  # (nj - 1, 12) of each joint on its parent: the rotation row by row, then the origin [m]
    axes: Array  # (nj - 1, 3)
    factor: Array  # (m,) of each value by the joint that it follows
    offset: Array  # (m,)
    smoothness: Array  # (N, N)
    interval: Rows  # (B,) of each sample
    fraction: Array  # (B,) where in it
    share: Array  # (B,) of the duration, the part of each sample
    turns: Array  # (B, f, 3, 3) of the frames of moving obstacles at the samples' times
    origins: Array  # (B, f, 3) [m]
    shaping_length: Array  # () [m]
    pairs: tuple[PairTable, ...]  # by their number of planes


ZERO, NONE, ONE, HALF = (read_only(np.array(x)) for x in (0.0, 0, 1.0, 0.5))
APART_PLANES = read_only(
    np.array([0.0, 0.0, 1.0, -1.0])[:, None]
)  # planes 1 m below the vertices, which are at the origin
FILL_PAIR = PairTable(
    NONE, vertices=ZERO, weights=ONE, radius=ZERO, planes=APART_PLANES, place=read_only(np.array(NO_PLACE))
)
FILL = Tables(*(ZERO,) * 5, NONE, HALF, ZERO, turns=read_only(np.eye(3)), origins=ZERO, shaping_length=ZERO, pairs=())


def structure_of(problem: Problem) -> Structure:
    """Return the properties that other problems must share with this one."""
    _, count, parents, coordinates, turning, _, _ = _tree(problem)
    linkage = problem.robot.linkage
    return Structure(
        waypoints=problem.waypoints,
        joints=problem.robot.n,
        parents=tuple(parents.tolist()),
        coordinates=tuple(coordinates.tolist()),
        turning=tuple(turning.astype(bool).tolist()),
        leaders=tuple(range(count) if linkage is None else linkage.leader.tolist()),
        gamma=problem.scene.planner.gamma,
    )


def tables_of(problems: Sequence[Problem]) -> Tables:
    """Return the tables of R problems of one structure."""
    pairs = [term.pairs for problem in problems for term in problem.terms.pairs]
    vertices = max((each.vertex_slots for each in pairs), default=1)
    planes = sorted({slots for each in pairs for slots in each.plane_tables})
    fill = FILL._replace(pairs=(FILL_PAIR,) * len(planes))
    found: Tables = jax.tree.map(_together, fill, *(_tables(problem, vertices, planes) for problem in problems))
    return found


def _tree(problem: Problem) -> tuple[Any, ...]:
    """Return the tree of joints as `Kinematics.tree` has it."""
    fields: tuple[Any, ...] = problem.kinematics.tree.fields
    return fields


def _together(fill: Array, *arrays: Array) -> Array:
    """Return arrays as one, with one axis more, filled where one is larger than another."""
    shape = np.max([array.shape for array in arrays], axis=0)
    result = np.broadcast_to(fill, (len(arrays), *shape)).astype(arrays[0].dtype)
    for row, array in enumerate(arrays):
        there: tuple[Any, ...] = (row, *map(slice, array.shape))
        result[there] = array
    return result


def _tables(problem: Problem, vertices: int, planes: Sequence[int]) -> Tables:
    """Return the tables of one problem, with so many vertices, and with pairs by these numbers of planes."""
    *_, placed, axes = _tree(problem)
    linkage, samples, count = problem.robot.linkage, problem.samples, problem.kinematics.n
    poses = np.empty((len(samples.parameter), 0, 4, 4))
    if moving := problem.terms.moving_obstacles:
        poses = np.stack([each.at(moving.law.time_at(samples.parameter)) for each in moving.motions], axis=1)
    return Tables(
        placed=placed,
        axes=axes,
        factor=np.ones(count) if linkage is None else linkage.factor,
        offset=np.zeros(count) if linkage is None else linkage.offset,
        smoothness=problem.smoothness.matrix,
        interval=samples.interval,
        fraction=samples.fraction,
        share=samples.weight,
        turns=poses[..., :3, :3],
        origins=poses[..., :3, 3],
        shaping_length=np.array(problem.scene.planner.shaping_length),
        pairs=tuple(_pairs(problem.terms.pairs, vertices, slots) for slots in planes),
    )


def _pairs(terms: Sequence[PairTerm], vertices: int, slots: int) -> PairTable:
    """Return the pairs of all terms whose second bodies have so many planes."""
    nothing = PairTable(
        frames=np.empty((0, 2), np.int64),
        vertices=np.empty((0, vertices, 3)),
        weights=np.empty((0, vertices)),
        radius=np.empty(0),
        planes=np.empty((0, 4, slots)),
        place=np.empty(0, np.int64),
    )
    found, first = [nothing], 0
    for term in terms:
        pairs, own = term.pairs, term.pairs.vertex_slots
        if len(chosen := np.flatnonzero(pairs.plane_slots == slots)):
            rows, spare = pairs.body_table[pairs.body[chosen]], ((0, 0), (0, vertices - own))
            planes = pairs.plane_tables[slots][pairs.plane_row[chosen]]
            normals, supports = planes[:, : 3 * slots].reshape(-1, slots, 3), planes[:, 3 * slots :]
            table = PairTable(
                frames=np.column_stack([pairs.joint_a[chosen], pairs.joint_b[chosen]]),
                vertices=np.pad(rows[:, : 3 * own].reshape(-1, own, 3), (*spare, (0, 0)), mode="edge"),
                weights=np.pad(rows[:, 3 * own : -1], spare),
                radius=rows[:, -1],
                planes=np.concatenate([normals.swapaxes(1, 2), supports[:, None]], axis=1),
                place=first + chosen,
            )
            found.append(table)
        first += len(pairs)
    return PairTable._make(np.concatenate(parts) for parts in zip(*found, strict=True))
