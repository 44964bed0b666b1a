"""The reach ρ of many bodies in loops of C: `Chain.reach_around` and `Chain.local_reach`, to rounding the same."""

from __future__ import annotations

import ctypes
import functools

import numpy as np

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.scenes.array_types import Array, Rows

SOURCE = """
#include <math.h>

/* A tree of n joints: joint j + 1 moves coordinate j, turning or sliding; of each joint (0: the world) its parent,
   which coordinates carry it, and nine numbers of the way to its parent, as `Chain._inward` says. */
typedef struct {
  long long n;
  const long long *parents, *revolute, *carried;
  const double* inward;
} chain;

static double larger(double a, double b) { return a > b ? a : b; }
static double length(double x, double y, double z) { return sqrt(x * x + y * y + z * z); }

/* rho (bodies, n), zeros before, of bodies in cylinders (bodies, 3) on joints; travel (n, 2) of every coordinate. */
void reach_around(const chain* of, long long bodies, const long long* joints, const double* cylinders,
                  const double* travel, double* rho) {
  long long g;
  for (g = 0; g < bodies; ++g, rho += of->n, cylinders += 3) {
    double wide = cylinders[0], low = cylinders[1], high = cylinders[2];
    long long joint = joints[g];
    while (joint > 0) {
      const double *w = of->inward + 9 * joint, *beside = w + 2, *out = w + 5;
      double tilt = w[8] * wide, one, other;
      long long j = joint - 1;
      rho[j] = of->revolute[j] ? wide : 1.0;
      if (!of->revolute[j]) {
        low += travel[2 * j];
        high += travel[2 * j + 1];
      }
      wide += larger(length(beside[0] + low * out[0], beside[1] + low * out[1], beside[2] + low * out[2]),
                     length(beside[0] + high * out[0], beside[1] + high * out[1], beside[2] + high * out[2]));
      one = w[0] + w[1] * low;
      other = w[0] + w[1] * high;
      low = (one < other ? one : other) - tilt;
      high = (one < other ? other : one) + tilt;
      joint = of->parents[joint];
    }
  }
}

/* The smaller of rho (bodies, n) and what the bounding balls allow on each of `count` intervals: (count, bodies, n),
   zeros before, which are not touched where nothing moves: so they take no memory. */
void local_reach(const chain* of, long long count, long long bodies, const long long* joints, const double* rho,
                 const double* centers, const double* radii, const double* axes, const double* origins,
                 const double* half, double* local) {
  long long k, g, j, n = of->n;
  for (k = 0; k < count; ++k, axes += 3 * n, origins += 3 * n, half += n)
    for (g = 0; g < bodies; ++g, centers += 3, local += n) {
      const double* most = rho + n * g;
      double after = 0.0;
      if (joints[g] == 0) continue;
      for (j = n - 1; j >= 0; --j) {
        const double *a = axes + 3 * j, *o = origins + 3 * j;
        if (!of->carried[n * joints[g] + j]) continue;
        local[j] = 1.0;
        if (of->revolute[j]) {
          double x = centers[0] - o[0], y = centers[1] - o[1], z = centers[2] - o[2];
          double away = length(y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]) + radii[g] + after;
          local[j] = away >= most[j] ? most[j] : away;  /* what is not a number stays so, and proves nothing */
        }
        after += half[j] * local[j];
      }
    }
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loops; None without a C compiler."""
    return c_functions("reach", SOURCE)


def reach_around(loops: ctypes.CDLL, chain: Record, joints: Rows, cylinders: Array, travel: Array) -> Array:
    """Return what `Chain.reach_around` returns."""
    rho = np.zeros((len(joints), len(travel)))
    call(loops.reach_around, chain, len(joints), joints, cylinders, travel, rho)
    return rho


def local_reach(loops: ctypes.CDLL, chain: Record, joints: Rows, rho: Array, at: tuple[Array, ...]) -> Array:
    """Return what `Chain.local_reach` returns; `at`: its centers, radii, axes, origins and half."""
    count = len(at[0])
    local = np.zeros((count, *rho.shape))
    call(loops.local_reach, chain, count, len(rho), joints, rho, *at, local)
    return local
