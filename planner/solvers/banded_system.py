"""Cholesky's solution of a symmetric positive definite system with a band, in one loop of C.

As LAPACK's `pbsv`, to rounding, which machines without a compiler use: to load SciPy takes longer than to plan.
"""

from __future__ import annotations

import ctypes
import functools

import numpy as np

from hdplan.distance.compiled.c_library import c_functions, call
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy

SOURCE = """
#include <math.h>

/* Overwrites the columns (size, width) of the lower band by those of the factor, and x (size,) by the solution. Returns
   0, or 1 if the system is not positive definite. */
long long solve_banded(long long size, long long width, double* columns, double* x) {
  long long c, i, j;
  for (c = 0; c < size; ++c) {
    double *column = columns + c * width, pivot = sqrt(column[0]);
    long long below = size - c < width ? size - c : width;
    if (!(column[0] > 0.0)) return 1;
    column[0] = pivot;
    for (i = 1; i < below; ++i) column[i] /= pivot;
    x[c] /= pivot;
    for (j = 1; j < below; ++j) {
      double *after = column + j * width, factor = column[j];
      for (i = 0; i < below - j; ++i) after[i] -= factor * column[j + i];
      x[c + j] -= factor * x[c];
    }
  }
  for (c = size - 1; c >= 0; --c) {
    const double* column = columns + c * width;
    long long below = size - c < width ? size - c : width;
    double value = x[c];
    for (i = 1; i < below; ++i) value -= column[i] * x[c + i];
    x[c] = value / column[0];
  }
  return 0;
}
"""


@functools.cache
def _library() -> ctypes.CDLL | None:
    return c_functions("banded_system", SOURCE)


def solve_banded(band: Array, right: Array) -> Array:
    """Return x (size,) with H x = right, for the lower band (width, size) of H: row d, column c holds H[c + d, c].

    Raises LinAlgError if H is not positive definite.
    """
    loops = _library()
    if loops is None:
        return np.asarray(scipy.linalg.solveh_banded(band, right, lower=True, check_finite=False))
    columns, solution = np.array(band.T, order="C"), right.copy()
    if call(loops.solve_banded, band.shape[1], band.shape[0], columns, solution):
        raise np.linalg.LinAlgError("the banded system is not positive definite")
    return solution
