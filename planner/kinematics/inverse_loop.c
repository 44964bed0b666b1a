/* Damped least squares from many configurations: what `inverse.py` and `search/inverse_kinematics.py` say in NumPy, to
   rounding the same. */

#include <math.h>
#include <stdlib.h>

#include "../../distance/compiled/border.h"
#include "forward_loop.h"

/* Poses of links on one arm with n coordinates: link l is placed by row l (rotation row by row, then origin) on joint
   joints[l], and wanted at row l of `wanted`; it may turn freely about its axis freedoms[l], 3: about none, 4: in any
   way. Its Jacobian has a column where moved (links, n) is 1. */
typedef struct {
  const tree* arm;
  long long links;
  const long long *joints, *freedoms, *moved;
  const double *placed, *wanted, *tolerances, *lower, *upper;
  const double* rule;  /* the sine below which two directions define no axis, λ, the longest step of a joint */
} goal;

/* Rows of one configuration: errors e (m) and Jacobian J (m, n), m = 6 links; the rest is scratch. */
typedef struct {
  double *placements, *columns, *error, *jacobian, *square, *pull, *step;
} room;

static room laid_out(const goal* g, double* work) {
  long long n = g->arm->n, m = 6 * g->links;
  room r;
  r.placements = work;
  r.columns = r.placements + 12 * g->arm->joints;
  r.error = r.columns + 6 * n;
  r.jacobian = r.error + m;
  r.square = r.jacobian + m * n;
  r.pull = r.square + m * m;
  r.step = r.pull + m;
  return r;
}

static double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double* a, const double* b, double* c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

/* The rotation vector of a rotation matrix, by its unit quaternion with the largest component first. */
static void vector_of(const double* m, double* turn) {
  double trace = m[0] + m[4] + m[8], v[3], w, size, angle;
  int i, j, k, most = m[0] > m[4] ? 0 : 1;
  if (m[8] > m[4 * most]) most = 2;
  if (trace >= m[4 * most]) {
    w = 1.0 + trace;
    v[0] = m[7] - m[5]; v[1] = m[2] - m[6]; v[2] = m[3] - m[1];
  } else {
    i = most; j = (i + 1) % 3; k = (i + 2) % 3;
    v[i] = 1.0 - trace + 2.0 * m[4 * i];
    v[j] = m[3 * j + i] + m[3 * i + j];
    v[k] = m[3 * k + i] + m[3 * i + k];
    w = m[3 * k + j] - m[3 * j + k];
  }
  size = sqrt(dot(v, v));
  angle = 2.0 * atan2(w < 0.0 ? -size : size, fabs(w));
  for (i = 0; i < 3; ++i) turn[i] = size > 0.0 ? v[i] / size * angle : 0.0;
}

/* The shortest turn between unit vectors; a half turn about anything across for opposite ones. */
static void turn_between(const double* from, const double* to, double parallel, double* turn) {
  double c[3], sine, unit[3] = {0.0, 0.0, 0.0}, across[3], angle;
  int i, least = 0;
  cross(from, to, c);
  sine = sqrt(dot(c, c));
  angle = atan2(sine, dot(from, to));
  for (i = 1; i < 3; ++i)
    if (fabs(to[i]) < fabs(to[least])) least = i;
  unit[least] = 1.0;
  cross(to, unit, across);
  for (i = 0; i < 3; ++i)
    turn[i] = angle * (sine > parallel ? c[i] / sine : across[i] / sqrt(dot(across, across)));
}

