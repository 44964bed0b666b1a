/* Every configuration of six turning joints that places a link, in closed form, for any arm of which two neighbouring
   axes meet. With E_i the motion about axis i, M the link's placement where all joints are 0 and T the wanted one,
   E_1 … E_6 = T M⁻¹ = G is solved (`arm_kinds.h`), from any joint on, as a closed loop has no first one:
   E_{r+1} … E_6 (G⁻¹ E_1 … E_r G) = G; or backwards, by E_6⁻¹ … E_1⁻¹ = G⁻¹. Any two neighbours that meet are thus the
   last ones. Lengths in [m], angles in [rad]. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/cholesky.h"
#include "arm_kinds.h"

enum { MOST_CONFIGURATIONS = 16 }; /* configurations */

static const double POSE_ERROR = 1e-10; /* [m] and [rad] by which a configuration may miss the pose */
static const double SAME_BRANCH = 1e-6; /* [rad] between two configurations that are one */
static const double BEYOND_LIMIT = 0.3; /* [rad] beyond a limit of what the last steps need not bring back */
static const double DIVERGED = 1e-3;    /* [m] and [rad] still missed after half of the steps */
static const double SINGULAR = 0.02;    /* [m] and [rad] for 1 rad, least: below it two configurations may be close */
static const double AT_LIMIT = 1e-9;    /* [rad or m] beyond a limit that is rounding */
static const double DAMPING = 1e-12;    /* λ² of the last steps */

/* A chain of n joints, each about (turns) or along a direction through a point, the link's placement `tip` where all
   are 0, which six of them are solved, from which of these on, in which direction, and how. */
typedef struct {
  long long n, kind, first, backwards;
  const long long *turns, *solved;
  const double *directions, *points, *tip, *lower, *upper;
} chain;

/* Where the link is at angles of six axes, and where it is after each of these: at (SIX + 1, 12) and link (12); its
   error (6) [m, rad]. */
static void look(const axis* axes, const double* tip, const double* wanted, const double* q, double (*at)[12],
                 double* link, double* error) {
  double between[9];
  to_identity(at[0]);
  for (int j = 0; j < SIX; ++j) follow(at[j], &axes[j], 1, q[j], at[j + 1]);
  compose(at[SIX], tip, link);
  difference(wanted + 9, link + 9, error);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) between[3 * i + j] = dot(wanted + 3 * i, link + 3 * j);
  const double sine[3] = {0.5 * (between[7] - between[5]), 0.5 * (between[2] - between[6]),
                          0.5 * (between[3] - between[1])};
  const double size = norm(sine), angle = atan2(size, 0.5 * (between[0] + between[4] + between[8] - 1.0));
  for (int i = 0; i < 3; ++i) error[3 + i] = size > 1e-12 ? sine[i] / size * angle : (angle > 1.0 ? NAN : sine[i]);
}

/* The Jacobian J (6, 6) there, in world axes at the link's origin. */
static void slope_at(const axis* axes, double (*at)[12], const double* link, double* jacobian) {
  double w[3], lever[3], velocity[3], point[3];
  for (int j = 0; j < SIX; ++j) {
    turned(at[j], axes[j].h, w);
    placed(at[j], axes[j].p, point);
    difference(link + 9, point, lever);
    cross(w, lever, velocity);
    for (int i = 0; i < 3; ++i) {
      jacobian[SIX * i + j] = velocity[i];
      jacobian[SIX * (3 + i) + j] = w[i];
    }
  }
}

static double missed_by(const double* error) { return most_of(norm(error), norm(error + 3)); }

/* J Jᵀ + λ² I, by columns of its lower half. */
static void square_of(const double* jacobian, double* square) {
  for (int c = 0; c < SIX; ++c)
    for (int r = c; r < SIX; ++r) {
      double sum = r == c ? DAMPING : 0.0;
      for (int k = 0; k < SIX; ++k) sum += jacobian[SIX * r + k] * jacobian[SIX * c + k];
      square[SIX * c + r - c] = sum;
    }
}

/* way = Jᵀ pull. */
static void drawn_by(const double* jacobian, const double* pull, double* way) {
  for (int j = 0; j < SIX; ++j) {
    way[j] = 0.0;
    for (int i = 0; i < SIX; ++i) way[j] += jacobian[SIX * i + j] * pull[i];
  }
}

/* Newton's steps from angles that almost place the link. Returns whether they do in the end. */
static int refine(const axis* axes, const double* tip, const double* wanted, int steps, double* q) {
  double at[SIX + 1][12], link[12], error[SIX], jacobian[SIX * SIX], square[SIX * SIX], way[SIX];
  for (int step = 0;; ++step) {
    look(axes, tip, wanted, q, at, link, error);
    const double missed = missed_by(error);
    if (!(missed < 4.0) || step == steps || missed <= 1e-14) return missed <= POSE_ERROR;
    if (2 * step >= steps && missed > DIVERGED) return 0;
    slope_at(axes, at, link, jacobian);
    square_of(jacobian, square);
    if (!solved(SIX, SIX, square, error)) return missed <= POSE_ERROR;
    drawn_by(jacobian, error, way);
    double most = 0.0;
    for (int j = 0; j < SIX; ++j) most = fmax(most, fabs(way[j]));
    for (int j = 0; j < SIX; ++j) q[j] += way[j] * (most > 0.3 ? 0.3 / most : 1.0);
    if (missed <= POSE_ERROR && most <= 1e-13) return 1;
  }
}

