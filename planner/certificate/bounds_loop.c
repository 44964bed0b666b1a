/* The bounds of many pairs on many intervals: `Bounds.by_ball` and `Bounds.by_plane`, equal to NumPy's but for rounding.
   What is not a number stays so, and passes no bound: a direction that is not finite has no support value. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

/* Bodies: of each, `number` vertices from row `first` on, and what sweeps them: a ball, a disc normal to z, an
   ellipsoid; half the size of its box, the radius of its ball; on interval k it has row `row` + k `step` of the places
below. Pairs, and which coordinates move one of their bodies and not the other (pairs, n). `turns` is 1 for every
   coordinate that turns. */
typedef struct {
  long long n, pairs, bodies;
  const long long *turns, *a, *b, *moves_a, *moves_b, *first, *number, *row, *step;
  const double *vertices, *ball, *disc, *radii, *half, *radius;
} world;

/* The intervals, as in `Intervals`; the last four are null where nothing drifts. */
typedef struct {
  long long count, places, n;
  const double *rotation, *origin, *center, *reach, *delta, *deviation, *axes, *points;
  const double *drift_omega, *drift_velocity, *drift_first, *drift_second;
} intervals;

/* A query: pairs on intervals. */
typedef struct {
  const world* of;
  const intervals* during;
  const long long *node, *pair;
  long long items;
} query;

/* One body of a pair on an interval: its row of the places, and which coordinates move it and not the other. */
typedef struct {
  const world* of;
  const intervals* during;
  long long k, body, row;
  const long long* moves;
} mover;

static mover mover_of(const query* request, long long item, int second) {
  const world* of = request->of;
  const long long k = request->node[item], pair = request->pair[item], body = second ? of->b[pair] : of->a[pair];
  return (mover){
      .of = of,
      .during = request->during,
      .k = k,
      .body = body,
      .row = of->row[body] + k * of->step[body],
      .moves = (second ? of->moves_b : of->moves_a) + pair * of->n,
  };
}

/* --- by balls ----------------------------------------------------------------------------------------------------- */

/* How far any point of a body moves from its place at the midpoint: Σ (|d_j| + e_j) ρ_j. */
static double travel(const mover* by) {
  const long long n = by->of->n;
  const double* reach = by->during->reach + by->row * n;
  const double *delta = by->during->delta + by->k * n, *deviation = by->during->deviation + by->k * n;
  double total = 0.0;
  for (long long j = 0; j < n; ++j)
    if (by->moves[j]) total += (fabs(delta[j]) + deviation[j]) * reach[j];
  return total;
}

/* The distance of the centre of the first body's ball from the second one's box, and its direction; from inside, that
   from the box's centre. */
static double centre_to_box(const mover* ball, const mover* box, double* normal) {
  const double* rotation = box->during->rotation + 9 * box->row;
  const double* half = box->of->half + 3 * box->body;
  double gap[3], local[3], away[3];
  difference(ball->during->center + 3 * ball->row, box->during->center + 3 * box->row, gap);
  turned_back(rotation, gap, local);
  for (int i = 0; i < 3; ++i)
    away[i] = local[i] - (local[i] < -half[i] ? -half[i] : (local[i] > half[i] ? half[i] : local[i]));
  const double square = dot(away, away);
  turned(rotation, square == 0.0 ? local : away, normal);
  const double length = norm(normal);
  for (int i = 0; i < 3; ++i) normal[i] = length > 0.0 ? normal[i] / length : (i == 2 ? 1.0 : 0.0);
  return sqrt(square);
}

/* From the ball around the first body of each item's pair to the box of the second: the distance, less radius and
   travel, and its direction. */
static void by_ball(const query* request, double* bound, double* normal) {
  for (long long i = 0; i < request->items; ++i) {
    const mover ours = mover_of(request, i, 0), theirs = mover_of(request, i, 1);
    const double distance = centre_to_box(&ours, &theirs, normal + 3 * i);
    bound[i] = distance - request->of->radius[ours.body] - travel(&ours) - travel(&theirs);
  }
}

/* --- by planes ---------------------------------------------------------------------------------------------------- */

/* x' = omega × x + velocity, how far a body moves at most, and how far beyond that straight line. */
typedef struct {
  double omega[3], velocity[3], first, second;
} motion;

/* Add the share of coordinate j, which moves by `delta`: about an axis z through o, delta z and o × delta z; along z only
   a velocity. */
static void add_joint(const mover* by, long long j, double delta, motion* found) {
  const double* axis = by->during->axes + 3 * (by->k * by->of->n + j);
  const double* point = by->during->points + 3 * (by->k * by->of->n + j);
  double across[3];
  if (!by->of->turns[j]) {
    for (int i = 0; i < 3; ++i) found->velocity[i] += delta * axis[i];
    return;
  }
  cross(point, axis, across);
  for (int i = 0; i < 3; ++i) {
    found->omega[i] += delta * axis[i];
    found->velocity[i] += delta * across[i];
  }
}

