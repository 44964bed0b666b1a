"""Derivatives by rigid motions as derivatives by the entries of a placement, for CasADi graphs.

A placement is twelve numbers: the rotation row by row, then the origin. Motions are exp(ξ), ξ = (v, ω), about the
world's origin. What is derived is meaningful only along rigid motions.
"""

from __future__ import annotations

import functools

import casadi as ca


@functools.cache
def by_entries(order: int) -> ca.Function:
    """Return the function that turns a wrench (6) into a derivative by a placement's entries.

    With dR = [ω] R, dt = v + ω × t: F·v + T·ω is the product of (dR, dt) with ([T − t × F] R/2, F). Outputs: those
    entries (12), and for order 2 their derivatives by the wrench (12, 6) and by the placement (12, 12).
    """
    placement, wrench = ca.SX.sym("placement", 12), ca.SX.sym("wrench", 6)
    rotation, force = ca.reshape(placement[:9], 3, 3).T, wrench[:3]
    turning = ca.skew(wrench[3:] - ca.cross(placement[9:], force)) @ rotation / 2
    entries = ca.densify(ca.vertcat(ca.vec(turning.T), force))
    derivatives = [ca.densify(ca.jacobian(entries, part)) for part in (wrench, placement)] if order == 2 else []
    return ca.Function("by_entries", [placement, wrench], [entries, *derivatives])


@functools.cache
def twice_by_entries() -> ca.Function:
    """Return the function that turns a wrench (6) and second derivatives (6, 6) by a motion into those by the entries
    of a placement (12, 12); also the derivatives of the entries by the wrench (12, 6), which turn mixed ones."""
    placement, wrench, hessian = ca.MX.sym("placement", 12), ca.MX.sym("wrench", 6), ca.MX.sym("hessian", 6, 6)
    _, up, turned = by_entries(2)(placement, wrench)
    within = up @ (hessian - bracket(wrench)) @ up.T + turned
    return ca.Function("twice_by_entries", [placement, wrench, hessian], [within, up])


def bracket(gradient: ca.MX) -> ca.MX:
    """Return what the gradient by a body's own twist changes by along a twist besides the Hessian, as twists do not
    commute: ½ g·[η, ·]. For motions in the world it is the opposite."""
    force, torque = ca.skew(gradient[:3]), ca.skew(gradient[3:])
    return ca.blockcat([[ca.MX(3, 3), force], [force, torque]]) / 2
