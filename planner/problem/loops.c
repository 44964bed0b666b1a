/* The loops of one evaluation: the hinge on the distance of close pairs, summed at their samples, and sums over samples
   carried back to waypoints. `clearance.py` and `samples.py` are the NumPy twins; the two agree but for rounding, as
   sums are taken in another order. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"
#include "../collision/close_pairs.h"
#include "../collision/exact_loop.h"
#include "../collision/hdsdf_loop.h"
#include "../kinematics/forward_loop.h"

/* A penalty on pairs: the order and the length of their distance's shaping, or the solids between which it is exact, and
   by how much each coordinate moves the first body of a pair against the second, 0, 1 or −1 (pairs, n). */
typedef struct {
  const tables* pairs;
  const solids* solids;
  long long n;
  int gamma;
  double length;
  const double* moves;
} term;

/* Samples: placements (batch, joints, 12), columns (batch, n, 6), weights (batch), null where only depths are wanted. */
typedef struct {
  long long batch, joints;
  const double *placements, *columns, *weight;
} samples;

/* What is added up: gradient (batch, n), Gauss-Newton curvature (batch, n, n), and the largest −D̃ of every sample. */
typedef struct {
  double *gradient, *curvature, *depth;
} derivatives;

/* --- penalties -------------------------------------------------------------------------------------------------- */

/* A sum on the way; `moving` and `slope` (n) are the coordinates that move a pair, and dD/dq_i by them. The normal is
   that of the last row of `pair`: the samples of a motion follow one another. */
typedef struct {
  const term* of;
  const samples* at;
  const derivatives* to;
  long long* moving;
  double *slope, total;
  long long pair;
  double normal[3];
} sum;

/* dD/dq_i = column_i · wrench, times how q_i moves the pair. Returns the number of coordinates that move it. */
static long long put_slopes(const sum* adding, long long sample, long long pair, const double* wrench) {
  const long long n = adding->of->n;
  const double *moves = adding->of->moves + n * pair, *columns = adding->at->columns + 6 * n * sample;
  long long active = 0;
  for (long long i = 0; i < n; ++i) {
    if (moves[i] == 0.0) continue;
    double along = 0.0;
    for (int j = 0; j < 6; ++j) along += columns[6 * i + j] * wrench[j];
    adding->moving[active] = i;
    adding->slope[active++] = along * moves[i];
  }
  return active;
}

/* The exact D of a row, with its wrench. */
static double exactly(sum* adding, long long sample, long long pair, double* wrench) {
  const term* of = adding->of;
  if (adding->pair != pair) {
    adding->pair = pair;
    adding->normal[0] = adding->normal[1] = 0.0;
    adding->normal[2] = 1.0;
  }
  const double* frames = adding->at->placements + 12 * sample * adding->at->joints;
  return exact(of->solids, of->pairs, pair, frames, 0.0, adding->normal, wrench);
}

/* Add ½ w min(D, 0)² of a row that no plane separates, with w D ∇D and w ∇D ∇Dᵀ. */
static void add(void* given, long long sample, long long pair, double apart, projection* found) {
  sum* adding = given;
  const samples* at = adding->at;
  const derivatives* to = adding->to;
  const tables* pairs = adding->of->pairs;
  const long long n = adding->of->n;
  double wrench[6], distance = 0.0;
  if (apart > 0.0) return;
  if (adding->of->solids && !((apart = distance = exactly(adding, sample, pair, wrench)) < 0.0)) return;
  if (-apart > to->depth[sample]) to->depth[sample] = -apart;
  if (!at->weight) return;
  const double *frame = at->placements + 12 * (sample * at->joints + pairs->joint_b[pair]), weight = at->weight[sample];
  const link_body body = body_of(pairs, pair);
  const halfspaces planes = planes_of(pairs, pair);
  if (!adding->of->solids)
    distance = hdsdf(adding->of->gamma, adding->of->length, frame, &body, &planes, apart, found, wrench);
  adding->total += 0.5 * weight * distance * distance;
  const long long active = put_slopes(adding, sample, pair, wrench), *moving = adding->moving;
  const double* slope = adding->slope;
  double *gradient = to->gradient + sample * n, *curvature = to->curvature + sample * n * n;
  for (long long i = 0; i < active; ++i) gradient[moving[i]] += weight * distance * slope[i];
  for (long long i = 0; i < active; ++i)
    for (long long j = 0; j <= i; ++j) {
      const double value = weight * slope[i] * slope[j];
      curvature[moving[i] * n + moving[j]] += value;
      if (j < i) curvature[moving[j] * n + moving[i]] += value;
    }
}

/* Room to work with n coordinates. */
typedef struct {
  long long* moving;
  double* slope;
} room;

