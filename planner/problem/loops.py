"""The loops of one evaluation in C: the hinge on the distance of close pairs, summed at their samples, and sums over
samples carried back to waypoints.

`clearance` and `samples` have the same in NumPy, for machines without a compiler; the two agree but for rounding, as
sums are taken in another order.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence

import numpy as np

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.planner.collision import close_pairs, hdsdf_loop
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics import forward_loop
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.terms import Penalty
from hdplan.scenes.array_types import Array, Rows

SOURCE = """
typedef struct {
  const tables* t;
  long long n, gamma, joints, *moving;
  const double *moves, *placements, *columns, *weight;
  double length, total, *slope, *gradient, *curvature, *depth;
} sums;

static void add(void* given, long long s, long long k, double apart, projection* of) {
  sums* to = given;
  const tables* t = to->t;
  long long n = to->n, box = t->box[k], active = 0, i, j, *moving = to->moving;
  const double *moves = to->moves + n * k, *columns = to->columns + 6 * n * s, *placed = to->placements;
  double distance, wrench[6], weight, *slope = to->slope;
  if (apart > 0.0) return;
  if (-apart > to->depth[s]) to->depth[s] = -apart;
  if (!to->weight) return;
  distance = hdsdf(to->gamma, to->length, placed + 12 * (s * to->joints + t->joint_b[k]), t->slots,
                   t->table + (4 * t->slots + 1) * t->body[k] + 3 * t->slots, t->width[box], t->planes + t->first[box],
                   apart, of, wrench);
  weight = to->weight[s];
  to->total += 0.5 * weight * distance * distance;
  for (i = 0; i < n; ++i, columns += 6) {
    double along = 0.0;
    if (moves[i] == 0.0) continue;
    for (j = 0; j < 6; ++j) along += columns[j] * wrench[j];
    moving[active] = i;
    slope[active++] = along * moves[i];
    to->gradient[s * n + i] += weight * distance * along * moves[i];
  }
  for (i = 0; i < active; ++i)
    for (j = 0; j <= i; ++j) {
      double product = weight * slope[i] * slope[j];
      to->curvature[(s * n + moving[i]) * n + moving[j]] += product;
      if (j < i) to->curvature[(s * n + moving[j]) * n + moving[i]] += product;
    }
}

/* Returns ½ Σ weight min(D, 0)² over the close rows, −1 without memory; adds its gradient (batch, n) and Gauss-Newton
   curvature (batch, n, n), and puts the largest −D̃ of every sample into `depth`. Without weights, the last only. */
double penalties(const tables* t, long long gamma, double length, long long n, const double* moves, double least,
                 long long batch, long long joints, const double* placements, const double* columns,
                 const double* weight, long long* moving, double* slope, double* gradient, double* curvature,
                 double* depth) {
  sums to;
  to.t = t; to.gamma = gamma; to.length = length; to.n = n; to.moves = moves; to.joints = joints; to.moving = moving;
  to.placements = placements; to.columns = columns; to.weight = weight;
  to.total = 0.0; to.slope = slope; to.gradient = gradient; to.curvature = curvature; to.depth = depth;
  if (visit(t, batch, joints, placements, 0, t->reach, least, add, &to)) return -1.0;
  return to.total;
}

/* What stays of a motion that is evaluated: a robot, samples of `intervals` intervals, and terms of pairs. */
typedef struct {
  const tables* t;
  long long gamma;
  const double *length, *moves;
} term;
typedef struct {
  const tree* robot;
  long long intervals, batch, terms;
  const long long* counts;
  const double *fraction, *weight;
  const term** of;
} motion;

/* The `penalties` of all terms at the samples of waypoints (N, n), and the kinematics there, as `forward` gives it. */
double at_samples(const motion* m, double least, const double* positions, double* placements, double* columns,
                  double* gradient, double* curvature, double* depth) {
  long long n = m->robot->n, k, c, i;
  double *q = malloc((m->batch + 1) * n * sizeof(double)), *slope = q + m->batch * n, *to = q, total = 0.0;
  long long* moving = malloc(n * sizeof(long long));
  const double* fraction = m->fraction;
  if (q && moving) {
    for (k = 0; k < m->intervals; ++k, positions += n)
      for (c = 0; c < m->counts[k]; ++c, ++fraction)
        for (i = 0; i < n; ++i) *to++ = (1.0 - *fraction) * positions[i] + *fraction * positions[n + i];
    forward(m->robot, m->batch, q, placements, columns);
  }
  for (k = 0; k < m->terms && total >= 0.0; ++k) {
    const term* of = m->of[k];
    double found = !q || !moving ? -1.0
                                 : penalties(of->t, of->gamma, *of->length, n, of->moves, least, m->batch,
                                             m->robot->joints, placements, columns, m->weight, moving, slope, gradient,
                                             curvature, depth);
    total = found < 0.0 ? -1.0 : total + found;
  }
  free(q);
  free(moving);
  return total;
}

