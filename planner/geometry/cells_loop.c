/* Points grouped by the cubes of a grid in two passes, without sorting: see cells_loop.py. */

#include <math.h>
#include <string.h>

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

#define SIDE (1LL << 20) /* cubes along an axis, half of them on each side of the origin */
#define BEGIN 0.37       /* of an edge, where a cube begins: surfaces often lie at round numbers, and none is cut there */
#define SUMS 11          /* of a cell: count, largest radius, sum (3), products (6) */

/* The slot of a key in a table of a power of two of slots, open addressing: its own, or the empty one to take. */
static long long slot_of(long long key, const long long* cell_at, const long long* key_of, long long size) {
  /* the upper bits: of all three numbers in a key, the first one changes no others */
  long long slot = (long long)(((unsigned long long)key * 0x9E3779B97F4A7C15ULL) >> 40) & (size - 1);
  while (cell_at[slot] >= 0 && key_of[cell_at[slot]] != key) slot = (slot + 1) & (size - 1);
  return slot;
}

static long long along(double x, double per_edge) {
  const double at = x * per_edge + ((double)(SIDE / 2) + BEGIN);
  return at < 0.0 ? 0 : at < (double)SIDE ? (long long)at : SIDE - 1;
}

static double middle(long long at, double edge) { return ((double)(at - SIDE / 2) + 0.5 - BEGIN) * edge; }

static int reached(const double* p, double radius, long long balls, const double* ball) {
  int found = 0;
  for (long long k = 0; k < balls; ++k, ball += 4) {
    const double x = p[0] - ball[0], y = p[1] - ball[1], z = p[2] - ball[2], far = ball[3] + radius;
    found |= x * x + y * y + z * z <= far * far; /* no branch: what is in reach is not foreseen */
  }
  return found;
}

