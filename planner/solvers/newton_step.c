/* One damped Gauss-Newton step of a motion on a system that is banded in time, as in `newton_step.py`. */

#include <string.h>

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/cholesky.h"

/* The parts of H, for `waypoints` of n coordinates: the blocks of the penalty's curvature within waypoints and from
   each to the next; diagonals 0, 1 and 2 of the smoothness' Hessian (3, waypoints); and what is added to the diagonal
   (waypoints, n), more than 0 where a coordinate is held. */
typedef struct {
  long long waypoints, n;
  const double *smooth, *diagonal, *coupling, *held;
  double damping;
} hessian;

/* Column j of waypoint k, in rows 0 to 2 n below the diagonal. */
static void put_column(const hessian* of, long long k, long long j, double* column) {
  const long long n = of->n, waypoints = of->waypoints, last = waypoints - 1 - k;
  for (long long i = j; i < n; ++i) column[i - j] = of->diagonal[(k * n + i) * n + j];
  for (long long i = 0; last > 0 && i < n; ++i) column[n + i - j] += of->coupling[(k * n + i) * n + j];
  column[0] = (column[0] + of->smooth[k]) * (1.0 + of->damping) + of->held[k * n + j];
  if (last > 0) column[n] += of->smooth[waypoints + k];
  if (last > 1) column[2 * n] += of->smooth[2 * waypoints + k];
}

/* Solve H step = −gradient, with 0 where a coordinate is held. Returns whether H is positive definite. */
static int newton_step(const hessian* of, const double* gradient, double* band, double* step) {
  const long long width = 2 * of->n + 1, size = of->waypoints * of->n;
  memset(band, 0, (size_t)(size * width) * sizeof *band);
  for (long long c = 0; c < size; ++c) {
    put_column(of, c / of->n, c % of->n, band + width * c);
    step[c] = of->held[c] > 0.0 ? 0.0 : -gradient[c];
  }
  return solved(size, width, band, step);
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_newton_step) {
  arguments taken = begin("newton_step", given, count);
  const double* gradient = numbers(&taken, "gradient", SHAPE(ANY, ANY));
  const long long waypoints = taken.shape[0], n = taken.shape[1];
  hessian of = {.waypoints = waypoints, .n = n};
  of.smooth = numbers(&taken, "smooth", SHAPE(3, waypoints));
  of.diagonal = numbers(&taken, "diagonal", SHAPE(waypoints, n, n));
  of.coupling = numbers(&taken, "coupling", SHAPE(waypoints > 0 ? waypoints - 1 : 0, n, n));
  of.held = numbers(&taken, "held", SHAPE(waypoints, n));
  of.damping = number(&taken, "damping");
  double* step = written(&taken, "step", SHAPE(waypoints, n));
  double* band = scratch(&taken, waypoints * n * (2 * n + 1));
  int definite = 0;
  if (ready(&taken)) WITHOUT_LOCK(definite = newton_step(&of, gradient, band, step));
  return ended(&taken, PyBool_FromLong(definite));
}

PyMethodDef newton_step_functions[] = {
    FUNCTION("newton_step", call_newton_step, "Whether the Hessian is positive definite, and the step."),
    END_OF_FUNCTIONS,
};