/* Sums over the samples at fractions of their intervals, counts[k] on interval k, as `Samples` says: of a gradient
   (batch, n) to waypoints (N, n), of a curvature (batch, n, n) to blocks (N, n, n) and between neighbours. */
void to_waypoints(long long intervals, const long long* counts, const double* fraction, long long n,
                  const double* gradient, const double* curvature, double* slope, double* diagonal,
                  double* coupling) {
  long long k, c, i;
  for (k = 0; k < intervals; ++k, slope += n, diagonal += n * n, coupling += n * n)
    for (c = 0; c < counts[k]; ++c, ++fraction, gradient += n, curvature += n * n) {
      double ahead = *fraction, behind = 1.0 - ahead;
      for (i = 0; i < n; ++i) {
        slope[i] += behind * gradient[i];
        slope[n + i] += ahead * gradient[i];
      }
      for (i = 0; i < n * n; ++i) {
        diagonal[i] += behind * behind * curvature[i];
        diagonal[n * n + i] += ahead * ahead * curvature[i];
        coupling[i] += ahead * behind * curvature[i];
      }
    }
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loops; None without a C compiler."""
    return c_functions("evaluation", forward_loop.SOURCE + close_pairs.SOURCE + hdsdf_loop.SOURCE + SOURCE)


def penalties(
    loops: ctypes.CDLL,
    pairs: BodyPairs,
    distance: HdsdfPairs,
    kinematics: KinematicsBatch,
    weight: Array | None,
) -> tuple[float, Array, Array, Array]:
    """Return the cost of the pairs at samples, its gradient (B, n) and curvature (B, n, n), and the depth (B,) [m];
    without weights (B,) only the depth, and 0 and empty arrays for the others."""
    batch, n = kinematics.columns.shape[:2]
    asked = 0 if weight is None else batch
    gradient, curvature, depth = np.zeros((asked, n)), np.zeros((asked, n, n)), np.zeros(batch)
    cost = call(
        loops.penalties,
        *(pairs.tables, distance.gamma, distance.shaping_length, n, pairs.moves, close_pairs.LEAST, batch),
        *(kinematics.placements.shape[1], kinematics.placements, kinematics.columns, weight),
        *(np.empty(n, np.int64), np.empty(n), gradient, curvature, depth),
    )
    if cost < 0.0:
        raise MemoryError
    return float(cost), gradient, curvature, depth


def term(pairs: BodyPairs, distance: HdsdfPairs) -> Record:
    """The C struct of that name."""
    length = np.array([distance.shaping_length])
    return Record(pairs.tables, distance.gamma, length, pairs.moves)


class AtSamples:
    """The penalties of terms of pairs at the samples of a robot's motion, and the kinematics there, in one call."""

    def __init__(
        self, kinematics: Kinematics, counts: Rows, fraction: Array, weight: Array, terms: Sequence[Record]
    ) -> None:
        """Take what stays: samples as `Samples` says, and a `term` for each."""
        self.shape = len(weight), kinematics.n, kinematics.nj
        self.record = Record(
            *(kinematics.tree, len(counts), len(weight), len(terms), counts, fraction, weight, Record(*terms))
        )

    def __call__(self, loops: ctypes.CDLL, positions: Array) -> tuple[KinematicsBatch, Penalty]:
        """Evaluate at waypoints (N, n)."""
        batch, n, joints = self.shape
        placements, columns = np.empty((batch, joints, 12)), np.empty((batch, n, 6))
        gradient, curvature, depth = np.zeros((batch, n)), np.zeros((batch, n, n)), np.zeros(batch)
        found = (placements, columns, gradient, curvature, depth)
        cost = call(loops.at_samples, self.record, close_pairs.LEAST, positions, *found)
        if cost < 0.0:
            raise MemoryError
        return KinematicsBatch(placements, columns), Penalty(float(cost), gradient, curvature, depth)


def to_waypoints(
    loops: ctypes.CDLL, counts: Rows, fraction: Array, gradient: Array, curvature: Array
) -> tuple[Array, Array, Array]:
    """Return what `Samples.to_waypoints` returns."""
    intervals, n = len(counts), gradient.shape[1]
    slope, diagonal = np.zeros((intervals + 1, n)), np.zeros((intervals + 1, n, n))
    coupling = np.zeros((intervals, n, n))
    call(loops.to_waypoints, intervals, counts, fraction, n, gradient, curvature, slope, diagonal, coupling)
    return slope, diagonal, coupling