static void add_drift(const intervals* during, long long row, motion* found) {
  for (int i = 0; i < 3; ++i) {
    found->omega[i] += during->drift_omega[3 * row + i];
    found->velocity[i] += during->drift_velocity[3 * row + i];
  }
  found->first += during->drift_first[row];
  found->second += during->drift_second[row];
}

/* The motion of a body, due to the joints that move it and to its own drift. */
static motion motion_of(const mover* by) {
  const intervals* during = by->during;
  const long long n = by->of->n;
  const double* reach = during->reach + by->row * n;
  const double *delta = during->delta + by->k * n, *deviation = during->deviation + by->k * n;
  double total = 0.0, leaving = 0.0, bend = 0.0, before = 0.0;
  motion found = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 0.0, 0.0};
  for (long long j = 0; j < n; ++j) {
    if (!by->moves[j]) continue;
    const double turn = by->of->turns[j] ? fabs(delta[j]) : 0.0, speed = fabs(delta[j]) * reach[j];
    leaving += deviation[j] * reach[j];
    total += speed;
    bend += speed * (turn + 2.0 * before);
    before += turn;
    add_joint(by, j, delta[j], &found);
  }
  found.first = total + leaving;
  found.second = 0.5 * bend + leaving;
  if (during->drift_omega) add_drift(during, by->row, &found);
  return found;
}

/* max v·x over vertices (number, 3). */
static double farthest(const double* vertices, long long number, const double* v) {
  double best = dot(v, vertices);
  for (long long k = 1; k < number; ++k) {
    const double along = dot(v, vertices + 3 * k);
    best = along > best ? along : best;
  }
  return best;
}

/* max v·x over the points x of a body, in its own frame; what is not finite has none. */
static double support(const world* of, long long body, const double* v) {
  const double* radii = of->radii + 3 * body;
  double best = farthest(of->vertices + 3 * of->first[body], of->number[body], v);
  best += of->ball[body] * norm(v) + of->disc[body] * sqrt(v[0] * v[0] + v[1] * v[1]);
  best += sqrt(radii[0] * v[0] * radii[0] * v[0] + radii[1] * v[1] * radii[1] * v[1] +
               radii[2] * v[2] * radii[2] * v[2]);
  return v[0] - v[0] == 0.0 && v[1] - v[1] == 0.0 && v[2] - v[2] == 0.0 ? best : NAN;
}

/* max n·(x + s x') over the points x of a body, x' = omega × x + velocity, for s = 0, 1, −1. */
static void extremes(const mover* by, const double* n, const motion* moved, double* values) {
  const double *origin = by->during->origin + 3 * by->row, *rotation = by->during->rotation + 9 * by->row;
  const double along = dot(n, moved->velocity);
  double across[3], way[3], local[3];
  cross(n, moved->omega, across);
  for (int s = 0; s < 3; ++s) {
    for (int i = 0; i < 3; ++i) way[i] = s == 0 ? n[i] : (s == 1 ? n[i] + across[i] : n[i] - across[i]);
    turned_back(rotation, way, local);
    values[s] = s == 0 ? 0.0 : (s == 1 ? along : -along);
    values[s] += dot(way, origin);
    values[s] += support(by->of, by->body, local);
  }
}

/* Between parallel planes normal to a direction from the second body of each item's pair to the first: their distance
   at the midpoint, the bound over the interval, and how far the two bodies move at most. */
