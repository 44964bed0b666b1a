/* Straight lines between configurations, proven to be free: at the middle of an interval the gap of a pair is measured,
   and by the bounds of `motion_bounds.py` either no point moves as far as the gap until the interval's ends, or a plane
   between the two stays between them, as they move nearly steadily. Else both halves are looked at, for the pairs that
   are left. */

#include "free_loop.h"

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

#define MOST_INTERVALS 131072.0 /* intervals that a line may need; a longer one counts as not free */
/* [m] of what moves most; the gaps of a wider interval would not last until its ends, and are left out */
#define WIDEST_INTERVAL 0.15

long long line_numbers(const space* of) {
  return 4 * of->pairs + 2 * of->arm->n + 12 * of->arm->joints + 6 * of->arm->n;
}

line line_in(const space* of, double* numbers, long long* indices) {
  line found = {.of = of, .rates = numbers, .normals = numbers + of->pairs, .active = indices};
  found.moved = found.normals + 3 * of->pairs;
  found.joints = found.moved + of->arm->n;
  found.placements = found.joints + of->arm->n;
  found.columns = found.placements + 12 * of->arm->joints;
  for (long long term = 0, row = 0; term < of->terms; ++term)
    for (long long k = 0; k < of->kept[term]->pairs->pairs; ++k, ++row) {
      if (of->kept[term]->floors[k] > -INFINITY) indices[found.count++] = row;
      for (int i = 0; i < 3; ++i) found.normals[3 * row + i] = i == 2;
    }
  return found;
}

/* The term of a pair that is counted through all terms, and its row there. */
static const keeping* term_of(const space* of, long long* pair) {
  long long term = 0;
  for (; *pair >= of->kept[term]->pairs->pairs; ++term) *pair -= of->kept[term]->pairs->pairs;
  return of->kept[term];
}

static void place(line* along, const double* q) {
  const space* of = along->of;
  for (long long j = 0; j < of->arm->n; ++j) along->joints[j] = of->factor[j] * q[of->leader[j]] + of->offset[j];
  forward(of->arm, 1, along->joints, along->placements, along->columns);
}

static void place_between(line* along, double t) {
  const space* of = along->of;
  for (long long j = 0; j < of->arm->n; ++j) {
    const long long i = of->leader[j];
    const double q = along->from[i] + t * (along->to[i] - along->from[i]);
    along->joints[j] = of->factor[j] * q + of->offset[j];
  }
  forward(of->arm, 1, along->joints, along->placements, along->columns);
}

/* A lower bound of the gap of a pair: from a ball around the body to a box around the other, enlarged by its margin. */
static double at_least(const keeping* kept, long long pair, const double* frames) {
  const tables* of = kept->pairs;
  const long long body = of->body[pair], box = of->box[pair];
  const double *at = of->at + 16 * box, *half = of->half + 3 * box;
  double centre[3], apart[3], seen[3], square = 0.0;
  placed(frames + 12 * of->joint_a[pair], of->centres + 3 * body, centre);
  difference(centre, frames + 12 * of->joint_b[pair] + 9, apart);
  turned_back(frames + 12 * of->joint_b[pair], apart, seen);
  for (int i = 0; i < 3; ++i) seen[i] -= at[4 * i + 3];
  for (int i = 0; i < 3; ++i) {
    const double beyond = fabs(seen[0] * at[i] + seen[1] * at[4 + i] + seen[2] * at[8 + i]) - half[i];
    if (beyond > 0.0) square += beyond * beyond;
  }
  return square > 0.0 ? sqrt(square) - kept->radii[body] + kept->solids->margins[box] : -INFINITY;
}

/* The velocity of the points of one body of a pair, moved by the joints whose sign is that one, along a unit vector n of the
   world, for an interval of half width `half`: n·v = along·p + constant at the point p; `along` has n added. */
static double steady(const line* along, const keeping* kept, long long pair, double sign, double half, const double* n,
                     double* turned_by) {
  const space* of = along->of;
  const double* moves = kept->moves + pair * of->arm->n;
  double twist[6] = {0.0}, turning[3];
  for (long long j = 0; j < of->arm->n; ++j) {
    const long long i = of->leader[j];
    const double rate = moves[j] == sign ? half * of->factor[j] * (along->to[i] - along->from[i]) : 0.0;
    for (int row = 0; rate != 0.0 && row < 6; ++row) twist[row] += rate * along->columns[6 * j + row];
  }
  cross(n, twist + 3, turning);
  for (int i = 0; i < 3; ++i) turned_by[i] = turning[i];
  return dot(n, twist);
}

