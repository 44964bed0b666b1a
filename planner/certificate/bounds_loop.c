/* The bounds of many pairs on many intervals: `Bounds.by_ball` and `Bounds.by_plane`, to rounding the same as in NumPy.
   What is not a number stays so, and passes no bound: a direction that is not finite has no support value. */

#include <math.h>

#include "../../distance/compiled/border.h"

/* Bodies: of each, `number` vertices from row `first` on, and what sweeps them: a ball, a disc normal to z, an
   ellipsoid; half the size of its box, the radius of its ball; on interval k it has row `row` + k `step` of the places
   below. Pairs, and which coordinates move one of their bodies and not the other (pairs, n). `turns` tells of every
   coordinate whether it turns. */
typedef struct {
  long long n, pairs, bodies;
  const long long *turns, *a, *b, *moves_a, *moves_b, *first, *number, *row, *step;
  const double *vertices, *ball, *disc, *radii, *half, *radius;
} world;

/* The intervals, as `Intervals` says; the last four are null where nothing drifts. */
typedef struct {
  long long count, places, n;
  const double *rotation, *origin, *center, *reach, *delta, *deviation, *axes, *points;
  const double *drift_omega, *drift_velocity, *drift_first, *drift_second;
} intervals;

typedef struct {
  double omega[3], velocity[3], first, second;
} motion;

/* What is not a number stays so, and proves nothing. */
static double least(double a, double b) { return a != a || a < b ? a : b; }
static double most(double a, double b) { return a != a || a > b ? a : b; }

static double travel(const world* w, const intervals* at, long long k, long long row, const long long* moves) {
  const double *reach = at->reach + row * w->n, *d = at->delta + k * w->n, *e = at->deviation + k * w->n;
  double total = 0.0;
  long long j;
  for (j = 0; j < w->n; ++j) if (moves[j]) total += (fabs(d[j]) + e[j]) * reach[j];
  return total;
}

/* From the ball around the first body of each item's pair to the box of the second: the distance, less radius and
   travel, and its direction. */
static void by_ball(const world* w, const intervals* at, long long items, const long long* node, const long long* pair,
             double* bound, double* normal) {
  long long i;
  int c;
  for (i = 0; i < items; ++i, normal += 3) {
    long long k = node[i], p = pair[i], a = w->a[p], b = w->b[p];
    long long row = w->row[a] + k * w->step[a], other_row = w->row[b] + k * w->step[b];
    const double *turn = at->rotation + 9 * other_row, *half = w->half + 3 * b;
    const double *ours = at->center + 3 * row, *other = at->center + 3 * other_row;
    double gap[3], local[3], away[3], square = 0.0, length, *out;
    for (c = 0; c < 3; ++c) gap[c] = ours[c] - other[c];
    for (c = 0; c < 3; ++c) {
      double x = turn[c] * gap[0] + turn[3 + c] * gap[1] + turn[6 + c] * gap[2];
      local[c] = x;
      away[c] = x - (x < -half[c] ? -half[c] : (x > half[c] ? half[c] : x));
      square += away[c] * away[c];
    }
    bound[i] = sqrt(square) - w->radius[a] - travel(w, at, k, row, w->moves_a + p * w->n) -
               travel(w, at, k, other_row, w->moves_b + p * w->n);
    out = square == 0.0 ? local : away;
    for (c = 0; c < 3; ++c) normal[c] = turn[3 * c] * out[0] + turn[3 * c + 1] * out[1] + turn[3 * c + 2] * out[2];
    length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (c = 0; c < 3; ++c) normal[c] = length > 0.0 ? normal[c] / length : (c == 2 ? 1.0 : 0.0);
  }
}

/* The motion of the body in a row of the places, due to the joints that `moves` names and to its own drift. */
static motion motion_of(const world* w, const intervals* at, long long k, long long row, const long long* moves) {
  const double *reach = at->reach + row * w->n, *d = at->delta + k * w->n, *e = at->deviation + k * w->n;
  double total = 0.0, leaving = 0.0, bend = 0.0, before = 0.0;
  long long j, n = w->n;
  int c;
  motion found = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 0.0, 0.0};
  for (j = 0; j < n; ++j) {
    const double *z = at->axes + 3 * (k * n + j), *o = at->points + 3 * (k * n + j);
    double speed, turn = w->turns[j] ? fabs(d[j]) : 0.0;
    if (!moves[j]) continue;
    speed = fabs(d[j]) * reach[j];
    leaving += e[j] * reach[j];
    total += speed;
    bend += speed * (turn + 2.0 * before);
    before += turn;
    if (w->turns[j]) {
      for (c = 0; c < 3; ++c) found.omega[c] += d[j] * z[c];
      found.velocity[0] += d[j] * (o[1] * z[2] - o[2] * z[1]);
      found.velocity[1] += d[j] * (o[2] * z[0] - o[0] * z[2]);
      found.velocity[2] += d[j] * (o[0] * z[1] - o[1] * z[0]);
    } else {
      for (c = 0; c < 3; ++c) found.velocity[c] += d[j] * z[c];
    }
  }
  found.first = total + leaving;
  found.second = 0.5 * bend + leaving;
  if (at->drift_omega) {
    for (c = 0; c < 3; ++c) {
      found.omega[c] += at->drift_omega[3 * row + c];
      found.velocity[c] += at->drift_velocity[3 * row + c];
    }
    found.first += at->drift_first[row];
    found.second += at->drift_second[row];
  }
  return found;
}

