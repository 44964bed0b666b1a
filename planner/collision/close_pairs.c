/* The loops of the broad phase: which balls reach which boxes, and which of them no plane separates.

   Samples that follow one another lie close together in a motion, so each pair is tested first with balls around GROUP
   of them, and before that with a ball around all. */

#include "close_pairs.h"

#include <stdlib.h>

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/clones.h"
#include "../../distance/compiled/vectors.h"

enum { GROUP = 8 };

#define ROUNDING 1e-12 /* [m] by which balls are larger */

/* --- paths of points -------------------------------------------------------------------------------------------- */

/* Points (count, 3) in the frames of joints, in the world at every sample: (count, batch, 3). */
static void place_points(long long batch, long long joints, const double* placements, long long count,
                         const long long* joint, const double* points, double* found) {
  for (long long k = 0; k < count; ++k)
    for (long long sample = 0; sample < batch; ++sample, found += 3)
      placed(placements + 12 * (sample * joints + joint[k]), points + 3 * k, found);
}

/* A ball (centre, radius) around the samples `begin` to `end` of a path. Its centre is the middle sample: as good as
   any on a path that hardly bends. */
INLINE void ball_around(const double* path, long long begin, long long end, double* ball) {
  const double* middle = path + 3 * ((begin + end) / 2);
  double apart[3], most = 0.0;
  for (long long sample = begin; sample < end; ++sample) {
    difference(path + 3 * sample, middle, apart);
    const double square = dot(apart, apart);
    most = square > most ? square : most;
  }
  for (int i = 0; i < 3; ++i) ball[i] = middle[i];
  ball[3] = sqrt(most) + ROUNDING;
}

/* For each of `count` paths (batch, 3): a ball around all of it, then one around each group of samples. */
CLONES
static void balls_around(long long count, long long batch, const double* paths, double* balls) {
  const long long groups = (batch + GROUP - 1) / GROUP;
  for (long long k = 0; k < count; ++k) {
    const double* path = paths + 3 * batch * k;
    double *all = balls + 4 * (groups + 1) * k, *ball = all + 4, apart[3];
    for (int i = 0; i < 3; ++i) all[i] = path[3 * (batch / 2) + i];
    all[3] = 0.0;
    for (long long group = 0; group < groups; ++group, ball += 4) {
      const long long begin = group * GROUP, end = begin + GROUP < batch ? begin + GROUP : batch;
      ball_around(path, begin, end, ball);
      difference(ball, all, apart);
      const double radius = norm(apart) + ball[3] + ROUNDING;
      all[3] = radius > all[3] ? radius : all[3];
    }
  }
}

/* Squared distance of a point, given from the box's centre, from a box: its placement (4, 4) row by row and half size. */
INLINE double beyond(const double* point, const double* at, const double* half) {
  double total = 0.0;
  for (int i = 0; i < 3; ++i) {
    const double along = point[0] * at[i] + point[1] * at[4 + i] + point[2] * at[8 + i];
    const double out = (along < 0.0 ? -along : along) - half[i];
    if (out > 0.0) total += out * out;
  }
  return total;
}

/* --- planes ----------------------------------------------------------------------------------------------------- */

link_body body_of(const tables* of, long long pair) {
  const double* row = of->table + (4 * of->slots + 1) * of->body[pair];
  return (link_body){of->slots, row, row + 3 * of->slots, row[4 * of->slots]};
}

halfspaces planes_of(const tables* of, long long pair) {
  const long long box = of->box[pair];
  return (halfspaces){of->width[box], of->planes + of->first[box]};
}

int make_projection(const tables* of, projection* found) {
  found->points = malloc((size_t)(3 * of->slots + (of->slots + 3) * of->widest) * sizeof(double));
  if (!found->points) return -1;
  found->x = found->points + 3 * of->slots;
  found->least = found->x + of->slots * of->widest;
  found->work = found->least + of->widest;
  return 0;
}

