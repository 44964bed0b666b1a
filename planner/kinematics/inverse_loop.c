/* Damped least squares from many configurations: `inverse.py` and `search/inverse_kinematics.py` in C, equal but
   for rounding. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/cholesky.h"
#include "../../distance/compiled/vectors.h"
#include "forward_loop.h"

/* Poses of links on one arm with n coordinates: link l is placed by row l (rotation row by row, then origin) on joint
   joints[l], and wanted at row l of `wanted`; it may turn freely about its axis freedoms[l], or not, or in any way. Its
   Jacobian has a column where moved (links, n) is 1. `tolerances` (2 links): of positions [m] and of turns [rad]. */
typedef struct {
  const tree* arm;
  long long links;
  const long long *joints, *freedoms, *moved;
  const double *placed, *wanted, *tolerances, *lower, *upper;
  double parallel; /* the sine below which two directions define no axis */
  double damping;  /* λ */
  double longest;  /* the longest step of a joint */
} goal;

enum { NOT_FREE = 3, FREE = 4 };

/* Rows of one configuration: errors e (m) and Jacobian J (m, n), m = 6 links; the rest is scratch. */
typedef struct {
  double *placements, *columns, *error, *jacobian, *square, *pull, *step;
} room;

static void copy(long long count, const double* from, double* to) {
  for (long long i = 0; i < count; ++i) to[i] = from[i];
}

/* --- errors ----------------------------------------------------------------------------------------------------- */

/* The rotation vector of a rotation matrix, by its unit quaternion (w, v) with the largest component first. */
static void rotation_vector(const double* m, double* turn) {
  const double trace = m[0] + m[4] + m[8];
  double v[3], w;
  int most = m[0] > m[4] ? 0 : 1;
  if (m[8] > m[4 * most]) most = 2;
  if (trace >= m[4 * most]) {
    w = 1.0 + trace;
    v[0] = m[7] - m[5];
    v[1] = m[2] - m[6];
    v[2] = m[3] - m[1];
  } else {
    const int i = most, j = (i + 1) % 3, k = (i + 2) % 3;
    v[i] = 1.0 - trace + 2.0 * m[4 * i];
    v[j] = m[3 * j + i] + m[3 * i + j];
    v[k] = m[3 * k + i] + m[3 * i + k];
    w = m[3 * k + j] - m[3 * j + k];
  }
  const double size = norm(v), angle = 2.0 * atan2(w < 0.0 ? -size : size, fabs(w));
  for (int i = 0; i < 3; ++i) turn[i] = size > 0.0 ? v[i] / size * angle : 0.0;
}

/* The shortest turn between unit vectors; a half turn about anything across for opposite ones. */
static void turn_between(const double* from, const double* to, double parallel, double* turn) {
  double axis[3], unit[3] = {0.0, 0.0, 0.0}, across[3];
  int least = 0;
  cross(from, to, axis);
  const double sine = norm(axis), angle = atan2(sine, dot(from, to));
  for (int i = 1; i < 3; ++i)
    if (fabs(to[i]) < fabs(to[least])) least = i;
  unit[least] = 1.0;
  cross(to, unit, across);
  for (int i = 0; i < 3; ++i) turn[i] = angle * (sine > parallel ? axis[i] / sine : across[i] / norm(across));
}

/* The error (6) of a link at a placement, and the axis about which it may turn. */
static void put_error(const goal* to, long long link, const double* rotation, const double* origin, double* axis,
                      double* error) {
  const double* wanted = to->wanted + 12 * link;
  const long long freedom = to->freedoms[link];
  difference(wanted + 9, origin, error);
  for (int i = 0; i < 3; ++i) axis[i] = error[3 + i] = 0.0;
  if (freedom < NOT_FREE) {
    double wanted_axis[3];
    for (int i = 0; i < 3; ++i) {
      axis[i] = rotation[3 * i + freedom];
      wanted_axis[i] = wanted[3 * i + freedom];
    }
    turn_between(axis, wanted_axis, to->parallel, error + 3);
  } else if (freedom == NOT_FREE) { /* R_wanted Rᵀ */
    double between[9];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) between[3 * i + j] = dot(wanted + 3 * i, rotation + 3 * j);
    rotation_vector(between, error + 3);
  }
}

