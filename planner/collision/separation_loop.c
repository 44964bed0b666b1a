/* The search of `separation_bounds.py` for one pair: best box first, each halved alone.

   The normal between the bodies is that of GJK (E. G. Gilbert, D. W. Johnson, S. S. Keerthi, 1988) on their vertices. Its
   distance only decides which boxes are worth halving: the bound holds along any unit normal. */

#include <math.h>
#include <stdlib.h>

#include "../../distance/compiled/border.h"
#include "../kinematics/forward_loop.h"

#define PI 3.14159265358979323846

/* Two bodies: vertices (count, 3) in the frame of a joint, and the radius of a ball that sweeps them. */
typedef struct { long long joint, count; const double* vertices; } hull;

static double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The point v of least norm of the hull of k ≤ 4 points, by trying every face of it; keeps the points of that face. */
static void nearest(double points[4][3], long long* count, double* v) {
  double best = INFINITY, kept[4][3];
  long long mask, size = 0, k = *count, m, i, j;
  for (mask = 1; mask < 1 << k; ++mask) {
    const double* p[4];
    double e[3][3], g[3][4], found[3];
    int inside = 1;
    for (i = m = 0; i < k; ++i)
      if (mask >> i & 1) p[m++] = points[i];
    for (i = 0; i + 1 < m; ++i) for (j = 0; j < 3; ++j) e[i][j] = p[i + 1][j] - p[0][j];
    for (i = 0; i + 1 < m; ++i) {
      for (j = 0; j + 1 < m; ++j) g[i][j] = dot(e[i], e[j]);
      g[i][m - 1] = -dot(e[i], p[0]);
    }
    for (i = 0; i + 1 < m && inside; ++i) {  /* Gauss-Jordan; a Gram matrix needs no pivots */
      long long r, c;
      if (!(g[i][i] > 1e-14 * dot(e[i], e[i]))) inside = 0;
      else for (r = 0; r + 1 < m; ++r) {
        double factor = g[r][i] / g[i][i];
        if (r != i) for (c = i; c < m; ++c) g[r][c] -= factor * g[i][c];
      }
    }
    if (!inside) continue;
    for (j = 0; j < 3; ++j) found[j] = p[0][j];
    {
      double rest = 1.0;
      for (i = 0; i + 1 < m; ++i) {
        double weight = g[i][m - 1] / g[i][i];
        rest -= weight;
        inside = inside && weight > 0.0;
        for (j = 0; j < 3; ++j) found[j] += weight * e[i][j];
      }
      inside = inside && rest > 0.0;
    }
    if (inside && dot(found, found) < best) {
      best = dot(found, found);
      size = m;
      for (i = 0; i < m; ++i) for (j = 0; j < 3; ++j) kept[i][j] = p[i][j];
      for (j = 0; j < 3; ++j) v[j] = found[j];
    }
  }
  for (i = 0; i < size; ++i) for (j = 0; j < 3; ++j) points[i][j] = kept[i][j];
  *count = size;
}

/* About the distance of two hulls, 0 where they meet, and the unit normal n from b to a, if they do not. */
static double apart(long long count_a, const double* a, long long count_b, const double* b, double* n) {
  double points[4][3], v[3];
  long long count = 0, round, i, j;
  for (j = 0; j < 3; ++j) v[j] = a[j] - b[j];
  for (round = 0; round < 50; ++round) {
    double w[3], low = INFINITY, high = -INFINITY, square = dot(v, v);
    const double *at_a = a, *at_b = b;
    if (square < 1e-18) return 0.0;
    for (i = 0; i < count_a; ++i) {
      double value = dot(v, a + 3 * i);
      if (value < low) { low = value; at_a = a + 3 * i; }
    }
    for (i = 0; i < count_b; ++i) {
      double value = dot(v, b + 3 * i);
      if (value > high) { high = value; at_b = b + 3 * i; }
    }
    if (round && square - (low - high) <= 1e-10 * square) break;
    for (j = 0; j < 3; ++j) w[j] = at_a[j] - at_b[j];
    for (i = 0; i < count; ++i)
      if (w[0] == points[i][0] && w[1] == points[i][1] && w[2] == points[i][2]) break;
    if (i < count) break;
    for (j = 0; j < 3; ++j) points[count][j] = w[j];
    ++count;
    nearest(points, &count, v);
    if (count == 4) return 0.0;
  }
  {
    double length = sqrt(dot(v, v));
    for (j = 0; j < 3; ++j) n[j] = v[j] / length;
    return length;
  }
}

