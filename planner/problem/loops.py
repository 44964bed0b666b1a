"""The loops of one evaluation in C: the hinge on the distance of close pairs, summed at their samples, and sums over
samples carried back to waypoints.

`clearance` and `samples` have the same in NumPy, for machines without a compiler; the two agree but for rounding, as
sums are taken in another order.
"""

from __future__ import annotations

import ctypes
import functools

import numpy as np

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.planner.collision import close_pairs
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows

SOURCE = """
typedef int kernel(const double** arg, double** res, long long* iw, double* w, int mem);

/* What stays: kernel number which[k] gives the distance of pair k; its planes are row plane_row[k], of plane_widths, of
   its table. */
typedef struct {
  long long n, body_width;
  const double *moves, *bodies;
  const long long *joint_a, *joint_b, *body, *which, *plane_row, *plane_widths;
  const double **planes;
} hinge;

typedef struct {
  const hinge* of;
  const void** machines;  /* of each kernel: itself, arg, res, iw, w */
  long long joints;
  const double *placements, *columns, *weight;
  double total, *slope, *gradient, *curvature, *depth;
} sums;

static void add(void* given, long long s, long long k) {
  sums* to = given;
  const hinge* of = to->of;
  long long n = of->n, c = of->which[k], i, j;
  const void** machine = to->machines + 5 * c;
  const double **arg = (const double**)machine[1], *moves = of->moves + n * k, *columns = to->columns + 6 * n * s;
  double **res = (double**)machine[2], distance, wrench[6], separation, weight, *slope = to->slope;
  arg[0] = to->placements + 12 * (s * to->joints + of->joint_a[k]);
  arg[1] = to->placements + 12 * (s * to->joints + of->joint_b[k]);
  arg[2] = of->bodies + of->body_width * of->body[k];
  arg[3] = of->planes[c] + of->plane_widths[c] * of->plane_row[k];
  res[0] = &distance;
  res[1] = wrench;
  res[2] = &separation;
  ((kernel*)machine[0])(arg, res, (long long*)machine[3], (double*)machine[4], 0);
  if (!(distance < 0.0)) return;
  if (-separation > to->depth[s]) to->depth[s] = -separation;
  if (!to->weight) return;
  weight = to->weight[s];
  to->total += 0.5 * weight * distance * distance;
  for (i = 0; i < n; ++i, columns += 6) {
    slope[i] = 0.0;
    if (moves[i] == 0.0) continue;
    for (j = 0; j < 6; ++j) slope[i] += columns[j] * wrench[j];
    slope[i] *= moves[i];
    to->gradient[s * n + i] += weight * distance * slope[i];
    for (j = 0; j <= i; ++j) {
      double product = weight * slope[i] * slope[j];
      to->curvature[(s * n + i) * n + j] += product;
      if (j < i) to->curvature[(s * n + j) * n + i] += product;
    }
  }
}

/* Returns ½ Σ weight min(D, 0)² over the close rows, −1 without memory; adds its gradient (batch, n) and Gauss-Newton
   curvature (batch, n, n), and puts the largest −D̃ of every sample into `depth`. Without weights, the last only. */
double penalties(const tables* t, const hinge* of, const void** machines, double least, long long batch,
                 long long joints, const double* placements, const double* columns, const double* weight,
                 double* slope, double* gradient, double* curvature, double* depth) {
  sums to;
  to.of = of; to.machines = machines; to.joints = joints;
  to.placements = placements; to.columns = columns; to.weight = weight;
  to.total = 0.0; to.slope = slope; to.gradient = gradient; to.curvature = curvature; to.depth = depth;
  if (visit(t, batch, joints, placements, 0, t->reach, least, add, &to)) return -1.0;
  return to.total;
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
    return c_functions("evaluation", close_pairs.SOURCE + SOURCE)


def hinge(pairs: BodyPairs, distance: HdsdfPairs) -> Record:
    """The C struct of that name: what stays from one evaluation to the next."""
    order = list(distance.kernels)
    tables = [pairs.plane_tables.get(count, np.empty((0, 4 * count))) for count in order]
    return Record(
        *(pairs.moves.shape[1], pairs.body_table.shape[1], pairs.moves, pairs.body_table),
        *(pairs.joint_a, pairs.joint_b, pairs.body, np.searchsorted(order, pairs.plane_slots), pairs.plane_row),
        *(np.array([table.shape[1] for table in tables], np.int64), Record(*tables)),
    )


def penalties(
    loops: ctypes.CDLL,
    pairs: BodyPairs,
    hinge: Record,
    distance: HdsdfPairs,
    kinematics: KinematicsBatch,
    weight: Array | None,
) -> tuple[float, Array, Array, Array]:
    """Return the cost of the pairs at samples, its gradient (B, n) and curvature (B, n, n), and the depth (B,) [m];
    without weights (B,) only the depth, and 0 and empty arrays for the others."""
    batch, n = kinematics.columns.shape[:2]
    asked = 0 if weight is None else batch
    gradient, curvature, depth = np.zeros((asked, n)), np.zeros((asked, n, n)), np.zeros(batch)
    machines = np.array([kernel.machine for kernel in distance.kernels.values()], np.int64)
    cost = call(
        loops.penalties,
        *(pairs.tables.struct, hinge.struct, machines, close_pairs.LEAST, batch, kinematics.placements.shape[1]),
        *(kinematics.placements, kinematics.columns, weight, np.empty(n), gradient, curvature, depth),
    )
    if cost < 0.0:
        raise MemoryError
    return float(cost), gradient, curvature, depth


def to_waypoints(
    loops: ctypes.CDLL, counts: Rows, fraction: Array, gradient: Array, curvature: Array
) -> tuple[Array, Array, Array]:
    """Return what `Samples.to_waypoints` returns."""
    intervals, n = len(counts), gradient.shape[1]
    slope, diagonal = np.zeros((intervals + 1, n)), np.zeros((intervals + 1, n, n))
    coupling = np.zeros((intervals, n, n))
    call(loops.to_waypoints, intervals, counts, fraction, n, gradient, curvature, slope, diagonal, coupling)
    return slope, diagonal, coupling