/* The Jacobian (6, n) of a link at an origin: columns v + ω × o, and ω without what turns about the free axis. */
static void put_jacobian(const goal* to, long long link, const double* columns, const double* origin,
                         const double* axis, double* jacobian) {
  const long long n = to->arm->n;
  for (long long j = 0; j < n; ++j) {
    const double *column = columns + 6 * j, *angular = column + 3;
    double slope[6] = {0.0}, lever[3];
    if (to->moved[link * n + j]) {
      const double share = dot(angular, axis);
      cross(angular, origin, lever);
      for (int i = 0; i < 3; ++i) {
        slope[i] = column[i] + lever[i];
        slope[3 + i] = to->freedoms[link] == FREE ? 0.0 : angular[i] - share * axis[i];
      }
    }
    for (int i = 0; i < 6; ++i) jacobian[i * n + j] = slope[i];
  }
}

/* Errors and Jacobian of all links at q (n). */
static void look(const goal* to, const double* q, const room* at) {
  forward(to->arm, 1, q, at->placements, at->columns);
  for (long long link = 0; link < to->links; ++link) {
    const double *joint = at->placements + 12 * to->joints[link], *local = to->placed + 12 * link;
    double rotation[9], origin[3], axis[3];
    product(joint, local, rotation);
    placed(joint, local + 9, origin);
    put_error(to, link, rotation, origin, axis, at->error + 6 * link);
    put_jacobian(to, link, at->columns, origin, axis, at->jacobian + 6 * link * to->arm->n);
  }
}

static int is_within(const goal* to, const double* error, double share) {
  for (long long i = 0; i < 2 * to->links; ++i)
    if (!(norm(error + 3 * i) <= share * to->tolerances[i])) return 0;
  return 1;
}

/* --- steps ------------------------------------------------------------------------------------------------------ */

/* step = Jᵀ (J Jᵀ + λ² I)⁻¹ pull. */
static void solve_step(const goal* to, const room* at) {
  const long long n = to->arm->n, m = 6 * to->links;
  const double* jacobian = at->jacobian;
  for (long long j = 0; j < m; ++j) /* column j of the lower half, which begins at the diagonal */
    for (long long i = j; i < m; ++i) {
      double sum = i == j ? to->damping * to->damping : 0.0;
      for (long long k = 0; k < n; ++k) sum += jacobian[i * n + k] * jacobian[j * n + k];
      at->square[m * j + i - j] = sum;
    }
  const int definite = solved(m, m, at->square, at->pull);
  for (long long j = 0; j < n; ++j) at->step[j] = definite ? 0.0 : NAN;
  for (long long i = m - 1; i >= 0; --i)
    for (long long j = 0; j < n; ++j) at->step[j] += jacobian[i * n + j] * at->pull[i];
}

/* q + step within the limits, each joint by no more than the longest step. */
static void move_by(const goal* to, const double* step, const double* q, double* found) {
  const long long n = to->arm->n;
  double most = 1e-12;
  for (long long j = 0; j < n; ++j) most = fabs(step[j]) > most ? fabs(step[j]) : most;
  const double share = to->longest / most < 1.0 ? to->longest / most : 1.0;
  for (long long j = 0; j < n; ++j) {
    double value = q[j] + step[j] * share;
    value = value > to->lower[j] ? value : to->lower[j];
    found[j] = value < to->upper[j] ? value : to->upper[j];
  }
}

/* One damped step from q with the whole error, which `look` has found. */
static void step_from(const goal* to, const double* q, const room* at, double* found) {
  copy(6 * to->links, at->error, at->pull);
  solve_step(to, at);
  move_by(to, at->step, q, found);
}

