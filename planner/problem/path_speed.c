/* The cost of a motion's path speed, with derivatives: `path_speed.py` defines it, and computes it in NumPy, equal but for
   rounding. */

#include <math.h>

#include "../../distance/compiled/border.h"

/* Add the share of one step x (n), weighted by joints, to the gradients at its two ends and to the blocks (n, n) of both
   and between them. Returns ‖x‖_p². */
static double add_step(long long n, const double* x, const double* shares, double scale, double* direction,
                       double* slender, double* gradient, double* diagonal, double* coupling) {
  double largest = 0.0, total = 0.0;
  for (long long i = 0; i < n; ++i)
    if (fabs(x[i]) > largest) largest = fabs(x[i]);
  for (long long i = 0; i < n; ++i) {
    const double ratio = largest > 0.0 ? fabs(x[i]) / largest : 1.0, square = ratio * ratio, fourth = square * square;
    slender[i] = fourth * fourth * fourth * square; /* the power p − 2 */
    direction[i] = x[i] > 0.0 ? slender[i] * ratio : x[i] < 0.0 ? -slender[i] * ratio : 0.0;
    total += slender[i] * square;
  }
  const double root = sqrt(sqrt(sqrt(total))), outer = root / total, length = largest * sqrt(root); /* p = 16 */
  for (long long i = 0; i < n; ++i) {
    const double slope = scale * largest * outer * direction[i] * shares[i];
    gradient[i] -= slope;
    gradient[n + i] += slope;
    for (long long j = 0; j < n; ++j) {
      double second_order = -14.0 / total * direction[i] * direction[j];
      if (i == j) second_order += 15.0 * slender[i];
      second_order *= scale * outer * shares[i] * shares[j];
      diagonal[i * n + j] += second_order;
      diagonal[n * n + i * n + j] += second_order;
      coupling[i * n + j] = -second_order;
    }
  }
  return length * length;
}

/* The cost at waypoints (count, n), its gradient and the blocks (count, n, n) and (count − 1, n, n) of its Hessian. */
static double path_speed(long long count, long long n, const double* positions, const double* shares, double* work,
                   double* gradient, double* diagonal, double* coupling) {
  const double scale = (double)(count - 1);
  double total = 0.0;
  for (long long k = 0; k < count - 1; ++k) {
    const double *here = positions + k * n, *then = here + n;
    for (long long i = 0; i < n; ++i) work[i] = (then[i] - here[i]) * shares[i];
    total += add_step(n, work, shares, scale, work + n, work + 2 * n, gradient + k * n, diagonal + k * n * n,
                      coupling + k * n * n);
  }
  return 0.5 * scale * total;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_path_speed) {
  arguments taken = begin("path_speed", given, count);
  const double* positions = numbers(&taken, "positions", SHAPE(ANY, ANY));
  const long long waypoints = taken.shape[0], n = taken.shape[1];
  const double* shares = numbers(&taken, "shares", SHAPE(n));
  double* gradient = written(&taken, "gradient", SHAPE(waypoints, n));
  double* diagonal = written(&taken, "diagonal", SHAPE(waypoints, n, n));
  double* coupling = written(&taken, "coupling", SHAPE(waypoints > 0 ? waypoints - 1 : 0, n, n));
  double *work = scratch(&taken, 3 * n), cost = 0.0;
  if (ready(&taken))
    WITHOUT_LOCK(cost = path_speed(waypoints, n, positions, shares, work, gradient, diagonal, coupling));
  return ended(&taken, PyFloat_FromDouble(cost));
}

PyMethodDef path_speed_functions[] = {
    FUNCTION("path_speed", call_path_speed, "The cost of a motion's path speed, and its derivatives."),
    END_OF_FUNCTIONS,
};
