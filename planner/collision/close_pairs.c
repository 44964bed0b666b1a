/* The loops of the broad phase: which balls reach which boxes, and which of them no plane separates.

   Samples that follow one another lie close together in a motion, so each pair is first asked with balls around GROUP
   of them, and before that with a ball around all. */

#include "close_pairs.h"

#include <math.h>
#include <stdlib.h>

#include "../../distance/compiled/border.h"

enum { GROUP = 8 };

/* Points (count, 3) in the frames of joints, in the world at every sample: (count, batch, 3). */
static void place(long long batch, long long joints, const double* placements, long long count, const long long* joint,
                  const double* points, double* placed) {
  long long s, k;
  int i;
  for (k = 0; k < count; ++k)
    for (s = 0; s < batch; ++s) {
      const double *frame = placements + 12 * (s * joints + joint[k]), *p = points + 3 * k;
      for (i = 0; i < 3; ++i)
        *placed++ = frame[3 * i] * p[0] + frame[3 * i + 1] * p[1] + frame[3 * i + 2] * p[2] + frame[9 + i];
    }
}

/* For each of `count` paths (batch, 3): a ball (centre, radius) around all of it, then one around each group of
   samples, with room for rounding. Centres are the middle samples: as good as any on a path that hardly bends. */
static double* balls_around(long long count, long long batch, const double* paths) {
  long long groups = (batch + GROUP - 1) / GROUP, k, g, s;
  double* balls = malloc((size_t)((count * (groups + 1) + 1) * 4) * sizeof(double));
  int i;
  for (k = 0; balls && k < count; ++k) {
    const double* path = paths + 3 * batch * k;
    double *all = balls + 4 * (groups + 1) * k, *ball = all + 4;
    for (i = 0; i < 3; ++i) all[i] = path[3 * (batch / 2) + i];
    all[3] = 0.0;
    for (g = 0; g < groups; ++g, ball += 4) {
      long long begin = g * GROUP, end = begin + GROUP < batch ? begin + GROUP : batch;
      const double* middle = path + 3 * ((begin + end) / 2);
      double x, y, z, most = 0.0;
      for (s = begin; s < end; ++s) {
        double apart;
        x = path[3 * s] - middle[0];
        y = path[3 * s + 1] - middle[1];
        z = path[3 * s + 2] - middle[2];
        apart = x * x + y * y + z * z;
        most = apart > most ? apart : most;
      }
      for (i = 0; i < 3; ++i) ball[i] = middle[i];
      ball[3] = sqrt(most) + 1e-12;
      x = ball[0] - all[0];
      y = ball[1] - all[1];
      z = ball[2] - all[2];
      x = sqrt(x * x + y * y + z * z) + ball[3] + 1e-12;
      all[3] = x > all[3] ? x : all[3];
    }
  }
  return balls;
}

/* Squared distance from a box, of a point given from its centre; `box` is its placement (4, 4), row by row. */
static double beyond(double x, double y, double z, const double* box, const double* half) {
  double total = 0.0;
  int i;
  for (i = 0; i < 3; ++i) {
    double along = x * box[i] + y * box[4 + i] + z * box[8 + i];
    double out = (along < 0.0 ? -along : along) - half[i];
    if (out > 0.0) total += out * out;
  }
  return total;
}

/* Room for any pair; `points` is to be freed. Returns 0, or −1 without memory. */
int make_projection(const tables* t, projection* of) {
  of->points = malloc((size_t)(3 * t->slots + (t->slots + 3) * t->widest) * sizeof(double));
  if (!of->points) return -1;
  of->x = of->points + 3 * t->slots;
  of->least = of->x + t->slots * t->widest;
  of->work = of->least + t->widest;
  return 0;
}

/* The largest of `width` numbers, a multiple of four: four at a time, as wide as vectors are. */
double largest(long long width, const double* values) {
  double most[4];
  long long k;
  int j;
  for (j = 0; j < 4; ++j) most[j] = values[j];
  for (k = 4; k < width; k += 4)
    for (j = 0; j < 4; ++j) most[j] = values[k + j] > most[j] ? values[k + j] : most[j];
  most[0] = most[1] > most[0] ? most[1] : most[0];
  most[2] = most[3] > most[2] ? most[3] : most[2];
  return most[2] > most[0] ? most[2] : most[0];
}

