"""The quadratic program of a controller: the best velocity, even if not all constraints can be met.

    minimize ½ uᵀ H u + fᵀ u    subject to    low ≤ u ≤ high,   a_k·u ≥ target_k    for every row k          (1)

If no velocity meets every target, a row still keeps its floor, floor_k ≤ target_k, and its shortfall s_k from the
target has a weight:

    minimize φ(u) = ½ uᵀ H u + fᵀ u + ½ Σ (weight_k max(0, target_k − a_k·u))²    subject to    a_k·u ≥ floor_k    (2)

so that (1) is solved exactly if it is feasible, and otherwise (2) favours the rows of the greatest weight. A row with
floor = target is a hard constraint, one with floor = −∞ a purely soft one. (2) is feasible if some velocity keeps every
floor: with box and floors around 0, standing still does.

φ is convex, and quadratic wherever the same rows are missed: Newton's method with an exact line search reaches the
optimum in finitely many steps, each a program in u alone. (With a variable for each shortfall, DAQP took 200 ms where
800 rows could be missed, 30 times as long.)
"""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array

SHORTEST_ROW = 1e-12  # shorter rows are left out: no velocity changes them
UNBOUNDED = 1e30  # DAQP's infinity
LEAST_CURVATURE = 1e-9  # of the greatest: where H is flatter, the shortest of many equal velocities is taken
NEWTON_STEPS = 100  # of Newton's method, at most; it takes 1 to 5
LARGEST_MISS = 1e-5  # of a bound on rows of length 1: ten times DAQP's tolerance
SOLVED = (1, 2)  # DAQP's exit flags of a solution, exact or to its tolerance

Bounds = tuple[Array, Array, Array, NDArray[np.int32]]  # rows, greatest and least values of u and rows, kinds


class SoftConstraints(NamedTuple):
    """Rows of the program, m of them."""

    matrix: Array  # (m, n) a
    target: Array  # (m,)
    floor: Array  # (m,) at most the target; −inf: none
    weight: Array  # (m,) of the shortfall from the target

    def with_rows(self, other: SoftConstraints) -> SoftConstraints:
        """Return these rows followed by others."""
        return SoftConstraints(*(np.concatenate(parts) for parts in zip(self, other, strict=True)))


def best_velocity(hessian: Array, linear: Array, low: Array, high: Array, constraints: SoftConstraints) -> Array | None:
    """Return u (n,); None if no velocity keeps every floor.

    By DAQP, a dual active-set solver: for 7 joints, bounds and 60 rows it took 0.02 ms where quadprog took 0.04,
    PIQP 0.11, ProxQP 0.47 and OSQP 1.6 (benchmarks/control.py), with quadprog's answers to 1e-13.
    """
    matrix, target, floor, weight = constraints
    length = np.linalg.norm(matrix, axis=1)
    # rows that no velocity within the box can violate are left out, which is exact and most of them
    least = np.minimum(matrix * low, matrix * high).sum(axis=1)
    kept = (least < target) & (length > SHORTEST_ROW)
    length = length[kept]
    matrix, target, floor = matrix[kept] / length[:, None], target[kept] / length, floor[kept] / length
    scale = float(np.abs(hessian).max()) or 1.0  # DAQP's tolerances are absolute
    hessian, linear, weight = hessian / scale, linear / scale, weight / np.sqrt(scale)
    found = _solved(hessian, linear, _bounded(matrix, low, high, target))
    if (command := _checked(found, low, high, matrix, target)) is not None:
        return command
    gives = floor < target
    weight = (weight[kept] * length)[gives]
    firm = np.isfinite(floor)
    within = _bounded(matrix[firm], low, high, floor[firm])
    found = _least_missed(hessian, linear, matrix[gives] * weight[:, None], target[gives] * weight, within)
    return _checked(found, low, high, matrix, floor)


