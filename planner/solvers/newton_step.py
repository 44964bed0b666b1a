"""One damped Gauss-Newton step of a motion: (H + λ diag H) dq = −∇ on a system that is banded in time.

H is the smoothness' exact Hessian plus the penalty's Gauss-Newton curvature. A waypoint is coupled only to its two
neighbours on either side, so H is banded and a step costs O(N n³). Joint limits hold by projection: coordinates that a
step would push beyond a limit are held for that step (Bertsekas, Projected Newton Methods, 1982).

The loop in C puts the band together and factorizes it, in a quarter of the time that SciPy takes at this size; without
a compiler it is SciPy.
"""

from __future__ import annotations

import functools

import numpy as np

from hdplan.distance.compiled.loops import C, twin_of
from hdplan.planner.problem.problem import Evaluation, Problem
from hdplan.scenes.array_types import Array, Mask, Rows

HOLDING_STIFFNESS = 1e15  # stiffness that holds a coordinate at its limit for one step


def newton_step(problem: Problem, positions: Array, state: Evaluation, damping: float) -> Array:
    """Return the step as displacements of waypoints (N, n), zero at the ends."""
    interior, gradient, (lower, upper) = positions[1:-1], state.gradient, problem.robot.inner
    outward = ((interior >= upper) & (gradient < 0)) | ((interior <= lower) & (gradient > 0))
    step = np.zeros_like(positions)
    step[1:-1] = _of_interior(problem.smoothness.diagonals, state, outward, damping)
    return step


def _in_c(smooth: Array, state: Evaluation, outward: Mask, damping: float) -> Array:
    held = HOLDING_STIFFNESS * outward
    given = map(np.ascontiguousarray, (state.gradient, smooth, state.diagonal, state.coupling, held))
    step = np.empty_like(state.gradient)
    if not C.newton_step(*given, damping, step):
        raise np.linalg.LinAlgError("the Hessian is not positive definite")
    return step


@twin_of(_in_c)
def _of_interior(smooth: Array, state: Evaluation, outward: Mask, damping: float) -> Array:
    from scipy.linalg import solveh_banded

    count, n = state.gradient.shape
    band = np.zeros((2 * n + 1, count * n))  # row d, column c holds H[c + d, c]
    for offset in range(min(3, count)):
        band[offset * n, : (count - offset) * n] = np.repeat(smooth[offset, : count - offset], n)
    within, between, (row, column) = _places(count, n)
    band.ravel()[within] += state.diagonal[:, row, column]
    band.ravel()[between] += state.coupling.reshape(-1, n * n)
    band[0] *= 1 + damping
    band[0] += HOLDING_STIFFNESS * outward.ravel()
    wanted = np.where(outward, 0.0, -state.gradient).ravel()
    step: Array = solveh_banded(band, wanted, lower=True, check_finite=False).reshape(count, n)
    return step


@functools.lru_cache(maxsize=8)
def _places(count: int, n: int) -> tuple[Rows, Rows, tuple[Rows, Rows]]:
    """The positions in the flat band of each waypoint's block and of the block that couples it to the next: of the
    former, which is symmetric, the lower triangle (M, n (n + 1) / 2), of the latter everything (M − 1, n²); also that
    triangle's rows and columns."""
    width, first = count * n, np.arange(count)[:, None] * n
    row, column = np.tril_indices(n)
    within = (row - column) * width + first + column
    below, beside = (index.ravel() for index in np.indices((n, n)))
    between = (n + below - beside) * width + first[:-1] + beside
    return within, between, (row, column)
