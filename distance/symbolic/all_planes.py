"""The HD-SDF by the planes of one body, all planes at once: from points to D, D̃ and the derivatives by a motion.

The same shaped Hölder minima and maximum as in ``all_axes``, of x_ki = n_k·a_i − h_k − r, as matrices (planes, points):
loops over planes that compilers turn into vectors. Everything is in the frame of the body of the planes, and the motion
is that of the points in it. With c_ki = ∂D/∂x_ki and F_i = Σ_k c_ki n_k, the force on point i,

    ∂D/∂η = Σ_i J_iᵀ F_i,   ∂²D/∂η² = Σ_i J_iᵀ (Σ_k s_ki n_k n_kᵀ) J_i + Σ_k α_k w_k w_kᵀ + β w wᵀ + Σ_i ∂²(F_i·a_i)/∂η²

where J_i = [I, −[a_i]×] is the point's derivative by η = (v, ω), w_k plane k's share of the gradient w, and s, α and β
the second derivatives of the minima, of each plane's value and of the maximum. Planes may move out too, by sizes of
their body on which h_k depends linearly: these are three more motions, with −∂h_k as derivatives of x_ki.
"""

from __future__ import annotations

import functools

import casadi as ca

from hdplan.distance.symbolic.all_axes import Maximum, maximum
from hdplan.distance.symbolic.one_axis import TINY_NUMBER, Shaped, integer_power, shaped

NEVER_INLINE = {"never_inline": True}
MOST_SIZES = 3  # of a body, at most


