"""The support values of many pieces on many intervals, in one loop of C: what `Bounds.by_plane` asks of them.

As `Piece.support` in NumPy, which machines without a compiler use. A direction that is not finite has no support value:
NaN, which no bound passes.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.planner.certificate.exact_proximity import Piece

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SOURCE = """
#include <math.h>

/* The pieces: of each, `number` vertices from row `first` on, and what sweeps them: a ball, a disc normal to z, an
   ellipsoid. */
typedef struct {
  long long count;
  const long long *first, *number;
  const double *vertices, *ball, *disc, *radii;
} pieces;

static double support(const pieces* p, long long b, double x, double y, double z) {
  const double *v = p->vertices + 3 * p->first[b], *end = v + 3 * p->number[b], *r = p->radii + 3 * b;
  double best = x * v[0] + y * v[1] + z * v[2];
  for (v += 3; v < end; v += 3) {
    double along = x * v[0] + y * v[1] + z * v[2];
    best = along > best ? along : best;
  }
  best += p->ball[b] * sqrt(x * x + y * y + z * z) + p->disc[b] * sqrt(x * x + y * y);
  return best + sqrt(r[0] * x * r[0] * x + r[1] * y * r[1] * y + r[2] * z * r[2] * z);
}

/* max n·(x + s x') over the points x of bodies, x' = omega × x + velocity, for s = 0, 1, −1: (3, items). */
void extremes(const pieces* p, long long items, const long long* node, const long long* body, const double* rotation,
              const double* origin, const double* normal, const double* omega, const double* velocity,
              double* values) {
  long long i;
  int s, j;
  for (i = 0; i < items; ++i) {
    long long at = node[i] * p->count + body[i];
    const double *n = normal + 3 * i, *w = omega + 3 * i, *u = velocity + 3 * i, *o = origin + 3 * at;
    const double *turn = rotation + 9 * at;
    double across[3];
    across[0] = n[1] * w[2] - n[2] * w[1];
    across[1] = n[2] * w[0] - n[0] * w[2];
    across[2] = n[0] * w[1] - n[1] * w[0];
    for (s = 0; s < 3; ++s) {
      double d[3], local[3], value = s ? (s == 1 ? 1.0 : -1.0) * (n[0] * u[0] + n[1] * u[1] + n[2] * u[2]) : 0.0;
      for (j = 0; j < 3; ++j) d[j] = s ? (s == 1 ? n[j] + across[j] : n[j] - across[j]) : n[j];
      for (j = 0; j < 3; ++j) local[j] = turn[j] * d[0] + turn[3 + j] * d[1] + turn[6 + j] * d[2];
      value += d[0] * o[0] + d[1] * o[1] + d[2] * o[2];
      value += support(p, body[i], local[0], local[1], local[2]);
      if (!(local[0] - local[0] == 0.0 && local[1] - local[1] == 0.0 && local[2] - local[2] == 0.0)) value = NAN;
      values[s * items + i] = value;
    }
  }
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loop; None without a C compiler."""
    return c_functions("supports", SOURCE)


def record(pieces: Sequence[Piece]) -> Record:
    """The C struct `pieces`."""
    number = np.array([len(piece.vertices) for piece in pieces], np.int64)
    none = np.zeros(3)
    return Record(
        *(len(pieces), np.cumsum(number) - number, number, np.concatenate([piece.vertices for piece in pieces])),
        *(np.array([piece.ball for piece in pieces]), np.array([piece.disc for piece in pieces])),
        np.array([none if piece.radii is None else piece.radii for piece in pieces]),
    )


def extremes(
    loops: ctypes.CDLL,
    pieces: Record,
    node: Index,
    body: Index,
    rotation: Array,
    origin: Array,
    normal: Array,
    omega: Array,
    velocity: Array,
) -> Array:
    """Return max_{x ∈ body} n·(x + s (Ω × x + U)) for s = 0, 1, −1: (3, i).

    Rotations (k, g, 3, 3) and origins (k, g, 3) are those of all bodies at all nodes, the others (i, ·) of the items.
    """
    values = np.empty((3, len(node)))
    call(loops.extremes, pieces.struct, len(node), node, body, rotation, origin, normal, omega, velocity, values)
    return values
