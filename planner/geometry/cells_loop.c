/* Points grouped by the cubes of a grid in two passes, without sorting: see cells_loop.py. */

#include <math.h>
#include <string.h>

#include "../../distance/compiled/border.h"

#define SIDE (1LL << 20) /* cubes along an axis, half of them on each side of the origin */
#define BEGIN 0.37       /* of an edge, where a cube begins: surfaces often lie at round numbers, and none is cut there */
#define SUMS 11          /* of a cell: count, largest radius, sum (3), products (6) */

/* The slot of a key in a table of a power of two of slots, open addressing: its own, or the empty one to take. */
static long long slot_of(long long key, const long long* cell_at, const long long* key_of, long long size) {
  long long slot = (long long)(((unsigned long long)key * 0x9E3779B97F4A7C15ULL) >> 20) & (size - 1);
  while (cell_at[slot] >= 0 && key_of[cell_at[slot]] != key) slot = (slot + 1) & (size - 1);
  return slot;
}

static long long along(double x, double per_edge) {
  const double at = x * per_edge + ((double)(SIDE / 2) + BEGIN);
  return at < 0.0 ? 0 : at < (double)SIDE ? (long long)at : SIDE - 1;
}

static double middle(long long at, double edge) { return ((double)(at - SIDE / 2) + 0.5 - BEGIN) * edge; }

static int reached(const double* p, double radius, long long balls, const double* ball) {
  for (long long k = 0; k < balls; ++k, ball += 4) {
    const double x = p[0] - ball[0], y = p[1] - ball[1], z = p[2] - ball[2], far = ball[3] + radius;
    if (x * x + y * y + z * z <= far * far) return 1;
  }
  return 0;
}

static long long gather(long long count, const double* points, const double* radii, double edge, long long balls,
                        const double* ball, long long* cell, double* sums, long long* key_of, long long* cell_at) {
  const double per_edge = 1.0 / edge;
  long long cells = 0, size = 1 << 10;
  memset(cell_at, -1, (size_t)size * sizeof *cell_at);
  for (long long i = 0; i < count; ++i) {
    const double* p = points + 3 * i;
    if (!reached(p, radii[i], balls, ball)) {
      cell[i] = 0; /* in none: the first one is number 1 */
      continue;
    }
    const long long x = along(p[0], per_edge), y = along(p[1], per_edge), z = along(p[2], per_edge);
    const long long key = (x * SIDE + y) * SIDE + z;
    long long slot = slot_of(key, cell_at, key_of, size);
    if (cell_at[slot] < 0) {
      if (2 * (cells + 1) > size) { /* at most half full */
        size *= 2;
        memset(cell_at, -1, (size_t)size * sizeof *cell_at);
        for (long long c = 0; c < cells; ++c) cell_at[slot_of(key_of[c], cell_at, key_of, size)] = c;
        slot = slot_of(key, cell_at, key_of, size);
      }
      memset(sums + SUMS * cells, 0, SUMS * sizeof *sums);
      key_of[cells] = key;
      cell_at[slot] = cells++;
    }
    const long long c = cell_at[slot];
    cell[i] = c + 1;
    double* s = sums + SUMS * c;
    /* from the cube's middle, so that the products lose nothing */
    const double a = p[0] - middle(x, edge), b = p[1] - middle(y, edge), d = p[2] - middle(z, edge);
    s[0] += 1.0;
    if (radii[i] > s[1]) s[1] = radii[i];
    s[2] += a, s[3] += b, s[4] += d;
    s[5] += a * a, s[6] += a * b, s[7] += a * d, s[8] += b * b, s[9] += b * d, s[10] += d * d;
  }
  return cells;
}

static void extend(long long count, const double* points, const long long* cell, long long cells,
                   const double* rotation, double* low, double* high) {
  for (long long k = 0; k < 3 * cells; ++k) low[k] = INFINITY, high[k] = -INFINITY;
  for (long long i = 0; i < count; ++i) {
    if (!cell[i]) continue;
    const long long c = cell[i] - 1;
    const double *p = points + 3 * i, *r = rotation + 9 * c;
    double *l = low + 3 * c, *h = high + 3 * c;
    for (int k = 0; k < 3; ++k) {
      const double at = p[0] * r[k] + p[1] * r[3 + k] + p[2] * r[6 + k];
      if (at < l[k]) l[k] = at;
      if (at > h[k]) h[k] = at;
    }
  }
}

WRAPPER(call_gather) {
  arguments taken = begin("gather_cells", given, count);
  const double* points = numbers(&taken, "points", SHAPE(ANY, 3));
  const long long rows = taken.shape[0];
  const double* radii = numbers(&taken, "radii", SHAPE(rows));
  const double edge = number(&taken, "edge");
  if (!(edge > 0.0)) wrong(&taken, "edge", "greater than 0");
  const double* ball = numbers(&taken, "balls", SHAPE(ANY, 4));
  const long long balls = taken.shape[0];
  long long* cell = written_indices(&taken, "cell", SHAPE(rows));
  double* sums = written(&taken, "sums", SHAPE(rows, SUMS));
  long long size = 1 << 10, cells = 0;
  while (size < 2 * (rows + 1)) size *= 2;
  long long* key_of = scratch_indices(&taken, rows + 1);
  long long* cell_at = scratch_indices(&taken, size);
  if (ready(&taken))
    WITHOUT_LOCK(cells = gather(rows, points, radii, edge, balls, ball, cell, sums, key_of, cell_at));
  return ended(&taken, PyLong_FromLongLong(cells));
}

WRAPPER(call_extend) {
  arguments taken = begin("extend_cells", given, count);
  const double* points = numbers(&taken, "points", SHAPE(ANY, 3));
  const long long rows = taken.shape[0];
  const double* rotation = numbers(&taken, "rotation", SHAPE(ANY, 3, 3));
  const long long cells = taken.shape[0];
  const long long* cell = indices(&taken, "cell", 0, cells + 1, SHAPE(rows));
  double* low = written(&taken, "low", SHAPE(cells, 3));
  double* high = written(&taken, "high", SHAPE(cells, 3));
  if (ready(&taken)) WITHOUT_LOCK(extend(rows, points, cell, cells, rotation, low, high));
  return ended(&taken, none());
}

PyMethodDef cells_functions[] = {
    FUNCTION("gather_cells", call_gather, "Number the cells of points and sum what is in each; returns how many."),
    FUNCTION("extend_cells", call_extend, "The extents of each cell's points along its axes."),
    END_OF_FUNCTIONS,
};