/* Errors and Jacobian of all links at q (n). */
static void look(const goal* g, const double* q, const room* r) {
  long long n = g->arm->n, l, j;
  int i, k;
  forward(g->arm, 1, q, r->placements, r->columns);
  for (l = 0; l < g->links; ++l) {
    const double *on = r->placements + 12 * g->joints[l], *x = g->placed + 12 * l, *w = g->wanted + 12 * l;
    double rotation[9], origin[3], along[3] = {0.0, 0.0, 0.0}, *error = r->error + 6 * l;
    long long freedom = g->freedoms[l];
    for (i = 0; i < 3; ++i) {
      for (k = 0; k < 3; ++k)
        rotation[3 * i + k] = on[3 * i] * x[k] + on[3 * i + 1] * x[3 + k] + on[3 * i + 2] * x[6 + k];
      origin[i] = dot(on + 3 * i, x + 9) + on[9 + i];
      error[i] = w[9 + i] - origin[i];
      error[3 + i] = 0.0;
    }
    if (freedom < 3) {
      double to[3];
      for (i = 0; i < 3; ++i) { along[i] = rotation[3 * i + freedom]; to[i] = w[3 * i + freedom]; }
      turn_between(along, to, g->rule[0], error + 3);
    } else if (freedom == 3) {
      double between[9];
      for (i = 0; i < 3; ++i)
        for (k = 0; k < 3; ++k) between[3 * i + k] = dot(w + 3 * i, rotation + 3 * k);
      vector_of(between, error + 3);
    }
    for (j = 0; j < n; ++j) {
      const double *column = r->columns + 6 * j, *angular = column + 3;
      double* slope = r->jacobian + 6 * l * n + j, lever[3], share = dot(angular, along);
      if (!g->moved[l * n + j]) {
        for (i = 0; i < 6; ++i) slope[i * n] = 0.0;
        continue;
      }
      cross(angular, origin, lever);
      for (i = 0; i < 3; ++i) {
        slope[i * n] = column[i] + lever[i];
        slope[(3 + i) * n] = freedom == 4 ? 0.0 : angular[i] - share * along[i];
      }
    }
  }
}

/* step = Jᵀ (J Jᵀ + λ² I)⁻¹ pull. */
static void pulled(const goal* g, const room* r) {
  double damping = g->rule[1];
  long long n = g->arm->n, m = 6 * g->links, i, j, k;
  double *s = r->square, *y = r->pull;
  for (i = 0; i < m; ++i)
    for (j = 0; j <= i; ++j) {
      double sum = i == j ? damping * damping : 0.0;
      for (k = 0; k < n; ++k) sum += r->jacobian[i * n + k] * r->jacobian[j * n + k];
      s[i * m + j] = sum;
    }
  for (i = 0; i < m; ++i) {  /* Cholesky, and the forward substitution on the way */
    for (j = 0; j < i; ++j) {
      double sum = s[i * m + j];
      for (k = 0; k < j; ++k) sum -= s[i * m + k] * s[j * m + k];
      s[i * m + j] = sum * s[j * m + j];
    }
    for (k = 0; k < i; ++k) {
      s[i * m + i] -= s[i * m + k] * s[i * m + k];
      y[i] -= s[i * m + k] * y[k];
    }
    s[i * m + i] = 1.0 / sqrt(s[i * m + i]);
    y[i] *= s[i * m + i];
  }
  for (j = 0; j < n; ++j) r->step[j] = 0.0;
  for (i = m - 1; i >= 0; --i) {
    for (k = i + 1; k < m; ++k) y[i] -= s[k * m + i] * y[k];
    y[i] *= s[i * m + i];
    for (j = 0; j < n; ++j) r->step[j] += r->jacobian[i * n + j] * y[i];
  }
}

/* q + step within the limits, each joint by no more than the longest step. */
static void moved_by(const goal* g, const double* step, const double* q, double* to) {
  long long n = g->arm->n, j;
  double most = 1e-12, longest = g->rule[2], share;
  for (j = 0; j < n; ++j) most = fabs(step[j]) > most ? fabs(step[j]) : most;
  share = longest / most < 1.0 ? longest / most : 1.0;
  for (j = 0; j < n; ++j) {
    double value = q[j] + step[j] * share;
    value = value > g->lower[j] ? value : g->lower[j];
    to[j] = value < g->upper[j] ? value : g->upper[j];
  }
}

static double size_of(const double* error) { return sqrt(dot(error, error)); }

static int within(const goal* g, const double* error, double share) {
  long long i;
  for (i = 0; i < 2 * g->links; ++i)
    if (!(size_of(error + 3 * i) <= share * g->tolerances[i])) return 0;
  return 1;
}

/* Errors (batch, m) and Jacobians (batch, m, n) at q (batch, n). */
static void linearized(const goal* g, long long batch, const double* q, double* errors, double* jacobians, double* work) {
  long long n = g->arm->n, m = 6 * g->links, b;
  room r = laid_out(g, work);
  for (b = 0; b < batch; ++b) {
    r.error = errors + m * b;
    r.jacobian = jacobians + m * n * b;
    look(g, q + n * b, &r);
  }
}

/* Moves q (batch, n) step by step until all are within `enough` of the tolerances, or, from step `many` on, no more
   than `left` are not; only what is beyond `aim` of a tolerance pulls. going (batch), next (batch, n): scratch. */