/* The least of n·v − Σ e_j(v) over a body's vertices (count, 3) in the world; adds that vertex' e_j to `shifts`. */
static double lowest(const tree* t, long long count, const double* vertices, const double* n, double sign, double side,
                     const double* moves, const double* half, const double* columns, double* trial, double* shifts) {
  double least = INFINITY;
  long long i, j;
  for (i = 0; i < count; ++i) {
    const double* v = vertices + 3 * i;
    double height = sign * dot(n, v), before = 0.0;
    for (j = 0; j < t->n; ++j) {
      const double *c = columns + 6 * j, h = half[j];
      double speed, along, chord, bend, u[3];
      if (moves[j] != side) continue;
      u[0] = c[0] + c[4] * v[2] - c[5] * v[1];
      u[1] = c[1] + c[5] * v[0] - c[3] * v[2];
      u[2] = c[2] + c[3] * v[1] - c[4] * v[0];
      speed = sqrt(dot(u, u));
      along = fabs(dot(n, u));
      if (dot(c + 3, c + 3) > 0.25) {
        chord = 2.0 * sin((h < PI ? h : PI) / 2.0);
        bend = 0.5 * h * h + chord * (before < 2.0 ? before : 2.0);
        before += h;
      } else {
        chord = h;
        bend = chord * (before < 2.0 ? before : 2.0);
      }
      trial[j] = chord * speed < h * along + bend * speed ? chord * speed : h * along + bend * speed;
      height -= trial[j];
    }
    if (height < least) {
      least = height;
      for (j = 0; j < t->n; ++j) if (moves[j] == side) shifts[j] = trial[j];
    }
  }
  return least;
}

static void place(const hull* body, const double* placements, double* vertices) {
  const double *turn = placements + 12 * body->joint, *origin = turn + 9;
  long long i, j;
  for (i = 0; i < body->count; ++i)
    for (j = 0; j < 3; ++j) vertices[3 * i + j] = dot(turn + 3 * j, body->vertices + 3 * i) + origin[j];
}

/* The bound over the box (centre, half), and the joint that contributes most to its looseness; *least becomes the
   distance at the centre, if that is less. `room`: of the kinematics and the vertices. */
static double look(const tree* t, const hull* a, const hull* b, double radii, const double* moves, const double* centre,
                   const double* half, double* room, double* least, long long* widest) {
  double *placements = room, *columns = placements + 12 * t->joints, *trial = columns + 6 * t->n;
  double *shifts = trial + t->n, *of_a = shifts + t->n, *of_b = of_a + 3 * a->count, n[3] = {1.0, 0.0, 0.0}, found, gap;
  long long j;
  forward(t, 1, centre, placements, columns);
  place(a, placements, of_a);
  place(b, placements, of_b);
  found = apart(a->count, of_a, b->count, of_b, n) - radii;
  if (found < *least) *least = found;
  for (j = 0; j < t->n; ++j) shifts[j] = 0.0;
  gap = lowest(t, a->count, of_a, n, 1.0, 1.0, moves, half, columns, trial, shifts)
        + lowest(t, b->count, of_b, n, -1.0, -1.0, moves, half, columns, trial, shifts) - radii;
  for (*widest = 0, j = 1; j < t->n; ++j) if (shifts[j] > shifts[*widest]) *widest = j;
  return gap;
}

/* A lower bound of the distance of a pair over the box of the limits, and in *looked how many boxes it took. `boxes`
   (most + 2, 2 n + 1): a heap of centre, half widths and bound, the least bound first; `widest` goes with it. */
