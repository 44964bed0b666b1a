"""The forward kinematics of many configurations in one loop of C: the recursion of `forward`, to rounding the same."""

from __future__ import annotations

import ctypes
import functools

import numpy as np

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.scenes.array_types import Array

SOURCE = """
#include <math.h>

/* A tree of joints, each with one coordinate: joint i + 1 turns about axis i or slides along it, and is placed by row i
   (rotation row by row, then origin) on its parent. */
typedef struct {
  long long joints, n;  /* the world is joint 0 */
  const long long *parents, *coordinates, *turns;
  const double *placed, *axes;
} tree;

/* Placements (batch, joints, 12) and columns (batch, n, 6) at configurations (batch, n). */
void forward(const tree* t, long long batch, const double* q, double* placements, double* columns) {
  long long s, k;
  int i, j;
  for (s = 0; s < batch; ++s, q += t->n, placements += 12 * t->joints, columns += 6 * t->n) {
    for (i = 0; i < 12; ++i) placements[i] = i == 0 || i == 4 || i == 8 ? 1.0 : 0.0;
    for (k = 1; k < t->joints; ++k) {
      const double *on = placements + 12 * t->parents[k - 1], *x = t->placed + 12 * (k - 1), *a = t->axes + 3 * (k - 1);
      double *found = placements + 12 * k, *column = columns + 6 * t->coordinates[k - 1], turn[9], d[3], *o = found + 9;
      double value = q[t->coordinates[k - 1]];
      for (i = 0; i < 3; ++i) {
        for (j = 0; j < 3; ++j)
          turn[3 * i + j] = on[3 * i] * x[j] + on[3 * i + 1] * x[3 + j] + on[3 * i + 2] * x[6 + j];
        o[i] = on[9 + i] + (on[3 * i] * x[9] + on[3 * i + 1] * x[10] + on[3 * i + 2] * x[11]);
      }
      for (i = 0; i < 3; ++i) d[i] = turn[3 * i] * a[0] + turn[3 * i + 1] * a[1] + turn[3 * i + 2] * a[2];
      if (t->turns[k - 1]) {  /* Rodrigues: a aᵀ + cos q (I − a aᵀ) + sin q [a]× */
        double c = cos(value), n = sin(value), m[9];
        for (i = 0; i < 3; ++i)
          for (j = 0; j < 3; ++j) m[3 * i + j] = a[i] * a[j] + c * ((i == j ? 1.0 : 0.0) - a[i] * a[j]);
        m[1] -= n * a[2]; m[2] += n * a[1]; m[3] += n * a[2]; m[5] -= n * a[0]; m[6] -= n * a[1]; m[7] += n * a[0];
        for (i = 0; i < 3; ++i)
          for (j = 0; j < 3; ++j)
            found[3 * i + j] = turn[3 * i] * m[j] + turn[3 * i + 1] * m[3 + j] + turn[3 * i + 2] * m[6 + j];
        column[0] = o[1] * d[2] - o[2] * d[1];
        column[1] = o[2] * d[0] - o[0] * d[2];
        column[2] = o[0] * d[1] - o[1] * d[0];
        for (i = 0; i < 3; ++i) column[3 + i] = d[i];
      } else {
        for (i = 0; i < 9; ++i) found[i] = turn[i];
        for (i = 0; i < 3; ++i) {
          column[i] = d[i];
          column[3 + i] = 0.0;
          o[i] += d[i] * value;
        }
      }
    }
  }
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loop; None without a C compiler."""
    return c_functions("forward", SOURCE)


def forward(loops: ctypes.CDLL, tree: Record, q: Array, joints: int) -> tuple[Array, Array]:
    """Return placements (B, joints, 12) and columns (B, n, 6) at configurations (B, n)."""
    batch, n = q.shape
    placements, columns = np.empty((batch, joints, 12)), np.empty((batch, n, 6))
    call(loops.forward, tree, batch, q, placements, columns)
    return placements, columns
