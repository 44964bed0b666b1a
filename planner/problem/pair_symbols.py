"""Clearance of body pairs in symbols: Σ_pairs ½ min(D, 0)² at one configuration, or at the two ends of an interval.

In: the pairs. Out: one Function of joint values and of the frames that carry obstacles, with first and second
derivatives in closed form. Every pair is in it, in three steps, each a real branch of generated code: a ball around the
link body that does not reach the enlarged box of the other; a plane of the enlarged body that separates them; the
distance. The first two prove D > 0, as they do in the broad phase of the loops (`broad_phase`).

With S_j the joints' screws in the world, m_j = 1, −1 or 0 as joint j moves A only, B only or both (or neither), c_j the
number of the two bodies that it carries, w and H the derivatives of D by a motion of A, η the motion of B's frame:

    ∂²D/∂q_j∂q_k = m_j m_k S_j·H S_k + ½ m_j c_k w·[S_j, S_k],   j nearer the base than k
    ∂²D/∂q_j∂η = m_j S_j·(−H η + ½ [w·[·, η]])        ∂²D/∂η² = H

Of a body swept from one placement to another w and H are by both, and so are the joints: those at either end.
"""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np

from hdplan.distance.symbolic.closed import CLOSED, closed_function
from hdplan.distance.symbolic.halfspaces import halfspace_distance, swept_halfspace_distance
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.problem.symbolic_place import SymbolicPlace, bracket, by_entries
from hdplan.scenes.array_types import Array, Rows

UNBRANCHED = {"never_inline": True}  # a Function that stays one, so that it can be a branch


def clearance_function(
    kinematics: Kinematics,
    pairs: BodyPairs,
    gamma: int,
    shaping_length: float,
    frames: int,
    exact: bool,
    ends: int = 1,
) -> ca.Function:
    """Return the Function (q (n,) at each of `ends` configurations, frames (12, F)) -> penalty.

    Joints of the pairs beyond the robot's are frames. Without `exact` the second derivative is that of the residuals'
    squares alone, Σ ∇D ∇Dᵀ where D < 0. With two ends D is that of the first body swept between them.
    """
    carried = ca.MX.sym("frames", 12, frames)
    values = [ca.MX.sym(f"q{k}", kinematics.n) for k in range(ends)]
    places = [SymbolicPlace(kinematics, q, carried, exact) for q in values]
    n, zeros, everything = kinematics.n * ends, ca.MX.zeros, kinematics.nj + frames
    value, hessian = ca.MX(0), zeros(n, n)
    pushed = [zeros(6, everything) for _ in values]  # wrenches on what each joint or frame carries
    bent = zeros(6 * n, frames), zeros(36, frames), zeros(6, frames)
    for slots in sorted(set(pairs.plane_slots.tolist())):
        rows = np.flatnonzero(pairs.plane_slots == slots)
        count, joint_a, joint_b = len(rows), pairs.joint_a[rows], pairs.joint_b[rows]
        placed = [place.placements[:, joint_a.tolist()] for place in places]
        placed.append(places[0].placements[:, joint_b.tolist()])
        near = _near(pairs.widest, ends).map(count)(*placed, *_balls_and_boxes(pairs, rows))
        bodies = ca.DM(pairs.body_table[pairs.body[rows]].T), ca.DM(pairs.plane_tables[slots][pairs.plane_row[rows]].T)
        given, settings = (near, *placed, *bodies), (pairs.vertex_slots, slots, gamma, shaping_length, ends)

        depths, pushes = _pair(*settings).map(count)(*given)
        value += ca.sum2(depths)
        apart = _selection(joint_a, everything) - _selection(joint_b, everything)
        pushed = [ca.mac(each, apart, so_far) for so_far, each in zip(pushed, ca.vertsplit(pushes, 6), strict=True)]

        one, other = _carried(kinematics, joint_a), _carried(kinematics, joint_b)
        screws = [ca.repmat(place.columns, 1, count) for place in places]
        bend = _pair_bend(*settings, kinematics.n, exact).map(count)
        found = bend(*given, *screws, ca.DM((one - other).T), ca.DM((one + other).T))
        hessian += ca.reshape(ca.sum2(found[0]), n, n)
        on_frame = _selection(joint_b - kinematics.nj, frames)
        bent = tuple(ca.mac(each, on_frame, so_far) for so_far, each in zip(bent, found[1:], strict=True))
    on_links, on_frames = zip(*(ca.horzsplit(each, [0, kinematics.nj, everything]) for each in pushed), strict=True)
    moved = ca.sparsify(ca.DM(kinematics.supports.astype(float)))
    slopes = [ca.sum1(place.columns * (each @ moved)) for place, each in zip(places, on_links, strict=True)]
    slopes.append(ca.vec(by_entries(1).map(frames)(carried, sum(on_frames))).T if frames else ca.MX(1, 0))
    blocks = [ca.horzsplit(row, kinematics.n) for row in ca.vertsplit(hessian, kinematics.n)]
    across, within = _to_entries(n).map(frames)(carried, *bent) if frames else (ca.MX(n, 0), ca.MX(0, 0))
    curvatures = [[*row, part] for row, part in zip(blocks, ca.vertsplit(across, kinematics.n), strict=True)]
    curvatures.append([*(row[-1].T for row in curvatures), ca.diagcat(*ca.horzsplit(within, 12))])

    # One evaluation serves value and slopes: they are handed over by a Function that has no derivative itself. CasADi
    # looks for what they depend on in their expressions, so that these have to name it.
    given = [*values, carried]
    known = ca.Function("pairs", given, [value, *slopes], CLOSED | {"is_diff_in": [False] * len(given)})
    fixed = [ca.MX.sym(f"known{k}", known.sparsity_out(k)) for k in range(known.n_out())]
    nothing = ca.fmin(sum(ca.sumsqr(each) for each in given), 0)
    closed = closed_function(
        "clearance", given, fixed[0] + nothing, [part + nothing for part in fixed[1:]], curvatures, fixed
    )
    return ca.Function("clearance", given, [closed(*given, *known(*given))], {"always_inline": True})