static long long gather(long long count, const double* points, const double* radii, double edge, long long balls,
                        const double* ball, long long* near, long long* cell, double* sums, long long* key_of,
                        long long* cell_at) {
  const double per_edge = 1.0 / edge;
  long long cells = 0, size = 1 << 10, found = 0;
  for (long long i = 0; i < count; ++i) {
    near[found] = i;
    found += reached(points + 3 * i, radii[i], balls, ball);
  }
  memset(cell_at, -1, (size_t)size * sizeof *cell_at);
  for (long long n = 0; n < found; ++n) {
    const long long i = near[n];
    const double* p = points + 3 * i;
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
    cell[n] = c;
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

#define LINE 0.05 /* share of a cell's largest spread; with the second one below it, the points lie on a line */
#define SWEEPS 12 /* of Jacobi's rotations: each squares what is left beside the diagonal */

/* Eigenvalues, ascending, of the symmetric matrix with this upper half, and eigenvectors as rows: by Jacobi's rotations. */
static void principal_axes(const double* upper, double* value, double axis[3][3]) {
  double a[3][3] = {{upper[0], upper[1], upper[2]}, {upper[1], upper[3], upper[4]}, {upper[2], upper[4], upper[5]}};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) axis[i][j] = i == j;
  for (int sweep = 0; sweep < SWEEPS; ++sweep) {
    const double beside = fabs(a[0][1]) + fabs(a[0][2]) + fabs(a[1][2]);
    if (!(beside > 1e-17 * (fabs(a[0][0]) + fabs(a[1][1]) + fabs(a[2][2])))) break;
    for (int p = 0; p < 2; ++p)
      for (int q = p + 1; q < 3; ++q) {
        if (a[p][q] == 0.0) continue;
        const double slope = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
        const double t = copysign(1.0, slope) / (fabs(slope) + sqrt(slope * slope + 1.0));
        const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
        const int r = 3 - p - q;
        const double left = a[r][p], right = a[r][q];
        a[p][p] -= t * a[p][q], a[q][q] += t * a[p][q], a[p][q] = a[q][p] = 0.0;
        a[r][p] = a[p][r] = c * left - s * right, a[r][q] = a[q][r] = s * left + c * right;
        for (int k = 0; k < 3; ++k) {
          const double x = axis[p][k], y = axis[q][k];
          axis[p][k] = c * x - s * y, axis[q][k] = s * x + c * y;
        }
      }
  }
  for (int i = 0; i < 3; ++i) value[i] = a[i][i];
  for (int pass = 0; pass < 2; ++pass)
    for (int i = 0; i < 2 - pass; ++i) {
      if (value[i] <= value[i + 1]) continue;
      const double least = value[i + 1];
      value[i + 1] = value[i], value[i] = least;
      for (int k = 0; k < 3; ++k) {
        const double x = axis[i][k];
        axis[i][k] = axis[i + 1][k], axis[i + 1][k] = x;
      }
    }
}

/* Axes of each cell, as `cells.axes_of` has them, from its sums. */
static void turn(long long cells, const double* sums, double* rotation) {
  for (long long c = 0; c < cells; ++c) {
    const double* s = sums + SUMS * c;
    double upper[6], value[3], axis[3][3], unit[3] = {0.0, 0.0, 0.0}, third[3];
    for (int i = 0, at = 0; i < 3; ++i)
      for (int j = i; j < 3; ++j, ++at) upper[at] = s[5 + at] - s[2 + i] * s[2 + j] / s[0];
    principal_axes(upper, value, axis);
    if (!(value[1] < LINE * value[2])) { /* on a surface: its normal, and the cube's edge that is closest to it */
      int k = 0;
      for (int i = 1; i < 3; ++i)
        if (fabs(axis[0][i]) < fabs(axis[0][k])) k = i;
      unit[k] = 1.0;
      const double over = dot(unit, axis[0]);
      for (int i = 0; i < 3; ++i) axis[1][i] = unit[i] - over * axis[0][i];
      const double length = norm(axis[1]);
      for (int i = 0; i < 3; ++i) axis[1][i] /= length;
    }
    cross(axis[0], axis[1], third); /* right-handed */
    for (int i = 0; i < 3; ++i) {
      double* row = rotation + 9 * c + 3 * i;
      row[0] = axis[0][i], row[1] = axis[1][i], row[2] = third[i];
    }
  }
}

static void extend(long long count, const double* points, const long long* near, const long long* cell,
                   long long cells, const double* rotation, double* low, double* high) {
  for (long long k = 0; k < 3 * cells; ++k) low[k] = INFINITY, high[k] = -INFINITY;
  for (long long n = 0; n < count; ++n) {
    const long long c = cell[n];
    const double *p = points + 3 * near[n], *r = rotation + 9 * c;
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
  long long* near = written_indices(&taken, "near", SHAPE(rows));
  long long* cell = written_indices(&taken, "cell", SHAPE(rows));
  double* sums = written(&taken, "sums", SHAPE(rows, SUMS));
  long long size = 1 << 10, cells = 0;
  while (size < 2 * (rows + 1)) size *= 2;
  long long* key_of = scratch_indices(&taken, rows + 1);
  long long* cell_at = scratch_indices(&taken, size);
  if (ready(&taken))
    WITHOUT_LOCK(cells = gather(rows, points, radii, edge, balls, ball, near, cell, sums, key_of, cell_at));
  return ended(&taken, PyLong_FromLongLong(cells));
}

WRAPPER(call_turn) {
  arguments taken = begin("turn_cells", given, count);
  const double* sums = numbers(&taken, "sums", SHAPE(ANY, SUMS));
  const long long cells = taken.shape[0];
  double* rotation = written(&taken, "rotation", SHAPE(cells, 3, 3));
  if (ready(&taken)) WITHOUT_LOCK(turn(cells, sums, rotation));
  return ended(&taken, none());
}

WRAPPER(call_extend) {
  arguments taken = begin("extend_cells", given, count);
  const double* points = numbers(&taken, "points", SHAPE(ANY, 3));
  const long long rows = taken.shape[0];
  const double* rotation = numbers(&taken, "rotation", SHAPE(ANY, 3, 3));
  const long long cells = taken.shape[0];
  const long long* near = indices(&taken, "near", 0, rows, SHAPE(ANY));
  const long long found = taken.shape[0];
  const long long* cell = indices(&taken, "cell", 0, cells, SHAPE(found));
  double* low = written(&taken, "low", SHAPE(cells, 3));
  double* high = written(&taken, "high", SHAPE(cells, 3));
  if (ready(&taken)) WITHOUT_LOCK(extend(found, points, near, cell, cells, rotation, low, high));
  return ended(&taken, none());
}

PyMethodDef cells_functions[] = {
    FUNCTION("gather_cells", call_gather, "Number the cells of points and sum what is in each; returns how many."),
    FUNCTION("turn_cells", call_turn, "The axes of each cell, from its sums."),
    FUNCTION("extend_cells", call_extend, "The extents of each cell's points along its axes."),
    END_OF_FUNCTIONS,
};
