"""The planner's distance as a CasADi Function for graphs: ``halfspaces``' D by the relative pose, closed to second
order.

As in ``graph_distance``, each order is a Function that supplies the next one as its Jacobian, because CasADi's own
derivatives are wrong where vertices or planes tie.
"""

from __future__ import annotations

import functools

import casadi as ca

from hdplan.distance.symbolic.all_axes import combined
from hdplan.distance.symbolic.closed import closed_function
from hdplan.distance.symbolic.graph_distance import bracket
from hdplan.distance.symbolic.graph_poses import rigid_or_nan
from hdplan.distance.symbolic.halfspaces import plane_axes


@functools.cache
def halfspace_function(vertices: int, planes: int, gamma: int, shaping_length: float) -> ca.Function:
    """Return D of ``halfspaces.halfspace_distance`` as a Function of A's pose in B's frame.

    Inputs: relative (3, 4) = [R | p]; body (4·vertices + 1) and body_planes (4·planes) as there, numbers: D has no
    derivatives by them. Output: distance [m], NaN where R is no rotation. Derivatives are meaningful only along rigid
    motions; a third one is refused.
    """
    relative = ca.MX.sym("relative", 3, 4)
    body, body_planes = ca.MX.sym("body", 4 * vertices + 1), ca.MX.sym("body_planes", 4 * planes)
    inputs = [relative, body, body_planes]
    points = relative[:, :3] @ ca.reshape(body[: 3 * vertices], 3, vertices)
    points += ca.repmat(relative[:, 3], 1, vertices)
    axes = plane_axes(points, body[3 * vertices : 4 * vertices], body[4 * vertices], body_planes)

    def closed(order: int) -> list[ca.MX]:
        return combined([axes], gamma, order, ca.MX(shaping_length))

    *_, gradient, hessian = closed(2)
    _, by_gradient, by_pose = _lift()(relative, gradient)
    curved = by_gradient @ (hessian - bracket(gradient)) @ by_gradient.T + by_pose  # as twists do not commute
    slope = _lift()(relative, closed(1)[2])[0].T
    value = closed(0)[0] + rigid_or_nan(relative[:, :3])
    found = closed_function("halfspaces", [relative], value, [slope], [[curved]], [body, body_planes])
    names = ["relative", "body", "body_planes"]
    return ca.Function("halfspaces", inputs, [found(*inputs)], names, ["distance"], {"always_inline": True})


@functools.cache
def _lift() -> ca.Function:
    """Return the function that turns a gradient (6) by the twist (v, ω) of A in B's frame into one by the pose's
    entries, columnwise.

    With dR = [ω]R, dp = v + ω×p: f·v + t·ω is the product of (dR, dp) with ([t − p×f]R/2, f). Outputs: those entries
    (12, 1), their derivatives by the gradient (12, 6) and by the pose (12, 12).
    """
    pose, gradient = ca.SX.sym("pose", 3, 4), ca.SX.sym("gradient", 6)
    force, turn = gradient[:3], gradient[3:] - ca.cross(pose[:, 3], gradient[:3])
    flat = ca.densify(ca.vec(ca.horzcat(ca.skew(turn) @ pose[:, :3] / 2, force)))
    by_gradient, by_pose = (ca.densify(ca.jacobian(flat, part)) for part in (gradient, ca.vec(pose)))
    return ca.Function("lift", [pose, gradient], [flat, by_gradient, by_pose])
