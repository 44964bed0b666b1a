/* The shaping of the HD-SDF undone, as `straightened` of `barrier_safety.py`. */

#include "barrier_safety.h"

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

enum { NEWTON = 8 }; /* as in `barrier_safety.py` */

/* The u ≥ 0 with Phi(u) = value > 0, with Phi'(u) in *slope: Newton's method for x = ln(u / length), with
   e = exp(−|γ x|), of which softplus ln(1 + exp(γ x)) and logistic function 1 / (1 + exp(γ x)) are made. */
static double unshaped(double value, double gamma, double length, double* slope) {
  const double wanted = log(value / length);
  double x = wanted > 0.0 ? wanted : wanted / (gamma + 1.0);
  for (int round = 0; round < NEWTON; ++round) {
    const double power = gamma * x, e = exp(-fabs(power));
    const double softplus = (power > 0.0 ? power : 0.0) + log1p(e), logistic = (power > 0.0 ? e : 1.0) / (1.0 + e);
    x -= ((gamma + 1.0) * x - softplus - wanted) / (1.0 + gamma * logistic);
  }
  const double u = length * exp(x), raised = exp(-fabs(gamma * log(u / length)));
  const double share = (u > length ? 1.0 : raised) / (1.0 + raised);
  *slope = share * (1.0 + gamma * (1.0 - share));
  return u;
}

double straightened(double distance, double gamma, double length, double* slope) {
  double value = fabs(distance), along = 0.0;
  *slope = distance != 0.0 ? 1.0 : 0.0;
  for (int time = 0; time < 2; ++time) {
    value = value > 0.0 ? unshaped(value, gamma, length, &along) : 0.0;
    *slope *= value > 0.0 ? along : 0.0;
  }
  return copysign(value, distance);
}

/* The same of `count` distances. */
static void straighten(long long count, double gamma, double length, const double* distance, double* separation,
                       double* slope) {
  for (long long k = 0; k < count; ++k) separation[k] = straightened(distance[k], gamma, length, slope + k);
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_straightened) {
  arguments taken = begin("straightened", given, count);
  const long long gamma = whole(&taken, "gamma", 1, 1000);
  const double length = number(&taken, "length");
  const double* distance = numbers(&taken, "distance", SHAPE(ANY));
  const long long rows = taken.shape[0];
  double* separation = written(&taken, "separation", SHAPE(rows));
  double* slope = written(&taken, "slope", SHAPE(rows));
  if (ready(&taken)) WITHOUT_LOCK(straighten(rows, (double)gamma, length, distance, separation, slope));
  return ended(&taken, none());
}

PyMethodDef barrier_safety_functions[] = {
    FUNCTION("straightened", call_straightened, "Separations without the flat spot, and the slope there."),
    END_OF_FUNCTIONS,
};