/* Project a body (vertices, weights, radius) in frame a on the planes of a body in frame b, a row of all x, of all y
   and z of the normals and one of the supports. Returns the largest least x: more than 0 only where a plane separates
   the two. */
double project(const double* a, const double* b, long long slots, const double* body, long long width,
                      const double* restrict planes, projection* of) {
  double turn[9], shift[3], radius = body[4 * slots], *p = of->points;
  double *restrict x = of->x, *restrict least = of->least;
  const double *nx = planes, *ny = nx + width, *nz = ny + width, *h = nz + width;
  long long i, j, k;
  for (i = 0; i < 3; ++i) {
    shift[i] = b[i] * (a[9] - b[9]) + b[3 + i] * (a[10] - b[10]) + b[6 + i] * (a[11] - b[11]);
    for (j = 0; j < 3; ++j) turn[3 * i + j] = b[i] * a[j] + b[3 + i] * a[3 + j] + b[6 + i] * a[6 + j];
  }
  for (i = 0; i < slots; ++i, body += 3, p += 3, x += width) {
    double px, py, pz;
    for (j = 0; j < 3; ++j)
      p[j] = turn[3 * j] * body[0] + turn[3 * j + 1] * body[1] + turn[3 * j + 2] * body[2] + shift[j];
    px = p[0];
    py = p[1];
    pz = p[2];
    for (k = 0; k < width; ++k) {
      double along = nx[k] * px + ny[k] * py + nz[k] * pz - (h[k] + radius);
      x[k] = along;
      least[k] = i == 0 || along < least[k] ? along : least[k];
    }
  }
  return largest(width, least);
}

/* Whether one plane of a body in frame b, row `which` of a projection's, separates a body in frame a by `least`. */
static int separates(const double* a, const double* b, long long slots, const double* body, long long width,
                     const double* planes, long long which, double least) {
  const double* n = planes + which;
  double nx = n[0], ny = n[width], nz = n[2 * width], x, y, z, gap;
  long long i;
  x = b[0] * nx + b[1] * ny + b[2] * nz;  /* the normal in the world, then in frame a */
  y = b[3] * nx + b[4] * ny + b[5] * nz;
  z = b[6] * nx + b[7] * ny + b[8] * nz;
  gap = x * (a[9] - b[9]) + y * (a[10] - b[10]) + z * (a[11] - b[11]) - n[3 * width] - body[4 * slots] - least;
  nx = x * a[0] + y * a[3] + z * a[6];
  ny = x * a[1] + y * a[4] + z * a[7];
  nz = x * a[2] + y * a[5] + z * a[8];
  for (i = 0; i < slots; ++i, body += 3)
    if (!(nx * body[0] + ny * body[1] + nz * body[2] + gap > 0.0)) return 0;
  return 1;
}

/* Visit the rows (sample, pair) of balls that reach their box, pair by pair, that no plane of the box's body separates
   by `least`; the plane that did so at the sample before is tried first. With `centres` (bodies, batch, 3) given, those
   of standing boxes only, without planes. Returns 0, or −1 without memory. */
