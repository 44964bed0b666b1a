/* The hinge on gravity torques at samples: `gravity_torque.py` defines the torques, `hinge.py` the hinge, both in
   NumPy, equal but for rounding. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

/* A robot's bodies with all loads, one on each joint of the model: masses (joints), centres (joints, 3), and whether a
   coordinate moves them (joints, n), joint j + 1 having coordinate j. Of the `rows` coordinates that gravity may
   overload: scale times torque is compared with `begin`, a band below the bound; `activation` is the depth of the whole
   band. */
typedef struct {
  long long joints, n, rows;
  double gravity[3], begin, band, activation;
  const double *masses, *centres, *scale;
  const long long *supports, *each;
} gravity;

/* At one sample, for every coordinate: the mass behind it, Σ m c of the bodies there, γ × a, and w. */
typedef struct {
  double *behind, *moments, *turned, *moved, *slope;
} room;

static int before(const gravity* of, long long j, long long k) { return of->supports[(j + 1) * of->n + k] != 0; }

static void put_moments(const gravity* of, const double* placements, const double* columns, const room* at) {
  const long long n = of->n;
  for (long long j = 0; j < n; ++j) at->behind[j] = at->moments[3 * j] = at->moments[3 * j + 1] = at->moments[3 * j + 2] = 0.0;
  for (long long body = 0; body < of->joints; ++body) {
    double centre[3];
    if (of->masses[body] == 0.0) continue;
    placed(placements + 12 * body, of->centres + 3 * body, centre);
    for (long long j = 0; j < n; ++j) {
      if (!of->supports[body * n + j]) continue;
      at->behind[j] += of->masses[body];
      for (int i = 0; i < 3; ++i) at->moments[3 * j + i] += of->masses[body] * centre[i];
    }
  }
  for (long long j = 0; j < n; ++j) cross(of->gravity, columns + 6 * j + 3, at->turned + 3 * j);
}

/* g_j = −γ·l_j Σ m − (γ × a_j)·Σ m c */
static double torque(const gravity* of, const double* columns, const room* at, long long j) {
  return -(at->behind[j] * dot(of->gravity, columns + 6 * j) + dot(at->turned + 3 * j, at->moments + 3 * j));
}

/* w_j = l_j Σ m + a_j × Σ m c, of all coordinates. */
static void put_moved(const gravity* of, const double* columns, const room* at) {
  for (long long j = 0; j < of->n; ++j) {
    cross(columns + 6 * j + 3, at->moments + 3 * j, at->moved + 3 * j);
    for (int i = 0; i < 3; ++i) at->moved[3 * j + i] += at->behind[j] * columns[6 * j + i];
  }
}

/* Add ½ w r² of a residual r = scale g_j less what is allowed, with w r ∇r and w ∇r ∇rᵀ. */
static void add(const gravity* of, const room* at, long long j, double scale, double residual, double weight,
                double* gradient, double* curvature) {
  const long long n = of->n;
  for (long long k = 0; k < n; ++k) {
    const double found = before(of, j, k)   ? dot(at->turned + 3 * k, at->moved + 3 * j)
                         : before(of, k, j) ? dot(at->turned + 3 * j, at->moved + 3 * k)
                                            : 0.0;
    at->slope[k] = -scale * found;
    gradient[k] += weight * residual * at->slope[k];
  }
  for (long long k = 0; k < n; ++k)
    for (long long i = 0; i < n; ++i) curvature[k * n + i] += weight * at->slope[k] * at->slope[i];
}

/* Returns ½ Σ weight r² at samples; adds to gradient (batch, n) and curvature (batch, n, n), and puts depths (batch).
   Without weights only these. */
static double gravity_hinge(const gravity* of, long long batch, const double* placements, const double* columns,
                            const double* weight, double* gradient, double* curvature, double* depth, const room* at) {
  const long long n = of->n;
  double total = 0.0;
  for (long long sample = 0; sample < batch; ++sample, placements += 12 * of->joints, columns += 6 * n) {
    int ready = 0;
    put_moments(of, placements, columns, at);
    depth[sample] = 0.0;
    for (long long row = 0; row < of->rows; ++row) {
      const double value = of->scale[row] * torque(of, columns, at, of->each[row]), beyond = fabs(value) - of->begin;
      if (!(beyond > 0.0)) continue;
      const double deep = of->activation * beyond / of->band + (beyond > of->band ? beyond - of->band : 0.0);
      if (deep > depth[sample]) depth[sample] = deep;
      if (!weight) continue;
      if (!ready) put_moved(of, columns, at);
      ready = 1;
      total += 0.5 * weight[sample] * beyond * beyond;
      add(of, at, of->each[row], of->scale[row], value < 0.0 ? -beyond : beyond, weight[sample], gradient + n * sample,
          curvature + n * n * sample);
    }
  }
  return total;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_gravity) {
  arguments taken = begin("gravity", given, count);
  const double* along = numbers(&taken, "gravity", SHAPE(3));
  gravity of = {.masses = numbers(&taken, "masses", SHAPE(ANY))};
  of.joints = taken.shape[0];
  of.centres = numbers(&taken, "centres", SHAPE(of.joints, 3));
  of.supports = indices(&taken, "supports", 0, 2, SHAPE(of.joints, of.joints - 1));
  of.n = of.joints - 1;
  of.each = indices(&taken, "rows", 0, of.n, SHAPE(ANY));
  of.rows = taken.shape[0];
  of.scale = numbers(&taken, "scale", SHAPE(of.rows));
  of.begin = number(&taken, "begin");
  of.band = number(&taken, "band");
  of.activation = number(&taken, "activation");
  for (int i = 0; !taken.failed && i < 3; ++i) of.gravity[i] = along[i];
  return made(&taken, "gravity", &of, sizeof of);
}

WRAPPER(call_gravity_hinge) {
  arguments taken = begin("gravity_hinge", given, count);
  const gravity* of = record(&taken, "gravity", "gravity");
  const long long joints = of ? of->joints : 0, n = of ? of->n : 0;
  const double* placements = numbers(&taken, "placements", SHAPE(ANY, joints, 12));
  const long long batch = taken.shape[0];
  const double* columns = numbers(&taken, "columns", SHAPE(batch, n, 6));
  const double* weight = numbers_or_none(&taken, "weight", SHAPE(batch));
  const long long summed = weight ? batch : 0;
  double* gradient = written(&taken, "gradient", SHAPE(summed, n));
  double* curvature = written(&taken, "curvature", SHAPE(summed, n, n));
  double* depth = written(&taken, "depth", SHAPE(batch));
  double *memory = scratch(&taken, 11 * n), total = 0.0;
  if (ready(&taken)) {
    const room at = {memory, memory + n, memory + 4 * n, memory + 7 * n, memory + 10 * n};
    WITHOUT_LOCK(total = gravity_hinge(of, batch, placements, columns, weight, gradient, curvature, depth, &at));
  }
  return ended(&taken, PyFloat_FromDouble(total));
}

PyMethodDef gravity_functions[] = {
    FUNCTION("gravity", make_gravity, "A robot's masses, and the torques that gravity may have."),
    FUNCTION("gravity_hinge", call_gravity_hinge, "The cost of gravity's torques at samples, and its derivatives."),
    END_OF_FUNCTIONS,
};