static double separation(const tree* t, const hull* a, const hull* b, double radii, const double* moves,
                         const double* low, const double* high, double wanted, double tight, long long most,
                         double* boxes, long long* widest, double* room, long long* looked) {
  long long n = t->n, row = 2 * n + 1, count = 1, boxed = 1, i, j, s;
  double least = INFINITY;
  for (j = 0; j < n; ++j) {
    boxes[j] = 0.5 * (low[j] + high[j]);
    boxes[n + j] = moves[j] != 0.0 ? 0.5 * (high[j] - low[j]) : 0.0;
  }
  boxes[2 * n] = look(t, a, b, radii, moves, boxes, boxes + n, room, &least, widest);
  while (boxes[2 * n] < tight * least && least > wanted && boxed < most) {
    double *one = boxes + row * count, *other = one + row;
    long long split = widest[0], w[2];
    for (j = 0; j < row; ++j) one[j] = boxes[j];
    one[n + split] /= 2.0;
    for (j = 0; j < row; ++j) other[j] = one[j];
    one[split] -= one[n + split];
    other[split] += one[n + split];
    one[2 * n] = look(t, a, b, radii, moves, one, one + n, room, &least, w);
    other[2 * n] = look(t, a, b, radii, moves, other, other + n, room, &least, w + 1);
    boxed += 2;
    for (s = 0; s < 2; ++s) {  /* the first takes the place of the box that was halved, at the top: it sinks */
      double* from = s ? other : one;
      if (s == 0) {
        for (i = 0;;) {
          long long child = 2 * i + 1;
          if (child + 1 < count && boxes[row * (child + 1) + 2 * n] < boxes[row * child + 2 * n]) ++child;
          if (child >= count || boxes[row * child + 2 * n] >= from[2 * n]) break;
          for (j = 0; j < row; ++j) boxes[row * i + j] = boxes[row * child + j];
          widest[i] = widest[child];
          i = child;
        }
        for (j = 0; j < row; ++j) boxes[row * i + j] = from[j];
        widest[i] = w[0];
      } else {  /* the second comes last: it rises */
        for (j = 0; j < row; ++j) room[j] = from[j];
        for (i = count++; i > 0; i = (i - 1) / 2) {
          long long parent = (i - 1) / 2;
          if (boxes[row * parent + 2 * n] <= room[2 * n]) break;
          for (j = 0; j < row; ++j) boxes[row * i + j] = boxes[row * parent + j];
          widest[i] = widest[parent];
        }
        for (j = 0; j < row; ++j) boxes[row * i + j] = room[j];
        widest[i] = w[1];
      }
    }
  }
  *looked = boxed;
  return boxes[2 * n];
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* call_separation(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("separation", given, count);
  const tree* t = record(&c, "tree", "tree");
  long long n = t ? t->n : 0, joints = t ? t->joints : 0, most, looked = 0, room, *widest;
  hull hulls[2];
  const double *moves, *low, *high;
  double radii, wanted, tight, *boxes, *work, bound = 0.0;
  int i;
  (void)self;
  for (i = 0; i < 2; ++i) {
    hulls[i].joint = whole(&c, "joint", 0, joints - 1);
    hulls[i].vertices = numbers(&c, "vertices", SHAPE(ANY, 3));
    hulls[i].count = c.shape[0];
    if (!c.failed && hulls[i].count < 1) wrong(&c, "vertices", "one or more");
  }
  radii = number(&c, "radii");
  moves = numbers(&c, "moves", SHAPE(n));
  low = numbers(&c, "low", SHAPE(n));
  high = numbers(&c, "high", SHAPE(n));
  wanted = number(&c, "wanted");
  tight = number(&c, "tight");
  most = whole(&c, "most", 0, 1LL << 30);
  if (!ready(&c)) return ended(&c, NULL);
  room = 12 * joints + 8 * n + 3 * (hulls[0].count + hulls[1].count) + 1;
  boxes = malloc((size_t)((most + 3) * (2 * n + 1)) * sizeof(double));
  widest = malloc((size_t)(most + 3) * sizeof(long long));
  work = malloc((size_t)room * sizeof(double));
  if (boxes && widest && work)
    WITHOUT_LOCK(bound = separation(t, hulls, hulls + 1, radii, moves, low, high, wanted, tight, most, boxes, widest,
                                    work, &looked));
  free(boxes);
  free(widest);
  free(work);
  return ended(&c, boxes && widest && work ? Py_BuildValue("dL", bound, looked) : no_memory());
}

PyMethodDef separation_functions[] = {
    FUNCTION("separation", call_separation, "A lower bound of a pair's distance over all joint values; boxes looked at."),
    END_OF_FUNCTIONS,
};
