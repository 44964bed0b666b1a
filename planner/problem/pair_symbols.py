"""Clearance of body pairs in symbols: Σ_pairs ½ min(D, 0)² at one configuration, or at the two ends of an interval.

In: the pairs. Out: one Function of joint values and of the frames that carry obstacles, with first and second
derivatives in closed form. It goes through the convex pieces one by one, and where a link body is near a piece through
all link bodies (`one_pair`): so what is far away costs next to nothing in generated code.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hdplan.distance.symbolic.closed import CLOSED, closed_function
from hdplan.distance.symbolic.rigid_motions import by_entries, twice_by_entries
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.problem.one_pair import UNBRANCHED, PairKind, ball, near, pair, pair_bend, total, where
from hdplan.planner.problem.symbolic_place import SymbolicPlace
from hdplan.scenes.array_types import Rows


def clearance_function(
    kinematics: Kinematics,
    pairs: BodyPairs,
    gamma: int,
    shaping_length: float,
    frames: int,
    exact: bool,
    ends: int = 1,
    movable: bool = True,
) -> ca.Function:
    """Return the Function (q (n,) at each of `ends` configurations, frames (12, F)) -> penalty.

    Joints of the pairs beyond the robot's are frames. Without `exact` the second derivative is that of the residuals'
    squares alone, Σ ∇D ∇Dᵀ where D < 0. With two ends D is that of the first body swept between them. Without `movable`
    it has no derivatives by the frames.
    """
    carried = ca.MX.sym("frames", 12, frames)
    values = [ca.MX.sym(f"q{k}", kinematics.n) for k in range(ends)]
    places = [SymbolicPlace(kinematics, q, carried, exact, movable) for q in values]
    n, joints = kinematics.n, kinematics.nj
    value, slope, pushed = ca.MX(0), ca.MX.zeros(n * ends), ca.MX.zeros(6, frames)
    hessian = ca.MX.zeros(n * ends, n * ends)
    bent = [ca.MX.zeros(rows, frames) for rows in (6 * n * ends, 36, 6)]  # as `pair_bend` has them, by frame
    screws = [place.columns for place in places]
    for slots in sorted(set(pairs.plane_slots.tolist())):
        met, kind = _Pieces.of(pairs, slots), PairKind(pairs.vertex_slots, slots, gamma, shaping_length, ends)
        placed = [place.placements[:, met.joint_a.tolist()] for place in places]
        own = places[0].placements[:, met.joint_b.tolist()]  # of the pieces
        looked_at: list[Any] = [met.reached(placed, own), *(_repeated(each, met) for each in placed), own, met.planes]
        looked_at += [*(_repeated(each, met) for each in screws), met.moves]
        depth, push, back = met.mapped(_pushes(kind, met, n)).call(looked_at)
        value, slope = value + ca.sum2(depth), slope + ca.sum2(push)
        found = met.mapped(_bends(kind, met, n, exact, movable)).call(looked_at)
        hessian += ca.reshape(ca.sum2(found[0]), n * ends, n * ends)
        if movable and frames:
            on_frame = _selection(met.joint_b - joints, frames)
            pushed = ca.mac(back, on_frame, pushed)
            bent = [ca.mac(each, on_frame, so_far) for so_far, each in zip(bent, found[1:], strict=True)]
    slopes = [each.T for each in ca.vertsplit(slope, n)]
    curvatures = [ca.horzsplit(row, n) for row in ca.vertsplit(hessian, n)]
    if not movable:
        return _handed_over(values, [carried], [value, *slopes], curvatures)
    return _handed_over(
        [*values, carried], [], [value, *slopes, _slope(carried, pushed)], _with_frames(curvatures, carried, bent)
    )


@dataclass(frozen=True, eq=False)
class _Pieces:
    """B convex pieces of equally many planes, and the A link bodies that meet them."""

    joint_a: Rows  # (A,)
    joint_b: Rows  # (B,)
    bodies: ca.DM  # (·, A) as in `BodyPairs`
    planes: ca.DM  # (·, B)
    moves: ca.DM  # (n, A B)
    listed: ca.DM  # (1, A B) whether that pair is one of the pairs
    balls: tuple[ca.DM, ca.DM]  # centres (3, A) and radii (1, A)
    boxes: tuple[ca.DM, ca.DM]  # (12, B) and half sizes (3, B)
    widest: float

    @classmethod
    def of(cls, pairs: BodyPairs, slots: int) -> _Pieces:
        """Those of the pairs with so many planes."""
        rows = np.flatnonzero(pairs.plane_slots == slots)
        body, first, a = np.unique(pairs.body[rows], return_index=True, return_inverse=True)
        piece, once, b = np.unique(pairs.halfspace_body[rows], return_index=True, return_inverse=True)
        first, once = rows[first], rows[once]
        listed, moves = np.zeros((len(piece), len(body))), np.zeros((len(piece), len(body), pairs.moves.shape[1]))
        listed[b, a], moves[b, a] = 1.0, pairs.moves[rows]
        boxes = pairs.boxes[piece]
        flat = np.hstack([boxes[:, :3, :3].reshape(-1, 9), boxes[:, :3, 3]])
        return cls(
            pairs.joint_a[first],
            pairs.joint_b[once],
            ca.DM(pairs.body_table[body].T),
            ca.DM(pairs.plane_tables[slots][pairs.plane_row[once]].T),
            ca.DM(moves.reshape(-1, moves.shape[2]).T),
            ca.DM(listed.reshape(1, -1)),
            (ca.DM(pairs.centres[body].T), ca.DM(pairs.radii[body][None])),
            (ca.DM(flat.T), ca.DM(pairs.half_sizes[piece].T)),
            pairs.widest,
        )

    @property
    def sizes(self) -> tuple[int, int]:
        """A and B."""
        return len(self.joint_a), len(self.joint_b)

    def mapped(self, function: ca.Function) -> ca.Function:
        """Over the pieces."""
        return function.map(self.sizes[1])

    def reached(self, placed: Sequence[ca.MX], own: ca.MX) -> ca.MX:
        """Which link bodies are near which piece (1, A B)."""
        count, pieces = self.sizes
        balls = ball(len(placed)).map(count)(*placed, *self.balls)
        return near(count, self.widest).map(pieces)(
            *(ca.repmat(each, 1, pieces) for each in balls), own, *self.boxes, self.listed
        )


def _repeated(each: ca.MX, met: _Pieces) -> ca.MX:
    return ca.repmat(each, 1, met.sizes[1])


def _given(kind: PairKind, met: _Pieces, n: int) -> tuple[list[ca.MX], list[ca.MX], list[ca.MX], ca.MX]:
    """Of one piece: which link bodies (1, A) are near, the inputs of a pair for all of them, screws and moves."""
    count = met.sizes[0]
    reached = ca.MX.sym("reached", 1, count)
    placed = [ca.MX.sym(f"placed{k}", 12, count) for k in range(kind.ends)]
    own, planes = ca.MX.sym("own", 12), ca.MX.sym("planes", 4 * kind.planes)
    screws = [ca.MX.sym(f"screws{k}", 6, n) for k in range(kind.ends)]
    moves = ca.MX.sym("moves", n, count)
    alike = [ca.repmat(own, 1, count), ca.MX(met.bodies), ca.repmat(planes, 1, count)]
    return [reached, *placed, own, planes, *screws, moves], [reached, *placed, *alike], screws, moves


def _pushes(kind: PairKind, met: _Pieces, n: int) -> ca.Function:
    """Of one piece: its penalty, the derivatives by the joints (n e) and by the motion of the piece (6)."""
    given, pairs, screws, moves = _given(kind, met, n)
    depths, wrenches = pair(kind).map(met.sizes[0]).call(pairs)
    parts = ca.vertsplit(wrenches, 6)
    slopes = [ca.sum2((each.T @ part) * moves) for each, part in zip(screws, parts, strict=True)]
    return _any_near("pushes", given, [ca.sum2(depths), ca.vertcat(*slopes), -ca.sum2(total(parts))])


def _bends(kind: PairKind, met: _Pieces, n: int, exact: bool, movable: bool) -> ca.Function:
    """The second derivatives of one piece's penalty, as `pair_bend` has them."""
    given, pairs, screws, moves = _given(kind, met, n)
    count = met.sizes[0]
    found = (
        pair_bend(kind, n, exact, movable)
        .map(count)
        .call([*pairs, *(ca.repmat(each, 1, count) for each in screws), moves])
    )
    return _any_near("bends", given, [ca.sum2(each) for each in found])


