/* One damped Gauss-Newton step of a motion on a system that is banded in time: `newton_step.py` says what it is. */

#include <math.h>
#include <stdlib.h>

#include "../../distance/compiled/border.h"

/* Solves H step = −gradient for M waypoints of n coordinates, H as the module says; `smooth` (3, M) are diagonals 0, 1
   and 2 of the smoothness' Hessian, `held` (M, n) what is added to the diagonal. `band` (M n, 2 n + 1), zeros before:
   H[c + d, c] at row c, column d. Returns whether H is positive definite. */
static int newton_step(long long waypoints, long long n, const double* smooth, const double* diagonal,
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
      const double factor = column[i], *restrict from = column + i;
      double* restrict to = band + width * (c + i);
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

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* call_newton_step(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("newton_step", given, count);
  const double* gradient = numbers(&c, "gradient", SHAPE(ANY, ANY));
  long long waypoints = c.shape[0], n = c.shape[1];
  const double* smooth = numbers(&c, "smooth", SHAPE(3, waypoints));
  const double* diagonal = numbers(&c, "diagonal", SHAPE(waypoints, n, n));
  const double* coupling = numbers(&c, "coupling", SHAPE(waypoints - 1, n, n));
  const double* held = numbers(&c, "held", SHAPE(waypoints, n));
  double damping = number(&c, "damping");
  double *step = written(&c, "step", SHAPE(waypoints, n)), *band = NULL;
  int definite = 0;
  (void)self;
  if (ready(&c)) {
    band = calloc((size_t)(waypoints * n * (2 * n + 1) + 1), sizeof(double));
    if (band)
      WITHOUT_LOCK(definite = newton_step(waypoints, n, smooth, diagonal, coupling, gradient, held, damping, band, step));
    else
      c.failed = 1, no_memory();
    free(band);
  }
  return ended(&c, PyBool_FromLong(definite));
}

PyMethodDef newton_step_functions[] = {
    FUNCTION("newton_step", call_newton_step, "Whether the Hessian is positive definite, and the step."),
    END_OF_FUNCTIONS,
};