static double support(const world* w, long long b, double x, double y, double z) {
  const double *v = w->vertices + 3 * w->first[b], *end = v + 3 * w->number[b], *r = w->radii + 3 * b;
  double best = x * v[0] + y * v[1] + z * v[2];
  for (v += 3; v < end; v += 3) {
    double along = x * v[0] + y * v[1] + z * v[2];
    best = along > best ? along : best;
  }
  best += w->ball[b] * sqrt(x * x + y * y + z * z) + w->disc[b] * sqrt(x * x + y * y);
  return best + sqrt(r[0] * x * r[0] * x + r[1] * y * r[1] * y + r[2] * z * r[2] * z);
}

/* max n·(x + s x') over the points x of a body, x' = omega × x + velocity, for s = 0, 1, −1. */
static void extremes(const world* w, const intervals* at, long long body, long long row, const double* n,
                     const motion* by, double* values) {
  const double *u = by->velocity, *v = by->omega, *o = at->origin + 3 * row, *turn = at->rotation + 9 * row;
  double across[3];
  int s, j;
  across[0] = n[1] * v[2] - n[2] * v[1];
  across[1] = n[2] * v[0] - n[0] * v[2];
  across[2] = n[0] * v[1] - n[1] * v[0];
  for (s = 0; s < 3; ++s) {
    double d[3], local[3], value = s ? (s == 1 ? 1.0 : -1.0) * (n[0] * u[0] + n[1] * u[1] + n[2] * u[2]) : 0.0;
    for (j = 0; j < 3; ++j) d[j] = s ? (s == 1 ? n[j] + across[j] : n[j] - across[j]) : n[j];
    for (j = 0; j < 3; ++j) local[j] = turn[j] * d[0] + turn[3 + j] * d[1] + turn[6 + j] * d[2];
    value += d[0] * o[0] + d[1] * o[1] + d[2] * o[2];
    value += support(w, body, local[0], local[1], local[2]);
    if (!(local[0] - local[0] == 0.0 && local[1] - local[1] == 0.0 && local[2] - local[2] == 0.0)) value = NAN;
    values[s] = value;
  }
}

/* Between parallel planes normal to a direction from the second body of each item's pair to the first: their distance
   at the midpoint, the bound over the interval, and how far the two bodies move at most. */
