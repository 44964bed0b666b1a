"""The exact signed distance of the enclosed geometry, for narrow places: a link's own hull, or the hull of each part of
it, against the obstacle's own shape.

The pairs, and the broad phase, are those of the outer bodies, which contain the parts: where outer bodies are apart,
nothing more is done. Where they are not,

    D = d(A, B) − margin

in a loop of C: GJK where the solids are apart, the expanding polytope where they overlap (`gjk.c`). Its gradient is the
motion of A's witness point along the normal (the envelope theorem), which jumps where d has kinks. `euclidean` has the
same by coal, one pair after another; it serves where hdplan was installed without a C compiler.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.loops import C, Record, twin_of
from hdplan.distance.poses import placement_rows
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.collision.pieces import Pieces
from hdplan.planner.geometry.shape_table import Swept, operations
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.shapes import Box, Shape

LANES = 8  # numbers in the widest vector of a processor
CLUSTER = 32  # vertices that are near each other: of a large hull, few clusters have to be examined
RADIUS_ROUNDING = 1e-12  # [–] relative, by which balls are larger
CLUSTERED_VERTICES = 256  # vertices of a hull from which on clusters pay


def _distances(exact: ExactPairs, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
    distance, wrench = np.empty(len(pair)), np.empty((len(pair), 6))
    rows = (np.ascontiguousarray(each, np.int64) for each in (sample, pair))
    given = exact.record.struct, exact.pairs.tables.struct, kinematics.placements, *rows
    C.exact_rows(*given, exact.far, distance, wrench)
    return distance, wrench, distance


class ExactPairs(PairDistance):
    """D of the pairs' solids, less the margin."""

    def __init__(
        self, pairs: BodyPairs, parts: Sequence[LinkBody], solids: Sequence[HalfspaceBody], far: float = 0.0
    ) -> None:
        """Take pairs of outer bodies, and for the rows that they index, what the bodies enclose. far: up to where D is
        exact [m]."""
        self.pairs, self.parts, self.solids, self.far = pairs, parts, solids, far

    @property
    def shaping(self) -> tuple[int, float, Record | None] | None:
        """The solids, without shaping."""
        return (1, 1.0, self.record) if C else None

    @property
    def how(self) -> str:
        """Compiled, or by coal."""
        return "exact Euclidean distance, compiled C" if C else self._twin.how

    def enlarged(self, by: float) -> ExactPairs:
        """This distance with a margin that is larger [m]."""
        return ExactPairs(self.pairs.enlarged(by), self.parts, self.solids, self.far)

    @cached_property
    def record(self) -> Record:
        """The C struct `solids`. All boxes of a cloud come at once, after the others."""
        pieces = Pieces.of(self.solids)
        given = [*(part.body for part in self.parts), *pieces.shapes]
        places = np.concatenate([np.tile(np.eye(4), (len(self.parts), 1, 1)), pieces.placements])
        swept = [BOX if shape is None else _swept(shape) for shape in given]
        held = [_held(each.vertices.tobytes()) for each in swept]
        boxes = np.array([shape is None for shape in given], dtype=np.bool_)
        counts = np.array([len(each.rows) for each in held], dtype=np.int64)
        order = np.argsort(boxes, kind="stable")
        first = np.empty_like(counts)
        first[order] = np.cumsum(counts[order]) - counts[order]
        half = pieces.half_sizes[boxes[len(self.parts) :]]
        corners = (BOX.vertices * half[:, None]).transpose(0, 2, 1)
        return Record(
            *("solids", len(self.parts), first),
            *(np.array([each.width for each in held]), np.array([each.clusters for each in held])),
            np.concatenate([*(each.rows for each, box in zip(held, boxes, strict=True) if not box), corners.ravel()]),
            *(np.array([each.disc for each in swept]), np.array([each.radii for each in swept])),
            np.array([each.ball for each in swept]),
            *(placement_rows(places), self.pairs.margins),
        )

    @cached_property
    def _twin(self) -> PairDistance:
        from hdplan.planner.collision.euclidean import FclPairs

        parts = [replace(part, body=_whole(part.body)) for part in self.parts]
        solids = [
            replace(each, shape=_whole(each.shape)) if isinstance(each.shape, ConvexBody) else each
            for each in self.solids
        ]
        return FclPairs(self.pairs, parts, solids)

    @twin_of(_distances)
    def __call__(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return D (S,) [m], its wrench (S, 6) and D again, for S pairs at samples; some number above `far`
        where D is above it."""
        return self._twin(kinematics, sample, pair)


class _Held(NamedTuple):
    """Vertices as the loops hold them."""

    rows: Array  # all x, all y and all z, then balls around the clusters
    width: int  # how many vertices, some of them repeated
    clusters: int


@functools.lru_cache(maxsize=1024)
def _held(vertices: bytes) -> _Held:
    points = np.frombuffer(vertices).reshape(-1, 3)
    if len(points) <= CLUSTERED_VERTICES:
        filled = _filled(points, LANES)
        return _Held(filled.T.ravel(), len(filled), 0)
    filled = _filled(_clustered(points), LANES * CLUSTER)
    return _Held(np.append(filled.T, _balls(filled)), len(filled), len(filled) // CLUSTER)


def _filled(vertices: Array, count: int) -> Array:
    """Vertices (K, 3) with the first repeated until they are a multiple of `count`."""
    return np.vstack([vertices, np.tile(vertices[:1], (-len(vertices) % count, 1))])


def _clustered(vertices: Array) -> Array:
    """The vertices (K, 3) in an order in which each CLUSTER of them are near each other: halved along their longest
    side, again and again."""
    if len(vertices) <= CLUSTER:
        return vertices
    along = vertices[:, np.ptp(vertices, axis=0).argmax()].argsort(kind="stable")
    half = CLUSTER * (-(-len(vertices) // CLUSTER) // 2)
    return np.vstack([_clustered(vertices[along[:half]]), _clustered(vertices[along[half:]])])


def _balls(vertices: Array) -> Array:
    """Balls around the clusters: rows of x, y, z and radii (4, K / CLUSTER), a little larger than rounding needs."""
    clusters = vertices.reshape(-1, CLUSTER, 3)
    middles = 0.5 * (clusters.min(axis=1) + clusters.max(axis=1))
    radii = np.linalg.norm(clusters - middles[:, None], axis=2).max(axis=1)
    return np.vstack([middles.T, radii + RADIUS_ROUNDING * (radii + np.abs(middles).max())])


def _whole(body: ConvexBody) -> ConvexBody:
    """This body with its faces and edges."""
    return ConvexBody.from_points(body.vertices, body.radius)


@functools.lru_cache(maxsize=1024)  # a controller sees the same boxes again and again
def _swept(shape: Shape | ConvexBody) -> Swept:
    if isinstance(shape, ConvexBody):
        return Swept(shape.vertices, ball=shape.radius)
    outline = operations(shape).outline
    if outline is None:
        raise TypeError(f"a {type(shape).__name__} has to be split into convex pieces first")
    return outline.swept(shape)


BOX = _swept(Box((2.0, 2.0, 2.0)))  # half sizes are 1


def as_solids(planes: Sequence[HalfspaceBody], parts: Sequence[LinkBody]) -> tuple[HalfspaceBody, ...]:
    """Return links' halfspace bodies with their parts as what they enclose."""
    return tuple(replace(each, shape=part.body) for each, part in zip(planes, parts, strict=True))
