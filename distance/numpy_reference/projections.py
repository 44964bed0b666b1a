"""Projections of two bodies on their candidate normals, in NumPy, with derivatives: the linear part of the distance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import CandidateNormals
from hdplan.distance.numpy_reference.jets import Jet, inverse_power, product
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import read_only

CROSS = np.zeros((3, 3, 3))  # (u×v)_x = CROSS[x, y, z] u_y v_z
CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]], CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = 1.0, -1.0
CROSS = read_only(CROSS)


@dataclass(frozen=True, eq=False)
class Along:
    """The projections of a pair of bodies along an axis."""

    x: Jet  # (..., vertex pairs) [m] w·(a_i - b_j) - r_A - r_B - f
    bound: Array  # (...,) [m] the axis' contribution to D̃, see ``normals``
    count: float  # how often it counts in the maximum


def separations(
    normals: CandidateNormals, body_a: ConvexBody, pose_a: Jet, body_b: ConvexBody, pose_b: Jet, witnesses: Array
) -> Iterator[Along]:
    """Yield the projections of the bodies along every axis w and -w.

    Poses are jets (..., 4, 4), witnesses unit vectors (..., W, 3) in B's frame. For the axes see ``normals``.
    """
    radii = body_a.radius + body_b.radius
    offset = pose_a.part(slice(3), 3) - pose_b.part(slice(3), 3)  # positions are relative to B's origin
    rotation_a, rotation_b = pose_a.part(slice(3), slice(3)), pose_b.part(slice(3), slice(3))
    vertices_a = product("xy,iy->ix", rotation_a, body_a.vertices) + offset.part(None, slice(None))
    vertices_b = product("xy,iy->ix", rotation_b, body_b.vertices)
    for w, fade, count in _axes(normals, rotation_a, rotation_b, offset, witnesses):
        along_a, along_b = product("ix,x->i", vertices_a, w), product("jx,x->j", vertices_b, w)
        differences = (along_a.part(slice(None), None) - along_b.part(None, slice(None))).merged()
        for sign in (1.0, -1.0):
            x = (differences * sign).plus(-radii)
            if fade is None:
                yield Along(x, x.value.min(axis=-1), count)
                continue
            x = x - fade.part(None)
            overlap = np.minimum((sign * differences.value).min(axis=-1), 0.0)
            square = np.einsum("...x,...x->...", w.value, w.value)
            stretched = overlap / np.maximum(square, np.finfo(float).tiny) - radii - fade.value
            bound = np.where(overlap < 0, stretched, x.value.min(axis=-1))
            yield Along(x, np.where(square > 0, bound, -np.inf), count)


def _axes(
    normals: CandidateNormals, rotation_a: Jet, rotation_b: Jet, offset: Jet, witnesses: Array
) -> Iterator[tuple[Jet, Jet | None, float]]:
    """Yield every axis w (..., 3) in the world, its fade (...,), None for unit vectors, and its count."""
    for direction, count in zip(normals.in_a, normals.counts_a, strict=True):
        yield product("xy,y->x", rotation_a, direction), None, count
    for direction, count in zip(normals.in_b, normals.counts_b, strict=True):
        yield product("xy,y->x", rotation_b, direction), None, count
    for k in range(witnesses.shape[-2]):
        yield product("xy,y->x", rotation_b, witnesses[..., k, :]), None, 1.0
    if (centre := normals.centre) is not None:
        t = product("xy,y->x", rotation_a, centre.point_a) + offset - product("xy,y->x", rotation_b, centre.point_b)
        square = product("x,x->", t, t)
        yield product("x,->x", t, inverse_power(square, centre.softness, 0.5)), square * 0.0, 1.0
    if (edges := normals.edges) is not None:
        for u in edges.along_a:
            turn = product("xyz,y->xz", _constant(CROSS, rotation_a), product("xy,y->x", rotation_a, u))
            for v in edges.along_b:
                cross = product("xz,z->x", turn, product("xy,y->x", rotation_b, v))
                square = product("x,x->", cross, cross)
                w = product("x,->x", cross, inverse_power(square, edges.sine, 0.5))
                # sine² (1 - |u×v|²) / (|u×v|² + sine²) in one inverse
                faded = (inverse_power(square, edges.sine, 1.0) * (1.0 + edges.sine**2)).plus(-1.0)
                yield w, faded * (edges.fade * edges.sine**2), 1.0


def _constant(array: Array, like: Jet) -> Jet:
    n = like.first.shape[-1]
    return Jet(array, np.zeros((*array.shape, n)), np.zeros((*array.shape, n, n)))
