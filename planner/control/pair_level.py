"""Pairs of outer bodies that a controller keeps apart, with the exact pairs of the links' hulls behind them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.collision.box_pairs import BoxPairs, GdfPairs
from hdplan.planner.collision.broad_phase import BodyPairs, body_pairs
from hdplan.planner.collision.exact import ExactPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.collision.pieces import Pieces
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Mask, Rows


class PairGroup(NamedTuple):
    """Pairs with one kind of distance."""

    pairs: BodyPairs
    distance: PairDistance


class Hulls(NamedTuple):
    """The exact pairs of the links' hulls behind P pairs."""

    distance: ExactPairs
    row: Rows  # (P,) the row there of each pair
    barrier: Record | None


class PairLevel:
    """Pairs with obstacles, or pairs of links."""

    def __init__(
        self,
        bodies: Sequence[LinkBody],
        others: Pieces,
        chosen: Rows,
        margin: float | Array,
        supports: Mask,
        hulls: Sequence[LinkBody],
        solids: Pieces,
        settings: BarrierSettings,
    ) -> None:
        """Assemble pairs (P, 2) of bodies with others, enlarged by a margin [m]. Behind them are the hulls with
        `solids`: the others themselves, or where these are links their hulls."""
        self.pairs = body_pairs(bodies, others, chosen, margin, supports)
        self.outer = PairGroup(self.pairs, _distance(self.pairs, bodies, others, settings))
        self._enlarged: dict[float, BodyPairs] = {}
        self._hulls, self._solids, self._supports = hulls, solids, supports
        self._links = [body.link for body in bodies]
        self._chosen, self._own = chosen, solids is not others

    def near(self, by: float) -> BodyPairs:
        """Return the pairs enlarged by a distance [m]."""
        if by not in self._enlarged:
            self._enlarged[by] = self.pairs.enlarged(by)
        return self._enlarged[by]

    @cached_property
    def barrier(self) -> Record | None:
        """For the loops in C: their struct of that name; None of a distance that they do not know."""
        return _barrier(self.pairs, self.outer.distance)

    @cached_property
    def hulls(self) -> Hulls:
        """The exact pairs of the hulls, assembled when a pair is first inside its margin."""
        row_of = {hull.link: row for row, hull in enumerate(self._hulls)}
        hull_of = np.array([row_of[link] for link in self._links])
        first, second = hull_of[self._chosen[:, 0]], self._chosen[:, 1]
        second = hull_of[second] if self._own else second
        unique, row = np.unique(first * len(self._solids) + second, return_inverse=True)
        chosen = np.column_stack(np.divmod(unique, len(self._solids)))
        pairs = body_pairs(self._hulls, self._solids, chosen, 0.0, self._supports)
        distance = ExactPairs(pairs, self._hulls, self._solids, far=np.inf)
        return Hulls(distance, row, _barrier(pairs, distance))

    def nearness(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return the exact distance of the hulls, as a `PairDistance`."""
        return self.hulls.distance(kinematics, sample, self.hulls.row[pair])


def _barrier(pairs: BodyPairs, distance: PairDistance) -> Record | None:
    return Record("barrier", pairs.tables, *distance.shaping) if distance.shaping else None


def _distance(
    pairs: BodyPairs,
    bodies: Sequence[LinkBody],
    others: Sequence[HalfspaceBody],
    settings: BarrierSettings,
) -> PairDistance:
    match settings.distance:
        case "hdsdf":
            return HdsdfPairs(pairs, settings.gamma, settings.shaping_length)
        case "hdsdf-boxes":
            return BoxPairs(pairs, bodies, others, settings.gamma, settings.shaping_length, settings.normals)
        case "euclidean":
            return ExactPairs(pairs, bodies, others, far=np.inf)
        case "gdf":
            return GdfPairs(pairs, bodies, others)
    raise ValueError(f"unknown distance {settings.distance!r}")