/* How far a pair may be from a steady motion about the middle of the whole line; of a part, by the square of its share. */
static double bend_of(const line* along, const keeping* kept, long long pair) {
  const tree* arm = along->of->arm;
  const double* moves = kept->moves + pair * arm->n;
  double turned_before[2] = {0.0}, bend = 0.0;
  for (long long row = 0; row < arm->joints - 1; ++row) {
    const long long j = arm->coordinates[row];
    const double delta = along->moved[j];
    if (moves[j] == 0.0) continue;
    double* before = turned_before + (moves[j] < 0.0);
    bend += delta * kept->reach[j * kept->pairs->pairs + pair] * (0.5 * (arm->turns[row] ? delta : 0.0) + *before);
    if (arm->turns[row]) *before += delta;
  }
  return bend;
}

/* The least gap of a pair along the normal that was found in the middle of an interval, over all of it. */
static double gap_through(const line* along, const keeping* kept, long long pair, long long which, double half) {
  const double* frame = along->placements + 12 * kept->pairs->joint_b[pair];
  const double* place_of_box = kept->solids->places + 12 * (kept->solids->bodies + kept->pairs->box[pair]);
  double local[3], n[3], first[3], second[3], least = INFINITY;
  turned(place_of_box, along->normals + 3 * which, local);
  turned(frame, local, n);
  const double ahead = steady(along, kept, pair, 1.0, half, n, first) - steady(along, kept, pair, -1.0, half, n, second);
  for (double s = -1.0; s < 2.0; s += 2.0) {
    double a[3], b[3];
    for (int i = 0; i < 3; ++i) {
      a[i] = n[i] + s * first[i];
      b[i] = n[i] + s * second[i];
    }
    least = least_of(least, s * ahead + gap_along(kept->solids, kept->pairs, pair, along->placements, a, b));
  }
  return least - half * half * bend_of(along, kept, pair);
}

/* Look at the pairs that are active in the middle of an interval of half width `half`, and put first those that it
   leaves open over the whole; returns their number, or −1 where one, put first of all, is too near. In a wide
   interval, gaps are measured for this alone. */
static long long left_open(line* along, double half, int wide, long long count) {
  long long open = 0;
  for (long long k = 0; k < count; ++k) {
    const long long which = along->active[k];
    long long pair = which;
    const keeping* kept = term_of(along->of, &pair);
    const double floor = kept->floors[pair], moved = half * along->rates[which], enough = wide ? floor : floor + moved;
    const double least = at_least(kept, pair, along->placements);
    double *normal = along->normals + 3 * which, found = least;
    if (least > floor + moved) continue;
    if (!(found > enough)) found = gap(kept->around, kept->pairs, pair, along->placements, enough, enough, normal);
    if (!(found > enough)) found = gap(kept->solids, kept->pairs, pair, along->placements, floor, enough, normal);
    if (!wide && (found > enough || (found > floor && gap_through(along, kept, pair, which, half) > floor))) continue;
    const int near = !(found > floor);
    if (near) open = 0;
    along->active[k] = along->active[open];
    along->active[open++] = which;
    if (near) return -1;
  }
  return open;
}

/* The end of the free part that begins at `low`, of the interval up to `high`, by the first `count` active pairs. The
   pair that is met goes to `hit` wherever the end is not `high`: one that is too near in the middle may be proven to be
   free until there, but for rounding. */
static double end_of(line* along, double low, double high, long long count) {
  const double middle = 0.5 * (low + high), half = 0.5 * (high - low);
  place_between(along, middle);
  const long long open = left_open(along, half, half * along->fastest > WIDEST_INTERVAL, count);
  if (open == 0) return high;
  const long long first = along->active[0];
  if (!(half * along->rates[first] >= along->of->finest) || (open < 0 && along->whole)) {
    along->hit = first;
    return low;
  }
  if (open < 0) along->hit = first;
  const double reached = end_of(along, low, middle, open < 0 ? count : open);
  if (open < 0 || reached < middle) return reached;
  return end_of(along, middle, high, open);
}

/* How far each joint moves along the whole line, and each pair at most, and the most of these. */
static void bound(line* along) {
  const space* of = along->of;
  double* rates = along->rates;
  for (long long j = 0; j < of->arm->n; ++j) {
    const long long i = of->leader[j];
    along->moved[j] = fabs(of->factor[j] * (along->to[i] - along->from[i]));
  }
  along->fastest = 0.0;
  for (long long term = 0; term < of->terms; ++term) {
    const long long pairs = of->kept[term]->pairs->pairs;
    for (long long k = 0; k < pairs; ++k) rates[k] = 0.0;
    for (long long j = 0; j < of->arm->n; ++j) {
      const double moved = along->moved[j], *reach = of->kept[term]->reach + j * pairs;
      for (long long k = 0; moved != 0.0 && k < pairs; ++k) rates[k] += moved * reach[k];
    }
    for (long long k = 0; k < pairs; ++k) along->fastest = most_of(along->fastest, rates[k]);
    rates += pairs;
  }
}

