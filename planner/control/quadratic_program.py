"""The quadratic program of a controller: the best velocity, even if not all constraints can be met.

    minimize ½ uᵀ H u + fᵀ u    subject to    low ≤ u ≤ high,   a_k·u ≥ target_k    for every row k          (1)

If no velocity meets every target, a row still keeps its floor, floor_k ≤ target_k, and its shortfall s_k from the
target has a weight:

    minimize ½ uᵀ H u + fᵀ u + ½ Σ (weight_k s_k)²    subject to    a_k·u ≥ floor_k,   a_k·u + s_k ≥ target_k    (2)

so that (1) is solved exactly if it is feasible, and otherwise (2) favours the rows of the greatest weight. A row with
floor = target is a hard constraint, one with floor = −∞ a purely soft one. (2) is feasible if some velocity keeps every
floor: with box and floors around 0, standing still does.
"""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from hdplan.scenes.array_types import Array

SHORTEST_ROW = 1e-12  # shorter rows are left out: no velocity changes them
UNBOUNDED = 1e30  # DAQP's infinity
SOLVED = (1, 2)  # DAQP's exit flags of a solution, exact or to its tolerance


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
    found = _solved(hessian, linear, matrix, low, high, target)
    if found is not None:
        return np.clip(found, low, high)  # DAQP's bounds hold to 1e-12
    weight = weight[kept] * length
    n, gives = len(linear), floor < target
    count = int(gives.sum())
    # (2) in u and weight · s; each weighted row is scaled so that its coefficients are at most 1
    scale = np.maximum(weight[gives], 1.0)
    weighted = np.hstack([matrix[gives] * (weight[gives] / scale)[:, None], np.diag(1.0 / scale)])
    floors = np.hstack([matrix, np.zeros((len(matrix), count))])
    firm = np.isfinite(floor)
    both = np.zeros((n + count, n + count))
    both[:n, :n], both[n:, n:] = hessian, np.eye(count)
    found = _solved(
        both,
        np.append(linear, np.zeros(count)),
        np.concatenate([floors[firm], weighted]),
        np.append(low, np.zeros(count)),
        np.append(high, np.full(count, UNBOUNDED)),
        np.concatenate([floor[firm], target[gives] * weight[gives] / scale]),
    )
    return None if found is None else np.clip(found[:n], low, high)


def _solved(hessian: Array, linear: Array, matrix: Array, low: Array, high: Array, bound: Array) -> Array | None:
    solution, _, flag, _ = daqp.solve(
        hessian,
        linear,
        np.ascontiguousarray(matrix),
        np.append(high, np.full(len(matrix), UNBOUNDED)),
        np.append(low, bound),
        np.zeros(len(low) + len(matrix), dtype=np.int32),
    )
    return np.array(solution) if flag in SOLVED else None
