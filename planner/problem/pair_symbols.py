"""Clearance of body pairs in symbols: Σ_pairs ½ min(D, 0)² at one configuration, or at the two ends of an interval.

In: the pairs. Out: one Function of joint values and of the frames that carry obstacles, with first and second
derivatives in closed form. Every pair is in it (`one_pair`); wrenches are summed on what they push, then turned into
derivatives by the joints, once for all pairs.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from hdplan.distance.symbolic.closed import CLOSED, closed_function
from hdplan.distance.symbolic.graph_distance import bracket
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.problem.one_pair import near, pair, pair_bend
from hdplan.planner.problem.symbolic_place import SymbolicPlace, by_entries
from hdplan.scenes.array_types import Array, Rows


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
    n, joints, carriers = kinematics.n * ends, kinematics.nj, kinematics.nj + frames
    value, hessian = ca.MX(0), ca.MX.zeros(n, n)
    pushed = [ca.MX.zeros(6, carriers) for _ in values]  # wrenches on what each joint or frame carries
    bent = [ca.MX.zeros(rows, frames) for rows in (6 * n, 36, 6)]  # as `pair_bend` has them, by frame
    for slots in sorted(set(pairs.plane_slots.tolist())):
        rows = np.flatnonzero(pairs.plane_slots == slots)
        count, joint_a, joint_b = len(rows), pairs.joint_a[rows], pairs.joint_b[rows]
        placed = [place.placements[:, joint_a.tolist()] for place in places]
        placed.append(places[0].placements[:, joint_b.tolist()])
        reaches = near(pairs.widest, ends).map(count)(*placed, *_balls_and_boxes(pairs, rows))
        bodies = [pairs.body_table[pairs.body[rows]].T, pairs.plane_tables[slots][pairs.plane_row[rows]].T]
        looked_at = [reaches, *placed, *(ca.MX(ca.DM(each)) for each in bodies)]
        settings = pairs.vertex_slots, slots, gamma, shaping_length, ends

        depths, pushes = pair(*settings).map(count).call(looked_at)
        value += ca.sum2(depths)
        apart = _selection(joint_a, carriers) - _selection(joint_b, carriers)
        pushed = [ca.mac(each, apart, so_far) for so_far, each in zip(pushed, ca.vertsplit(pushes, 6), strict=True)]

        one, other = _carried(kinematics, joint_a), _carried(kinematics, joint_b)
        moves = [ca.MX(ca.DM(each.T)) for each in (one - other, one + other)]
        screws = [ca.repmat(place.columns, 1, count) for place in places]
        found = pair_bend(*settings, kinematics.n, exact).map(count).call([*looked_at, *screws, *moves])
        hessian += ca.reshape(ca.sum2(found[0]), n, n)
        on_frame = _selection(joint_b - joints, frames)
        bent = [ca.mac(each, on_frame, so_far) for so_far, each in zip(bent, found[1:], strict=True)]
    slopes = _slopes(places, pushed)
    return _handed_over([*values, carried], [value, *slopes], _curvatures(carried, hessian, bent, ends))


def _slopes(places: Sequence[SymbolicPlace], pushed: Sequence[ca.MX]) -> list[ca.MX]:
    """The derivatives by the joints of each place (1, n), and by the frames (1, 12 F), of wrenches (6, nj + F)."""
    kinematics, carried = places[0].kinematics, places[0].frames
    parts = [ca.horzsplit(each, [0, kinematics.nj, each.shape[1]]) for each in pushed]
    moved = ca.sparsify(ca.DM(kinematics.supports.astype(float)))
    slopes = [ca.sum1(place.columns * (links @ moved)) for place, (links, _) in zip(places, parts, strict=True)]
    if not carried.shape[1]:
        return [*slopes, ca.MX(1, 0)]
    on_frames = sum((frames for _, frames in parts), ca.MX.zeros(6, carried.shape[1]))
    return [*slopes, ca.vec(by_entries(1).map(carried.shape[1])(carried, on_frames)).T]


def _curvatures(carried: ca.MX, hessian: ca.MX, bent: Sequence[ca.MX], ends: int) -> list[list[ca.MX]]:
    """Their derivatives by the joints of each place and by the frames."""
    n, frames = hessian.shape[0], carried.shape[1]
    across, within = ca.MX(n, 0), ca.MX(0, 0)
    if frames:
        across, within = _to_entries(n).map(frames)(carried, *bent)
    blocks = [ca.horzsplit(row, n // ends) for row in ca.vertsplit(hessian, n // ends)]
    curvatures = [[*row, part] for row, part in zip(blocks, ca.vertsplit(across, n // ends), strict=True)]
    return [*curvatures, [*(row[-1].T for row in curvatures), ca.diagcat(*ca.horzsplit(within, 12))]]


def _handed_over(given: list[ca.MX], known: list[ca.MX], curvatures: list[list[ca.MX]]) -> ca.Function:
    """The Function of a value and its slopes that are known together: one evaluation serves both, as they are handed
    over by a Function that has no derivative itself. CasADi looks for what they depend on in their expressions, so that
    these have to name it."""
    evaluated = ca.Function("pairs", given, known, CLOSED | {"is_diff_in": [False] * len(given)})
    fixed = [ca.MX.sym(f"known{k}", part.sparsity()) for k, part in enumerate(known)]
    nothing = ca.fmin(sum((ca.sumsqr(each) for each in given), ca.MX(0)), 0)
    value, *slopes = (part + nothing for part in fixed)
    closed = closed_function("clearance", given, value, slopes, curvatures, fixed)
    return ca.Function("clearance", given, [closed(*given, *evaluated.call(given))], {"always_inline": True})


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
def _to_entries(n: int) -> ca.Function:
    """One frame's second derivatives by its motion as those by the entries of its placement: with the joints (n, 12),
    and with itself (12, 12)."""
    placement, mixed, own, push = (
        ca.MX.sym(name, size) for name, size in (("placement", 12), ("mixed", 6 * n), ("own", 36), ("push", 6))
    )
    _, up, turned = by_entries(2)(placement, push)
    across = ca.reshape(mixed, n, 6) @ up.T
    within = up @ (ca.reshape(own, 6, 6) - bracket(push)) @ up.T + turned
    return ca.Function("to_entries", [placement, mixed, own, push], [across, within])