int visit(const tables* t, long long batch, long long joints, const double* placements, const double* centres,
                 const double* reach, double least, action* act, void* given) {
  long long groups = (batch + GROUP - 1) / GROUP, pairs = centres ? t->standing : t->pairs, r, g, s;
  long long boxes = t->pairs > t->standing && !centres ? t->boxes : 0;
  double *placed, *origins, *around, *beside;
  projection of;
  if (batch == 0) return 0;
  if (make_projection(t, &of)) return -1;
  placed = malloc((size_t)(3 * batch * (t->bodies + boxes + 1)) * sizeof(double));
  if (!placed) {
    free(of.points);
    return -1;
  }
  origins = placed + 3 * batch * t->bodies;
  if (!centres) place(batch, joints, placements, t->bodies, t->body_joint, t->centres, placed);
  place(batch, joints, placements, boxes, t->box_joint, t->middles, origins);
  if (!centres) centres = placed; else placements = 0;
  around = balls_around(t->bodies, batch, centres);
  beside = balls_around(boxes, batch, origins);
  for (r = 0; around && beside && r < pairs; ++r) {
    long long k = t->order[r], a = t->body[k], b = t->box[k], last = 0;
    int moving = t->joint_b[k] > 0;
    const double *at = t->at + 16 * b, *half = t->half + 3 * b, *ball = around + 4 * (groups + 1) * a;
    const double *other = moving ? beside + 4 * (groups + 1) * b : 0, *body = t->table + (4 * t->slots + 1) * a;
    const double* planes = t->planes + t->first[b];
    for (g = -1; g < groups; ++g, ball += 4, other += moving ? 4 : 0) {  /* −1: all samples */
      double most = reach[a] + ball[3];
      int far;
      if (moving) {
        double x = ball[0] - other[0], y = ball[1] - other[1], z = ball[2] - other[2];
        most += t->balls[b] + other[3];
        far = !(x * x + y * y + z * z < most * most);
      } else far = !(beyond(ball[0] - at[3], ball[1] - at[7], ball[2] - at[11], at, half) < most * most);
      if (far && g < 0) break;
      if (far || g < 0) continue;
      for (s = g * GROUP; s < batch && s < (g + 1) * GROUP; ++s) {
        const double* p = centres + 3 * (batch * a + s);
        most = reach[a] * reach[a];
        if (moving) {
          const double *o = origins + 3 * (batch * b + s), *frame = placements + 12 * (s * joints + t->joint_b[k]);
          double x = p[0] - o[0], y = p[1] - o[1], z = p[2] - o[2], near = reach[a] + t->balls[b];
          if (!(x * x + y * y + z * z < near * near)) continue;
          if (!(beyond(frame[0] * x + frame[3] * y + frame[6] * z, frame[1] * x + frame[4] * y + frame[7] * z,
                       frame[2] * x + frame[5] * y + frame[8] * z, at, half) < most)) continue;
        } else if (!(beyond(p[0] - at[3], p[1] - at[7], p[2] - at[11], at, half) < most)) continue;
        most = 0.0;
        if (placements) {
          const double* frame = placements + 12 * (s * joints + t->joint_a[k]);
          const double* beside_it = placements + 12 * (s * joints + t->joint_b[k]);
          if (separates(frame, beside_it, t->slots, body, t->width[b], planes, last, least)) continue;
          most = project(frame, beside_it, t->slots, body, t->width[b], planes, &of);
          if (most > least) {
            for (last = 0; of.least[last] < most;) ++last;
            continue;
          }
        }
        act(given, s, k, most, &of);
      }
    }
  }
  s = around && beside ? 0 : -1;
  free(of.points);
  free(placed);
  free(around);
  free(beside);
  return (int)s;
}

typedef struct { long long count, room, *samples, *pairs; } kept_rows;

static void keep(void* given, long long sample, long long pair, double apart, projection* of) {
  kept_rows* kept = given;
  (void)apart, (void)of;
  if (kept->count < kept->room) { kept->samples[kept->count] = sample; kept->pairs[kept->count] = pair; }
  ++kept->count;
}

