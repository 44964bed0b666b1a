/* Places on a curve of poses, one after the other: `PoseCurve.places`, equal to NumPy's but for rounding. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

/* `count` segments of a curve: where each begins, as an origin (count, 3) and a rotation (count, 9); its step and its
   turn (count, 3); arc length to all poses (count + 1); the axis about which the link is free, or 3; tolerances. */
typedef struct {
  long long count, axis;
  const double *origins, *rotations, *steps, *turns, *ahead;
  double far, angle, parallel;
} pose_curve;

/* Settings of the search for places: how far ahead beyond the link's own way, and by how much one may be farther away. */
typedef struct {
  double look_ahead, catch_up, sooner;
} search;

/* vector *= share */
static void scaled(double* vector, double share) {
  for (int i = 0; i < 3; ++i) vector[i] *= share;
}

/* The rotation vector that takes the beginning of a segment to a rotation, or the one's free axis to the other's. */
static void turn_from(const pose_curve* of, long long segment, const double* rotation, double* turn) {
  const double* begins = of->rotations + 9 * segment;
  if (of->axis < 3) {
    const double one[3] = {begins[of->axis], begins[3 + of->axis], begins[6 + of->axis]};
    const double other[3] = {rotation[of->axis], rotation[3 + of->axis], rotation[6 + of->axis]};
    cross(one, other, turn);
    const double sine = norm(turn);
    scaled(turn, atan2(sine, dot(one, other)) / most_of(sine, of->parallel));
    return;
  }
  double back[9], between[9];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) back[3 * i + j] = begins[3 * j + i];
  product(rotation, back, between);
  turn[0] = between[7] - between[5];
  turn[1] = between[2] - between[6];
  turn[2] = between[3] - between[1];
  const double sine = 0.5 * norm(turn);
  scaled(turn, 0.5 * atan2(sine, 0.5 * (between[0] + between[4] + between[8] - 1.0)) / most_of(sine, of->parallel));
}

/* The share of a segment that is nearest to the link, at least some, and how far away that is, in tolerances. */
static double share_of(const pose_curve* of, long long segment, const double* rotation, const double* origin,
                       double least, double* away) {
  const double *step = of->steps + 3 * segment, *turn = of->turns + 3 * segment;
  const double way = of->ahead[segment + 1] - of->ahead[segment], square = most_of(way * way, 1e-300);
  double off[3], turned[3];
  difference(origin, of->origins + 3 * segment, off);
  turn_from(of, segment, rotation, turned);
  double share = (dot(off, step) / (of->far * of->far) + dot(turned, turn) / (of->angle * of->angle)) / square;
  share = most_of(least_of(most_of(share, 0.0), 1.0), least);
  for (int i = 0; i < 3; ++i) {
    off[i] -= share * step[i];
    turned[i] -= share * turn[i];
  }
  *away = hypot(norm(off) / of->far, norm(turned) / of->angle);
  return share;
}

/* Places (nodes), of which the first is known, near rotations (nodes, 9) and origins (nodes, 3) of the link, which moves
   on by `moved` (nodes − 1), in tolerances; `shares` and `away` are memory for every segment. */
static void places(const pose_curve* of, const search* how, long long nodes, const double* rotations,
                   const double* origins, const double* moved, double* shares, double* away, double* found) {
  const long long begins = (long long)found[0], first = begins < of->count ? begins : of->count - 1;
  double gone = of->ahead[first] + (found[0] - (double)first) * (of->ahead[first + 1] - of->ahead[first]);
  for (long long k = 1; k < nodes; ++k) {
    const long long whole = (long long)found[k - 1], begin = whole < of->count ? whole : of->count - 1;
    const double until = gone + how->look_ahead * moved[k - 1] + how->catch_up;
    double least = INFINITY;
    long long near = 0, best = 0;
    while (begin + near < of->count && (near == 0 || of->ahead[begin + near] < until)) {
      shares[near] = share_of(of, begin + near, rotations + 9 * k, origins + 3 * k,
                              near == 0 ? found[k - 1] - (double)begin : 0.0, away + near);
      if (away[near] < least) least = away[near];
      ++near;
    }
    while (best + 1 < near && !(away[best] <= least + how->sooner)) ++best;
    while (best + 1 < near && shares[best] >= 1.0 && away[best + 1] < away[best]) ++best;
    const double there = (double)(begin + best) + shares[best];
    found[k] = there > found[k - 1] ? there : found[k - 1]; /* what is not a number leads nowhere */
    gone = of->ahead[begin + best] + shares[best] * (of->ahead[begin + best + 1] - of->ahead[begin + best]);
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_pose_curve) {
  arguments taken = begin("pose_curve", given, count);
  pose_curve of;
  of.steps = numbers(&taken, "steps", SHAPE(ANY, 3));
  of.count = taken.shape[0];
  of.turns = numbers(&taken, "turns", SHAPE(of.count, 3));
  of.origins = numbers(&taken, "origins", SHAPE(of.count, 3));
  of.rotations = numbers(&taken, "rotations", SHAPE(of.count, 3, 3));
  of.ahead = numbers(&taken, "ahead", SHAPE(of.count + 1));
  of.axis = whole(&taken, "axis", 0, 3);
  of.far = number(&taken, "far");
  of.angle = number(&taken, "angle");
  of.parallel = number(&taken, "parallel");
  if (!taken.failed && of.count < 1) wrong(&taken, "steps", "at least one");
  return made(&taken, "pose_curve", &of, sizeof of);
}

WRAPPER(call_places) {
  arguments taken = begin("places", given, count);
  const pose_curve* of = record(&taken, "curve", "pose_curve");
  search how;
  how.look_ahead = number(&taken, "look_ahead");
  how.catch_up = number(&taken, "catch_up");
  how.sooner = number(&taken, "sooner");
  const double* rotations = numbers(&taken, "rotations", SHAPE(ANY, 3, 3));
  const long long nodes = taken.shape[0];
  const double* origins = numbers(&taken, "origins", SHAPE(nodes, 3));
  const double* moved = numbers(&taken, "moved", SHAPE(nodes > 0 ? nodes - 1 : 0));
  double* found = written(&taken, "found", SHAPE(nodes));
  if (!taken.failed && nodes > 0 && !(found[0] >= 0.0 && found[0] <= (double)of->count))
    wrong(&taken, "found", "begun with a place on the curve");
  double* shares = scratch(&taken, of ? of->count : 0);
  double* away = scratch(&taken, of ? of->count : 0);
  if (ready(&taken) && nodes > 0)
    WITHOUT_LOCK(places(of, &how, nodes, rotations, origins, moved, shares, away, found));
  return ended(&taken, none());
}

PyMethodDef places_functions[] = {
    FUNCTION("pose_curve", make_pose_curve, "A curve of poses, as in `PoseCurve`."),
    FUNCTION("places", call_places, "What `PoseCurve.places` returns, but for the last one."),
    END_OF_FUNCTIONS,
};
