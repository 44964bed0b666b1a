/* The reach rho of many bodies: `Chain.reach_around` and `Chain.local_reach`, to rounding the same. */

#include <math.h>

#include "../../distance/compiled/border.h"

/* A tree of n joints: joint j + 1 moves coordinate j, turning or sliding; of each joint (0: the world) its parent,
   which coordinates carry it, and nine numbers of the way to its parent, as `Chain._inward` says. */
typedef struct {
  long long n;
  const long long *parents, *revolute, *carried;
  const double* inward;
} chain;

static double larger(double a, double b) { return a > b ? a : b; }
static double length(double x, double y, double z) { return sqrt(x * x + y * y + z * z); }

/* rho (bodies, n), zeros before, of bodies in cylinders (bodies, 3) on joints; travel (n, 2) of every coordinate. */
static void reach_around(const chain* of, long long bodies, const long long* joints, const double* cylinders,
                  const double* travel, double* rho) {
  long long g;
  for (g = 0; g < bodies; ++g, rho += of->n, cylinders += 3) {
    double wide = cylinders[0], low = cylinders[1], high = cylinders[2];
    long long joint = joints[g];
    while (joint > 0) {
      const double *w = of->inward + 9 * joint, *beside = w + 2, *out = w + 5;
      double tilt = w[8] * wide, one, other;
      long long j = joint - 1;
      rho[j] = of->revolute[j] ? wide : 1.0;
      if (!of->revolute[j]) {
        low += travel[2 * j];
        high += travel[2 * j + 1];
      }
      wide += larger(length(beside[0] + low * out[0], beside[1] + low * out[1], beside[2] + low * out[2]),
                     length(beside[0] + high * out[0], beside[1] + high * out[1], beside[2] + high * out[2]));
      one = w[0] + w[1] * low;
      other = w[0] + w[1] * high;
      low = (one < other ? one : other) - tilt;
      high = (one < other ? other : one) + tilt;
      joint = of->parents[joint];
    }
  }
}

/* The smaller of rho (bodies, n) and what the bounding balls allow on each of `count` intervals: (count, bodies, n),
   zeros before, which are not touched where nothing moves: so they take no memory. */
static void local_reach(const chain* of, long long count, long long bodies, const long long* joints, const double* rho,
                 const double* centers, const double* radii, const double* axes, const double* origins,
                 const double* half, double* local) {
  long long k, g, j, n = of->n;
  for (k = 0; k < count; ++k, axes += 3 * n, origins += 3 * n, half += n)
    for (g = 0; g < bodies; ++g, centers += 3, local += n) {
      const double* most = rho + n * g;
      double after = 0.0;
      if (joints[g] == 0) continue;
      for (j = n - 1; j >= 0; --j) {
        const double *a = axes + 3 * j, *o = origins + 3 * j;
        if (!of->carried[n * joints[g] + j]) continue;
        local[j] = 1.0;
        if (of->revolute[j]) {
          double x = centers[0] - o[0], y = centers[1] - o[1], z = centers[2] - o[2];
          double away = length(y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]) + radii[g] + after;
          local[j] = away >= most[j] ? most[j] : away;  /* what is not a number stays so, and proves nothing */
        }
        after += half[j] * local[j];
      }
    }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* make_chain(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("chain", given, count);
  chain of;
  PyObject* found;
  (void)self;
  of.revolute = rows(&c, "revolute", 0, 2, SHAPE(ANY));
  of.n = c.shape[0];
  of.parents = rows(&c, "parents", 0, of.n + 1, SHAPE(of.n + 1));
  of.carried = rows(&c, "carried", 0, 2, SHAPE(of.n + 1, of.n));
  of.inward = numbers(&c, "inward", SHAPE(of.n + 1, 9));
  found = made(&c, "chain", &of, sizeof of);
  return ended(&c, found);
}

static PyObject* call_reach_around(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("reach_around", given, count);
  const chain* of = record(&c, "chain", "chain");
  long long n = of ? of->n : 0, bodies;
  const long long* joints = rows(&c, "joints", 0, n + 1, SHAPE(ANY));
  const double *cylinders, *travel;
  double* rho;
  (void)self;
  bodies = c.shape[0];
  cylinders = numbers(&c, "cylinders", SHAPE(bodies, 3));
  travel = numbers(&c, "travel", SHAPE(n, 2));
  rho = written(&c, "rho", SHAPE(bodies, n));
  if (ready(&c)) WITHOUT_LOCK(reach_around(of, bodies, joints, cylinders, travel, rho));
  return ended(&c, none());
}

static PyObject* call_local_reach(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("local_reach", given, count);
  const chain* of = record(&c, "chain", "chain");
  long long n = of ? of->n : 0, bodies, intervals;
  const long long* joints = rows(&c, "joints", 0, n + 1, SHAPE(ANY));
  const double *rho, *centers, *radii, *axes, *origins, *half;
  double* local;
  (void)self;
  bodies = c.shape[0];
  rho = numbers(&c, "rho", SHAPE(bodies, n));
  centers = numbers(&c, "centers", SHAPE(ANY, bodies, 3));
  intervals = c.shape[0];
  radii = numbers(&c, "radii", SHAPE(bodies));
  axes = numbers(&c, "axes", SHAPE(intervals, n, 3));
  origins = numbers(&c, "origins", SHAPE(intervals, n, 3));
  half = numbers(&c, "half", SHAPE(intervals, n));
  local = written(&c, "local", SHAPE(intervals, bodies, n));
  if (ready(&c))
    WITHOUT_LOCK(local_reach(of, intervals, bodies, joints, rho, centers, radii, axes, origins, half, local));
  return ended(&c, none());
}

PyMethodDef reach_functions[] = {
    FUNCTION("chain", make_chain, "A tree of joints, as `Chain` has it."),
    FUNCTION("reach_around", call_reach_around, "What `Chain.reach_around` returns."),
    FUNCTION("local_reach", call_local_reach, "What `Chain.local_reach` returns."),
    END_OF_FUNCTIONS,
};
