"""The planner's distance as a CasADi Function for graphs: ``halfspaces``' D by both placements, closed to second
order.

As in ``graph_distance``, each order is a Function that supplies the next one as its Jacobian, because CasADi's own
derivatives are wrong where vertices or planes tie.
"""

from __future__ import annotations

import functools

import casadi as ca

from hdplan.distance.symbolic.closed import ClosedForm, closed_function
from hdplan.distance.symbolic.halfspaces import halfspace_distance
from hdplan.distance.symbolic.rigid_motions import bracket, by_entries, twice_by_entries


@functools.cache
def halfspace_function(vertices: int, planes: int, gamma: int, shaping_length: float) -> ca.Function:
    """Return D of ``halfspaces.halfspace_distance`` as a Function that may be differentiated twice by its placements.

    Inputs and output as there; body and body_planes are numbers: D has no derivatives by them. D is NaN at placements
    that are not rigid. Derivatives are meaningful only along rigid motions; a third one is refused. With w and H by the
    motions ξ of A, and η those of B: ∂D/∂η = −w, ∂²D/∂η² = H, ∂²D/∂ξ∂η = −H − ½ w·[·, ·].
    """
    kernels = [halfspace_distance(vertices, planes, gamma, shaping_length, order) for order in (1, 2)]
    given = kernels[0].mx_in()
    placements, fixed = given[:2], given[2:]
    value, wrench, *_ = kernels[0].call(given)
    slopes = [by_entries(1)(placed, push).T for placed, push in zip(placements, (wrench, -wrench), strict=True)]
    _, wrench, _, hessian = kernels[1].call(given)
    (own_a, up_a), (own_b, up_b) = (
        twice_by_entries()(placed, push, hessian) for placed, push in zip(placements, (wrench, -wrench), strict=True)
    )
    across = up_a @ (-hessian - bracket(wrench)) @ up_b.T
    form = ClosedForm(value, slopes, [[own_a, across], [across.T, own_b]])
    found = closed_function("halfspaces", placements, form, fixed)
    return ca.Function(
        "halfspaces", given, [found(*given)], kernels[0].name_in(), ["distance"], {"always_inline": True}
    )