/* Write those rows down; returns their number, which may exceed the room for them, or −1. */
static long long close_rows(const tables* t, long long batch, long long joints, const double* placements,
                     const double* centres, const double* reach, double least, long long room, long long* samples,
                     long long* pairs) {
  kept_rows kept;
  kept.count = 0; kept.room = room; kept.samples = samples; kept.pairs = pairs;
  if (visit(t, batch, joints, placements, centres, reach ? reach : t->reach, least, keep, &kept)) return -1;
  return kept.count;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* make_tables(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("tables", given, count);
  tables t;
  const long long joints = 1LL << 30;
  long long k, size;
  PyObject* found;
  (void)self;
  t.standing = whole(&c, "standing", 0, 1LL << 40);
  t.body_joint = rows(&c, "body_joint", 0, joints, SHAPE(ANY));
  t.bodies = c.shape[0];
  t.box_joint = rows(&c, "box_joint", 0, joints, SHAPE(ANY));
  t.boxes = c.shape[0];
  t.order = rows(&c, "order", 0, 1LL << 40, SHAPE(ANY));
  t.pairs = c.shape[0];
  t.joint_a = rows(&c, "joint_a", 0, joints, SHAPE(t.pairs));
  t.joint_b = rows(&c, "joint_b", 0, joints, SHAPE(t.pairs));
  t.body = rows(&c, "body", 0, t.bodies, SHAPE(t.pairs));
  t.box = rows(&c, "box", 0, t.boxes, SHAPE(t.pairs));
  t.first = rows(&c, "first", 0, 1LL << 40, SHAPE(t.boxes));
  t.width = rows(&c, "width", 0, 1LL << 30, SHAPE(t.boxes));
  t.centres = numbers(&c, "centres", SHAPE(t.bodies, 3));
  t.reach = numbers(&c, "reach", SHAPE(t.bodies));
  t.middles = numbers(&c, "middles", SHAPE(t.boxes, 3));
  t.balls = numbers(&c, "balls", SHAPE(t.boxes));
  t.at = numbers(&c, "at", SHAPE(t.boxes, 4, 4));
  t.half = numbers(&c, "half", SHAPE(t.boxes, 3));
  t.table = numbers(&c, "table", SHAPE(t.bodies, ANY));
  t.slots = (c.shape[1] - 1) / 4;
  if (!c.failed && (c.shape[1] < 5 || c.shape[1] % 4 != 1)) wrong(&c, "table", "4 slots + 1 numbers for each body");
  t.planes = numbers(&c, "planes", SHAPE(ANY));
  size = c.shape[0];
  if (!c.failed && t.standing > t.pairs) wrong(&c, "standing", "a number of pairs");
  t.widest = 4;
  t.joints = 1;
  for (k = 0; !c.failed && k < t.pairs; ++k) {
    long long width = t.width[t.box[k]];
    if (width < 4 || width % 4 != 0 || t.first[t.box[k]] + 4 * width > size) wrong(&c, "width", "rows within `planes`");
    if (t.order[k] >= t.pairs) wrong(&c, "order", "rows of pairs");
    t.widest = width > t.widest ? width : t.widest;
    t.joints = t.joint_a[k] >= t.joints ? t.joint_a[k] + 1 : t.joints;
    t.joints = t.joint_b[k] >= t.joints ? t.joint_b[k] + 1 : t.joints;
  }
  for (k = 0; !c.failed && k < t.bodies; ++k) t.joints = t.body_joint[k] >= t.joints ? t.body_joint[k] + 1 : t.joints;
  for (k = 0; !c.failed && k < t.boxes; ++k) t.joints = t.box_joint[k] >= t.joints ? t.box_joint[k] + 1 : t.joints;
  found = made(&c, "tables", &t, sizeof t);
  return ended(&c, found);
}

static PyObject* call_close_rows(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("close_rows", given, count);
  const tables* t = record(&c, "tables", "tables");
  long long bodies = t ? t->bodies : 0, batch, joints, room, found = 0, *samples, *pairs;
  const double *placements, *centres, *reach;
  double least;
  (void)self;
  placements = numbers_or_none(&c, "placements", SHAPE(ANY, ANY, 12));
  batch = c.shape[0];
  joints = c.shape[1];
  if (placements && joints < t->joints) wrong(&c, "placements", "those of all joints");
  centres = numbers_or_none(&c, "centres", SHAPE(bodies, ANY, 3));
  if (!placements) batch = c.shape[1];
  reach = numbers_or_none(&c, "reach", SHAPE(bodies));
  if (!c.failed && !placements == !centres) wrong(&c, "centres", "given, or else placements");
  least = number(&c, "least");
  samples = written_rows(&c, "samples", SHAPE(ANY));
  room = c.shape[0];
  pairs = written_rows(&c, "pairs", SHAPE(room));
  if (ready(&c))
    WITHOUT_LOCK(found = close_rows(t, batch, joints, placements, centres, reach, least, room, samples, pairs));
  return ended(&c, found < 0 ? no_memory() : PyLong_FromLongLong(found));
}

PyMethodDef close_pairs_functions[] = {
    FUNCTION("tables", make_tables, "Everything about pairs that stays."),
    FUNCTION("close_rows", call_close_rows, "Write down the rows that are close; returns their number."),
    END_OF_FUNCTIONS,
};