/* Only what is beyond `aim` of a tolerance pulls. */
static void pull_beyond(const goal* to, const room* at, double aim) {
  for (long long i = 0; i < 2 * to->links; ++i) {
    const double size = norm(at->error + 3 * i), rest = 1.0 - aim * to->tolerances[i] / (size > 1e-300 ? size : 1e-300);
    for (long long j = 3 * i; j < 3 * i + 3; ++j) at->pull[j] = at->error[j] * (rest > 0.0 ? rest : 0.0);
  }
}

/* --- the loops -------------------------------------------------------------------------------------------------- */

/* Errors (batch, m) and Jacobians (batch, m, n) at q (batch, n). */
static void linearized(const goal* to, long long batch, const double* q, double* errors, double* jacobians, room at) {
  const long long n = to->arm->n, m = 6 * to->links;
  for (long long i = 0; i < batch; ++i) {
    at.error = errors + m * i;
    at.jacobian = jacobians + m * n * i;
    look(to, q + n * i, &at);
  }
}

/* The settings of `approach`: the most steps; the step from which on `left` may be left behind, and how many those are; the
   shares of the tolerances aimed at, and that are enough. */
typedef struct {
  long long steps, many;
  double left, aim, enough;
} schedule;

/* Moves q (batch, n) step by step until all are within `enough` of the tolerances, or, from step `many` on, no more
   than `left` are not. going (batch), next (batch, n): scratch. */
static void approach(const goal* to, long long batch, double* q, const schedule* plan, long long* going, double* next,
                     const room* at) {
  const long long n = to->arm->n;
  long long count = batch;
  for (long long i = 0; i < batch; ++i) going[i] = i;
  for (long long step = 0; step < plan->steps; ++step) {
    long long far = 0;
    for (long long i = 0; i < count; ++i) {
      const double* from = q + n * going[i];
      look(to, from, at);
      if (is_within(to, at->error, plan->enough)) continue;
      pull_beyond(to, at, plan->aim);
      solve_step(to, at);
      move_by(to, at->step, from, next + n * far);
      going[far++] = going[i];
    }
    if ((double)far <= (step >= plan->many ? plan->left : 0.0)) return;
    for (long long i = 0; i < far; ++i) copy(n, next + n * i, q + n * going[i]);
    count = far;
  }
}

/* Moves q (batch, n) on towards the centre of the tolerances, as long as no error grows. before (m), moved (n): scratch. */
static void centre(const goal* to, long long batch, double* q, long long steps, double* before, double* moved,
                   const room* at) {
  const long long n = to->arm->n, m = 6 * to->links;
  for (long long i = 0; i < batch; ++i, q += n) {
    look(to, q, at);
    for (long long step = 0; step < steps; ++step) {
      int better = 1;
      copy(m, at->error, before);
      step_from(to, q, at, moved);
      look(to, moved, at);
      for (long long j = 0; j < m; j += 3) better = better && norm(at->error + j) <= norm(before + j);
      if (!better) break;
      copy(n, moved, q);
    }
  }
}

/* The step way − J⁺ J way: along what moves no link that counts. */
static void solve_step_along(const goal* to, const double* way, const room* at) {
  const long long n = to->arm->n;
  for (long long i = 0; i < 6 * to->links; ++i) {
    at->pull[i] = 0.0;
    for (long long j = 0; j < n; ++j) at->pull[i] += at->jacobian[i * n + j] * way[j];
  }
  solve_step(to, at);
  for (long long j = 0; j < n; ++j) at->step[j] = way[j] - at->step[j];
}

/* Moves q (batch, n), each within the tolerances, towards `start` (n): steps along what moves no link that counts, each
   followed by `back` steps to the goal; a step that leaves `enough` of the tolerances or gains nothing is the last.
   way (n), moved (n): scratch. */
