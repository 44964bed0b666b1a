"""Clearance of body pairs in symbols: Σ_pairs ½ min(D, 0)² at one configuration, or at the two ends of an interval.

In: the pairs. Out: a closed form, first and second derivatives included, of joint values and of the frames that carry
obstacles, with how much these have grown. It goes through the convex pieces one by one, and where a
link body is near a piece through all link bodies (`one_pair`): so what is far away costs next to nothing in generated
code.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hdplan.distance.poses import placement_rows
from hdplan.distance.symbolic.all_planes import MOST_SIZES
from hdplan.distance.symbolic.closed import ClosedForm
from hdplan.distance.symbolic.rigid_motions import by_entries, twice_by_entries
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.growth import Growths
from hdplan.planner.problem.one_pair import UNBRANCHED, PairKind, ball, box_seen, pair, pair_second_order, total, where
from hdplan.planner.problem.symbolic_place import SymbolicPlace
from hdplan.scenes.array_types import Array, Rows

FRAME = 12 + MOST_SIZES  # numbers of a frame: its placement, and by how much the sizes of what it carries have changed


def clearance_form(
    places: Sequence[SymbolicPlace], pairs: BodyPairs, growths: Growths, gamma: int, shaping_length: float
) -> ClosedForm:
    """Return the penalty of one configuration, or of an interval between two: D is then that of the first body swept
    between them. Derivatives are by the joint values of each, and by the frames (15, F) where these are movable.

    Joints of the pairs beyond the robot's are frames. Where the places are not exact the second derivative is that of
    the residuals' squares alone, Σ ∇D ∇Dᵀ where D < 0.
    """
    kinematics, carried, ends = places[0].kinematics, places[0].frames, len(places)
    exact, movable, frames = places[0].exact, places[0].movable, carried.shape[1]
    n, joints = kinematics.n, kinematics.nj
    changes = ca.horzcat(ca.MX.zeros(MOST_SIZES, joints), carried[12:, :])  # links do not grow
    value, slope = ca.MX(0), ca.MX.zeros(n * ends)
    pushed, grown = ca.MX.zeros(6, frames), ca.MX.zeros(MOST_SIZES, frames)
    hessian = ca.MX.zeros(n * ends, n * ends)
    sizes = 6 * n * ends, 36, 6, MOST_SIZES * n * ends, 6 * MOST_SIZES, MOST_SIZES * MOST_SIZES
    bent = [ca.MX.zeros(rows, frames) for rows in sizes]  # as `pair_second_order` has them, by frame
    screws = [place.columns for place in places]
    for slots in sorted(set(pairs.plane_slots.tolist())):
        met = _Pieces.of(pairs, growths, slots)
        grows = movable and met.growth is not None and frames > 0
        kind = PairKind(pairs.vertex_slots, slots, gamma, shaping_length, ends, grows)
        placed = [place.placements[:, met.joint_a.tolist()] for place in places]
        own = places[0].placements[:, met.joint_b.tolist()]  # of the pieces
        change = changes[:, met.joint_b.tolist()]
        looked_at: list[Any] = [met.reached(placed, own, change), *(_repeated(each, met) for each in placed)]
        looked_at += [own, *met.planes, *(() if met.growth is None else (met.growth, change))]
        looked_at += [*(_repeated(each, met) for each in screws), met.moves]
        depth, push, back, *more = met.mapped(_pushes(kind, met, n)).call(looked_at)
        value, slope = value + ca.sum2(depth), slope + ca.sum2(push)
        found = met.mapped(_second_orders(kind, met, n, exact, movable)).call(looked_at)
        hessian += ca.reshape(ca.sum2(found[0]), n * ends, n * ends)
        if movable and frames:
            on_frame = _selection(met.joint_b - joints, frames)
            pushed = ca.mac(back, on_frame, pushed)
            grown = ca.mac(more[0], on_frame, grown) if grows else grown
            for row, each in enumerate(found[1:]):
                bent[row] = ca.mac(each, on_frame, bent[row])
    slopes = [each.T for each in ca.vertsplit(slope, n)]
    curvatures = [ca.horzsplit(row, n) for row in ca.vertsplit(hessian, n)]
    if not movable:
        return ClosedForm(value, slopes, curvatures)
    of_frames = _slope(carried[:12, :], pushed, grown)
    return ClosedForm(value, [*slopes, of_frames], _with_frames(curvatures, carried[:12, :], bent))


@dataclass(frozen=True, eq=False)
class _Pieces:
    """B convex pieces of equally many planes, and the A link bodies that meet them."""

    joint_a: Rows  # (A,)
    joint_b: Rows  # (B,)
    bodies: ca.DM  # (·, A) as in `BodyPairs`
    planes: tuple[ca.DM, ca.DM]  # normals (K, 3 B) and supports (K, B)
    growth: ca.DM | None  # (K, 3 B) derivatives of the supports by the sizes, if any of the pieces has sizes
    moves: ca.DM  # (n, A B)
    listed: ca.DM  # (1, A B) whether that pair is one of the pairs
    balls: tuple[ca.DM, ca.DM]  # centres (3, A) and radii (1, A)
    boxes: ca.DM  # (12, B)
    half_sizes: ca.DM  # (3, B)
    widths: ca.DM  # (9, B) derivatives of the half sizes by the sizes (3, 3)
    widest: float

    @classmethod
    def of(cls, pairs: BodyPairs, growths: Growths, slots: int) -> _Pieces:
        """Pieces of the pairs with so many planes."""
        rows = np.flatnonzero(pairs.plane_slots == slots)
        body, first, a = np.unique(pairs.body[rows], return_index=True, return_inverse=True)
        piece, once, b = np.unique(pairs.halfspace_body[rows], return_index=True, return_inverse=True)
        first, once = rows[first], rows[once]
        listed, moves = np.zeros((len(piece), len(body))), np.zeros((len(piece), len(body), pairs.moves.shape[1]))
        listed[b, a], moves[b, a] = 1.0, pairs.moves[rows]
        table = pairs.plane_tables[slots][pairs.plane_row[once]]
        normals, growing = table[:, : 3 * slots].reshape(-1, 3), [growths.get(b) for b in piece.tolist()]
        supports = [np.zeros((slots, MOST_SIZES)) if each is None else each.supports for each in growing]
        halves = [np.zeros((3, MOST_SIZES)) if each is None else each.half_size for each in growing]
        return cls(
            pairs.joint_a[first],
            pairs.joint_b[once],
            ca.DM(pairs.body_table[body].T),
            (_side_by_side(normals, slots), ca.DM(table[:, 3 * slots :].T)),
            _side_by_side(np.vstack(supports), slots) if any(each is not None for each in growing) else None,
            ca.DM(moves.reshape(-1, moves.shape[2]).T),
            ca.DM(listed.reshape(1, -1)),
            (ca.DM(pairs.centres[body].T), ca.DM(pairs.radii[body][None])),
            ca.DM(placement_rows(pairs.boxes[piece]).T),
            ca.DM(pairs.half_sizes[piece].T),
            ca.DM(np.array([each.ravel(order="F") for each in halves]).T),
            pairs.widest,
        )

    @property
    def sizes(self) -> tuple[int, int]:
        """A and B."""
        return len(self.joint_a), len(self.joint_b)

    def mapped(self, function: ca.Function) -> ca.Function:
        """Over the pieces."""
        return function.map(self.sizes[1])

    def reached(self, placed: Sequence[ca.MX], own: ca.MX, change: ca.MX) -> ca.MX:
        """Nearness of link bodies and pieces (1, A B): 1 where the ball of the one reaches the box of the other; 0
        where D is sure to be positive. All at once, so that compilers make vectors of it."""
        count, pieces = self.sizes
        centres, radii = ball(len(placed)).map(count)(*placed, *self.balls)
        points = ca.vertcat(centres, ca.DM.ones(1, count)).T
        half = ca.MX(self.half_sizes)
        if self.growth is not None:
            half += _widened().map(pieces)(self.widths, change)
        outside = ca.MX.zeros(count, pieces)
        for axis, along in zip(box_seen().map(pieces).call([own, self.boxes]), ca.vertsplit(half), strict=True):
            beyond = ca.fmax(ca.fabs(points @ axis) - ca.DM.ones(count, 1) @ along, 0)
            outside += beyond * beyond
        reach = self.widest * radii.T
        close = ca.reshape(self.listed, count, pieces) * (outside < ca.repmat(reach * reach, 1, pieces))
        return ca.reshape(close, 1, count * pieces)


def _side_by_side(rows: Array, count: int) -> ca.DM:
    """Matrix (K, 3 B) of B matrices (K, 3) that stand one below another."""
    return ca.DM(np.hstack(np.split(rows, len(rows) // count)))


@functools.cache
def _widened() -> ca.Function:
    """Function from the derivatives (9) of half sizes by sizes and a change of these to that of the half sizes (3)."""
    widths, change = ca.SX.sym("widths", 9), ca.SX.sym("change", MOST_SIZES)
    return ca.Function("widened", [widths, change], [ca.reshape(widths, 3, MOST_SIZES) @ change])


def _repeated(each: ca.MX, met: _Pieces) -> ca.MX:
    return ca.repmat(each, 1, met.sizes[1])


def _given(kind: PairKind, met: _Pieces, n: int) -> tuple[list[ca.MX], list[ca.MX], list[ca.MX], ca.MX]:
    """For one piece: the link bodies (1, A) that are near, the inputs of a pair for all of them, screws and moves."""
    count, planes = met.sizes[0], kind.planes
    reached = ca.MX.sym("reached", 1, count)
    placed = [ca.MX.sym(f"placed{k}", 12, count) for k in range(kind.ends)]
    own, normals, supports = ca.MX.sym("own", 12), ca.MX.sym("normals", planes, 3), ca.MX.sym("supports", planes)
    given, alike = [reached, *placed, own, normals, supports], [own, normals, supports]
    if met.growth is not None:
        growth, change = ca.MX.sym("growth", planes, MOST_SIZES), ca.MX.sym("change", MOST_SIZES)
        given, alike = [*given, growth, change], [own, normals, supports + growth @ change, *[growth] * kind.grows]
    screws = [ca.MX.sym(f"screws{k}", 6, n) for k in range(kind.ends)]
    moves = ca.MX.sym("moves", n, count)
    frame, *of_planes = (ca.repmat(each, 1, count) for each in alike)
    pairs = [reached, *placed, frame, ca.MX(met.bodies), *of_planes]
    return [*given, *screws, moves], pairs, screws, moves


def _pushes(kind: PairKind, met: _Pieces, n: int) -> ca.Function:
    """Function of one piece: its penalty, the derivatives by the joints (n e), by the motion of the piece (6), and by
    its sizes (3) where it grows."""
    given, pairs, screws, moves = _given(kind, met, n)
    depths, wrenches, *by_sizes = pair(kind).map(met.sizes[0]).call(pairs)
    parts = ca.vertsplit(wrenches, 6)
    slopes = [ca.sum2((each.T @ part) * moves) for each, part in zip(screws, parts, strict=True)]
    found = [ca.sum2(depths), ca.vertcat(*slopes), -ca.sum2(total(parts)), *map(ca.sum2, by_sizes)]
    return _any_near("pushes", given, found)


def _second_orders(kind: PairKind, met: _Pieces, n: int, exact: bool, movable: bool) -> ca.Function:
    """The second derivatives of one piece's penalty, as `pair_second_order` has them."""
    given, pairs, screws, moves = _given(kind, met, n)
    count = met.sizes[0]
    found = (
        pair_second_order(kind, n, exact, movable)
        .map(count)
        .call([*pairs, *(ca.repmat(each, 1, count) for each in screws), moves])
    )
    return _any_near("bends", given, [ca.sum2(each) for each in found])


