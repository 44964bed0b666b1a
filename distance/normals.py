"""Candidate normals: the directions along which a pair of bodies is compared; a ladder of sets from cheap to tight.

A pair's distance is a maximum over axes. An axis is a vector w, |w| <= 1, that varies smoothly with the pose, and a
length f >= 0 by which it is faded. Both w and -w count, and each compares the bodies by

    x_ij = w·(a_i - b_j) - r_A - r_B - f      over the vertices a_i of A and b_j of B, radii r.

Sign safety, of every axis and so of every set: if the swept bodies share a point, the polytopes contain points a and b
with |a - b| <= r_A + r_B. A convex combination of the x_ij is w·(a - b) - r_A - r_B - f, at most |w||a - b| - r_A - r_B
- f <= 0, so the least of them is not positive; Hölder minimum, maximum and shaping keep signs, so D <= 0. The choice of
the set only decides how tight the distance is.

In metres, each axis bounds the signed distance d from below. With c the differences a - b of points of the polytopes,
d = max over unit n of min n·c, less the radii; so the least m = min w·c gives m/|w| - r_A - r_B <= d, and then

    m - r_A - r_B - f <= d  for m >= 0,     m/|w|² - r_A - r_B - f <= d  for m < 0,

as |w| <= 1 and f >= 0. D̃ (paper: eq. (5)) is the largest of these: a lower bound of d, with the sign of the largest
min x_ij and so of D. For unit vectors, as in the paper, it is that number itself. In contact a shrinking axis is
divided by |w| twice, so that it leaves the maximum as it vanishes; w = 0 gives no bound.

Names: ``paper``, or ``paper-multiset``, followed by any of ``+centre``, ``+edges``, ``+sphere-K``; ``RUNGS`` are those
worth comparing. Besides, ``separating_axes`` is the exact but discontinuous set of the separating axis theorem.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.bodies import ConvexBody, check_bodies, unique_directions
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.values import describe, shorten

PARALLEL_SINE = 1e-14  # sine of the angle between two edges below which their cross product is left out
CENTRE_SOFTNESS = 0.1  # of the bodies' reach: distance of the centres below which the axis between them shrinks
EDGE_SINE = 0.1  # sigma: sine of the angle of two edges below which the axis of their cross product fades
EDGE_FADE = 0.5  # kappa, of the bodies' mean reach: penetration that this axis gives where the edges are parallel

BASES = ("paper", "paper-multiset")
RUNGS = ("paper", "paper+centre", "paper+sphere-26", "paper+sphere-256", "paper+edges")
"""The sets of normals that are worth a comparison, each tighter and slower than the one before."""


@dataclass(frozen=True, eq=False)
class CentreAxis:
    """The axis w = t/√(|t|² + softness²) along t, the line from B's centre to A's; C∞ in the pose, never faded."""

    point_a: Array  # (3,) [m] centre of A, in A's frame
    point_b: Array  # (3,) [m] centre of B, in B's frame
    softness: float  # [m] > 0


@dataclass(frozen=True, eq=False)
class EdgeAxes:
    """One axis for every edge direction u of A and v of B, regularized so that none jumps where edges align.

    w = u×v/√(|u×v|² + sine²), faded by f = fade·sine²(1 - |u×v|²)/(|u×v|² + sine²) >= 0: no fade for perpendicular
    edges, ``fade`` for parallel ones, where the axis is meaningless. C∞ in the pose. ``fade`` must exceed the deepest
    penetration of interest: without it D would show no depth at all (w = 0 gives x = 0).
    """

    along_a: Array  # (E_a, 3) unit edge directions of A, in A's frame
    along_b: Array  # (E_b, 3) unit edge directions of B, in B's frame
    sine: float  # sigma, of an angle, > 0
    fade: float  # kappa [m] >= 0


@dataclass(frozen=True, eq=False)
class CandidateNormals:
    """A set of axes for one pair of bodies; -w goes with every w."""

    in_a: Array  # (K_a, 3) unit directions fixed in A's frame
    counts_a: Array  # (K_a,) how often each counts in the maximum: once, except in the multiset
    in_b: Array  # (K_b, 3) the same for B
    counts_b: Array  # (K_b,)
    centre: CentreAxis | None = None
    edges: EdgeAxes | None = None


def candidate_normals(name: str, body_a: ConvexBody, body_b: ConvexBody) -> CandidateNormals:
    """Return the set ``name`` for this pair.

    ``paper``           Ñ: faces and edges, equal directions once per body (eq. (4)). A's and B's copies are
                        both kept, even where they happen to align: merging them would make D jump.
    ``paper-multiset``  the same with every edge counted, as in the paper's published code.
    ``+centre``         one axis along the line of centres: for spheres, and corner against corner.
    ``+edges``          the regularized cross products of edges: what the paper's set lacks most.
    ``+sphere-K``       K more directions, K/2 lines evenly over the sphere, fixed in each body: for swept bodies.

    Raises InputError for an unknown name.
    """
    check_bodies(body_a, body_b)
    if not isinstance(name, str):
        raise InputError(f"normals: found {describe(name)}, allowed is the name of a set, such as 'paper+edges'")
    base, *parts = name.split("+")
    if base not in BASES or len(set(parts)) < len(parts):
        raise _unknown(name)
    (in_a, counts_a), (in_b, counts_b) = own_directions(body_a), own_directions(body_b)
    if base == "paper":
        counts_a, counts_b = np.ones(len(in_a)), np.ones(len(in_b))
    normals = CandidateNormals(in_a, counts_a, in_b, counts_b)
    size = 0.5 * (body_a.reach + body_b.reach) or 1.0
    for part in parts:
        kind, _, number = part.partition("-")
        if part == "centre":
            normals = replace(normals, centre=CentreAxis(body_a.centre, body_b.centre, CENTRE_SOFTNESS * size))
        elif part == "edges":
            normals = replace(normals, edges=EdgeAxes(body_a.edges, body_b.edges, EDGE_SINE, EDGE_FADE * size))
        elif kind == "sphere" and number.isascii() and number.isdigit() and int(number) >= 2 and int(number) % 2 == 0:
            more = sphere_directions(int(number))
            normals = replace(
                normals,
                in_a=np.vstack([normals.in_a, more]),
                counts_a=np.append(normals.counts_a, np.ones(len(more))),
                in_b=np.vstack([normals.in_b, more]),
                counts_b=np.append(normals.counts_b, np.ones(len(more))),
            )
        else:
            raise _unknown(name)
    return normals


def own_directions(body: ConvexBody) -> tuple[Array, Array]:
    """Return F(A) ∪ E(A) in the body's frame (K, 3), those equal up to sign once, and how often the published code
    counts each (K,).

    A point has no face and no edge, and a segment only its own direction: the paper's set would be empty for two
    spheres, and blind to two capsules side by side. Such a body is treated as the limit of a thin box: its directions
    are completed to an orthonormal frame, fixed in the body (so D stays smooth in the pose, and a sphere's orientation
    matters a little).
    """
    faces, _ = unique_directions(body.faces)
    directions, counts = unique_directions(np.vstack([faces, body.edges]))
    if len(directions) < 2:
        frame = np.linalg.qr(np.vstack([directions, np.eye(3)]).T)[0].T  # rows; the first is the body's own direction
        return np.vstack([directions, frame[len(directions) :]]), np.ones(3)
    for direction, count in zip(body.edges, body.edge_counts, strict=True):
        counts[np.argmax(np.abs(directions @ direction))] += count - 1
    return directions, counts


def sphere_directions(count: int) -> Array:
    """Return ``count``/2 unit directions (count/2, 3) that, with their opposites, cover the sphere evenly
    (Fibonacci)."""
    lines = count // 2
    height = (np.arange(lines) + 0.5) / lines
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(lines)
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


def check_witnesses(witnesses: ArrayLike | None) -> Array:
    """Return witness normals, fixed in B's frame, as unit vectors (..., W, 3); (0, 3) without any.

    Raises InputError for another shape and for vectors without a direction.
    """
    if witnesses is None:
        return np.empty((0, 3))
    try:
        vectors = np.asarray(witnesses, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"witnesses: not an array of numbers ({error})") from None
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if vectors.ndim < 2 or vectors.shape[-1] != 3 or not np.all(np.isfinite(lengths)) or np.any(lengths == 0):
        raise InputError(f"witnesses: found an array of shape {vectors.shape}, allowed are nonzero vectors (..., W, 3)")
    return np.asarray(vectors / lengths)


def check_witness_count(shape: tuple[int, ...], count: int) -> None:
    """Raise InputError unless witnesses of ``shape`` (..., W, 3) are as many at each pose as the distance has."""
    if shape[-2] != count:
        raise InputError(f"witnesses: found {shape[-2]} at each pose, allowed are {count}")


def separating_axes(body_a: ConvexBody, rotation_a: Array, body_b: ConvexBody, rotation_b: Array) -> Array:
    """Return N(A, B) up to sign, unit vectors (K, 3) in the world (paper: Definition III.1).

    The face normals of both bodies and the cross products of their edges, except of parallel edges. Where A - B is flat
    (two segments, coplanar polygons) the normals of its plane or line belong to it as well.
    """
    check_bodies(body_a, body_b)
    edges_a, edges_b = body_a.edges @ rotation_a.T, body_b.edges @ rotation_b.T
    crosses = np.cross(edges_a[:, None], edges_b[None]).reshape(-1, 3)
    sines = np.linalg.norm(crosses, axis=1)
    crosses = crosses[sines > PARALLEL_SINE] / sines[sines > PARALLEL_SINE, None]
    span = np.vstack([edges_a, edges_b, np.zeros((3, 3))])
    _, extents, axes = np.linalg.svd(span)
    return np.vstack(
        [body_a.faces @ rotation_a.T, body_b.faces @ rotation_b.T, crosses, axes[extents <= PARALLEL_SINE]]
    )


def _unknown(name: str) -> InputError:
    unknown = f"unknown set {shorten(repr(name))}{nearest(name, RUNGS)}"
    return InputError(f"normals: {unknown}, allowed are {', '.join(RUNGS)}")
