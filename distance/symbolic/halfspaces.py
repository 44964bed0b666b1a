"""The HD-SDF between a swept body and a body given by its planes: the planner's distance.

In: vertices of A (swept by a ball), unit normals n_k fixed in B's frame with B's exact support h_B(n_k) along each.
Out: D and its derivative as a wrench. Equation (Definition III.2 of the paper, with the normals of B's side and B's
minimum taken exactly):

    D = Phi( ⊞_k Phi( ⊕_i (n_k · a_i − r_A − h_B(n_k)) ) )

Why exact: along a normal that is fixed in B, B's projections are constants, so their hard minimum −h_B(n_k) is as
smooth as the Hölder one, tighter, and any convex B with a known support function (a true cylinder, a ball, a mesh's
hull) enters without vertices.

A lower bound in sign, an approximation in value. Sign safety: if A and B share a point y, then n_k·y ≤ h_B(n_k) and
min_i n_k·a_i − r_A ≤ n_k·y for every k, so every inner minimum is ≤ 0; ⊕, ⊞ and Phi preserve signs, hence D ≤ 0.
Positive D means separated; a clearance c is required by enlarging h_B by c.

A may also be swept: the hull of its vertices at two placements, D depending on both. All of the above holds for that
hull, which contains A at the two placements and on the straight line between them.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from hdplan.distance.symbolic.all_planes import distance_by_planes
from hdplan.distance.symbolic.graph_poses import rigid_or_nan
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import read_only

FAR_OFFSET = 1e3  # [m] offset of an unused plane: it weighs about (depth/FAR_OFFSET)^(gamma+1) in the maximum


@functools.cache
def box_directions() -> Array:
    """The 26 unit directions (26, 3) of a cube's faces, edges and corners: Ñ of a box, widened to 13 axes."""
    grid = np.array(
        [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)], dtype=float
    )
    return read_only(grid / np.linalg.norm(grid, axis=1, keepdims=True))


@functools.cache
def halfspace_distance(vertices: int, planes: int, gamma: int, shaping_length: float, order: int = 1) -> ca.Function:
    """Build D(A, B) as a CasADi function for A of `vertices` vertices and B of `planes` planes; the numbers are
    arguments.

    Inputs (flat, row-major): placement_a (12) and placement_b (12), each [R (9) | t (3)] from body to world [m];
    body (4·vertices + 1) = [a_i (3 each) | weight_i | r_A] in A's frame, weight 1, or 0 for a slot that repeats a
    vertex; body_planes (4·planes) = [n_k (3 each) | h_B(n_k)] in B's frame.

    Outputs: distance () [m]; wrench (6) = [F | T], the derivative of D under a motion of A: dD = F·v + T·ω for the
    velocity v of the point of A at the world's origin and angular velocity ω (D depends on the relative pose only, so
    B's wrench is −[F | T]); separation () [m], D̃ of eq. (5) with the plain minimum and maximum: it has D's sign even
    where D underflows, and never exceeds the true signed distance, as a negative D may. With order 2 also hessian (6,
    6) of D by the twist ξ = (v, ω) of A in the world: D of exp(ξ)·A to second order.

    Wrench and Hessian are closed forms, correct at every pose. CasADi's own derivatives of D and of the wrench are
    wrong where separated bodies have several least projections along a normal, as aligned boxes do.
    """
    wrenches = {"placement_a": "wrench"}
    return _by_planes("halfspaces", wrenches, vertices, planes, gamma, shaping_length, order)


@functools.cache
def swept_halfspace_distance(
    vertices: int, planes: int, gamma: int, shaping_length: float, order: int = 1
) -> ca.Function:
    """The distance for the hull of A at two placements: D of its 2·vertices points, with a wrench for each placement.

    Inputs: first (12) and second (12), A's placements; placement_b, body and body_planes as in `halfspace_distance`.
    Outputs: distance [m]; first_wrench and second_wrench (6), dD = F·v + T·ω under a motion of A at that placement
    alone; separation [m]. With order 2 also hessian (12, 12) by both motions.
    """
    wrenches = {"first": "first_wrench", "second": "second_wrench"}
    return _by_planes("swept_halfspaces", wrenches, vertices, planes, gamma, shaping_length, order)


def _by_planes(
    name: str, wrenches: Mapping[str, str], vertices: int, planes: int, gamma: int, shaping_length: float, order: int
) -> ca.Function:
    """Return the function for A at one placement or swept between several, each with the name of its wrench."""
    own, b = [ca.MX.sym(each, 12) for each in wrenches], ca.MX.sym("placement_b", 12)
    body, body_planes = ca.MX.sym("body", 4 * vertices + 1), ca.MX.sym("body_planes", 4 * planes)
    given = *points_seen([*own, b], body), body_planes
    distance, separation, gradient, *second = distance_by_planes(*given, gamma, shaping_length, order, len(own))
    mark = rigid_or_nan(*map(rotation_of, (*own, b)))
    pushes = ca.vertsplit(as_wrenches(b, gradient), 6)
    hessians = [in_the_world(b, hessian, len(own)) for hessian in second]
    return ca.Function(
        f"hdsdf_{name}_{vertices}_{planes}_{gamma}",
        [*own, b, body, body_planes],
        [distance + mark, *pushes, separation + mark, *hessians],
        [*wrenches, "placement_b", "body", "body_planes"],
        ["distance", *wrenches.values(), "separation", *["hessian"] * len(hessians)],
    )


def rotation_of(placement: ca.MX) -> ca.MX:
    """Return the rotation (3, 3) of a placement (12)."""
    return ca.reshape(placement[:9], 3, 3).T


def points_seen(placements: Sequence[ca.MX], body: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Return the vertices of A at its placements, all but the last, in the frame of B, which is the last: (3, m e),
    their weights, and A's radius."""
    vertices, (*own, last) = (body.numel() - 1) // 4, placements
    corners, weights = ca.reshape(body[: 3 * vertices], 3, vertices), body[3 * vertices : 4 * vertices]
    world = [rotation_of(each) @ corners + ca.repmat(each[9:] - last[9:], 1, vertices) for each in own]
    return rotation_of(last).T @ ca.horzcat(*world), ca.vertcat(*[weights] * len(own)), body[4 * vertices]


def as_wrenches(placement_b: ca.MX, gradient: ca.MX) -> ca.MX:
    """Return the derivative by motions (6 e) as B sees them, as wrenches about the world's origin."""
    turn, found = rotation_of(placement_b), []
    for part in ca.vertsplit(gradient, 6):
        force = turn @ part[:3]
        found += [force, turn @ part[3:] + ca.cross(placement_b[9:], force)]
    return ca.vertcat(*found)


def in_the_world(placement_b: ca.MX, hessian: ca.MX, placements: int) -> ca.MX:
    """Return the Hessian by e motions, six each, as B sees them, by the same motions about the world's origin; what is
    after them in rows and columns is no motion."""
    turn = rotation_of(placement_b).T
    one = ca.blockcat([[turn, -turn @ ca.skew(placement_b[9:])], [ca.MX.zeros(3, 3), turn]])
    adjoint = ca.diagcat(*[one] * placements, ca.MX.eye(hessian.shape[0] - 6 * placements))
    return ca.densify(adjoint.T @ hessian @ adjoint)