def _any_near(name: str, given: list[ca.MX], results: list[ca.MX]) -> ca.Function:
    close = where(ca.Function(name, given, [ca.densify(each) for each in results], UNBRANCHED))
    return ca.Function(f"{name}_of_piece", given, close.call([ca.mmax(given[0]), *given]), UNBRANCHED)


def _slope(placements: ca.MX, pushed: ca.MX, grown: ca.MX) -> ca.MX:
    """The derivatives (1, 15 F) by the frames, of wrenches (6, F) on them, and by sizes (3, F)."""
    if not placements.shape[1]:
        return ca.MX(1, 0)
    entries = by_entries(1).map(placements.shape[1])(placements, pushed)
    return ca.vec(ca.vertcat(entries, grown)).T


def _with_frames(curvatures: list[list[ca.MX]], placements: ca.MX, bent: Sequence[ca.MX]) -> list[list[ca.MX]]:
    """Add the derivatives by the frames to those by the joints of each place."""
    n, frames = curvatures[0][0].shape[0], placements.shape[1]
    across, within = ca.MX(n * len(curvatures), 0), ca.MX(0, 0)
    if frames:
        across, within = _to_entries(n * len(curvatures)).map(frames)(placements, *bent)
    found = [[*row, part] for row, part in zip(curvatures, ca.vertsplit(across, n), strict=True)]
    return [*found, [*(row[-1].T for row in found), ca.diagcat(*ca.horzsplit(within, FRAME))]]


