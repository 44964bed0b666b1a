"""The bounds of many pairs on many intervals, in loops of C: `Bounds.by_ball` and `Bounds.by_plane`.

To rounding the same as in NumPy, which machines without a compiler use. What is not a number stays so, and passes no
bound: a direction that is not finite has no support value.
"""

from __future__ import annotations

import ctypes
import functools
from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.scenes.array_types import Array, Rows

if TYPE_CHECKING:
    from hdplan.planner.certificate.intervals import Bodies, Intervals, Pairs

SOURCE = """
#include <math.h>

/* Bodies: of each, `number` vertices from row `first` on, and what sweeps them: a ball, a disc normal to z, an
   ellipsoid; half the size of its box, the radius of its ball; on interval k it has row `row` + k `step` of the places
   below. Pairs, and which coordinates move one of their bodies and not the other (pairs, n). `turns` tells of every
   coordinate whether it turns. */
typedef struct {
  long long n;
  const long long *turns, *a, *b, *moves_a, *moves_b, *first, *number, *row, *step;
  const double *vertices, *ball, *disc, *radii, *half, *radius;
} world;

/* The intervals, as `Intervals` says; the last four are null where nothing drifts. */
typedef struct {
  const double *rotation, *origin, *center, *reach, *delta, *deviation, *axes, *points;
  const double *drift_omega, *drift_velocity, *drift_first, *drift_second;
} intervals;

typedef struct {
  double omega[3], velocity[3], first, second;
} motion;

/* What is not a number stays so, and proves nothing. */
static double least(double a, double b) { return a != a || a < b ? a : b; }
static double most(double a, double b) { return a != a || a > b ? a : b; }

static double travel(const world* w, const intervals* at, long long k, long long row, const long long* moves) {
  const double *reach = at->reach + row * w->n, *d = at->delta + k * w->n, *e = at->deviation + k * w->n;
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
    long long row = w->row[a] + k * w->step[a], other_row = w->row[b] + k * w->step[b];
    const double *turn = at->rotation + 9 * other_row, *half = w->half + 3 * b;
    const double *ours = at->center + 3 * row, *other = at->center + 3 * other_row;
    double gap[3], local[3], away[3], square = 0.0, length, *out;
    for (c = 0; c < 3; ++c) gap[c] = ours[c] - other[c];
    for (c = 0; c < 3; ++c) {
      double x = turn[c] * gap[0] + turn[3 + c] * gap[1] + turn[6 + c] * gap[2];
      local[c] = x;
      away[c] = x - (x < -half[c] ? -half[c] : (x > half[c] ? half[c] : x));
      square += away[c] * away[c];
    }
    bound[i] = sqrt(square) - w->radius[a] - travel(w, at, k, row, w->moves_a + p * w->n) -
               travel(w, at, k, other_row, w->moves_b + p * w->n);
    out = square == 0.0 ? local : away;
    for (c = 0; c < 3; ++c) normal[c] = turn[3 * c] * out[0] + turn[3 * c + 1] * out[1] + turn[3 * c + 2] * out[2];
    length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (c = 0; c < 3; ++c) normal[c] = length > 0.0 ? normal[c] / length : (c == 2 ? 1.0 : 0.0);
  }
}

/* The motion of the body in a row of the places, due to the joints that `moves` names and to its own drift. */
static motion motion_of(const world* w, const intervals* at, long long k, long long row, const long long* moves) {
  const double *reach = at->reach + row * w->n, *d = at->delta + k * w->n, *e = at->deviation + k * w->n;
  double total = 0.0, leaving = 0.0, bend = 0.0, before = 0.0;
  long long j, n = w->n;
  int c;
  motion found = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 0.0, 0.0};
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
      for (c = 0; c < 3; ++c) found.omega[c] += d[j] * z[c];
      found.velocity[0] += d[j] * (o[1] * z[2] - o[2] * z[1]);
      found.velocity[1] += d[j] * (o[2] * z[0] - o[0] * z[2]);
      found.velocity[2] += d[j] * (o[0] * z[1] - o[1] * z[0]);
    } else {
      for (c = 0; c < 3; ++c) found.velocity[c] += d[j] * z[c];
    }
  }
  found.first = total + leaving;
  found.second = 0.5 * bend + leaving;
  if (at->drift_omega) {
    for (c = 0; c < 3; ++c) {
      found.omega[c] += at->drift_omega[3 * row + c];
      found.velocity[c] += at->drift_velocity[3 * row + c];
    }
    found.first += at->drift_first[row];
    found.second += at->drift_second[row];
  }
  return found;
}

static double support(const world* w, long long b, double x, double y, double z) {
  const double *v = w->vertices + 3 * w->first[b], *end = v + 3 * w->number[b], *r = w->radii + 3 * b;
  double best = x * v[0] + y * v[1] + z * v[2];
  for (v += 3; v < end; v += 3) {
    double along = x * v[0] + y * v[1] + z * v[2];
    best = along > best ? along : best;
  }
  best += w->ball[b] * sqrt(x * x + y * y + z * z) + w->disc[b] * sqrt(x * x + y * y);
  return best + sqrt(r[0] * x * r[0] * x + r[1] * y * r[1] * y + r[2] * z * r[2] * z);
}

/* max n·(x + s x') over the points x of a body, x' = omega × x + velocity, for s = 0, 1, −1. */
static void extremes(const world* w, const intervals* at, long long body, long long row, const double* n,
                     const motion* by, double* values) {
  const double *u = by->velocity, *v = by->omega, *o = at->origin + 3 * row, *turn = at->rotation + 9 * row;
  double across[3];
  int s, j;
  across[0] = n[1] * v[2] - n[2] * v[1];
  across[1] = n[2] * v[0] - n[0] * v[2];
  across[2] = n[0] * v[1] - n[1] * v[0];
  for (s = 0; s < 3; ++s) {
    double d[3], local[3], value = s ? (s == 1 ? 1.0 : -1.0) * (n[0] * u[0] + n[1] * u[1] + n[2] * u[2]) : 0.0;
    for (j = 0; j < 3; ++j) d[j] = s ? (s == 1 ? n[j] + across[j] : n[j] - across[j]) : n[j];
    for (j = 0; j < 3; ++j) local[j] = turn[j] * d[0] + turn[3 + j] * d[1] + turn[6 + j] * d[2];
    value += d[0] * o[0] + d[1] * o[1] + d[2] * o[2];
    value += support(w, body, local[0], local[1], local[2]);
    if (!(local[0] - local[0] == 0.0 && local[1] - local[1] == 0.0 && local[2] - local[2] == 0.0)) value = NAN;
    values[s] = value;
  }
}

/* Between parallel planes normal to a direction from the second body of each item's pair to the first: their distance
   at the midpoint, the bound over the interval, and how far the two bodies move at most. */
void by_plane(const world* w, const intervals* at, long long items, const long long* node, const long long* pair,
              const double* normal, double* gap, double* bound, double* travels) {
  long long i;
  for (i = 0; i < items; ++i, normal += 3) {
    long long k = node[i], p = pair[i], a = w->a[p], b = w->b[p];
    long long row = w->row[a] + k * w->step[a], other = w->row[b] + k * w->step[b];
    motion ours = motion_of(w, at, k, row, w->moves_a + p * w->n);
    motion theirs = motion_of(w, at, k, other, w->moves_b + p * w->n);
    double back[3], near[3], far[3], gaps[3], moved;
    int s;
    for (s = 0; s < 3; ++s) back[s] = -normal[s];
    extremes(w, at, a, row, back, &ours, near);
    extremes(w, at, b, other, normal, &theirs, far);
    for (s = 0; s < 3; ++s) gaps[s] = -near[s] - far[s];
    moved = ours.first + theirs.first;
    gap[i] = gaps[0];
    bound[i] = most(least(gaps[1], gaps[2]) - (ours.second + theirs.second), gaps[0] - moved);
    travels[i] = moved;
  }
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loops; None without a C compiler."""
    return c_functions("bounds", SOURCE)