/* The direction (a unit vector) in which angles move the link least, and how little, per unit: by inverse iteration. */
static double least_moving(const axis* axes, const double* tip, const double* wanted, const double* q, double* way) {
  double at[SIX + 1][12], link[12], error[SIX], jacobian[SIX * SIX], square[SIX * SIX], moved = 0.0;
  look(axes, tip, wanted, q, at, link, error);
  slope_at(axes, at, link, jacobian);
  square_of(jacobian, square);
  for (int i = 0; i < SIX; ++i) error[i] = 1.0 + 0.1 * i;
  for (int again = 0; again < 3; ++again) {
    if (again) solved_again(SIX, SIX, square, error);
    else if (!solved(SIX, SIX, square, error)) return 1.0;
    drawn_by(jacobian, error, way);
    double size = 0.0;
    for (int j = 0; j < SIX; ++j) size += way[j] * way[j];
    for (int j = 0; j < SIX; ++j) way[j] /= sqrt(size);
    moved = 0.0;
    for (int i = 0; i < SIX; ++i) {
      error[i] = 0.0;
      for (int j = 0; j < SIX; ++j) error[i] += jacobian[SIX * i + j] * way[j];
      moved += error[i] * error[i];
    }
    moved = sqrt(moved);
    for (int i = 0; i < SIX; ++i) error[i] /= fmax(moved, 1e-300);
  }
  return moved;
}

/* The angle shifted by whole turns, nearest to `seed` within the limits; not a number where there is none. */
static double within(double value, int turns, double seed, double lower, double upper) {
  if (turns) {
    value += 2.0 * PI * round((seed - value) / (2.0 * PI));
    if (value > upper + AT_LIMIT) value -= 2.0 * PI * ceil((value - upper - AT_LIMIT) / (2.0 * PI));
    if (value < lower - AT_LIMIT) value += 2.0 * PI * ceil((lower - AT_LIMIT - value) / (2.0 * PI));
  }
  if (!(value <= upper + AT_LIMIT && value >= lower - AT_LIMIT)) return NAN;
  return fmin(fmax(value, lower), upper);
}

/* Add a configuration, if there is none like it and room is left. Returns how many there are then. */
static int add_root(const double* q, double (*roots)[SIX], int count) {
  if (count == MOST_CONFIGURATIONS) return count;
  for (int i = 0; i < count; ++i) {
    double most = 0.0;
    for (int j = 0; j < SIX; ++j) most = fmax(most, apart(q[j], roots[i][j]));
    if (most <= SAME_BRANCH) return count;
  }
  for (int j = 0; j < SIX; ++j) roots[count][j] = q[j];
  return count + 1;
}