/* Add ½ Σ weight min(D, 0)² over the rows that `least` does not separate to `cost`, and to derivatives. Returns 0, or −1
   without memory. */
static int penalties(const term* of, const samples* at, double least, const derivatives* to, const room* work,
                     double* cost) {
  sum adding = {.of = of, .at = at, .to = to, .moving = work->moving, .slope = work->slope, .pair = -1};
  if (visit(of->pairs, at->batch, at->joints, at->placements, NULL, of->pairs->reach, least, add, &adding)) return -1;
  *cost += adding.total;
  return 0;
}

/* --- a motion --------------------------------------------------------------------------------------------------- */

/* The constant part of an evaluation: a robot, samples at fractions of `intervals` intervals, counts[k] on
   interval k, and terms of pairs. */
typedef struct {
  const tree* robot;
  long long intervals, batch, terms;
  const long long* counts;
  const double *fraction, *weight;
  const term* const* each;
} motion;

/* q = (1 − f) q_k + f q_(k + 1) at every sample (batch, n), between waypoints (N, n). */
static void interpolate(const motion* of, const double* positions, double* q) {
  const long long n = of->robot->n;
  const double* fraction = of->fraction;
  for (long long k = 0; k < of->intervals; ++k, positions += n)
    for (long long sample = 0; sample < of->counts[k]; ++sample, ++fraction)
      for (long long i = 0; i < n; ++i) *q++ = (1.0 - *fraction) * positions[i] + *fraction * positions[n + i];
}

/* Add the penalties of all terms at the samples of waypoints (N, n), with the kinematics there, as `forward` gives it; q
   (batch, n) is scratch. Returns 0, or −1 without memory. */
static int at_samples(const motion* of, double least, const double* positions, double* q, double* placements,
                      double* columns, const derivatives* to, const room* work, double* cost) {
  const samples at = {of->batch, of->robot->joints, placements, columns, of->weight};
  interpolate(of, positions, q);
  forward(of->robot, of->batch, q, placements, columns);
  for (long long k = 0; k < of->terms; ++k)
    if (penalties(of->each[k], &at, least, to, work, cost)) return -1;
  return 0;
}

/* Sums over samples (batch, n) and (batch, n, n), carried back to waypoints, as in `Samples`: of a gradient to slope
   (N, n), of a curvature to blocks (N, n, n) and to those between neighbours (N − 1, n, n). */