def _checked(u: Array | None, low: Array, high: Array, matrix: Array, bound: Array) -> Array | None:
    """Return u within its limits; None if it then misses a bound, as DAQP's u may where H is nearly flat."""
    if u is None:
        return None
    u = np.clip(u, low, high)
    return u if (matrix @ u >= bound - LARGEST_MISS).all() else None


def _least_missed(hessian: Array, linear: Array, weighted: Array, wanted: Array, within: Bounds) -> Array | None:
    """Return the solution (n,) of (2), with weighted rows weight · a (m, n), wanted: weight · target (m,); None if
    no velocity is within the floors."""
    u = _solved(hessian, linear, within)
    if u is None:
        return None
    values, axes = np.linalg.eigh(hessian)
    least = LEAST_CURVATURE * (values[-1] if values[-1] > 0.0 else 1.0)
    root = np.sqrt(np.maximum(values, least))[:, None] * axes.T
    hessian = root.T @ root
    for _ in range(NEWTON_STEPS):
        missed = weighted @ u < wanted
        active = weighted[missed]
        curved = np.asarray(np.linalg.qr(np.concatenate([root, active]), mode="r"))
        found = _solved_by_root(curved, linear - active.T @ wanted[missed], within)
        if found is None or ((weighted @ found < wanted) == missed).all():
            return u if found is None else found
        step = found - u
        slope, curvature = float((hessian @ u + linear) @ step), float(step @ hessian @ step)
        share = _lowest(slope, curvature, wanted - weighted @ u, weighted @ step)
        if share == 0.0:  # rows that are met exactly are missed by rounding
            return u
        u = u + share * step
    return u


def _lowest(slope: float, curvature: float, missing: Array, gained: Array) -> float:
    """Return the t from 0 to 1 at which slope t + ½ curvature t² + ½ Σ max(0, missing − t gained)² is least."""

    def derivative(t: float) -> float:
        return slope + t * curvature - float(np.maximum(missing - t * gained, 0.0) @ gained)

    ends = np.divide(missing, gained, out=np.zeros_like(missing), where=gained != 0.0)  # of quadratic pieces
    pieces: list[float] = [0.0, *np.unique(ends[(ends > 0.0) & (ends < 1.0)]).tolist(), 1.0]
    after = bisect_left(pieces, 0.0, key=derivative)
    if after in (0, len(pieces)):
        return min(float(after), 1.0)
    first, last = pieces[after - 1 : after + 1]
    falls, rises = derivative(first), derivative(last)
    return first + (last - first) * falls / (falls - rises)


def _bounded(matrix: Array, low: Array, high: Array, bound: Array) -> Bounds:
    """Return low ≤ u ≤ high, matrix · u ≥ bound as DAQP takes it."""
    upper = np.concatenate([high, np.full(len(matrix), UNBOUNDED)])
    return np.ascontiguousarray(matrix), upper, np.concatenate([low, bound]), np.zeros(len(upper), dtype=np.int32)


def _solved(hessian: Array, linear: Array, within: Bounds) -> Array | None:
    solution, _, flag, _ = daqp.solve(hessian, linear, *within)
    return np.array(solution) if flag in SOLVED else None


def _solved_by_root(root: Array, linear: Array, within: Bounds) -> Array | None:
    """Return the u (n,) within bounds that minimizes ½ ‖root u‖² + fᵀ u; None if DAQP finds none.

    DAQP takes v = root u, as it would itself, but bounds of length 1: great weights make them short in v, and DAQP
    passes over those that are shorter than 3e-6, floors as well.
    """
    matrix, greatest, least, kinds = within
    inverse = np.linalg.inv(root)
    rows = np.concatenate([inverse, matrix @ inverse])
    length = np.linalg.norm(rows, axis=1)
    bounds = rows / length[:, None], np.minimum(greatest / length, UNBOUNDED), least / length, kinds
    v = _solved(np.eye(len(root)), linear @ inverse, bounds)
    return None if v is None else inverse @ v
