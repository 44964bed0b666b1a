"""Obstacles whose sizes may change: how the planes around them move out, and how their boxes widen.

A shape's sizes are its lengths in the order of its fields: the edges of a box, the radius and the length of a capsule.
Of shapes whose supports and boxes are linear in them, none of the planes turns:

    h_k(σ) = h_k(σ₀) + G_k (σ − σ₀)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.symbolic.all_planes import MOST_SIZES
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.geometry.shape_table import TABLE, operations
from hdplan.scenes.array_types import Array
from hdplan.scenes.shapes import Shape


@dataclass(frozen=True, eq=False)
class Growth:
    """Derivatives by the sizes of a body; zeros beyond those that it has."""

    supports: Array  # (K, 3)
    half_size: Array  # (3, 3)


Growths = Mapping[int, Growth]  # by the row of the body


def sizes_of(shape: object) -> Array:
    """Return the sizes (k,) of a shape [m]; none of one that cannot grow."""
    row = TABLE.get(type(shape))
    if row is None or row.outline is None or not row.outline.linear:
        return np.empty(0)
    return np.concatenate([np.atleast_1d(getattr(shape, field)) for field in row.sizes.split()]).astype(np.float64)


def growths(bodies: Sequence[HalfspaceBody]) -> dict[int, Growth]:
    """Return the growth of the bodies that grow."""
    return {row: _growth(body) for row, body in enumerate(bodies) if len(sizes_of(body.shape))}


def _growth(body: HalfspaceBody) -> Growth:
    """By differences, which are exact but for rounding."""
    shape, directions = body.shape, body.normals @ body.placement[:3, :3]
    assert shape is not None
    assert not isinstance(shape, ConvexBody)
    outline, sizes = operations(shape).outline, sizes_of(shape)
    assert outline is not None
    supports, half_size = np.zeros((len(directions), MOST_SIZES)), np.zeros((3, MOST_SIZES))
    for k in range(len(sizes)):
        longer = _of_sizes(shape, sizes + np.eye(len(sizes))[k])
        supports[:, k] = outline.support(longer, directions) - outline.support(shape, directions)
        half_size[:, k] = outline.half_size(longer) - outline.half_size(shape)
    return Growth(supports, half_size)


def _of_sizes(shape: Shape, sizes: Array) -> Shape:
    """A shape of this kind with other sizes."""
    values, fields = sizes.tolist(), operations(shape).sizes.split()
    given: dict[str, Any] = dict(zip(fields, values if len(fields) == len(values) else [values], strict=True))
    return replace(shape, **given)