static void draw_near(const goal* to, long long batch, double* q, const double* start, long long steps, long long back,
                      double enough, double* way, double* moved, const room* at) {
  const long long n = to->arm->n;
  for (long long i = 0; i < batch; ++i, q += n) {
    look(to, q, at);
    for (long long step = 0; step < steps; ++step) {
      double before = 0.0, after = 0.0;
      for (long long j = 0; j < n; ++j) way[j] = start[j] - q[j];
      solve_step_along(to, way, at);
      move_by(to, at->step, q, moved);
      for (long long again = 0; again < back; ++again) {
        look(to, moved, at);
        step_from(to, moved, at, moved);
      }
      look(to, moved, at);
      for (long long j = 0; j < n; ++j) {
        before += way[j] * way[j];
        after += (start[j] - moved[j]) * (start[j] - moved[j]);
      }
      if (!is_within(to, at->error, enough) || !(sqrt(after) < sqrt(before))) break;
      copy(n, moved, q);
    }
  }
}

/* --- which of them differ --------------------------------------------------------------------------------------- */

/* Rows of q (rows, n) that differ by more than `apart` in some joint from all that are kept before them, whole turns
   aside where a joint circles: their numbers into kept (rows). Returns how many there are. */
static long long distinct(long long rows, long long n, const double* q, const long long* circling, double apart,
                          long long* kept) {
  const double whole_turn = 2.0 * 3.14159265358979323846;
  long long count = 0;
  for (long long i = 0; i < rows; ++i) {
    int differs = 1;
    for (long long k = 0; differs && k < count; ++k) {
      differs = 0;
      for (long long j = 0; !differs && j < n; ++j) {
        double way = q[n * i + j] - q[n * kept[k] + j];
        if (circling[j]) way -= whole_turn * rint(way / whole_turn);
        differs = fabs(way) > apart;
      }
    }
    if (differs) kept[count++] = i;
  }
  return count;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_goal) {
  arguments taken = begin("goal", given, count);
  goal to = {.arm = record(&taken, "arm", "tree")};
  const long long n = to.arm ? to.arm->n : 0;
  to.joints = indices(&taken, "joints", 0, to.arm ? to.arm->joints : 0, SHAPE(ANY));
  to.links = taken.shape[0];
  if (to.links > 1LL << 16) wrong(&taken, "joints", "those of fewer links");
  to.freedoms = indices(&taken, "freedoms", 0, FREE + 1, SHAPE(to.links));
  to.moved = indices(&taken, "moved", 0, 2, SHAPE(to.links, n));
  to.placed = numbers(&taken, "placed", SHAPE(to.links, 12));
  to.wanted = numbers(&taken, "wanted", SHAPE(to.links, 12));
  to.tolerances = numbers(&taken, "tolerances", SHAPE(2 * to.links));
  to.lower = numbers(&taken, "lower", SHAPE(n));
  to.upper = numbers(&taken, "upper", SHAPE(n));
  const double* rule = numbers(&taken, "rule", SHAPE(3));
  if (rule) {
    to.parallel = rule[0];
    to.damping = rule[1];
    to.longest = rule[2];
  }
  return made(&taken, "goal", &to, sizeof to);
}

/* Memory for one configuration, and `more` numbers, which come first. */
static room take_room(arguments* taken, const goal* to, long long more, double** first) {
  const long long n = to ? to->arm->n : 0, joints = to ? to->arm->joints : 0, m = to ? 6 * to->links : 0;
  room at = {0};
  *first = scratch(taken, more + 12 * joints + 7 * n + m * (n + m + 2));
  if (!*first) return at;
  at.placements = *first + more;
  at.columns = at.placements + 12 * joints;
  at.error = at.columns + 6 * n;
  at.jacobian = at.error + m;
  at.square = at.jacobian + m * n;
  at.pull = at.square + m * m;
  at.step = at.pull + m;
  return at;
}

WRAPPER(call_linearized) {
  arguments taken = begin("linearized", given, count);
  const goal* to = record(&taken, "goal", "goal");
  const long long n = to ? to->arm->n : 0, m = to ? 6 * to->links : 0;
  const double* q = numbers(&taken, "q", SHAPE(ANY, n));
  const long long batch = taken.shape[0];
  double* errors = written(&taken, "errors", SHAPE(batch, m));
  double *jacobians = written(&taken, "jacobians", SHAPE(batch, m, n)), *none_more;
  const room at = take_room(&taken, to, 0, &none_more);
  if (ready(&taken)) WITHOUT_LOCK(linearized(to, batch, q, errors, jacobians, at));
  return ended(&taken, none());
}