/* x_ik = n_k·p_i − h_k − r of vertices in the frame of the planes; returns the largest least x. */
CLONES
static double spread(const link_body* body, const halfspaces* planes, const projection* found) {
  const long long width = planes->width;
  const double *restrict nx = planes->rows, *restrict ny = nx + width, *restrict nz = ny + width;
  const double *restrict supports = nz + width, radius = body->radius;
  double *restrict x = found->x, *restrict least = found->least;
  for (long long i = 0; i < body->slots; ++i, x += width) {
    const double px = found->points[3 * i], py = found->points[3 * i + 1], pz = found->points[3 * i + 2];
    for (long long k = 0; k < width; ++k) {
      const double along = nx[k] * px + ny[k] * py + nz[k] * pz - (supports[k] + radius);
      x[k] = along;
      least[k] = i == 0 || along < least[k] ? along : least[k];
    }
  }
  return largest(width, found->least);
}

double project(const double* a, const double* b, const link_body* body, const halfspaces* planes, projection* found) {
  double seen[12];
  seen_from(b, a, seen);
  for (long long i = 0; i < body->slots; ++i) placed(seen, body->vertices + 3 * i, found->points + 3 * i);
  return spread(body, planes, found);
}

/* Whether one plane of a body in frame b, row `which` of a projection's, separates a body in frame a by `least`. */
INLINE int separates(const double* a, const double* b, const link_body* body, const halfspaces* planes, long long which,
                     double least) {
  const double *row = planes->rows + which, normal[3] = {row[0], row[planes->width], row[2 * planes->width]};
  double world[3], local[3], apart[3]; /* the normal in the world, and in frame a */
  turned(b, normal, world);
  turned_back(a, world, local);
  difference(a + 9, b + 9, apart);
  const double gap = dot(world, apart) - row[3 * planes->width] - body->radius - least;
  for (long long i = 0; i < body->slots; ++i)
    if (!(dot(local, body->vertices + 3 * i) + gap > 0.0)) return 0;
  return 1;
}

/* --- the search ------------------------------------------------------------------------------------------------- */

/* A query, and paths of the bodies' and of the moving boxes' centres (…, batch, 3) with the balls around them. */
typedef struct {
  const tables* of;
  long long batch, joints, groups;
  const double *placements, *reach; /* without placements there are no planes, and no moving boxes */
  double least;
  const double *centres, *origins, *around, *beside;
} search;

INLINE int is_moving(const search* query, long long pair) { return query->of->joint_b[pair] > 0; }

/* Whether balls around a group of samples come close: a body's, and a box's or a standing box. −1: all samples. */
INLINE int group_reaches(const search* query, long long pair, long long group) {
  const tables* of = query->of;
  const long long body = of->body[pair], box = of->box[pair];
  const double* ball = query->around + 4 * ((query->groups + 1) * body + group + 1);
  double apart[3], most = query->reach[body] + ball[3];
  if (is_moving(query, pair)) {
    const double* other = query->beside + 4 * ((query->groups + 1) * box + group + 1);
    most += of->balls[box] + other[3];
    difference(ball, other, apart);
    return dot(apart, apart) < most * most;
  }
  const double *at = of->at + 16 * box, origin[3] = {at[3], at[7], at[11]};
  difference(ball, origin, apart);
  return beyond(apart, at, of->half + 3 * box) < most * most;
}

/* Whether a body's ball reaches the box at a sample. */
INLINE int reaches(const search* query, long long pair, long long sample) {
  const tables* of = query->of;
  const long long body = of->body[pair], box = of->box[pair];
  const double *centre = query->centres + 3 * (query->batch * body + sample), reach = query->reach[body];
  const double *at = of->at + 16 * box, origin[3] = {at[3], at[7], at[11]};
  double apart[3], local[3];
  if (!is_moving(query, pair)) {
    difference(centre, origin, local);
  } else {
    const double near = reach + of->balls[box];
    difference(centre, query->origins + 3 * (query->batch * box + sample), apart);
    if (!(dot(apart, apart) < near * near)) return 0;
    turned_back(query->placements + 12 * (sample * query->joints + of->joint_b[pair]), apart, local);
  }
  return beyond(local, at, of->half + 3 * box) < reach * reach;
}