def _carried(kinematics: Kinematics, joints: Rows) -> Array:
    """Whether each coordinate moves what joints (P,) carry (P, n); none moves a frame."""
    result = np.zeros((len(joints), kinematics.n))
    own = joints < kinematics.nj
    result[own] = kinematics.supports[joints[own]]
    return result


def _selection(carrier: Rows, count: int) -> ca.DM:
    """The matrix (P, K) that sums pairs by the joint or frame (P,) that carries a body; negative where none does."""
    chosen = np.flatnonzero(carrier >= 0)
    pattern = ca.Sparsity.triplet(len(carrier), count, chosen.tolist(), carrier[chosen].tolist())
    return ca.DM(pattern, np.ones(len(chosen)))


def _balls_and_boxes(pairs: BodyPairs, rows: Rows) -> list[ca.DM]:
    """Centres (3, P), radii (1, P), boxes (12, P) and half sizes (3, P) of pairs."""
    boxes = pairs.boxes[pairs.halfspace_body[rows]]
    flat = np.hstack([boxes[:, :3, :3].reshape(-1, 9), boxes[:, :3, 3]])
    body, half = pairs.body[rows], pairs.half_sizes[pairs.halfspace_body[rows]]
    parts = pairs.centres[body], pairs.radii[body, None], flat, half
    return [ca.DM(part.T) for part in parts]


@functools.cache
def _near(widest: float, ends: int) -> ca.Function:
    """Whether the ball around A, at all of its placements, reaches B's box: 1, or 0 where D is sure to be positive."""
    placed = [ca.SX.sym(f"placement_{k}", 12) for k in range(ends + 1)]
    ball_and_box = (("centre", 3), ("radius", 1), ("box", 12), ("half", 3))
    centre, radius, box, half = (ca.SX.sym(name, size) for name, size in ball_and_box)
    places = [_rotation(each) @ centre + each[9:] for each in placed[:-1]]
    middle = (places[0] + places[-1]) / 2
    reach = widest * (radius + ca.norm_2(places[-1] - places[0]) / 2 * (ends == 2))
    local = _rotation(placed[-1]).T @ (middle - placed[-1][9:])
    outside = ca.fmax(ca.fabs(_rotation(box).T @ (local - box[9:])) - half, 0)
    return ca.Function("near", [*placed, centre, radius, box, half], [ca.sumsqr(outside) < reach**2])


def _kernel(vertices: int, planes: int, gamma: int, shaping_length: float, ends: int, order: int) -> ca.Function:
    build = halfspace_distance if ends == 1 else swept_halfspace_distance
    return build(vertices, planes, gamma, shaping_length, order)


@functools.cache
def _pair(vertices: int, planes: int, gamma: int, shaping_length: float, ends: int) -> ca.Function:
    """One pair's ½ min(D, 0)², given whether it is near, and its derivative by A's motions, as wrenches (6 e)."""
    kernel = _kernel(vertices, planes, gamma, shaping_length, ends, 1)
    given = kernel.mx_in()
    value, *wrenches = kernel(*given)[: ends + 1]
    depth = ca.fmin(value, 0)
    return _where_near("pair", given, [depth * depth / 2, depth * ca.vertcat(*wrenches)], vertices, planes, ends)


@functools.cache
def _pair_bend(
    vertices: int, planes: int, gamma: int, shaping_length: float, ends: int, n: int, exact: bool
) -> ca.Function:
    """One pair's second derivatives: by the joints (n² of them, those at both ends for two), by the joints and the
    motion of B's frame (6 n), by the latter (36), and the derivative by it (6)."""
    kernel = _kernel(vertices, planes, gamma, shaping_length, ends, 2)
    given = kernel.mx_in()
    screws = [ca.MX.sym(f"screws{k}", 6, n) for k in range(ends)]
    moves, carried = ca.MX.sym("moves", n), ca.MX.sym("carried", n)
    value, *wrenches = (found := kernel(*given))[: ends + 1]
    results = _chained(ends, n, exact)(value, ca.vertcat(*wrenches), found[-1], ca.vertcat(*screws), moves, carried)
    return _where_near("pair_bend", [*given, *screws, moves, carried], list(results), vertices, planes, ends)