/* Configurations (MOST_CONFIGURATIONS, n), in number returned, with what is held at `values`. */
static int branches(const chain* arm, const double* wanted, const double* values, const double* seed, double* found) {
  axis axes[SIX], seen[SIX];
  double at[12], next[12], tip[12], back[12], goal[12], inverse[12], other[SIX], angles[TRIED][SIX];
  int kept = 0;
  to_identity(at);
  for (long long j = 0, s = 0, held = 0; j < arm->n; ++j) {
    const double *direction = arm->directions + 3 * j, *point = arm->points + 3 * j;
    axis about;
    if (s < SIX && arm->solved[s] == j) {
      turned(at, direction, axes[s].h);
      placed(at, point, axes[s].p);
      other[s++] = seed[j];
      continue;
    }
    for (int i = 0; i < 3; ++i) {
      about.h[i] = direction[i];
      about.p[i] = point[i];
    }
    follow(at, &about, arm->turns[j] != 0, values[held++], next);
    for (int i = 0; i < 12; ++i) at[i] = next[i];
  }
  compose(at, arm->tip, tip);
  invert(tip, back);
  compose(wanted, back, goal);
  invert(goal, inverse);
  double turned_seed[SIX];
  int order[SIX];
  for (int j = 0; j < SIX; ++j) {
    const int at_place = (int)arm->first + (arm->backwards ? SIX - 1 - j : j), joint = order[j] = at_place % SIX;
    seen[j] = axes[joint];
    if (at_place >= SIX) { /* E_{r+1} … E_6 (G⁻¹ E_1 … E_r G) = G */
      turned(inverse, axes[joint].h, seen[j].h);
      placed(inverse, axes[joint].p, seen[j].p);
    }
    turned_seed[j] = arm->backwards ? -other[joint] : other[joint];
  }
  const double* target = arm->backwards ? inverse : goal;
  int count;
  if (arm->kind == WRIST)
    count = by_wrist(seen, target, turned_seed, angles);
  else if (arm->kind == PARALLEL)
    count = by_parallel(seen, target, turned_seed, angles);
  else
    count = by_search(seen, target, turned_seed, angles);
  const int steps = arm->kind == MEETING ? 20 : 8;
  double roots[MOST_CONFIGURATIONS][SIX], q[SIX], way[SIX];
  int rooted = 0;
  for (int k = 0; k < count; ++k) {
    int inside = 1;
    for (int j = 0; j < SIX; ++j) q[order[j]] = arm->backwards ? -angles[k][j] : angles[k][j];
    for (int j = 0; j < SIX; ++j) { /* far beyond a limit no step leads back */
      const long long joint = arm->solved[j];
      const double value = within(q[j], 1, seed[joint], arm->lower[joint] - BEYOND_LIMIT, arm->upper[joint] + BEYOND_LIMIT);
      inside = inside && value == value;
    }
    if (inside && refine(axes, tip, wanted, steps, q)) rooted = add_root(q, roots, rooted);
  }
  for (int k = 0; k < rooted; ++k) { /* almost singular, another one is close by, on the other side of where it would be */
    const double least = least_moving(axes, tip, wanted, roots[k], way);
    for (int each = 0; least < SINGULAR && each < 6; ++each) {
      const double length = fmin((each < 2 ? 8.0 : each < 4 ? 20.0 : 50.0) * least, 0.4) * (each % 2 ? -1.0 : 1.0);
      for (int j = 0; j < SIX; ++j) q[j] = roots[k][j] + length * way[j];
      if (refine(axes, tip, wanted, steps, q)) rooted = add_root(q, roots, rooted);
    }
  }
  for (int k = 0; k < rooted; ++k) {
    double* row = found + arm->n * kept;
    int inside = 1;
    for (long long j = 0, s = 0, held = 0; j < arm->n; ++j) {
      const int is_solved = s < SIX && arm->solved[s] == j;
      row[j] = within(is_solved ? roots[k][s] : values[held], arm->turns[j] != 0, seed[j], arm->lower[j], arm->upper[j]);
      s += is_solved;
      held += !is_solved;
      inside = inside && row[j] == row[j];
    }
    kept += inside;
  }
  return kept;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_chain) {
  arguments taken = begin("six_joints", given, count);
  chain arm = {.n = whole(&taken, "n", SIX, 64)};
  arm.kind = whole(&taken, "kind", 0, KINDS - 1);
  arm.first = whole(&taken, "first", 0, SIX - 1);
  arm.backwards = whole(&taken, "backwards", 0, 1);
  arm.turns = indices(&taken, "turns", 0, 2, SHAPE(arm.n));
  arm.solved = indices(&taken, "solved", 0, arm.n, SHAPE(SIX));
  arm.directions = numbers(&taken, "directions", SHAPE(arm.n, 3));
  arm.points = numbers(&taken, "points", SHAPE(arm.n, 3));
  arm.tip = numbers(&taken, "tip", SHAPE(12));
  arm.lower = numbers(&taken, "lower", SHAPE(arm.n));
  arm.upper = numbers(&taken, "upper", SHAPE(arm.n));
  for (int s = 1; !taken.failed && s < SIX; ++s)
    if (arm.solved[s] <= arm.solved[s - 1]) wrong(&taken, "solved", "in rising order");
  return made(&taken, "six_joints", &arm, sizeof arm);
}

/* All configurations of a pose (12) with each row of held values (rows, n − 6): found (16 rows, n), counts (rows). */
WRAPPER(call_branches) {
  arguments taken = begin("branches", given, count);
  const chain* arm = record(&taken, "chain", "six_joints");
  const long long n = arm ? arm->n : SIX;
  const double* wanted = numbers(&taken, "wanted", SHAPE(12));
  const double* held = numbers(&taken, "held", SHAPE(ANY, n - SIX));
  const long long rows = taken.shape[0];
  if (rows > 1LL << 24) wrong(&taken, "held", "fewer rows");
  const double* seed = numbers(&taken, "seed", SHAPE(n));
  double* found = written(&taken, "found", SHAPE(MOST_CONFIGURATIONS * rows, n));
  long long* counts = written_indices(&taken, "counts", SHAPE(rows));
  if (ready(&taken)) {
    Py_BEGIN_ALLOW_THREADS;
    for (long long row = 0; row < rows; ++row) {
      counts[row] = branches(arm, wanted, held + (n - SIX) * row, seed, found);
      found += n * counts[row];
    }
    Py_END_ALLOW_THREADS;
  }
  return ended(&taken, none());
}

PyMethodDef closed_form_functions[] = {
    FUNCTION("six_joints", make_chain, "An arm that is solved in closed form."),
    FUNCTION("branches", call_branches, "Every configuration that places its link."),
    END_OF_FUNCTIONS,
};