def projections(points: ca.MX, radius: ca.MX, normals: ca.MX, supports: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return x (K, m) of points (3, m), grown by a radius, and planes, their normals (K, 3) and supports (K); and the
    least x along every plane (K)."""
    x = normals @ points - ca.repmat(supports + radius, 1, points.shape[1])
    return x, functools.reduce(ca.fmin, ca.horzsplit(x))


def by_coordinate(body_planes: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return the normals (K, 3) and supports (K) of planes (4 K) as ``halfspaces`` has them."""
    planes = body_planes.numel() // 4
    return ca.reshape(body_planes[: 3 * planes], 3, planes).T, body_planes[3 * planes :]


def distance_by_planes(
    points: ca.MX,
    weights: ca.MX,
    radius: ca.MX,
    body_planes: ca.MX,
    gamma: int,
    length: float,
    order: int,
    placements: int = 1,
) -> list[ca.MX]:
    """Return D, D̃ and, by order, the gradient (6) and the Hessian (6, 6) of D by the motion of the points (3, m), six
    for each of their placements, which have equal shares of them."""
    normals, supports = by_coordinate(body_planes)
    x, least = projections(points, radius, normals, supports)
    separation = ca.mmax(least)
    shape = points.shape[1], normals.shape[0], gamma, length, order, placements
    chosen = ca.Function.conditional("by_planes", [inside(*shape)], outside(*shape))
    value, *derivatives = chosen.call([separation > TINY_NUMBER, x, least, points, weights, normals])
    return [value, separation, *derivatives]


@functools.cache
def inside(
    points: int, planes: int, gamma: int, length: float, order: int, placements: int = 1, grows: bool = False
) -> ca.Function:
    """Return the function (x, least, points, their weights, normals) -> D and its derivatives, where no plane
    separates. Where the body of the planes `grows`, it takes the derivatives of the supports by its sizes (K, 3) too,
    and those of D are after those by motions."""
    given = x, least, *_ = _inputs(points, planes, grows)
    deep, p = least < -TINY_NUMBER, gamma + 1
    r = ca.fmax(x * _columns(deep / ca.fmin(least, -TINY_NUMBER), points), 0)
    sharp = integer_power(r, p - 2) if p > 2 else r > 0
    pull = sharp * r
    total = (pull * r) @ given[3] + ca.logic_not(deep)  # of a plane that only touches: 1
    minima = shaped(deep * least, total, length, gamma, False)
    results = _combined(given, minima, _deepest(minima.value, gamma, length), [pull, sharp], order, placements)
    return ca.Function("inside", given, results, NEVER_INLINE)


@functools.cache
def outside(points: int, planes: int, gamma: int, length: float, order: int, placements: int = 1) -> ca.Function:
    """Return the same where a plane does: those that do not then weigh nothing."""
    given = x, least, *_ = _inputs(points, planes)
    separates = least > TINY_NUMBER
    top = ca.if_else(separates, least, 1)
    r = _columns(separates * top, points) / ca.fmax(x, _columns(top, points))
    full = integer_power(r, gamma + 1)
    total = full @ given[3] + ca.logic_not(separates)
    minima = shaped(separates * least, total, length, gamma, True)
    found = maximum(minima.value, ca.MX.ones(planes), gamma, ca.MX(length))
    results = _combined(given, minima, found, [full * r, full * r * r], order, placements)
    return ca.Function("outside", given, results, NEVER_INLINE)


def _inputs(points: int, planes: int, grows: bool = False) -> list[ca.MX]:
    sizes = {"x": (planes, points), "least": (planes, 1), "points": (3, points), "weights": (points, 1)}
    sizes |= {"normals": (planes, 3)} | ({"growth": (planes, MOST_SIZES)} if grows else {})
    return [ca.MX.sym(name, *size) for name, size in sizes.items()]


def _deepest(g: ca.MX, gamma: int, length: float) -> Maximum:
    """``maximum`` of values none of which is positive."""
    p, top = gamma + 1, ca.mmax(g)
    r = (top < -TINY_NUMBER) * top / ca.fmin(g, -TINY_NUMBER)
    low = integer_power(r, p - 2) if p > 2 else r > 0
    full = low * r * r
    mirrored = shaped(-top, ca.sum1(full), length, gamma, True)
    return Maximum(
        -mirrored.value,
        mirrored.slope,
        full * r * mirrored.scale_pull,
        -mirrored.outer,
        -full * r * r * mirrored.scale_sharp,
    )


def _combined(
    given: list[ca.MX], minima: Shaped, found: Maximum, powers: list[ca.MX], order: int, placements: int
) -> list[ca.MX]:
    """Return D and its derivatives from the minima along the planes, their maximum, and the powers of r_ki that the
    first and second derivatives of the minima have."""
    if order == 0:
        return [found.value]
    _, _, points, weights, normals, *growth = given
    m = points.shape[1] // placements
    share = found.share * minima.slope
    pushed = found.slope * share
    gradient, of_planes, curved, along = [], [], [], ca.MX(0)
    for k in range(placements):
        own = slice(k * m, (k + 1) * m)
        levers = ca.horzcat(weights[own], ca.repmat(weights[own], 1, 3) * points[:, own].T)  # w_i [1, a_iᵀ]
        pull = (powers[0][:, own] * _columns(minima.scale_pull, m)) @ levers  # Σ_i ∂u_k/∂x_ki [1, a_iᵀ] (K, 4)
        forces = _products(normals, pull * _columns(pushed, 4))  # Σ_i F_i [1, a_iᵀ]
        gradient.append(_wrench()(forces))
        along += pull[:, 0]
        if order == 2:
            of_planes.append(_of_planes(pull, normals))
            curved.append(_curved()(forces))
    gradient += [-_products(each, along * pushed) for each in growth]
    if order == 1:
        return [found.value, ca.vertcat(*gradient)]
    each = ca.horzcat(*of_planes, *(-part * _columns(along, MOST_SIZES) for part in growth))  # w_k (K, 6 e), sizes
    own_slope = found.slope * found.share
    spread = own_slope * minima.outer + found.spread * minima.slope * minima.slope
    whole = _products(each, share)
    hessian = _products(each, each * _columns(spread, each.shape[1])) + found.outer * whole @ whole.T
    sharp = powers[1] * _columns(minima.scale_sharp * own_slope, m * placements)
    nx, ny, nz = ca.horzsplit(normals)
    squares = ca.horzcat(nx * nx, nx * ny, nx * nz, ny * ny, ny * nz, nz * nz)
    bent = _bent().map(m * placements)(points, weights.T, _products(squares, sharp))
    sums = [ca.sum2(bent[:, k * m : (k + 1) * m]) for k in range(placements)]
    blocks = ca.diagcat(*(ca.reshape(total, 6, 6) + part for total, part in zip(sums, curved, strict=True)))
    if growth:
        blocks = _with_growth(blocks, points, weights, normals, sharp, growth[0], placements)
    return [found.value, ca.vertcat(*gradient), hessian + blocks]


def _with_growth(
    blocks: ca.MX, points: ca.MX, weights: ca.MX, normals: ca.MX, sharp: ca.MX, growth: ca.MX, placements: int
) -> ca.MX:
    """Add the rows and columns of the sizes to Σ_ki s_ki ∂x_ki ∂x_kiᵀ (6 e, 6 e)."""
    m = points.shape[1] // placements
    mixed = [ca.MX.zeros(6, MOST_SIZES) for _ in range(placements)]
    for i, (point, weight, column) in enumerate(
        zip(ca.horzsplit(points), ca.vertsplit(weights), ca.horzsplit(sharp), strict=True)
    ):
        force = -weight * _products(normals, growth * _columns(column, MOST_SIZES))
        mixed[i // m] += ca.vertcat(force, ca.skew(point) @ force)
    across = ca.vertcat(*mixed)
    return ca.blockcat(
        [[blocks, across], [across.T, _products(growth, growth * _columns(sharp @ weights, MOST_SIZES))]]
    )


def _columns(column: ca.MX, count: int) -> ca.MX:
    return ca.repmat(column, 1, count)


def _products(one: ca.MX, other: ca.MX) -> ca.MX:
    """oneᵀ other, as products of columns, which lie side by side."""
    left, right = ca.horzsplit(one), ca.horzsplit(other)
    return ca.horzcat(*(ca.vertcat(*(ca.dot(a, b) for a in left)) for b in right))


@functools.cache
def _wrench() -> ca.Function:
    """Function from Σ_i F_i [1, a_iᵀ] (3, 4) to the sum of forces, and that of their torques (6)."""
    forces = ca.SX.sym("forces", 3, 4)
    m = forces[:, 1:]
    torque = ca.vertcat(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
    return ca.Function("wrench", [forces], [ca.vertcat(forces[:, 0], torque)])


@functools.cache
def _curved() -> ca.Function:
    """The Hessian (6, 6) of Σ_i F_i·a_i, a_i moved by exp(η): of F·(½ ω×v + ½ ω×(ω×a))."""
    forces = ca.SX.sym("forces", 3, 4)
    moment, between = forces[:, 1:], ca.skew(forces[:, 0]) / 2
    turning = (moment + moment.T) / 2 - ca.trace(moment) * ca.SX.eye(3)
    found = ca.blockcat([[ca.SX.zeros(3, 3), between], [-between, turning]])
    return ca.Function("curved", [forces], [ca.densify(found)])


@functools.cache
def _bent() -> ca.Function:
    """Function from one point, its weight and the six different entries of Σ_k s_k n_k n_kᵀ to JᵀSJ (36)."""
    point, weight, entries = ca.SX.sym("point", 3), ca.SX.sym("weight"), ca.SX.sym("entries", 6)
    xx, xy, xz, yy, yz, zz = ca.vertsplit(weight * entries)
    bent, turn = ca.blockcat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), ca.skew(point)
    found = ca.blockcat([[bent, -bent @ turn], [turn @ bent, -turn @ bent @ turn]])
    return ca.Function("bent", [point, weight, entries], [ca.densify(ca.vec(found))])


def _of_planes(pull: ca.MX, normals: ca.MX) -> ca.MX:
    """The derivatives (K, 6) of the planes' minima: [Σ_i q_ki n_k; Σ_i q_ki a_i × n_k]."""
    (total, ax, ay, az), (nx, ny, nz) = ca.horzsplit(pull), ca.horzsplit(normals)
    return ca.horzcat(total * nx, total * ny, total * nz, ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx)
