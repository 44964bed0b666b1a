"""The cheap bounds of many pairs on many intervals, in loops of C: `Bounds.by_ball`, and the bodies' `Motion`.

To rounding the same as in NumPy, which machines without a compiler use. What is not a number stays so, and passes no
bound.
"""

from __future__ import annotations

import ctypes
import functools
from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.planner.motion.motion_bounds import Motion
from hdplan.scenes.array_types import Array, Rows

if TYPE_CHECKING:
    from hdplan.planner.certificate.intervals import Bodies, Intervals, Pairs

SOURCE = """
#include <math.h>

/* Bodies and pairs: `turns` tells of every coordinate whether it turns; moves (pairs, n) which of them move one body of
   a pair and not the other. */
typedef struct {
  long long bodies, n;
  const long long *turns, *a, *b, *moves_a, *moves_b;
  const double *half, *radius;
} world;

/* The intervals, as `Intervals` says. */
typedef struct {
  const double *rotation, *center, *delta, *deviation, *axes, *points, *reach;
} intervals;

static double travel(const world* w, const intervals* at, long long k, long long body, const long long* moves) {
  const double *reach = at->reach + (k * w->bodies + body) * w->n;
  const double *d = at->delta + k * w->n, *e = at->deviation + k * w->n;
  double total = 0.0;
  long long j;
  for (j = 0; j < w->n; ++j) if (moves[j]) total += (fabs(d[j]) + e[j]) * reach[j];
  return total;
}

/* From the ball around the first body of each item's pair to the box of the second: the distance, less radius and
   travel, and its direction. */
void by_ball(const world* w, const intervals* at, long long items, const long long* node, const long long* pair,
             double* bound, double* normal) {
  long long i;
  int c;
  for (i = 0; i < items; ++i, normal += 3) {
    long long k = node[i], p = pair[i], a = w->a[p], b = w->b[p];
    const double *turn = at->rotation + 9 * (k * w->bodies + b), *half = w->half + 3 * b;
    const double *ours = at->center + 3 * (k * w->bodies + a), *other = at->center + 3 * (k * w->bodies + b);
    double gap[3], local[3], away[3], square = 0.0, length, *out;
    for (c = 0; c < 3; ++c) gap[c] = ours[c] - other[c];
    for (c = 0; c < 3; ++c) {
      double x = turn[c] * gap[0] + turn[3 + c] * gap[1] + turn[6 + c] * gap[2];
      local[c] = x;
      away[c] = x - (x < -half[c] ? -half[c] : (x > half[c] ? half[c] : x));
      square += away[c] * away[c];
    }
    bound[i] = sqrt(square) - w->radius[a] - travel(w, at, k, a, w->moves_a + p * w->n) -
               travel(w, at, k, b, w->moves_b + p * w->n);
    out = square == 0.0 ? local : away;
    for (c = 0; c < 3; ++c) normal[c] = turn[3 * c] * out[0] + turn[3 * c + 1] * out[1] + turn[3 * c + 2] * out[2];
    length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (c = 0; c < 3; ++c) normal[c] = length > 0.0 ? normal[c] / length : (c == 2 ? 1.0 : 0.0);
  }
}

/* The motion of a body of each item's pair due to the joints that move it alone: of the second body, or the first. */
void motions(const world* w, const intervals* at, long long items, const long long* node, const long long* pair,
             long long second, double* omega, double* velocity, double* first_order, double* second_order) {
  long long i, j, n = w->n;
  int c;
  for (i = 0; i < items; ++i, omega += 3, velocity += 3) {
    long long k = node[i], p = pair[i], body = second ? w->b[p] : w->a[p];
    const long long* moves = (second ? w->moves_b : w->moves_a) + p * n;
    const double *reach = at->reach + (k * w->bodies + body) * n, *d = at->delta + k * n, *e = at->deviation + k * n;
    double total = 0.0, leaving = 0.0, bend = 0.0, before = 0.0;
    for (c = 0; c < 3; ++c) omega[c] = velocity[c] = 0.0;
    for (j = 0; j < n; ++j) {
      const double *z = at->axes + 3 * (k * n + j), *o = at->points + 3 * (k * n + j);
      double speed, turn = w->turns[j] ? fabs(d[j]) : 0.0;
      if (!moves[j]) continue;
      speed = fabs(d[j]) * reach[j];
      leaving += e[j] * reach[j];
      total += speed;
      bend += speed * (turn + 2.0 * before);
      before += turn;
      if (w->turns[j]) {
        for (c = 0; c < 3; ++c) omega[c] += d[j] * z[c];
        velocity[0] += d[j] * (o[1] * z[2] - o[2] * z[1]);
        velocity[1] += d[j] * (o[2] * z[0] - o[0] * z[2]);
        velocity[2] += d[j] * (o[0] * z[1] - o[1] * z[0]);
      } else {
        for (c = 0; c < 3; ++c) velocity[c] += d[j] * z[c];
      }
    }
    first_order[i] = total + leaving;
    second_order[i] = 0.5 * bend + leaving;
  }
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loops; None without a C compiler."""
    return c_functions("bounds", SOURCE)


def world(bodies: Bodies, pairs: Pairs) -> Record:
    """The C struct of that name."""
    whole = (bodies.chain.revolute, pairs.a, pairs.b, pairs.moves_a, pairs.moves_b)
    counts = (len(bodies.bodies), len(bodies.chain.axes))
    return Record(*counts, *(each.astype(np.int64) for each in whole), bodies.half, bodies.radius)


def intervals(nodes: Intervals) -> Record:
    """The C struct of that name."""
    return Record(
        *(nodes.rotation, nodes.center, nodes.delta, nodes.deviation, nodes.axes, nodes.points, nodes.reach),
    )


def by_ball(loops: ctypes.CDLL, world: Record, nodes: Record, node: Rows, pair: Rows) -> tuple[Array, Array]:
    """Return a bound (i,) without what bodies drift and rounding may take, and the directions (i, 3)."""
    bound, normal = np.empty(len(node)), np.empty((len(node), 3))
    call(loops.by_ball, world.struct, nodes.struct, len(node), node, pair, bound, normal)
    return bound, normal


def motion(loops: ctypes.CDLL, world: Record, nodes: Record, node: Rows, pair: Rows, second: bool) -> Motion:
    """Return the motion (i,) of the first or the second body of each pair, without what bodies drift."""
    count = len(node)
    found = (np.empty((count, 3)), np.empty((count, 3)), np.empty(count), np.empty(count))
    call(loops.motions, world.struct, nodes.struct, count, node, pair, int(second), *found)
    return Motion(*found)
