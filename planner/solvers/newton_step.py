"""One damped Gauss-Newton step of a motion: (H + λ diag H) dq = −∇ on a system that is banded in time.

H is the smoothness' exact Hessian plus the penalty's Gauss-Newton curvature. A waypoint is coupled only to its two
neighbours on either side, so H is banded and a step costs O(N n³). Joint limits hold by projection: coordinates that a
step would push beyond a limit are held for that step (Bertsekas, Projected Newton Methods, 1982).

The loop in C puts the band together and factorizes it, in a quarter of the time that SciPy takes at this size; without
a compiler it is SciPy.
"""

from __future__ import annotations

import ctypes
import functools

import numpy as np

from hdplan.distance.compiled.c_library import c_functions, call
from hdplan.planner.problem.problem import Evaluation, Problem
from hdplan.scenes.array_types import Array, Mask, Rows

REST = 1e15  # stiffness that holds a coordinate at its limit for one step

SOURCE = """
#include <math.h>

/* Solves H step = −gradient for M waypoints of n coordinates, H as the module says; `smooth` (3, M) are diagonals 0, 1
   and 2 of the smoothness' Hessian, `held` (M, n) what is added to the diagonal. `band` (M n, 2 n + 1), zeros before:
   H[c + d, c] at row c, column d. Returns whether H is positive definite. */
long long newton_step(long long waypoints, long long n, const double* smooth, const double* diagonal,
                      const double* coupling, const double* gradient, const double* held, double damping, double* band,
                      double* step) {
  long long width = 2 * n + 1, size = waypoints * n, k, i, j, c, d;
  for (k = 0; k < waypoints; ++k)
    for (j = 0; j < n; ++j) {
      double* column = band + width * (k * n + j);
      for (i = j; i < n; ++i) column[i - j] = diagonal[(k * n + i) * n + j];
      if (k + 1 < waypoints)
        for (i = 0; i < n; ++i) column[n + i - j] += coupling[(k * n + i) * n + j];
      column[0] = (column[0] + smooth[k]) * (1.0 + damping) + held[k * n + j];
      if (k + 1 < waypoints) column[n] += smooth[waypoints + k];
      if (k + 2 < waypoints) column[2 * n] += smooth[2 * waypoints + k];
      step[k * n + j] = held[k * n + j] > 0.0 ? 0.0 : -gradient[k * n + j];
    }
  for (c = 0; c < size; ++c) {  /* Cholesky, and the forward substitution on the way */
    double *column = band + width * c, pivot;
    long long below = size - c < width ? size - c : width;
    if (!(column[0] > 0.0)) return 0;
    pivot = 1.0 / sqrt(column[0]);
    column[0] = pivot;
    step[c] *= pivot;
    for (d = 1; d < below; ++d) column[d] *= pivot;
    for (i = 1; i < below; ++i) {
      const double factor = column[i], *__restrict__ from = column + i;
      double* __restrict__ to = band + width * (c + i);
      if (factor == 0.0) continue;
      for (d = 0; d < below - i; ++d) to[d] -= factor * from[d];
      step[c + i] -= factor * step[c];
    }
  }
  for (c = size - 1; c >= 0; --c) {
    const double* column = band + width * c;
    long long below = size - c < width ? size - c : width;
    double value = step[c];
    for (d = 1; d < below; ++d) value -= column[d] * step[c + d];
    step[c] = value * column[0];
  }
  return 1;
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loop; None without a C compiler."""
    return c_functions("newton_step", SOURCE)


def newton_step(problem: Problem, positions: Array, state: Evaluation, damping: float) -> Array:
    """Return the step as displacements of waypoints (N, n), zero at the ends."""
    interior, gradient, (lower, upper) = positions[1:-1], state.gradient, problem.robot.inner
    outward = ((interior >= upper) & (gradient < 0)) | ((interior <= lower) & (gradient > 0))
    step = np.zeros_like(positions)
    smooth = problem.smoothness.diagonals
    if loops := library():
        count, n = interior.shape
        band = np.zeros((count * n, 2 * n + 1))
        given = (smooth, state.diagonal, state.coupling, gradient, REST * outward)
        if not call(loops.newton_step, count, n, *given, damping, band, step[1:-1]):
            raise np.linalg.LinAlgError("the Hessian is not positive definite")
        return step
    step[1:-1] = _by_scipy(smooth, state, outward, damping)
    return step


def _by_scipy(smooth: Array, state: Evaluation, outward: Mask, damping: float) -> Array:
    from scipy.linalg import solveh_banded

    count, n = state.gradient.shape
    band = np.zeros((2 * n + 1, count * n))  # row d, column c holds H[c + d, c]
    for offset in range(min(3, count)):
        band[offset * n, : (count - offset) * n] = np.repeat(smooth[offset, : count - offset], n)
    within, between, (row, column) = _places(count, n)
    band.ravel()[within] += state.diagonal[:, row, column]
    band.ravel()[between] += state.coupling.reshape(-1, n * n)
    band[0] *= 1 + damping
    band[0] += REST * outward.ravel()
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
