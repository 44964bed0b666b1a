/* The loops of one evaluation: the hinge on the distance of close pairs, summed at their samples, and sums over samples
   carried back to waypoints. `clearance.py` and `samples.py` have the same in NumPy; the two agree but for rounding, as
   sums are taken in another order. */

#include <stdlib.h>

#include "../../distance/compiled/border.h"
#include "../collision/close_pairs.h"
#include "../collision/hdsdf_loop.h"
#include "../kinematics/forward_loop.h"

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
static double penalties(const tables* t, long long gamma, double length, long long n, const double* moves, double least,
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
  long long gamma, n;
  double length;
  const double* moves;
} term;
typedef struct {
  const tree* robot;
  long long intervals, batch, terms;
  const long long* counts;
  const double *fraction, *weight;
  const term* const* of;
} motion;

/* The `penalties` of all terms at the samples of waypoints (N, n), and the kinematics there, as `forward` gives it. */
static double at_samples(const motion* m, double least, const double* positions, double* placements, double* columns,
                  double* gradient, double* curvature, double* depth) {
  long long n = m->robot->n, k, c, i;
  double *q = malloc((size_t)((m->batch + 1) * n + 1) * sizeof(double)), *slope = q + m->batch * n, *to = q, total = 0.0;
  long long* moving = malloc((size_t)(n + 1) * sizeof(long long));
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
                                 : penalties(of->t, of->gamma, of->length, n, of->moves, least, m->batch,
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
static void to_waypoints(long long intervals, const long long* counts, const double* fraction, long long n,
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

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* make_term(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("term", given, count);
  term of;
  PyObject* found;
  (void)self;
  of.t = record(&c, "tables", "tables");
  of.gamma = whole(&c, "gamma", 1, 1000);
  of.length = number(&c, "length");
  of.moves = numbers(&c, "moves", SHAPE(of.t ? of.t->pairs : 0, ANY));
  of.n = c.shape[1];
  found = made(&c, "term", &of, sizeof of);
  return ended(&c, found);
}

static PyObject* make_motion(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("motion", given, count);
  motion m;
  long long k, samples = 0;
  PyObject* found;
  (void)self;
  m.robot = record(&c, "robot", "tree");
  m.counts = rows(&c, "counts", 0, 1LL << 30, SHAPE(ANY));
  m.intervals = c.shape[0];
  m.fraction = numbers(&c, "fraction", SHAPE(ANY));
  m.batch = c.shape[0];
  m.weight = numbers(&c, "weight", SHAPE(m.batch));
  m.of = (const term* const*)records(&c, "terms", "term");
  m.terms = c.shape[0];
  for (k = 0; !c.failed && k < m.intervals; ++k) samples += m.counts[k];
  if (!c.failed && samples != m.batch) wrong(&c, "counts", "the numbers of the fractions on each interval");
  for (k = 0; !c.failed && k < m.terms; ++k)
    if (m.of[k]->n != m.robot->n || m.of[k]->t->joints > m.robot->joints) wrong(&c, "terms", "of the robot's joints");
  found = made(&c, "motion", &m, sizeof m);
  return ended(&c, found);
}

static PyObject* call_penalties(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("penalties", given, count);
  const term* of = record(&c, "term", "term");
  double least = number(&c, "least"), *gradient, *curvature, *depth, *slope, cost = 0.0;
  const double *placements = numbers(&c, "placements", SHAPE(ANY, ANY, 12)), *columns, *weight;
  long long n = of ? of->n : 0, batch = c.shape[0], joints = c.shape[1], summed, *moving;
  (void)self;
  if (!c.failed && joints < of->t->joints) wrong(&c, "placements", "those of all joints");
  columns = numbers(&c, "columns", SHAPE(batch, n, 6));
  weight = numbers_or_none(&c, "weight", SHAPE(batch));
  summed = weight ? batch : 0;
  gradient = written(&c, "gradient", SHAPE(summed, n));
  curvature = written(&c, "curvature", SHAPE(summed, n, n));
  depth = written(&c, "depth", SHAPE(batch));
  if (!ready(&c)) return ended(&c, NULL);
  slope = malloc((size_t)(n + 1) * sizeof(double));
  moving = malloc((size_t)(n + 1) * sizeof(long long));
  if (slope && moving)
    WITHOUT_LOCK(cost = penalties(of->t, of->gamma, of->length, n, of->moves, least, batch, joints, placements, columns,
                                  weight, moving, slope, gradient, curvature, depth));
  if (!slope || !moving) cost = -1.0;
  free(slope);
  free(moving);
  return ended(&c, cost < 0.0 ? no_memory() : PyFloat_FromDouble(cost));
}

static PyObject* call_at_samples(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("at_samples", given, count);
  const motion* m = record(&c, "motion", "motion");
  long long batch = m ? m->batch : 0, n = m ? m->robot->n : 0, joints = m ? m->robot->joints : 0;
  double least = number(&c, "least"), *placements, *columns, *gradient, *curvature, *depth, cost = 0.0;
  const double* positions = numbers(&c, "positions", SHAPE(m ? m->intervals + 1 : 0, n));
  (void)self;
  placements = written(&c, "placements", SHAPE(batch, joints, 12));
  columns = written(&c, "columns", SHAPE(batch, n, 6));
  gradient = written(&c, "gradient", SHAPE(batch, n));
  curvature = written(&c, "curvature", SHAPE(batch, n, n));
  depth = written(&c, "depth", SHAPE(batch));
  if (ready(&c))
    WITHOUT_LOCK(cost = at_samples(m, least, positions, placements, columns, gradient, curvature, depth));
  return ended(&c, cost < 0.0 ? no_memory() : PyFloat_FromDouble(cost));
}

static PyObject* call_to_waypoints(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("to_waypoints", given, count);
  const long long* counts = rows(&c, "counts", 0, 1LL << 30, SHAPE(ANY));
  long long intervals = c.shape[0], batch, n, samples = 0, k;
  const double *fraction = numbers(&c, "fraction", SHAPE(ANY)), *gradient, *curvature;
  double *slope, *diagonal, *coupling;
  (void)self;
  batch = c.shape[0];
  gradient = numbers(&c, "gradient", SHAPE(batch, ANY));
  n = c.shape[1];
  curvature = numbers(&c, "curvature", SHAPE(batch, n, n));
  slope = written(&c, "slope", SHAPE(intervals + 1, n));
  diagonal = written(&c, "diagonal", SHAPE(intervals + 1, n, n));
  coupling = written(&c, "coupling", SHAPE(intervals, n, n));
  for (k = 0; !c.failed && k < intervals; ++k) samples += counts[k];
  if (!c.failed && samples != batch) wrong(&c, "counts", "the numbers of the fractions on each interval");
  if (ready(&c))
    WITHOUT_LOCK(to_waypoints(intervals, counts, fraction, n, gradient, curvature, slope, diagonal, coupling));
  return ended(&c, none());
}

PyMethodDef evaluation_functions[] = {
    FUNCTION("term", make_term, "A penalty on pairs."),
    FUNCTION("motion", make_motion, "What stays of a motion that is evaluated."),
    FUNCTION("penalties", call_penalties, "The cost of one term at samples, and its derivatives."),
    FUNCTION("at_samples", call_at_samples, "The cost of all terms at the samples of waypoints, and its derivatives."),
    FUNCTION("to_waypoints", call_to_waypoints, "Sums over samples, carried back to waypoints."),
    END_OF_FUNCTIONS,
};