/* Whether no plane separates a pair at a sample; the plane that did so last is tried first. */
INLINE int none_separates(const search* query, long long pair, long long sample, const link_body* body,
                          const halfspaces* planes, long long* last, double* apart, projection* found) {
  const double* frames = query->placements + 12 * sample * query->joints;
  const double *a = frames + 12 * query->of->joint_a[pair], *b = frames + 12 * query->of->joint_b[pair];
  if (separates(a, b, body, planes, *last, query->least)) return 0;
  *apart = project(a, b, body, planes, found);
  if (!(*apart > query->least)) return 1;
  for (*last = 0; found->least[*last] < *apart;) ++*last;
  return 0;
}

CLONES
static void visit_pair(const search* query, long long pair, projection* found, action* act, void* given) {
  if (!group_reaches(query, pair, -1)) return;
  const link_body body = body_of(query->of, pair);
  const halfspaces planes = planes_of(query->of, pair);
  long long last = 0;
  for (long long group = 0; group < query->groups; ++group) {
    if (!group_reaches(query, pair, group)) continue;
    for (long long sample = group * GROUP; sample < query->batch && sample < (group + 1) * GROUP; ++sample) {
      double apart = 0.0;
      if (!reaches(query, pair, sample)) continue;
      if (query->placements && !none_separates(query, pair, sample, &body, &planes, &last, &apart, found)) continue;
      act(given, sample, pair, apart, found);
    }
  }
}

int visit(const tables* of, long long batch, long long joints, const double* placements, const double* centres,
          const double* reach, double least, action* act, void* given) {
  const long long pairs = centres ? of->standing : of->pairs, groups = (batch + GROUP - 1) / GROUP;
  const long long bodies = of->bodies, boxes = of->pairs > of->standing && !centres ? of->boxes : 0;
  const long long points = 3 * batch * (bodies + boxes), balls = 4 * (groups + 1) * (bodies + boxes);
  projection found;
  if (batch == 0) return 0;
  if (make_projection(of, &found)) return -1;
  double* placed_points = malloc((size_t)(points + balls + 1) * sizeof(double));
  if (placed_points) {
    double *origins = placed_points + 3 * batch * bodies, *around = placed_points + points;
    double* beside = around + 4 * (groups + 1) * bodies;
    if (!centres) place_points(batch, joints, placements, bodies, of->body_joint, of->centres, placed_points);
    place_points(batch, joints, placements, boxes, of->box_joint, of->middles, origins);
    const search query = {of,    batch, joints, groups, centres ? NULL : placements, reach, least,
                          centres ? centres : placed_points, origins, around, beside};
    balls_around(bodies, batch, query.centres, around);
    balls_around(boxes, batch, origins, beside);
    for (long long r = 0; r < pairs; ++r) visit_pair(&query, of->order[r], &found, act, given);
  }
  free(found.points);
  free(placed_points);
  return placed_points ? 0 : -1;
}

/* --- the rows themselves ---------------------------------------------------------------------------------------- */

typedef struct {
  long long count, room, *samples, *pairs;
} kept_rows;