def _any_near(name: str, given: list[ca.MX], results: list[ca.MX]) -> ca.Function:
    close = where(ca.Function(name, given, [ca.densify(each) for each in results], UNBRANCHED))
    return ca.Function(f"{name}_of_piece", given, close.call([ca.mmax(given[0]), *given]), UNBRANCHED)


def _slope(carried: ca.MX, pushed: ca.MX) -> ca.MX:
    """The derivatives (1, 12 F) by the frames, of wrenches (6, F) on them."""
    if not carried.shape[1]:
        return ca.MX(1, 0)
    return ca.vec(by_entries(1).map(carried.shape[1])(carried, pushed)).T


def _with_frames(curvatures: list[list[ca.MX]], carried: ca.MX, bent: Sequence[ca.MX]) -> list[list[ca.MX]]:
    """Add the derivatives by the frames to those by the joints of each place."""
    n, frames = curvatures[0][0].shape[0], carried.shape[1]
    across, within = ca.MX(n * len(curvatures), 0), ca.MX(0, 0)
    if frames:
        across, within = _to_entries(n * len(curvatures)).map(frames)(carried, *bent)
    found = [[*row, part] for row, part in zip(curvatures, ca.vertsplit(across, n), strict=True)]
    return [*found, [*(row[-1].T for row in found), ca.diagcat(*ca.horzsplit(within, 12))]]