double free_until(line* along, const double* from, const double* to, int whole) {
  const space* of = along->of;
  along->from = from;
  along->to = to;
  along->hit = -1;
  along->whole = whole;
  bound(along);
  if (!(along->fastest <= MOST_INTERVALS * of->finest)) {
    along->hit = 0;
    return 0.0;
  }
  const double reached = end_of(along, 0.0, 1.0, along->count);
  return along->hit < 0 ? reached : least_of(reached, 1.0 - 1e-9);
}

void uphill(line* along, const double* q, double* gradient) {
  const space* of = along->of;
  long long pair = along->hit;
  const keeping* kept = term_of(of, &pair);
  double wrench[6];
  place(along, q);
  (void)exact(kept->solids, kept->pairs, pair, along->placements, 0.0, along->normals + 3 * along->hit, wrench);
  for (long long i = 0; i < of->n; ++i) gradient[i] = 0.0;
  for (long long j = 0; j < of->arm->n; ++j) {
    const double* column = along->columns + 6 * j;
    const double slope = dot(column, wrench) + dot(column + 3, wrench + 3);
    gradient[of->leader[j]] += of->factor[j] * slope * kept->moves[pair * of->arm->n + j];
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_keeping) {
  arguments taken = begin("keeping", given, count);
  keeping of = {.solids = record(&taken, "solids", "solids"), .around = record(&taken, "around", "solids")};
  of.pairs = record(&taken, "tables", "tables");
  const long long pairs = of.pairs ? of.pairs->pairs : 0, bodies = of.pairs ? of.pairs->bodies : 0;
  for (int k = 0; of.pairs && k < 2; ++k) {
    const solids* each = k ? of.around : of.solids;
    if (each->bodies != bodies || each->boxes != of.pairs->boxes) wrong(&taken, "tables", "of these solids");
  }
  of.moves = numbers(&taken, "moves", SHAPE(pairs, ANY));
  const long long joints = taken.shape[1];
  of.reach = numbers(&taken, "reach", SHAPE(joints, pairs));
  of.floors = numbers(&taken, "floors", SHAPE(pairs));
  of.radii = numbers(&taken, "radii", SHAPE(bodies));
  of.joints = joints;
  return made(&taken, "keeping", &of, sizeof of);
}

WRAPPER(make_space) {
  arguments taken = begin("space", given, count);
  space of = {.arm = record(&taken, "tree", "tree"), .n = whole(&taken, "n", 1, 1LL << 16)};
  const long long m = of.arm ? of.arm->n : 0;
  of.leader = indices(&taken, "leader", 0, of.n, SHAPE(m));
  of.factor = numbers(&taken, "factor", SHAPE(m));
  of.offset = numbers(&taken, "offset", SHAPE(m));
  of.lower = numbers(&taken, "lower", SHAPE(of.n));
  of.upper = numbers(&taken, "upper", SHAPE(of.n));
  of.finest = number(&taken, "finest");
  of.kept = (const keeping* const*)records(&taken, "kept", "keeping");
  of.terms = taken.shape[0];
  for (long long term = 0; !taken.failed && term < of.terms; ++term) {
    const keeping* kept = of.kept[term];
    of.pairs += kept->pairs->pairs;
    if (kept->joints != m || kept->pairs->joints > of.arm->joints) wrong(&taken, "kept", "about the joints of the tree");
  }
  if (!(of.finest > 0.0)) wrong(&taken, "finest", "more than 0");
  return made(&taken, "space", &of, sizeof of);
}

WRAPPER(call_is_free) {
  arguments taken = begin("is_free", given, count);
  const space* of = record(&taken, "space", "space");
  const long long n = of ? of->n : 0;
  const double *from = numbers(&taken, "from", SHAPE(n)), *to = numbers(&taken, "to", SHAPE(n));
  double *room = scratch(&taken, of ? line_numbers(of) : 0), found = 0.0;
  long long* rows = scratch_indices(&taken, of ? of->pairs : 0);
  if (ready(&taken)) {
    line along = line_in(of, room, rows);
    WITHOUT_LOCK(found = free_until(&along, from, to, 1));
  }
  return ended(&taken, PyBool_FromLong(found == 1.0));
}

PyMethodDef free_functions[] = {
    FUNCTION("keeping", make_keeping, "Pairs that are to stay apart."),
    FUNCTION("space", make_space, "A robot, and what is to stay apart."),
    FUNCTION("is_free", call_is_free, "Whether all pairs are proven to stay apart along a line."),
    END_OF_FUNCTIONS,
};