static void keep(void* given, long long sample, long long pair, double apart, projection* found) {
  kept_rows* kept = given;
  (void)apart, (void)found;
  if (kept->count < kept->room) {
    kept->samples[kept->count] = sample;
    kept->pairs[kept->count] = pair;
  }
  ++kept->count;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static long long above(long long most, long long count, const long long* values) {
  for (long long k = 0; k < count; ++k) most = values[k] >= most ? values[k] + 1 : most;
  return most;
}

/* Whether the planes of all boxes that a pair names are there, and the first `standing` boxes stand; sizes follow. */
static void check_pairs(arguments* taken, tables* of, long long numbers_of_planes) {
  of->widest = 4;
  for (long long k = 0; k < of->pairs; ++k) {
    const long long first = of->first[of->box[k]], width = of->width[of->box[k]];
    if (width < 4 || width % 4 != 0 || first + 4 * width > numbers_of_planes) wrong(taken, "width", "rows within `planes`");
    if (of->order[k] >= of->pairs) wrong(taken, "order", "rows of pairs");
    else if (k < of->standing && of->joint_b[of->order[k]] != 0) wrong(taken, "order", "pairs with standing boxes first");
    of->widest = width > of->widest ? width : of->widest;
  }
  of->joints = above(above(1, of->pairs, of->joint_a), of->pairs, of->joint_b);
  of->joints = above(above(of->joints, of->bodies, of->body_joint), of->boxes, of->box_joint);
}

WRAPPER(make_tables) {
  arguments taken = begin("tables", given, count);
  const long long joints = 1LL << 16;
  tables of = {.standing = whole(&taken, "standing", 0, MANY)};
  of.body_joint = indices(&taken, "body_joint", 0, joints, SHAPE(ANY));
  of.bodies = taken.shape[0];
  of.box_joint = indices(&taken, "box_joint", 0, joints, SHAPE(ANY));
  of.boxes = taken.shape[0];
  of.order = indices(&taken, "order", 0, MANY, SHAPE(ANY));
  of.pairs = taken.shape[0];
  of.joint_a = indices(&taken, "joint_a", 0, joints, SHAPE(of.pairs));
  of.joint_b = indices(&taken, "joint_b", 0, joints, SHAPE(of.pairs));
  of.body = indices(&taken, "body", 0, of.bodies, SHAPE(of.pairs));
  of.box = indices(&taken, "box", 0, of.boxes, SHAPE(of.pairs));
  of.first = indices(&taken, "first", 0, MANY, SHAPE(of.boxes));
  of.width = indices(&taken, "width", 0, MANY, SHAPE(of.boxes));
  of.centres = numbers(&taken, "centres", SHAPE(of.bodies, 3));
  of.reach = numbers(&taken, "reach", SHAPE(of.bodies));
  of.middles = numbers(&taken, "middles", SHAPE(of.boxes, 3));
  of.balls = numbers(&taken, "balls", SHAPE(of.boxes));
  of.at = numbers(&taken, "at", SHAPE(of.boxes, 4, 4));
  of.half = numbers(&taken, "half", SHAPE(of.boxes, 3));
  of.table = numbers(&taken, "table", SHAPE(of.bodies, ANY));
  const long long row = taken.shape[1];
  of.slots = (row - 1) / 4;
  if (row < 5 || row % 4 != 1) wrong(&taken, "table", "4 slots + 1 numbers for each body");
  of.planes = numbers(&taken, "planes", SHAPE(ANY));
  if (of.standing > of.pairs) wrong(&taken, "standing", "a number of pairs");
  if (!taken.failed) check_pairs(&taken, &of, taken.shape[0]);
  return made(&taken, "tables", &of, sizeof of);
}

WRAPPER(call_close_rows) {
  arguments taken = begin("close_rows", given, count);
  const tables* of = record(&taken, "tables", "tables");
  const long long bodies = of ? of->bodies : 0;
  const double* placements = numbers_or_none(&taken, "placements", SHAPE(ANY, ANY, 12));
  long long batch = taken.shape[0];
  const long long joints = taken.shape[1];
  if (placements && joints < of->joints) wrong(&taken, "placements", "those of all joints");
  const double* centres = numbers_or_none(&taken, "centres", SHAPE(bodies, ANY, 3));
  if (!placements == !centres) wrong(&taken, "centres", "given, or else placements");
  if (centres) batch = taken.shape[1];
  const double* reach = numbers_or_none(&taken, "reach", SHAPE(bodies));
  const double least = number(&taken, "least");
  kept_rows kept = {.samples = written_indices(&taken, "samples", SHAPE(ANY))};
  kept.room = taken.shape[0];
  kept.pairs = written_indices(&taken, "pairs", SHAPE(kept.room));
  int failed = 0;
  if (ready(&taken))
    WITHOUT_LOCK(
        failed = visit(of, batch, joints, placements, centres, reach ? reach : of->reach, least, keep, &kept));
  return ended(&taken, failed ? no_memory() : PyLong_FromLongLong(kept.count));
}

PyMethodDef close_pairs_functions[] = {
    FUNCTION("tables", make_tables, "Everything about pairs that stays."),
    FUNCTION("close_rows", call_close_rows, "Write down the rows that are close; returns their number."),
    END_OF_FUNCTIONS,
};