def _handed_over(
    given: list[ca.MX], fixed: list[ca.MX], known: list[ca.MX], curvatures: list[list[ca.MX]]
) -> ca.Function:
    """The Function of a value and its slopes that are known together: one evaluation serves both, as they are handed
    over by a Function that has no derivative itself. CasADi looks for what they depend on in their expressions, so that
    these have to name it."""
    every = [*given, *fixed]
    evaluated = ca.Function("pairs", every, known, CLOSED | {"is_diff_in": [False] * len(every)})
    handed = [ca.MX.sym(f"known{k}", part.sparsity()) for k, part in enumerate(known)]
    zero = ca.fmin(total([ca.sumsqr(each) for each in given]), 0)
    value, *slopes = (part + zero for part in handed)
    closed = closed_function("clearance", given, value, slopes, curvatures, [*fixed, *handed])
    return ca.Function("clearance", every, [closed(*every, *evaluated.call(every))], {"always_inline": True})


def _selection(carrier: Rows, count: int) -> ca.DM:
    """The matrix (P, K) that sums pieces by the frame (P,) that carries them; negative where none does."""
    chosen = np.flatnonzero(carrier >= 0)
    pattern = ca.Sparsity.triplet(len(carrier), count, chosen.tolist(), carrier[chosen].tolist())
    return ca.DM(pattern, np.ones(len(chosen)))


@functools.cache
def _to_entries(n: int) -> ca.Function:
    """One frame's second derivatives by its motion as those by the entries of its placement: with the joints (n, 12),
    and with itself (12, 12)."""
    placement, mixed, own, push = (
        ca.MX.sym(name, size) for name, size in (("placement", 12), ("mixed", 6 * n), ("own", 36), ("push", 6))
    )
    within, up = twice_by_entries()(placement, push, ca.reshape(own, 6, 6))
    across = ca.reshape(mixed, n, 6) @ up.T
    return ca.Function("to_entries", [placement, mixed, own, push], [across, within])
