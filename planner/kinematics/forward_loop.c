/* The forward kinematics of many configurations: the recursion of `forward.py`, to rounding the same. */

#include "forward_loop.h"

#include <math.h>

#include "../../distance/compiled/border.h"

/* Placements (batch, joints, 12) and columns (batch, n, 6) at configurations (batch, n). */
void forward(const tree* t, long long batch, const double* q, double* placements, double* columns) {
  long long s, k;
  int i, j;
  for (s = 0; s < batch; ++s, q += t->n, placements += 12 * t->joints, columns += 6 * t->n) {
    for (i = 0; i < 12; ++i) placements[i] = i == 0 || i == 4 || i == 8 ? 1.0 : 0.0;
    for (k = 1; k < t->joints; ++k) {
      const double *on = placements + 12 * t->parents[k - 1], *x = t->placed + 12 * (k - 1), *a = t->axes + 3 * (k - 1);
      double *found = placements + 12 * k, *column = columns + 6 * t->coordinates[k - 1], turn[9], d[3], *o = found + 9;
      double value = q[t->coordinates[k - 1]];
      for (i = 0; i < 3; ++i) {
        for (j = 0; j < 3; ++j)
          turn[3 * i + j] = on[3 * i] * x[j] + on[3 * i + 1] * x[3 + j] + on[3 * i + 2] * x[6 + j];
        o[i] = on[9 + i] + (on[3 * i] * x[9] + on[3 * i + 1] * x[10] + on[3 * i + 2] * x[11]);
      }
      for (i = 0; i < 3; ++i) d[i] = turn[3 * i] * a[0] + turn[3 * i + 1] * a[1] + turn[3 * i + 2] * a[2];
      if (t->turns[k - 1]) {  /* Rodrigues: a aᵀ + cos q (I − a aᵀ) + sin q [a]× */
        double c = cos(value), n = sin(value), m[9];
        for (i = 0; i < 3; ++i)
          for (j = 0; j < 3; ++j) m[3 * i + j] = a[i] * a[j] + c * ((i == j ? 1.0 : 0.0) - a[i] * a[j]);
        m[1] -= n * a[2]; m[2] += n * a[1]; m[3] += n * a[2]; m[5] -= n * a[0]; m[6] -= n * a[1]; m[7] += n * a[0];
        for (i = 0; i < 3; ++i)
          for (j = 0; j < 3; ++j)
            found[3 * i + j] = turn[3 * i] * m[j] + turn[3 * i + 1] * m[3 + j] + turn[3 * i + 2] * m[6 + j];
        column[0] = o[1] * d[2] - o[2] * d[1];
        column[1] = o[2] * d[0] - o[0] * d[2];
        column[2] = o[0] * d[1] - o[1] * d[0];
        for (i = 0; i < 3; ++i) column[3 + i] = d[i];
      } else {
        for (i = 0; i < 9; ++i) found[i] = turn[i];
        for (i = 0; i < 3; ++i) {
          column[i] = d[i];
          column[3 + i] = 0.0;
          o[i] += d[i] * value;
        }
      }
    }
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* make_tree(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("tree", given, count);
  tree made_of;
  PyObject* found;
  (void)self;
  made_of.joints = whole(&c, "joints", 1, 1LL << 30);
  made_of.n = whole(&c, "n", 0, 1LL << 30);
  made_of.parents = rows(&c, "parents", 0, made_of.joints, SHAPE(made_of.joints - 1));
  made_of.coordinates = rows(&c, "coordinates", 0, made_of.n, SHAPE(made_of.joints - 1));
  made_of.turns = rows(&c, "turns", 0, 2, SHAPE(made_of.joints - 1));
  made_of.placed = numbers(&c, "placed", SHAPE(made_of.joints - 1, 12));
  made_of.axes = numbers(&c, "axes", SHAPE(made_of.joints - 1, 3));
  found = made(&c, "tree", &made_of, sizeof made_of);
  return ended(&c, found);
}

static PyObject* call_forward(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("forward", given, count);
  const tree* t = record(&c, "tree", "tree");
  long long joints = t ? t->joints : 0, n = t ? t->n : 0, batch;
  const double* q = numbers(&c, "q", SHAPE(ANY, n));
  double *placements, *columns;
  (void)self;
  batch = c.shape[0];
  placements = written(&c, "placements", SHAPE(batch, joints, 12));
  columns = written(&c, "columns", SHAPE(batch, n, 6));
  if (ready(&c)) WITHOUT_LOCK(forward(t, batch, q, placements, columns));
  return ended(&c, none());
}

PyMethodDef forward_functions[] = {
    FUNCTION("tree", make_tree, "A tree of joints."),
    FUNCTION("forward", call_forward, "Placements and columns at configurations."),
    END_OF_FUNCTIONS,
};