static void approach(const goal* g, long long batch, double* q, long long steps, long long many, double left, double aim,
              double enough, long long* going, double* next, double* work) {
  long long n = g->arm->n, m = 6 * g->links, count = batch, step, far, b, i;
  room r = laid_out(g, work);
  for (b = 0; b < batch; ++b) going[b] = b;
  for (step = 0; step < steps; ++step, count = far) {
    for (far = 0, b = 0; b < count; ++b) {
      const double* at = q + n * going[b];
      look(g, at, &r);
      if (within(g, r.error, enough)) continue;
      for (i = 0; i < m; ++i) {
        double size = size_of(r.error + 3 * (i / 3)), rest;
        rest = 1.0 - aim * g->tolerances[i / 3] / (size > 1e-300 ? size : 1e-300);
        r.pull[i] = r.error[i] * (rest > 0.0 ? rest : 0.0);
      }
      pulled(g, &r);
      moved_by(g, r.step, at, next + n * far);
      going[far++] = going[b];
    }
    if ((double)far <= (step >= many ? left : 0.0)) return;
    for (b = 0; b < far; ++b)
      for (i = 0; i < n; ++i) q[n * going[b] + i] = next[n * b + i];
  }
}

static void copied(long long count, const double* from, double* to) {
  long long i;
  for (i = 0; i < count; ++i) to[i] = from[i];
}

/* One damped step from q with the whole error, which `look` has left in r. */
static void stepped(const goal* g, const double* q, const room* r, double* to) {
  copied(6 * g->links, r->error, r->pull);
  pulled(g, r);
  moved_by(g, r->step, q, to);
}

/* Moves q (batch, n) on towards the centre of the tolerances, as long as no error grows. other (2 m + n) is scratch. */
static void centre(const goal* g, long long batch, double* q, long long steps, double* other, double* work) {
  long long n = g->arm->n, m = 6 * g->links, b, i, step;
  double* moved = other + m;
  room r = laid_out(g, work);
  for (b = 0; b < batch; ++b, q += n) {
    look(g, q, &r);
    for (step = 0; step < steps; ++step) {
      int better = 1;
      copied(m, r.error, other);
      stepped(g, q, &r, moved);
      look(g, moved, &r);
      for (i = 0; i < m; i += 3) better = better && size_of(r.error + i) <= size_of(other + i);
      if (!better) break;
      copied(n, moved, q);
    }
  }
}

/* Moves q (batch, n), each within the tolerances, towards `start` (n): steps along what moves no link that counts, each
   followed by `back` steps to the goal; a step that leaves `enough` of the tolerances or gains nothing is the last. */
