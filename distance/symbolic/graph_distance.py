"""The HD-SDF of two bodies as one CasADi Function for graphs, its first and second derivatives in closed form."""

from __future__ import annotations

import casadi as ca

from hdplan.distance.holder import check_gamma, resolve_shaping_length
from hdplan.distance.symbolic.closed import ClosedForm, closed_function
from hdplan.distance.symbolic.compiled_pair import twist_function
from hdplan.distance.symbolic.graph_poses import rigid_or_nan
from hdplan.distance.symbolic.rigid_motions import bracket
from hdplan.distance.unions import Body


def hdsdf_function(
    body_a: Body,
    body_b: Body,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
) -> ca.Function:
    """Return D of ``numpy_reference.hdsdf`` as a CasADi Function ``(pose_a (4,4), pose_b (4,4)) -> distance`` [m].

    A lower bound of the signed distance in sign (paper: Definition III.2). Usable in any SX or MX graph, and with
    ``factory``. Gradient and Hessian are closed forms, correct at every pose, aligned and touching ones included; for
    gamma = 1 the Hessian has jumps and is one of its one-sided values there. CasADi refuses a third derivative.
    Derivatives are meaningful only along rigid motions: compose the Function with a robot's kinematics or another
    parametrization of the pose. At poses that are not rigid D is NaN, as a graph cannot raise an error.

    Arguments and errors as ``numpy_reference.hdsdf``.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    pose_a, pose_b = ca.MX.sym("pose_a", 4, 4), ca.MX.sym("pose_b", 4, 4)
    lifts = [_lift()(pose, ca.MX.zeros(6)) for pose in (pose_a, pose_b)]

    def twisted(order: int) -> list[ca.MX]:
        function = twist_function(body_a, body_b, int(gamma), normals, 0, order)
        return list(function(ca.vec(pose_a.T), ca.vec(pose_b.T), length, ca.MX(0, 1)))

    gradient = ca.vertsplit(twisted(1)[2], 6)
    slopes = [_lift()(pose, part)[0].T for pose, part in zip((pose_a, pose_b), gradient, strict=True)]

    *_, gradients, hessian = twisted(2)
    curvatures: list[list[ca.MX]] = [[], []]
    for i, part in enumerate(ca.vertsplit(gradients, 6)):
        _, up, turned = _lift()((pose_a, pose_b)[i], part)
        for j in range(2):
            block = hessian[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
            own = (turned, bracket(part)) if i == j else (0, 0)
            curvatures[i].append(up @ (block + own[1]) @ lifts[j][1].T + own[0])
    value = twisted(0)[0] + rigid_or_nan(pose_a, pose_b)
    closed = closed_function("hdsdf", [pose_a, pose_b], ClosedForm(value, slopes, curvatures))
    names = ["pose_a", "pose_b"], ["distance"]
    return ca.Function("hdsdf", [pose_a, pose_b], [closed(pose_a, pose_b)], *names, {"always_inline": True})


def _lift() -> ca.Function:
    """Return the function that turns a gradient (6) by a pose's own twist (v, ω) into one by the pose's entries,
    columnwise.

    With dR = R[ω], dp = R v: f·v + t·ω is the product of (dR, dp) with (R[t]/2, R f). Outputs: those entries (16, 1),
    their derivatives by the gradient (16, 6) and by the pose (16, 16).
    """
    pose, gradient = ca.SX.sym("pose", 4, 4), ca.SX.sym("gradient", 6)
    turn = pose[:3, :3]
    entries = ca.vertcat(ca.horzcat(turn @ ca.skew(gradient[3:]) / 2, turn @ gradient[:3]), ca.SX(1, 4))
    flat = ca.densify(ca.vec(entries))
    by_gradient, by_pose = (ca.densify(ca.jacobian(flat, part)) for part in (gradient, ca.vec(pose)))
    return ca.Function("lift", [pose, gradient], [flat, by_gradient, by_pose])