WRAPPER(call_approach) {
  arguments taken = begin("approach", given, count);
  const goal* to = record(&taken, "goal", "goal");
  const long long n = to ? to->arm->n : 0;
  double *q = written(&taken, "q", SHAPE(ANY, n)), *next;
  const long long batch = taken.shape[0];
  schedule plan;
  plan.steps = whole(&taken, "steps", 0, 1LL << 30);
  plan.many = whole(&taken, "many", 0, 1LL << 30);
  plan.left = number(&taken, "left");
  plan.aim = number(&taken, "aim");
  plan.enough = number(&taken, "enough");
  long long* going = scratch_indices(&taken, batch);
  const room at = take_room(&taken, to, batch * n, &next);
  if (ready(&taken)) WITHOUT_LOCK(approach(to, batch, q, &plan, going, next, &at));
  return ended(&taken, none());
}

WRAPPER(call_centre) {
  arguments taken = begin("centre", given, count);
  const goal* to = record(&taken, "goal", "goal");
  const long long n = to ? to->arm->n : 0, m = to ? 6 * to->links : 0;
  double *q = written(&taken, "q", SHAPE(ANY, n)), *before;
  const long long batch = taken.shape[0], steps = whole(&taken, "steps", 0, 1LL << 30);
  const room at = take_room(&taken, to, m + n, &before);
  if (ready(&taken)) WITHOUT_LOCK(centre(to, batch, q, steps, before, before + m, &at));
  return ended(&taken, none());
}

WRAPPER(call_draw_near) {
  arguments taken = begin("draw_near", given, count);
  const goal* to = record(&taken, "goal", "goal");
  const long long n = to ? to->arm->n : 0;
  double *q = written(&taken, "q", SHAPE(ANY, n)), *way;
  const long long batch = taken.shape[0];
  const double* start = numbers(&taken, "start", SHAPE(n));
  const long long steps = whole(&taken, "steps", 0, 1LL << 30), back = whole(&taken, "back", 0, 1LL << 30);
  const double enough = number(&taken, "enough");
  const room at = take_room(&taken, to, 2 * n, &way);
  if (ready(&taken)) WITHOUT_LOCK(draw_near(to, batch, q, start, steps, back, enough, way, way + n, &at));
  return ended(&taken, none());
}

/* Numbers of the rows of q that differ, in the first places of kept (rows); returns their count. */
WRAPPER(call_distinct) {
  arguments taken = begin("distinct", given, count);
  const double* q = numbers(&taken, "q", SHAPE(ANY, ANY));
  const long long rows = taken.shape[0], n = taken.shape[1];
  const long long* circling = indices(&taken, "circling", 0, 2, SHAPE(n));
  const double apart = number(&taken, "apart");
  long long* kept = written_indices(&taken, "kept", SHAPE(rows));
  long long found = 0;
  if (!ready(&taken)) return ended(&taken, NULL);
  WITHOUT_LOCK(found = distinct(rows, n, q, circling, apart, kept));
  return ended(&taken, PyLong_FromLongLong(found));
}

PyMethodDef inverse_functions[] = {
    FUNCTION("goal", make_goal, "Poses of links of one arm."),
    FUNCTION("linearized", call_linearized, "Errors and Jacobians."),
    FUNCTION("approach", call_approach, "Moves configurations towards the goal."),
    FUNCTION("centre", call_centre, "Moves configurations towards the centre of the tolerances."),
    FUNCTION("draw_near", call_draw_near, "Moves configurations at the goal towards the start."),
    FUNCTION("distinct", call_distinct, "Finds configurations that differ from those before them."),
    END_OF_FUNCTIONS,
};