static void to_waypoints(long long intervals, const long long* counts, const double* fraction, long long n,
                         const double* restrict gradient, const double* restrict curvature, double* restrict slope,
                         double* restrict diagonal, double* restrict coupling) {
  for (long long k = 0; k < intervals; ++k, slope += n, diagonal += n * n, coupling += n * n)
    for (long long sample = 0; sample < counts[k]; ++sample, ++fraction, gradient += n, curvature += n * n) {
      const double ahead = *fraction, behind = 1.0 - ahead;
      for (long long i = 0; i < n; ++i) {
        slope[i] += behind * gradient[i];
        slope[n + i] += ahead * gradient[i];
      }
      for (long long i = 0; i < n * n; ++i) {
        diagonal[i] += behind * behind * curvature[i];
        diagonal[n * n + i] += ahead * ahead * curvature[i];
        coupling[i] += ahead * behind * curvature[i];
      }
    }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

/* The numbers of samples on each interval, as many in all as there are fractions. */
static void check_counts(arguments* taken, const long long* counts, long long intervals, long long batch) {
  long long left = batch;
  for (long long k = 0; !taken->failed && k < intervals; ++k) left -= left < 0 ? 0 : counts[k];
  if (left != 0) wrong(taken, "counts", "the numbers of the fractions on each interval");
}

static derivatives take_derivatives(arguments* taken, long long summed, long long batch, long long n) {
  derivatives to;
  to.gradient = written(taken, "gradient", SHAPE(summed, n));
  to.curvature = written(taken, "curvature", SHAPE(summed, n, n));
  to.depth = written(taken, "depth", SHAPE(batch));
  return to;
}

static room take_room(arguments* taken, long long n) {
  return (room){scratch_indices(taken, n), scratch(taken, n)};
}

WRAPPER(make_term) {
  arguments taken = begin("term", given, count);
  term of = {.pairs = record(&taken, "tables", "tables")};
  of.gamma = (int)whole(&taken, "gamma", 1, 1000);
  of.length = number(&taken, "length");
  of.solids = record_or_none(&taken, "solids", "solids");
  if (of.solids && of.pairs && (of.solids->bodies != of.pairs->bodies || of.solids->boxes != of.pairs->boxes))
    wrong(&taken, "solids", "of these pairs");
  of.moves = numbers(&taken, "moves", SHAPE(of.pairs ? of.pairs->pairs : 0, ANY));
  of.n = taken.shape[1];
  return made(&taken, "term", &of, sizeof of);
}

WRAPPER(make_motion) {
  arguments taken = begin("motion", given, count);
  motion of = {.robot = record(&taken, "robot", "tree")};
  of.counts = indices(&taken, "counts", 0, MANY, SHAPE(ANY));
  of.intervals = taken.shape[0];
  of.fraction = numbers(&taken, "fraction", SHAPE(ANY));
  of.batch = taken.shape[0];
  of.weight = numbers(&taken, "weight", SHAPE(of.batch));
  of.each = (const term* const*)records(&taken, "terms", "term");
  of.terms = taken.shape[0];
  check_counts(&taken, of.counts, of.intervals, of.batch);
  for (long long k = 0; !taken.failed && k < of.terms; ++k)
    if (of.each[k]->n != of.robot->n || of.each[k]->pairs->joints > of.robot->joints)
      wrong(&taken, "terms", "of the robot's joints");
  return made(&taken, "motion", &of, sizeof of);
}

WRAPPER(call_penalties) {
  arguments taken = begin("penalties", given, count);
  const term* of = record(&taken, "term", "term");
  const long long n = of ? of->n : 0;
  const double least = number(&taken, "least");
  samples at = {.placements = numbers(&taken, "placements", SHAPE(ANY, ANY, 12))};
  at.batch = taken.shape[0];
  at.joints = taken.shape[1];
  if (of && at.joints < of->pairs->joints) wrong(&taken, "placements", "those of all joints");
  at.columns = numbers(&taken, "columns", SHAPE(at.batch, n, 6));
  at.weight = numbers_or_none(&taken, "weight", SHAPE(at.batch));
  const derivatives to = take_derivatives(&taken, at.weight ? at.batch : 0, at.batch, n);
  const room work = take_room(&taken, n);
  double cost = 0.0;
  int failed = 0;
  if (ready(&taken)) WITHOUT_LOCK(failed = penalties(of, &at, least, &to, &work, &cost));
  return ended(&taken, failed ? no_memory() : PyFloat_FromDouble(cost));
}

WRAPPER(call_at_samples) {
  arguments taken = begin("at_samples", given, count);
  const motion* of = record(&taken, "motion", "motion");
  const long long batch = of ? of->batch : 0, n = of ? of->robot->n : 0, joints = of ? of->robot->joints : 0;
  const double least = number(&taken, "least");
  const double* positions = numbers(&taken, "positions", SHAPE(of ? of->intervals + 1 : 0, n));
  double* placements = written(&taken, "placements", SHAPE(batch, joints, 12));
  double* columns = written(&taken, "columns", SHAPE(batch, n, 6));
  const derivatives to = take_derivatives(&taken, batch, batch, n);
  const room work = take_room(&taken, n);
  double *q = scratch(&taken, batch * n), cost = 0.0;
  int failed = 0;
  if (ready(&taken)) WITHOUT_LOCK(failed = at_samples(of, least, positions, q, placements, columns, &to, &work, &cost));
  return ended(&taken, failed ? no_memory() : PyFloat_FromDouble(cost));
}

WRAPPER(call_to_waypoints) {
  arguments taken = begin("to_waypoints", given, count);
  const long long* counts = indices(&taken, "counts", 0, MANY, SHAPE(ANY));
  const long long intervals = taken.shape[0];
  const double* fraction = numbers(&taken, "fraction", SHAPE(ANY));
  const long long batch = taken.shape[0];
  const double* gradient = numbers(&taken, "gradient", SHAPE(batch, ANY));
  const long long n = taken.shape[1];
  const double* curvature = numbers(&taken, "curvature", SHAPE(batch, n, n));
  double* slope = written(&taken, "slope", SHAPE(intervals + 1, n));
  double* diagonal = written(&taken, "diagonal", SHAPE(intervals + 1, n, n));
  double* coupling = written(&taken, "coupling", SHAPE(intervals, n, n));
  check_counts(&taken, counts, intervals, batch);
  if (ready(&taken))
    WITHOUT_LOCK(to_waypoints(intervals, counts, fraction, n, gradient, curvature, slope, diagonal, coupling));
  return ended(&taken, none());
}

PyMethodDef evaluation_functions[] = {
    FUNCTION("term", make_term, "A penalty on pairs."),
    FUNCTION("motion", make_motion, "The constant part of a motion's evaluation."),
    FUNCTION("penalties", call_penalties, "The cost of one term at samples, and its derivatives."),
    FUNCTION("at_samples", call_at_samples, "The cost of all terms at the samples of waypoints, and its derivatives."),
    FUNCTION("to_waypoints", call_to_waypoints, "Sums over samples, carried back to waypoints."),
    END_OF_FUNCTIONS,
};
