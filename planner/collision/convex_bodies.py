"""Outer bodies with their faces and edges, kept on disk: loading the library for hulls takes longer than a plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.cache import content_key, finite, load, store
from hdplan.planner.collision.sphere_swept_fit import Swept
from hdplan.scenes.array_types import Array

VERSION = "1"  # to be changed with anything that changes a body's faces or edges, so that old entries are not used


def convex_bodies(around: Sequence[Swept]) -> tuple[ConvexBody, ...]:
    """Return these bodies with the faces and edges that `ConvexBody.from_points` finds.

    They are cached on disk, all together, by their content.
    """
    clouds = [each.vertices for each in around]
    key = content_key(VERSION, *(cloud.tobytes() for cloud in clouds))
    known = load("convex_bodies", key, lambda value: _read(value, around))
    if known is not None:
        return known
    found = [ConvexBody.from_points(cloud) for cloud in clouds]
    lists = [[array.tolist() for array in (body.vertices, body.faces, body.edges, body.edge_counts)] for body in found]
    store("convex_bodies", key, lists)
    return _read(lists, around)


def _read(lists: Sequence[Any], around: Sequence[Swept]) -> tuple[ConvexBody, ...]:
    return tuple(
        ConvexBody(_rows(vertices), _rows(faces), _rows(edges), finite(counts), each.radius)
        for each, (vertices, faces, edges, counts) in zip(around, lists, strict=True)
    )


def _rows(values: list[list[float]]) -> Array:
    return finite(values).reshape(-1, 3)