def world(bodies: Bodies, pairs: Pairs) -> Record:
    """The C struct of that name."""
    pieces = bodies.pieces
    number, none = np.array([len(piece.vertices) for piece in pieces], np.int64), np.zeros(3)
    whole = (bodies.chain.revolute, pairs.a, pairs.b, pairs.moves_a, pairs.moves_b)
    return Record(
        len(bodies.chain.axes),
        *(each.astype(np.int64) for each in (*whole, np.cumsum(number) - number, number, bodies.row, bodies.step)),
        np.concatenate([np.empty((0, 3)), *(piece.vertices for piece in pieces)]),
        *(np.array([piece.ball for piece in pieces]), np.array([piece.disc for piece in pieces])),
        np.array([none if piece.radii is None else piece.radii for piece in pieces]),
        *(bodies.half, bodies.radius),
    )


def intervals(nodes: Intervals) -> Record:
    """The C struct of that name."""
    drift = nodes.drift
    return Record(
        *(nodes.rotation, nodes.origin, nodes.center, nodes.reach),
        *(nodes.delta, nodes.deviation, nodes.axes, nodes.points),
        *((0,) * 4 if drift is None else (drift.omega, drift.velocity, drift.first, drift.second)),
    )


def by_ball(loops: ctypes.CDLL, world: Record, nodes: Record, node: Rows, pair: Rows) -> tuple[Array, Array]:
    """Return a bound (i,) without what bodies drift and rounding may take, and the directions (i, 3)."""
    bound, normal = np.empty(len(node)), np.empty((len(node), 3))
    call(loops.by_ball, world, nodes, len(node), node, pair, bound, normal)
    return bound, normal


def by_plane(
    loops: ctypes.CDLL, world: Record, nodes: Record, node: Rows, pair: Rows, normal: Array
) -> tuple[Array, Array, Array]:
    """Return gap(n) (i,), the bound over the interval without what rounding may take, and the bodies' travel (i,)."""
    gap, bound, travel = np.empty((3, len(node)))
    call(loops.by_plane, world, nodes, len(node), node, pair, normal, gap, bound, travel)
    return gap, bound, travel