@functools.cache
def _chained(ends: int, n: int, exact: bool) -> ca.Function:
    """From D's derivatives by A's motions to those of ½ min(D, 0)² by joints and by B's motion."""
    value, wrench, hessian = (
        ca.MX.sym(*size) for size in (("value", 1), ("wrench", 6 * ends), ("hessian", 6 * ends, 6 * ends))
    )
    screws, moves, carried = ca.MX.sym("screws", 6 * ends, n), ca.MX.sym("moves", n), ca.MX.sym("carried", n)
    depth, inside = ca.fmin(value, 0), value < 0
    moved = [part * ca.repmat(moves.T, 6, 1) for part in ca.vertsplit(screws, 6)]
    parts = ca.vertsplit(wrench, 6)
    slope = ca.vertcat(*(part.T @ by for part, by in zip(moved, parts, strict=True)))
    push = -functools.reduce(lambda one, other: one + other, parts)
    results = [(inside * slope) @ slope.T, (inside * slope) @ push.T, (inside * push) @ push.T, depth * push]
    if exact:
        turns = [bracket(part) / 2 for part in parts]
        blocks = [ca.horzsplit(row, 6) for row in ca.vertsplit(hessian, 6)]
        rows = [
            functools.reduce(lambda one, other: one + other, row) for row in blocks
        ]  # by B's motion, but for its sign
        curved = [
            [one.T @ block @ other for block, other in zip(row, moved, strict=True)]
            for row, one in zip(blocks, moved, strict=True)
        ]
        for i, (part, turn, whole) in enumerate(zip(moved, turns, ca.vertsplit(screws, 6), strict=True)):
            upper = ca.triu(
                part.T @ (turn @ (whole * ca.repmat(carried.T, 6, 1))), False
            )  # joints are in the tree's order
            curved[i][i] += ca.densify(upper + upper.T)
        results[0] += depth * ca.blockcat(curved)
        results[1] += depth * ca.vertcat(
            *(part.T @ (turn - row) for part, turn, row in zip(moved, turns, rows, strict=True))
        )
        results[2] += depth * functools.reduce(lambda one, other: one + other, rows)
    flat = [ca.vec(ca.densify(part)) for part in results]
    return ca.Function("chained", [value, wrench, hessian, screws, moves, carried], flat)


def _where_near(
    name: str, given: list[ca.MX], results: list[ca.MX], vertices: int, planes: int, ends: int
) -> ca.Function:
    """The Function (near, given …) -> results, 0 where the bodies are not near or a plane separates them."""
    nothing = ca.Function("apart", given, [ca.MX.zeros(*part.shape) for part in results], UNBRANCHED)
    deep = ca.Function(name, given, results, UNBRANCHED)
    chosen = ca.Function.conditional("unless_separated", [deep], nothing)
    separated = _separated(vertices, planes, ends)(*given[: ends + 3])
    close = ca.Function(f"{name}_near", given, chosen.call([separated, *given]), UNBRANCHED)
    return ca.Function.conditional("where_near", [nothing], close)


@functools.cache
def _separated(vertices: int, planes: int, ends: int) -> ca.Function:
    """Whether one of B's planes separates it from A at all of its placements: then D > 0."""
    placed = [ca.SX.sym(f"placement_{k}", 12) for k in range(ends + 1)]
    body, body_planes = ca.SX.sym("body", 4 * vertices + 1), ca.SX.sym("body_planes", 4 * planes)
    corners, origin = ca.reshape(body[: 3 * vertices], 3, vertices), placed[-1][9:]
    world = [_rotation(each) @ corners + ca.repmat(each[9:] - origin, 1, vertices) for each in placed[:-1]]
    points = _rotation(placed[-1]).T @ ca.horzcat(*world)
    along = ca.reshape(body_planes[: 3 * planes], 3, planes).T @ points  # (planes, points)
    least = ca.vertcat(*(ca.mmin(row) for row in ca.vertsplit(along)))
    gap = ca.mmax(least - body_planes[3 * planes :]) - body[-1]
    return ca.Function("separated", [*placed, body, body_planes], [gap > 0])


@functools.cache
def _to_entries(n: int) -> ca.Function:
    """One frame's second derivatives by its motion as those by the entries of its placement: with the joints (n, 12),
    and with itself (12, 12)."""
    placement, mixed, own, push = (
        ca.MX.sym(name, size) for name, size in (("placement", 12), ("mixed", 6 * n), ("own", 36), ("push", 6))
    )
    _, up, turned = by_entries(2)(placement, push)
    across = ca.reshape(mixed, n, 6) @ up.T
    within = up @ (ca.reshape(own, 6, 6) + bracket(push) / 2) @ up.T + turned
    return ca.Function("to_entries", [placement, mixed, own, push], [across, within])


def _rotation(placement: ca.SX) -> ca.SX:
    return ca.reshape(placement[:9], 3, 3).T