static void draw_near(const goal* g, long long batch, double* q, const double* start, long long steps, long long back,
               double enough, double* other, double* work) {
  long long n = g->arm->n, m = 6 * g->links, b, i, j, step;
  double *way = other, *moved = other + n;
  room r = laid_out(g, work);
  for (b = 0; b < batch; ++b, q += n) {
    for (step = 0; step < steps; ++step) {
      double before = 0.0, after = 0.0;
      look(g, q, &r);
      for (j = 0; j < n; ++j) way[j] = start[j] - q[j];
      for (i = 0; i < m; ++i)
        for (r.pull[i] = 0.0, j = 0; j < n; ++j) r.pull[i] += r.jacobian[i * n + j] * way[j];
      pulled(g, &r);
      for (j = 0; j < n; ++j) r.step[j] = way[j] - r.step[j];
      moved_by(g, r.step, q, moved);
      for (i = 0; i < back; ++i) {
        look(g, moved, &r);
        stepped(g, moved, &r, moved);
      }
      look(g, moved, &r);
      for (j = 0; j < n; ++j) {
        before += way[j] * way[j];
        after += (start[j] - moved[j]) * (start[j] - moved[j]);
      }
      if (!within(g, r.error, enough) || !(sqrt(after) < sqrt(before))) break;
      copied(n, moved, q);
    }
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* make_goal(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("goal", given, count);
  goal g;
  long long n;
  PyObject* found;
  (void)self;
  g.arm = record(&c, "arm", "tree");
  n = g.arm ? g.arm->n : 0;
  g.joints = rows(&c, "joints", 0, g.arm ? g.arm->joints : 0, SHAPE(ANY));
  g.links = c.shape[0];
  g.freedoms = rows(&c, "freedoms", 0, 5, SHAPE(g.links));
  g.moved = rows(&c, "moved", 0, 2, SHAPE(g.links, n));
  g.placed = numbers(&c, "placed", SHAPE(g.links, 12));
  g.wanted = numbers(&c, "wanted", SHAPE(g.links, 12));
  g.tolerances = numbers(&c, "tolerances", SHAPE(2 * g.links));
  g.lower = numbers(&c, "lower", SHAPE(n));
  g.upper = numbers(&c, "upper", SHAPE(n));
  g.rule = numbers(&c, "rule", SHAPE(3));
  found = made(&c, "goal", &g, sizeof g);
  return ended(&c, found);
}

/* Memory for one configuration, and `more` numbers. */
static double* room_for(const goal* g, long long more) {
  long long n = g->arm->n, m = 6 * g->links;
  return malloc((size_t)(12 * g->arm->joints + 7 * n + m * (n + m + 2) + more) * sizeof(double));
}

static PyObject* call_linearized(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("linearized", given, count);
  const goal* g = record(&c, "goal", "goal");
  long long n = g ? g->arm->n : 0, m = g ? 6 * g->links : 0, batch;
  const double* q = numbers(&c, "q", SHAPE(ANY, n));
  double *errors, *jacobians, *work;
  (void)self;
  batch = c.shape[0];
  errors = written(&c, "errors", SHAPE(batch, m));
  jacobians = written(&c, "jacobians", SHAPE(batch, m, n));
  if (!ready(&c)) return ended(&c, NULL);
  work = room_for(g, 0);
  if (work) WITHOUT_LOCK(linearized(g, batch, q, errors, jacobians, work));
  free(work);
  return ended(&c, work ? none() : no_memory());
}

static PyObject* call_approach(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("approach", given, count);
  const goal* g = record(&c, "goal", "goal");
  long long n = g ? g->arm->n : 0, batch, steps, many, *going;
  double *q = written(&c, "q", SHAPE(ANY, n)), left, aim, enough, *work;
  (void)self;
  batch = c.shape[0];
  steps = whole(&c, "steps", 0, 1LL << 30);
  many = whole(&c, "many", 0, 1LL << 30);
  left = number(&c, "left");
  aim = number(&c, "aim");
  enough = number(&c, "enough");
  if (!ready(&c)) return ended(&c, NULL);
  work = room_for(g, batch * n);
  going = malloc((size_t)(batch + 1) * sizeof(long long));
  if (work && going) WITHOUT_LOCK(approach(g, batch, q, steps, many, left, aim, enough, going, work, work + batch * n));
  free(work);
  free(going);
  return ended(&c, work && going ? none() : no_memory());
}

static PyObject* call_centre(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("centre", given, count);
  const goal* g = record(&c, "goal", "goal");
  long long n = g ? g->arm->n : 0, m = g ? 6 * g->links : 0, batch, steps;
  double *q = written(&c, "q", SHAPE(ANY, n)), *work;
  (void)self;
  batch = c.shape[0];
  steps = whole(&c, "steps", 0, 1LL << 30);
  if (!ready(&c)) return ended(&c, NULL);
  work = room_for(g, m + n);
  if (work) WITHOUT_LOCK(centre(g, batch, q, steps, work, work + m + n));
  free(work);
  return ended(&c, work ? none() : no_memory());
}

static PyObject* call_draw_near(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("draw_near", given, count);
  const goal* g = record(&c, "goal", "goal");
  long long n = g ? g->arm->n : 0, batch, steps, back;
  double *q = written(&c, "q", SHAPE(ANY, n)), *work, enough;
  const double* start;
  (void)self;
  batch = c.shape[0];
  start = numbers(&c, "start", SHAPE(n));
  steps = whole(&c, "steps", 0, 1LL << 30);
  back = whole(&c, "back", 0, 1LL << 30);
  enough = number(&c, "enough");
  if (!ready(&c)) return ended(&c, NULL);
  work = room_for(g, 2 * n);
  if (work) WITHOUT_LOCK(draw_near(g, batch, q, start, steps, back, enough, work, work + 2 * n));
  free(work);
  return ended(&c, work ? none() : no_memory());
}

PyMethodDef inverse_functions[] = {
    FUNCTION("goal", make_goal, "Poses of links of one arm."),
    FUNCTION("linearized", call_linearized, "Errors and Jacobians."),
    FUNCTION("approach", call_approach, "Moves configurations towards the goal."),
    FUNCTION("centre", call_centre, "Moves configurations towards the centre of the tolerances."),
    FUNCTION("draw_near", call_draw_near, "Moves configurations at the goal towards the start."),
    END_OF_FUNCTIONS,
};
