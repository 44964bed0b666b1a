"""The loops of the broad phase in C: which balls reach which boxes, and which of them no plane separates.

In: the tables of body pairs, and placements of the joints at samples. Out: rows (sample, pair), pair by pair.
`broad_phase` has the same in NumPy, without the planes, for machines without a compiler. Rounding may decide
differently where a ball only just touches a box; there the distance is positive anyway.

Samples that follow one another lie close together in a motion, so each pair is first asked with balls around GROUP of
them, and before that with a ball around all.
"""

from __future__ import annotations

import ctypes
import functools

import numpy as np

from hdplan.distance.compiled.c_library import Record, c_functions, call
from hdplan.scenes.array_types import Array, Rows

ROOM = 1 << 10  # rows that there is room for at first
LEAST = 1e-9  # [m] by which a plane must separate, so that rounding decides nothing

SOURCE = """
#include <math.h>
#include <stdlib.h>

enum { GROUP = 8 };

/* Everything about the pairs that stays, as `BodyPairs` has it. `middles` are the boxes' centres on their joints; the
   planes of box b are four rows of width[b] numbers from first[b] on; of the pairs in `order`, the first `standing`
   have a box in the world. */
typedef struct {
  long long bodies, boxes, pairs, standing, slots, widest;
  const long long *body_joint, *box_joint, *order, *joint_a, *joint_b, *body, *box, *first, *width;
  const double *centres, *reach, *middles, *balls, *at, *half, *table, *planes;
} tables;

/* Where a link body is, seen from a halfspace body: its vertices (slots, 3) in that frame; x_ik (slots, width), how far
   vertex i is beyond plane k, less the body's radius; the least of x_ik along every plane (width); and room to work. */
typedef struct { double *points, *x, *least, *work; } projection;

/* What is done with a row that is close; with planes, no plane separates it, and how it is projected is known. */
typedef void action(void* given, long long sample, long long pair, double apart, projection* of);

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
  double* balls = malloc((count * (groups + 1) + 1) * 4 * sizeof(double));
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
static int make_projection(const tables* t, projection* of) {
  of->points = malloc((3 * t->slots + (t->slots + 3) * t->widest) * sizeof(double));
  if (!of->points) return -1;
  of->x = of->points + 3 * t->slots;
  of->least = of->x + t->slots * t->widest;
  of->work = of->least + t->widest;
  return 0;
}

/* The largest of `width` numbers, a multiple of four: four at a time, as wide as vectors are. */
static double largest(long long width, const double* values) {
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
static double project(const double* a, const double* b, long long slots, const double* body, long long width,
                      const double* __restrict__ planes, projection* of) {
  double turn[9], shift[3], radius = body[4 * slots], *p = of->points;
  double *__restrict__ x = of->x, *__restrict__ least = of->least;
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
static int visit(const tables* t, long long batch, long long joints, const double* placements, const double* centres,
                 const double* reach, double least, action* act, void* given) {
  long long groups = (batch + GROUP - 1) / GROUP, pairs = centres ? t->standing : t->pairs, r, g, s;
  long long boxes = t->pairs > t->standing && !centres ? t->boxes : 0;
  double *placed, *origins, *around, *beside;
  projection of;
  if (batch == 0) return 0;
  if (make_projection(t, &of)) return -1;
  placed = malloc(3 * batch * (t->bodies + boxes + 1) * sizeof(double));
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

typedef struct { long long count, room, *samples, *pairs; } rows;

static void keep(void* given, long long sample, long long pair, double apart, projection* of) {
  rows* kept = given;
  if (kept->count < kept->room) { kept->samples[kept->count] = sample; kept->pairs[kept->count] = pair; }
  ++kept->count;
}

/* Write those rows down; returns their number, which may exceed the room for them, or −1. */
long long close_rows(const tables* t, long long batch, long long joints, const double* placements,
                     const double* centres, const double* reach, double least, long long room, long long* samples,
                     long long* pairs) {
  rows kept;
  kept.count = 0; kept.room = room; kept.samples = samples; kept.pairs = pairs;
  if (visit(t, batch, joints, placements, centres, reach ? reach : t->reach, least, keep, &kept)) return -1;
  return kept.count;
}
"""


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loops; None without a C compiler."""
    return c_functions("close_pairs", SOURCE)


def close_rows(
    loops: ctypes.CDLL,
    tables: Record,
    batch: int,
    placements: Array | None,
    centres: Array | None = None,
    reach: Array | None = None,
) -> tuple[Rows, Rows]:
    """Return samples and pairs (S,) of the rows that are close, pair by pair: at placements (batch, joints, 12), or of
    balls of other centres (bodies, batch, 3) and reaches (bodies,), with standing boxes."""
    room, joints = ROOM, 0 if placements is None else placements.shape[1]
    while True:
        sample, pair = np.empty(room, np.int64), np.empty(room, np.int64)
        given = (tables, batch, joints, placements, centres, reach, LEAST, room, sample, pair)
        count = int(call(loops.close_rows, *given))
        if count < 0:
            raise MemoryError
        if count <= room:
            return sample[:count], pair[:count]
        room = count