def _selection(carrier: Rows, count: int) -> ca.DM:
    """The matrix (P, K) that sums pieces by the frame (P,) that carries them; negative where none does."""
    chosen = np.flatnonzero(carrier >= 0)
    pattern = ca.Sparsity.triplet(len(carrier), count, chosen.tolist(), carrier[chosen].tolist())
    return ca.DM(pattern, np.ones(len(chosen)))


@functools.cache
def _to_entries(n: int) -> ca.Function:
    """One frame's second derivatives, as `pair_second_order` has them, as those by the entries of its placement and its
    sizes: with the joints (n, 15), and with itself (15, 15)."""
    sizes = {"mixed": (6, n), "own": (6, 6), "push": (6, 1)}
    sizes |= {"joints": (n, MOST_SIZES), "motion": (6, MOST_SIZES), "growth": (MOST_SIZES, MOST_SIZES)}
    placement, symbols = ca.MX.sym("placement", 12), [ca.MX.sym(name, rows * of) for name, (rows, of) in sizes.items()]
    shapes = [(n, 6), *list(sizes.values())[1:]]
    mixed, own, push, joints, motion, growth = (
        ca.reshape(each, *shape) for each, shape in zip(symbols, shapes, strict=True)
    )
    within, up = twice_by_entries()(placement, push, own)
    moved = up @ motion
    across = ca.horzcat(mixed @ up.T, joints)
    return ca.Function("to_entries", [placement, *symbols], [across, ca.blockcat([[within, moved], [moved.T, growth]])])