static void by_plane(const query* request, const double* normal, double* gap, double* bound, double* travels) {
  for (long long i = 0; i < request->items; ++i) {
    const mover ours = mover_of(request, i, 0), theirs = mover_of(request, i, 1);
    const motion first = motion_of(&ours), second = motion_of(&theirs);
    const double *n = normal + 3 * i, back[3] = {-n[0], -n[1], -n[2]};
    double near[3], far[3], gaps[3];
    extremes(&ours, back, &first, near);
    extremes(&theirs, n, &second, far);
    for (int s = 0; s < 3; ++s) gaps[s] = -near[s] - far[s];
    travels[i] = first.first + second.first;
    gap[i] = gaps[0];
    bound[i] = most_of(least_of(gaps[1], gaps[2]) - (first.second + second.second), gaps[0] - travels[i]);
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static void take_bodies(arguments* taken, world* of, long long vertices) {
  of->first = indices(taken, "first", 0, vertices, SHAPE(of->bodies));
  of->number = indices(taken, "number", 1, vertices + 1, SHAPE(of->bodies));
  of->ball = numbers(taken, "ball", SHAPE(of->bodies));
  of->disc = numbers(taken, "disc", SHAPE(of->bodies));
  of->radii = numbers(taken, "radii", SHAPE(of->bodies, 3));
  of->half = numbers(taken, "half", SHAPE(of->bodies, 3));
  of->radius = numbers(taken, "radius", SHAPE(of->bodies));
  for (long long k = 0; !taken->failed && k < of->bodies; ++k)
    if (of->first[k] + of->number[k] > vertices) wrong(taken, "number", "rows within `vertices`");
}

WRAPPER(make_world) {
  arguments taken = begin("world", given, count);
  world of;
  of.turns = indices(&taken, "turns", 0, 2, SHAPE(ANY));
  of.n = taken.shape[0];
  of.row = indices(&taken, "row", 0, MANY, SHAPE(ANY));
  of.bodies = taken.shape[0];
  of.step = indices(&taken, "step", 0, MANY, SHAPE(of.bodies));
  of.a = indices(&taken, "a", 0, of.bodies, SHAPE(ANY));
  of.pairs = taken.shape[0];
  of.b = indices(&taken, "b", 0, of.bodies, SHAPE(of.pairs));
  of.moves_a = indices(&taken, "moves_a", 0, 2, SHAPE(of.pairs, of.n));
  of.moves_b = indices(&taken, "moves_b", 0, 2, SHAPE(of.pairs, of.n));
  of.vertices = numbers(&taken, "vertices", SHAPE(ANY, 3));
  take_bodies(&taken, &of, taken.shape[0]);
  return made(&taken, "world", &of, sizeof of);
}

WRAPPER(make_intervals) {
  arguments taken = begin("intervals", given, count);
  intervals during;
  during.rotation = numbers(&taken, "rotation", SHAPE(ANY, 3, 3));
  during.places = taken.shape[0];
  during.origin = numbers(&taken, "origin", SHAPE(during.places, 3));
  during.center = numbers(&taken, "center", SHAPE(during.places, 3));
  during.reach = numbers(&taken, "reach", SHAPE(during.places, ANY));
  during.n = taken.shape[1];
  during.delta = numbers(&taken, "delta", SHAPE(ANY, during.n));
  during.count = taken.shape[0];
  during.deviation = numbers(&taken, "deviation", SHAPE(during.count, during.n));
  during.axes = numbers(&taken, "axes", SHAPE(during.count, during.n, 3));
  during.points = numbers(&taken, "points", SHAPE(during.count, during.n, 3));
  during.drift_omega = numbers_or_none(&taken, "drift_omega", SHAPE(during.places, 3));
  during.drift_velocity = numbers_or_none(&taken, "drift_velocity", SHAPE(during.places, 3));
  during.drift_first = numbers_or_none(&taken, "drift_first", SHAPE(during.places));
  during.drift_second = numbers_or_none(&taken, "drift_second", SHAPE(during.places));
  const int drifts = !!during.drift_omega + !!during.drift_velocity + !!during.drift_first + !!during.drift_second;
  if (drifts != 0 && drifts != 4) wrong(&taken, "drift_omega", "given with the three after it, or none of the four");
  return made(&taken, "intervals", &during, sizeof during);
}

/* The first arguments of both functions; every body has its place on every interval. */
static query take_query(arguments* taken) {
  query request;
  request.of = record(taken, "world", "world");
  request.during = record(taken, "intervals", "intervals");
  request.node = indices(taken, "node", 0, request.during ? request.during->count : 0, SHAPE(ANY));
  request.items = taken->shape[0];
  request.pair = indices(taken, "pair", 0, request.of ? request.of->pairs : 0, SHAPE(request.items));
  if (taken->failed) return request;
  const long long last = request.during->count - 1, places = request.during->places;
  if (request.during->n != request.of->n) wrong(taken, "intervals", "of the joints of the world");
  for (long long k = 0; k < request.of->bodies && last >= 0; ++k) {
    const long long row = request.of->row[k], step = request.of->step[k];
    if (row >= places || (step > 0 && last > (places - 1 - row) / step))
      wrong(taken, "intervals", "those in which the bodies of the world have places");
  }
  return request;
}

WRAPPER(call_by_ball) {
  arguments taken = begin("by_ball", given, count);
  const query request = take_query(&taken);
  double* bound = written(&taken, "bound", SHAPE(request.items));
  double* normal = written(&taken, "normal", SHAPE(request.items, 3));
  if (ready(&taken)) WITHOUT_LOCK(by_ball(&request, bound, normal));
  return ended(&taken, none());
}

WRAPPER(call_by_plane) {
  arguments taken = begin("by_plane", given, count);
  const query request = take_query(&taken);
  const double* normal = numbers(&taken, "normal", SHAPE(request.items, 3));
  double* gap = written(&taken, "gap", SHAPE(request.items));
  double* bound = written(&taken, "bound", SHAPE(request.items));
  double* travels = written(&taken, "travels", SHAPE(request.items));
  if (ready(&taken)) WITHOUT_LOCK(by_plane(&request, normal, gap, bound, travels));
  return ended(&taken, none());
}

PyMethodDef bounds_functions[] = {
    FUNCTION("world", make_world, "Bodies and pairs."),
    FUNCTION("intervals", make_intervals, "Intervals of a motion, with the places of bodies."),
    FUNCTION("by_ball", call_by_ball, "Bounds by balls and boxes, and directions."),
    FUNCTION("by_plane", call_by_plane, "Bounds by planes."),
    END_OF_FUNCTIONS,
};