static void by_plane(const world* w, const intervals* at, long long items, const long long* node, const long long* pair,
              const double* normal, double* gap, double* bound, double* travels) {
  long long i;
  for (i = 0; i < items; ++i, normal += 3) {
    long long k = node[i], p = pair[i], a = w->a[p], b = w->b[p];
    long long row = w->row[a] + k * w->step[a], other = w->row[b] + k * w->step[b];
    motion ours = motion_of(w, at, k, row, w->moves_a + p * w->n);
    motion theirs = motion_of(w, at, k, other, w->moves_b + p * w->n);
    double back[3], near[3], far[3], gaps[3], moved;
    int s;
    for (s = 0; s < 3; ++s) back[s] = -normal[s];
    extremes(w, at, a, row, back, &ours, near);
    extremes(w, at, b, other, normal, &theirs, far);
    for (s = 0; s < 3; ++s) gaps[s] = -near[s] - far[s];
    moved = ours.first + theirs.first;
    gap[i] = gaps[0];
    bound[i] = most(least(gaps[1], gaps[2]) - (ours.second + theirs.second), gaps[0] - moved);
    travels[i] = moved;
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* make_world(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("world", given, count);
  const long long many = 1LL << 40;
  world w;
  long long vertices, k;
  PyObject* found;
  (void)self;
  w.turns = rows(&c, "turns", 0, 2, SHAPE(ANY));
  w.n = c.shape[0];
  w.row = rows(&c, "row", 0, many, SHAPE(ANY));
  w.bodies = c.shape[0];
  w.step = rows(&c, "step", 0, many, SHAPE(w.bodies));
  w.a = rows(&c, "a", 0, w.bodies, SHAPE(ANY));
  w.pairs = c.shape[0];
  w.b = rows(&c, "b", 0, w.bodies, SHAPE(w.pairs));
  w.moves_a = rows(&c, "moves_a", 0, 2, SHAPE(w.pairs, w.n));
  w.moves_b = rows(&c, "moves_b", 0, 2, SHAPE(w.pairs, w.n));
  w.vertices = numbers(&c, "vertices", SHAPE(ANY, 3));
  vertices = c.shape[0];
  w.first = rows(&c, "first", 0, vertices, SHAPE(w.bodies));
  w.number = rows(&c, "number", 1, vertices + 1, SHAPE(w.bodies));
  w.ball = numbers(&c, "ball", SHAPE(w.bodies));
  w.disc = numbers(&c, "disc", SHAPE(w.bodies));
  w.radii = numbers(&c, "radii", SHAPE(w.bodies, 3));
  w.half = numbers(&c, "half", SHAPE(w.bodies, 3));
  w.radius = numbers(&c, "radius", SHAPE(w.bodies));
  for (k = 0; !c.failed && k < w.bodies; ++k)
    if (w.first[k] + w.number[k] > vertices) wrong(&c, "number", "rows within `vertices`");
  found = made(&c, "world", &w, sizeof w);
  return ended(&c, found);
}

static PyObject* make_intervals(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("intervals", given, count);
  intervals at;
  PyObject* found;
  (void)self;
  at.rotation = numbers(&c, "rotation", SHAPE(ANY, 3, 3));
  at.places = c.shape[0];
  at.origin = numbers(&c, "origin", SHAPE(at.places, 3));
  at.center = numbers(&c, "center", SHAPE(at.places, 3));
  at.reach = numbers(&c, "reach", SHAPE(at.places, ANY));
  at.n = c.shape[1];
  at.delta = numbers(&c, "delta", SHAPE(ANY, at.n));
  at.count = c.shape[0];
  at.deviation = numbers(&c, "deviation", SHAPE(at.count, at.n));
  at.axes = numbers(&c, "axes", SHAPE(at.count, at.n, 3));
  at.points = numbers(&c, "points", SHAPE(at.count, at.n, 3));
  at.drift_omega = numbers_or_none(&c, "drift_omega", SHAPE(at.places, 3));
  at.drift_velocity = numbers_or_none(&c, "drift_velocity", SHAPE(at.places, 3));
  at.drift_first = numbers_or_none(&c, "drift_first", SHAPE(at.places));
  at.drift_second = numbers_or_none(&c, "drift_second", SHAPE(at.places));
  if (!at.drift_omega != !at.drift_velocity || !at.drift_omega != !at.drift_first || !at.drift_omega != !at.drift_second)
    wrong(&c, "drift", "given whole, or not at all");
  found = made(&c, "intervals", &at, sizeof at);
  return ended(&c, found);
}

/* What both functions take first; whether every body has its place on every interval. */
typedef struct {
  const world* w;
  const intervals* at;
  const long long *node, *pair;
  long long items;
} asked;

static asked take_asked(call* c) {
  asked found;
  long long k;
  found.w = record(c, "world", "world");
  found.at = record(c, "intervals", "intervals");
  found.node = rows(c, "node", 0, found.at ? found.at->count : 0, SHAPE(ANY));
  found.items = c->shape[0];
  found.pair = rows(c, "pair", 0, found.w ? found.w->pairs : 0, SHAPE(found.items));
  if (c->failed) return found;
  if (found.at->n != found.w->n) wrong(c, "intervals", "of the joints of the world");
  for (k = 0; k < found.w->bodies && found.at->count > 0; ++k)
    if (found.w->row[k] + (found.at->count - 1) * found.w->step[k] >= found.at->places)
      wrong(c, "intervals", "those in which the bodies of the world have places");
  return found;
}

static PyObject* call_by_ball(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("by_ball", given, count);
  asked of = take_asked(&c);
  double *bound = written(&c, "bound", SHAPE(of.items)), *normal = written(&c, "normal", SHAPE(of.items, 3));
  (void)self;
  if (ready(&c)) WITHOUT_LOCK(by_ball(of.w, of.at, of.items, of.node, of.pair, bound, normal));
  return ended(&c, none());
}

static PyObject* call_by_plane(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("by_plane", given, count);
  asked of = take_asked(&c);
  const double* normal = numbers(&c, "normal", SHAPE(of.items, 3));
  double *gap = written(&c, "gap", SHAPE(of.items)), *bound = written(&c, "bound", SHAPE(of.items));
  double* travels = written(&c, "travels", SHAPE(of.items));
  (void)self;
  if (ready(&c)) WITHOUT_LOCK(by_plane(of.w, of.at, of.items, of.node, of.pair, normal, gap, bound, travels));
  return ended(&c, none());
}

PyMethodDef bounds_functions[] = {
    FUNCTION("world", make_world, "Bodies and pairs."),
    FUNCTION("intervals", make_intervals, "Intervals of a motion, with the places of bodies."),
    FUNCTION("by_ball", call_by_ball, "Bounds by balls and boxes, and directions."),
    FUNCTION("by_plane", call_by_plane, "Bounds by planes."),
    END_OF_FUNCTIONS,
};
