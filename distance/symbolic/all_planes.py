"""The HD-SDF by the planes of one body, all planes at once: from points to D, D̃ and the derivatives by a motion.

The same shaped Hölder minima and maximum as in ``all_axes``, of x_ik = n_k·a_i − h_k − r, as matrices (points, planes):
loops over planes that compilers turn into vectors. Everything is in the frame of the body of the planes, and the motion
is that of the points in it. With c_ik = ∂D/∂x_ik and F_i = Σ_k c_ik n_k, the force on point i,

    ∂D/∂η = Σ_i J_iᵀ F_i,   ∂²D/∂η² = Σ_i J_iᵀ (Σ_k s_ik n_k n_kᵀ) J_i + Σ_k α_k w_k w_kᵀ + β w wᵀ + Σ_i ∂²(F_i·a_i)/∂η²

where J_i = [I, −[a_i]×] is the point's derivative by η = (v, ω), w_k plane k's share of the gradient w, and s, α and β
the second derivatives of the minima, of each plane's value and of the maximum.
"""

from __future__ import annotations

import functools

import casadi as ca

from hdplan.distance.symbolic.all_axes import maximum
from hdplan.distance.symbolic.one_axis import TINY, integer_power, positive_part, shaped

STAYS = {"never_inline": True}


def projections(points: ca.MX, radius: ca.MX, body_planes: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return x (m, K) of points (3, m), grown by a radius, and planes (4 K) as ``halfspaces`` has them; and the least x
    along every plane (1, K)."""
    planes = body_planes.numel() // 4
    along = points.T @ normals_of(body_planes)
    x = along - ca.repmat(body_planes[3 * planes :].T + radius, points.shape[1], 1)
    return x, functools.reduce(ca.fmin, ca.vertsplit(x))


def normals_of(body_planes: ca.MX) -> ca.MX:
    """Return the normals (3, K) of planes (4 K)."""
    planes = body_planes.numel() // 4
    return ca.reshape(body_planes[: 3 * planes], 3, planes)


def distance_by_planes(
    points: ca.MX,
    weights: ca.MX,
    radius: ca.MX,
    body_planes: ca.MX,
    gamma: int,
    order: int,
    length: float,
    placements: int = 1,
) -> list[ca.MX]:
    """Return D, D̃ and, by order, the gradient (6) and the Hessian (6, 6) of D by the motion of the points (3, m), six
    for each of their placements, which have equal shares of them."""
    x, least = projections(points, radius, body_planes)
    separation = ca.mmax(least)
    shape = points.shape[1], x.shape[1], gamma, order, length, placements
    chosen = ca.Function.conditional("by_planes", [inside(*shape)], outside(*shape))
    value, *derivatives = chosen.call([separation > TINY, x, least, points, weights, normals_of(body_planes)])
    return [value, separation, *derivatives]


@functools.cache
def inside(points: int, planes: int, gamma: int, order: int, length: float, placements: int = 1) -> ca.Function:
    """Return the function (x, least, points, their weights, normals) -> D and its derivatives, where no plane
    separates."""
    given = x, least, *_ = _inputs(points, planes)
    scale = ca.if_else(least < -TINY, -1 / ca.fmin(least, -TINY), 0)
    r, p = positive_part(-x) * _rows(scale, points), gamma + 1
    sharp = integer_power(r, p - 2) if p > 2 else r > 0
    pull = sharp * r
    results = _combined(given, least, [pull * r, pull, sharp], gamma, order, length, placements, above=False)
    return ca.Function("inside", given, results, STAYS)


@functools.cache
def outside(points: int, planes: int, gamma: int, order: int, length: float, placements: int = 1) -> ca.Function:
    """Return the same where a plane does: those that do not then weigh nothing."""
    given = x, least, *_ = _inputs(points, planes)
    separates = least > TINY
    top = ca.if_else(separates, least, 1)
    r = _rows(separates * top, points) / ca.fmax(x, _rows(top, points))
    full = integer_power(r, gamma + 1)
    least = ca.if_else(separates, least, 0)
    results = _combined(given, least, [full, full * r, full * r * r], gamma, order, length, placements, above=True)
    return ca.Function("outside", given, results, STAYS)


def _inputs(points: int, planes: int) -> list[ca.MX]:
    sizes = {"x": (points, planes), "least": (1, planes), "points": (3, points), "weights": (points, 1)}
    return [ca.MX.sym(name, *size) for name, size in {**sizes, "normals": (3, planes)}.items()]


def _combined(
    given: list[ca.MX],
    least: ca.MX,
    powers: list[ca.MX],
    gamma: int,
    order: int,
    length: float,
    placements: int,
    above: bool,
) -> list[ca.MX]:
    """Return D and its derivatives from the least x and the powers of r_ik, whose sums are those of the minima: r^p,
    and what its first and second derivatives have."""
    _, _, points, weights, normals = given
    count, planes = points.shape[1], least.shape[1]
    weight = ca.repmat(weights, 1, planes)
    minima = shaped(least, weights.T @ powers[0], length, gamma, above)
    found = maximum(minima.value, ca.MX.ones(1, planes), gamma, ca.MX(length))
    if order == 0:
        return [found.value]
    pull = weight * powers[1] * _rows(minima.scale_pull, count)  # ∂u_k/∂x_ik
    share = found.share * minima.slope
    pushed = normals @ (pull * _rows(found.slope * share, count)).T  # F (3, m)
    groups = [slice(k * count // placements, (k + 1) * count // placements) for k in range(placements)]
    gradient = ca.vertcat(*(_wrench(points[:, of], pushed[:, of]) for of in groups))
    if order == 1:
        return [found.value, gradient]
    of_planes = ca.vertcat(*(_of_planes(points[:, of], pull[of, :], normals) for of in groups))  # w_k (6 e, K)
    own = found.slope * found.share
    spread = own * minima.outer + found.spread * minima.slope * minima.slope
    whole = of_planes @ share.T
    hessian = (of_planes * _rows(spread, 6 * placements)) @ of_planes.T + found.outer * whole @ whole.T
    sharp = weight * powers[2] * _rows(own * minima.scale_sharp, count)
    blocks = []
    for of in groups:
        block = ca.MX.zeros(6, 6)
        for i in range(of.start, of.stop):
            bent = (normals * _rows(sharp[i, :], 3)) @ normals.T
            turn = ca.skew(points[:, i])
            block += ca.blockcat([[bent, -bent @ turn], [turn @ bent, -turn @ bent @ turn]])
        blocks.append(block + _curved(points[:, of], pushed[:, of]))
    return [found.value, gradient, hessian + ca.diagcat(*blocks)]


def _rows(row: ca.MX, count: int) -> ca.MX:
    return ca.repmat(row, count, 1)


def _wrench(points: ca.MX, pushed: ca.MX) -> ca.MX:
    """The sum of forces (3, m) on points (3, m), and that of their torques."""
    moment = pushed @ points.T  # F aᵀ
    torque = ca.vertcat(moment[2, 1] - moment[1, 2], moment[0, 2] - moment[2, 0], moment[1, 0] - moment[0, 1])
    return ca.vertcat(ca.sum2(pushed), torque)


def _of_planes(points: ca.MX, pull: ca.MX, normals: ca.MX) -> ca.MX:
    """The derivatives (6, K) of the planes' minima: [Σ_i q_ik n_k; Σ_i q_ik a_i × n_k]."""
    (nx, ny, nz), (ax, ay, az) = ca.vertsplit(normals), ca.vertsplit(points @ pull)
    linear = normals * _rows(ca.sum1(pull), 3)
    return ca.vertcat(linear, ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx)


def _curved(points: ca.MX, pushed: ca.MX) -> ca.MX:
    """The Hessian (6, 6) of Σ_i F_i·a_i, a_i moved by exp(η): of F·(½ ω×v + ½ ω×(ω×a))."""
    moment, between = pushed @ points.T, ca.skew(ca.sum2(pushed)) / 2
    turning = (moment + moment.T) / 2 - ca.trace(moment) * ca.MX.eye(3)
    return ca.blockcat([[ca.MX.zeros(3, 3), between], [-between, turning]])
