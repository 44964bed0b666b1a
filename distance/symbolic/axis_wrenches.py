"""Changes of the separations along one candidate normal as B moves relative to A: wrenches and their derivatives.

Everything in A's frame; the motion is exp(η), η = (v, ω) the twist of B in A's frame [m, rad]. Each kind of axis gives
x(η), linear in the moments ψ of a pair of vertices (see ``one_axis``) and exact to second order at η = 0; CasADi
differentiates it there once, which leaves a few products with 4 or 7 rows per axis.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import casadi as ca

from hdplan.distance.symbolic.one_axis import AxisShape

# x(η, ψ, sign, parameters): the separation along the axis (sign 1) or its opposite (-1), up to a constant
Motion = Callable[[ca.SX, ca.SX, float, list[ca.SX]], ca.SX]


def fixed_in_a(eta: ca.SX, psi: ca.SX, sign: float, parameters: list[ca.SX]) -> ca.SX:
    """x = -n·b, b moving, each of B's placements by six of η; parameters: n."""
    (normal,) = parameters
    x = ca.SX(0)
    for k in range(psi.numel() // 4):
        x -= sign * ca.dot(normal, _moved(eta[6 * k : 6 * k + 6], psi[4 * k], psi[4 * k + 1 : 4 * k + 4]))
    return x


def fixed_in_b(eta: ca.SX, psi: ca.SX, sign: float, parameters: list[ca.SX]) -> ca.SX:
    """The wrench with the bodies' roles swapped: seen from B, A's vertices move backwards; parameters: n."""
    (normal,) = parameters
    return -sign * ca.dot(normal, _moved(-eta, psi[0], psi[1:4]))


def between_centres(eta: ca.SX, psi: ca.SX, sign: float, parameters: list[ca.SX]) -> ca.SX:
    """x = w·(a - b), w = t/√(|t|² + softness²); parameters: the centres of A and B, softness."""
    centre_a, centre_b, softness = parameters
    t = centre_a - _moved(eta, 1, centre_b)
    w = t / ca.sqrt(ca.dot(t, t) + softness**2)
    return sign * ca.dot(w, psi[4:7] - _moved(eta, psi[0], psi[1:4]))


def across_edges(eta: ca.SX, psi: ca.SX, sign: float, parameters: list[ca.SX]) -> ca.SX:
    """x = w·(a - b) - f with w and f of ``normals.EdgeAxes``; parameters: u, v (in A's frame), sine, fade."""
    edge_a, edge_b, sine, fade = parameters
    w, f = edge_axis(edge_a, _moved(eta, 0, edge_b), sine, fade)
    return sign * ca.dot(w, psi[4:7] - _moved(eta, psi[0], psi[1:4])) - f * psi[0]


def edge_axis(edge_a: ca.SX, edge_b: ca.SX, sine: ca.SX, fade: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the axis w across two edges and its fade f."""
    cross = ca.cross(edge_a, edge_b)
    square = ca.dot(cross, cross)
    return cross / ca.sqrt(square + sine**2), fade * sine**2 * (1 - square) / (square + sine**2)


@functools.cache
def wrench_function(motion: Motion, sizes: tuple[int, ...], shape: AxisShape) -> ca.Function:
    """Return the function for one axis' part in D's derivatives, for all its s signs.

    Inputs: the motion's parameters, of ``sizes``; pull (n, s) of ``axis_function``; push (1, s) = dU/dg · dg/du, the
    axis' share in the maximum U. For order 2 also sharp (n, s n); slope = dD/dg · dg/du, and the factors of (Σ q dx)(Σ
    q dx)ᵀ and of sharp, (1, s) each.

    Outputs: dU/dη (6, for each placement); for order 2 this axis' part of d²D/dη² (6, 6), the outer rank-one term
    aside.
    """
    moments, signs, twists = shape.moments, shape.signs, 6 * shape.placements
    eta, psi = ca.SX.sym("eta", twists), ca.SX.sym("psi", moments)
    parameters = [ca.SX.sym(f"parameter{k}", size) for k, size in enumerate(sizes)]
    pull, push = ca.SX.sym("pull", moments, len(signs)), ca.SX.sym("push", 1, len(signs))
    sharp = ca.SX.sym("sharp", moments, len(signs) * moments)
    slope, outer, spread = (ca.SX.sym(name, 1, len(signs)) for name in ("slope", "outer", "spread"))
    first, second = ca.SX.zeros(twists), ca.SX.zeros(twists, twists)
    for k, sign in enumerate(signs):
        x = motion(eta, psi, sign, parameters)
        bend, gradient = ca.hessian(x, eta)
        by_psi = ca.jacobian(gradient, psi)  # (6, n), as x is linear in psi
        at_rest = [ca.substitute(part, eta, ca.SX.zeros(twists)) for part in (by_psi, bend)]
        by_psi, bend = at_rest
        wrench = by_psi @ pull[:, k]
        first += push[k] * wrench
        second += (
            slope[k] * ca.substitute(bend, psi, pull[:, k])
            + outer[k] * wrench @ wrench.T
            + spread[k] * by_psi @ sharp[:, k * moments : (k + 1) * moments] @ by_psi.T
        )
    if shape.order == 1:
        return ca.Function("wrench", [*parameters, pull, push], [first])
    return ca.Function("wrench", [*parameters, pull, push, sharp, slope, outer, spread], [first, ca.densify(second)])


def _moved(eta: ca.SX, one: ca.SX | float, point: ca.SX) -> ca.SX:
    """Return exp(η) applied to the point (one = 1), the direction (one = 0) or a sum of points (one = their weight)."""
    v, omega = eta[:3], eta[3:]
    step = ca.cross(omega, point) + one * v
    return point + step + ca.cross(omega, step) / 2
