/* The HD-SDF of `distance/symbolic/halfspaces.py`, written by hand: the same equations, several times as fast. A lower
   bound in sign, an approximation in value; the CasADi function is the definition, and the two agree but for rounding.

   Why it is fast: one plane after another lies in memory, so that every step of the sums runs over planes in the widest
   vectors of the processor; roots are found without `pow`; and numbers of vertices and planes are arguments, so that no
   robot and no obstacle has to be compiled for. */

#include "hdsdf_loop.h"

#include <math.h>
#include <stdlib.h>

#include "../../distance/compiled/border.h"

#if defined(__GNUC__)
#define ALWAYS __inline__ __attribute__((always_inline))
#else
#define ALWAYS inline
#endif
#define TINY 1e-150  /* as in `one_axis` */

static ALWAYS double power(double base, int exponent) {
  double found = 1.0;
  if (exponent == 1) return base;
  if (exponent == 2) return base * base;
  if (exponent == 3) return base * base * base;
  if (exponent == 4) return base * base * (base * base);
  for (; exponent; exponent >>= 1, base *= base)
    if (exponent & 1) found *= base;
  return found;
}

/* s^(1/p), s ≥ 1: the cube root by Halley's method, three times, from q (1 + 2 q) / (2 + q), q = s^(1/4). */
static ALWAYS double root(double s, int p) {
  if (p == 1) return s;
  if (p == 2) return sqrt(s);
  if (p == 3) {
    double q = sqrt(sqrt(s)), y = q * (1.0 + 2.0 * q) / (2.0 + q), cube;
    cube = y * y * y; y *= (cube + 2.0 * s) / (2.0 * cube + s);
    cube = y * y * y; y *= (cube + 2.0 * s) / (2.0 * cube + s);
    cube = y * y * y; y *= (cube + 2.0 * s) / (2.0 * cube + s);
    return y;
  }
  if (p == 4) return sqrt(sqrt(s));
  return pow(s, 1.0 / p);
}

/* Phi(u) / u; its derivative by u goes to *slope. */
static ALWAYS double shaping(double u, double length, int gamma, double* slope) {
  double size = u < 0.0 ? -u : u;
  double small = size < length ? size : length, large = size < length ? length : size;
  double raised = power(small / large, gamma), whole = 1.0 / (1.0 + raised);
  double s = (size <= length ? raised : 1.0) * whole, rest = (size <= length ? 1.0 : raised) * whole;
  *slope = s * (1.0 + gamma * rest);
  return s;
}

/* D from x_ik (slots, width) and its least along every plane, the largest of which is `apart`; x is used up. The
   derivative of D by x_ik goes to x. `work` has room for 2 width. */
static ALWAYS double shaped_maximum(const int gamma, double length, long long slots, const double* weights, long long width,
                             double apart, const double* restrict least, double* restrict x,
                             double* restrict g, double* restrict factor) {
  const int p = gamma + 1;
  double top, total = 0.0, outer, inverse, u, slope, value, sums[4] = {0.0};
  long long i, k;
  if (apart > TINY) {  /* the planes that separate count, each with its Hölder minimum */
    top = 0.0;
    for (k = 0; k < width; ++k) {
      double sum = 0.0, along;
      g[k] = factor[k] = 0.0;
      if (!(least[k] > TINY)) continue;
      for (i = 0; i < slots; ++i) {
        double r = least[k] / x[i * width + k];
        x[i * width + k] = r;
        sum += weights[i] * power(r, p);
      }
      inverse = 1.0 / root(sum, p);
      u = least[k] * inverse;
      g[k] = u * shaping(u, length, gamma, &along);
      factor[k] = along * power(inverse, p + 1);
      top = g[k] > top ? g[k] : top;
    }
    if (!(top > TINY)) top = 1.0;  /* underflow: D is 0 */
    for (k = 0; k < width; ++k) total += power(g[k] / top, p);
    if (!(total > 0.0)) {
      for (k = 0; k < slots * width; ++k) x[k] = 0.0;
      return 0.0;
    }
    outer = root(total, p);
    value = top * outer;
    value *= shaping(value, length, gamma, &slope);
    for (k = 0; k < width; ++k) factor[k] *= slope * power(g[k] / (top * outer), p - 1);
    for (i = 0; i < slots; ++i)
      for (k = 0; k < width; ++k)
        x[i * width + k] = factor[k] > 0.0 ? weights[i] * factor[k] * power(x[i * width + k], p + 1) : 0.0;
    return value;
  }
  for (k = 0; k < width; ++k) {
    factor[k] = least[k] < -TINY ? -1.0 / least[k] : 0.0;
    g[k] = least[k] < -TINY ? 0.0 : 1.0;
  }
  for (i = 0; i < slots; ++i) {
    double weight = weights[i], *row = x + i * width;
    for (k = 0; k < width; ++k) {
      double r = (row[k] < 0.0 ? -row[k] : 0.0) * factor[k];
      row[k] = r;
      g[k] += weight * power(r, p);
    }
  }
  for (k = 0; k < width; ++k) {
    double raised = root(g[k], p), along;
    u = least[k] < -TINY ? least[k] * raised : 0.0;
    g[k] = u * shaping(u, length, gamma, &along);
    factor[k] = along * power(1.0 / raised, p - 1);
  }
  top = largest(width, g);
  if (!(top < -TINY)) {
    for (k = 0; k < slots * width; ++k) x[k] = 0.0;
    return 0.0;
  }
  for (k = 0; k < width; ++k) g[k] = top / g[k];
  for (k = 0; k < width; k += 4)
    for (i = 0; i < 4; ++i) sums[i] += power(g[k + i], p);
  inverse = 1.0 / root((sums[0] + sums[1]) + (sums[2] + sums[3]), p);
  value = top * inverse;
  value *= shaping(value, length, gamma, &slope);
  for (k = 0; k < width; ++k) factor[k] *= slope * power(g[k] * inverse, p + 1);
  for (i = 0; i < slots; ++i) {
    double weight = weights[i], *row = x + i * width;
    for (k = 0; k < width; ++k) row[k] = weight * factor[k] * power(row[k], p - 1);
  }
  return value;
}

/* D of a row that `project` has looked at; its wrench about the world's origin goes to `wrench`. */
double hdsdf(long long gamma, double length, const double* b, long long slots, const double* weights,
                    long long width, const double* planes, double apart, projection* of, double* wrench) {
  double *x = of->x, *work = of->work, force[3] = {0.0}, turning[3] = {0.0}, distance;
  const double* least = of->least;
  long long i, k;
  int j;
  /* The default order as a constant: its powers and roots are written out. */
  if (gamma == 2) distance = shaped_maximum(2, length, slots, weights, width, apart, least, x, work, work + width);
  else distance = shaped_maximum((int)gamma, length, slots, weights, width, apart, least, x, work, work + width);
  for (i = 0; i < slots; ++i, x += width) {
    const double *p = of->points + 3 * i, *nx = planes, *ny = planes + width, *nz = planes + 2 * width;
    double f[3], fx[4] = {0.0}, fy[4] = {0.0}, fz[4] = {0.0};  /* four sums side by side, as wide as vectors are */
    for (k = 0; k < width; k += 4)
      for (j = 0; j < 4; ++j) {
        fx[j] += x[k + j] * nx[k + j];
        fy[j] += x[k + j] * ny[k + j];
        fz[j] += x[k + j] * nz[k + j];
      }
    f[0] = (fx[0] + fx[1]) + (fx[2] + fx[3]);
    f[1] = (fy[0] + fy[1]) + (fy[2] + fy[3]);
    f[2] = (fz[0] + fz[1]) + (fz[2] + fz[3]);
    for (k = 0; k < 3; ++k) force[k] += f[k];
    turning[0] += p[1] * f[2] - p[2] * f[1];
    turning[1] += p[2] * f[0] - p[0] * f[2];
    turning[2] += p[0] * f[1] - p[1] * f[0];
  }
  for (k = 0; k < 3; ++k) {
    wrench[k] = b[3 * k] * force[0] + b[3 * k + 1] * force[1] + b[3 * k + 2] * force[2];
    wrench[3 + k] = b[3 * k] * turning[0] + b[3 * k + 1] * turning[1] + b[3 * k + 2] * turning[2];
  }
  wrench[3] += b[10] * wrench[2] - b[11] * wrench[1];
  wrench[4] += b[11] * wrench[0] - b[9] * wrench[2];
  wrench[5] += b[9] * wrench[1] - b[10] * wrench[0];
  return distance;
}

/* D (count), wrench (count, 6) and D̃ (count) of pairs at samples. Returns 0, or −1 without memory. */
static int hdsdf_rows(const tables* t, long long gamma, double length, long long joints, const double* placements,
                      long long count, const long long* samples, const long long* pairs, double* distance,
                     double* wrench, double* separation) {
  projection of;
  long long row;
  if (make_projection(t, &of)) return -1;
  for (row = 0; row < count; ++row) {
    long long k = pairs[row], box = t->box[k];
    const double *a = placements + 12 * (samples[row] * joints + t->joint_a[k]);
    const double *b = placements + 12 * (samples[row] * joints + t->joint_b[k]);
    const double* body = t->table + (4 * t->slots + 1) * t->body[k];
    separation[row] = project(a, b, t->slots, body, t->width[box], t->planes + t->first[box], &of);
    distance[row] = hdsdf(gamma, length, b, t->slots, body + 3 * t->slots, t->width[box], t->planes + t->first[box],
                          separation[row], &of, wrench + 6 * row);
  }
  free(of.points);
  return 0;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* call_hdsdf_rows(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("hdsdf_rows", given, count);
  const tables* t = record(&c, "tables", "tables");
  long long gamma = whole(&c, "gamma", 1, 1000), found = 0, batch, joints, size;
  double length = number(&c, "length"), *distance, *wrench, *separation;
  const double* placements = numbers(&c, "placements", SHAPE(ANY, ANY, 12));
  const long long *samples, *pairs;
  (void)self;
  batch = c.shape[0];
  joints = c.shape[1];
  if (placements && t && joints < t->joints) wrong(&c, "placements", "those of all joints");
  samples = rows(&c, "samples", 0, batch, SHAPE(ANY));
  size = c.shape[0];
  pairs = rows(&c, "pairs", 0, t ? t->pairs : 0, SHAPE(size));
  distance = written(&c, "distance", SHAPE(size));
  wrench = written(&c, "wrench", SHAPE(size, 6));
  separation = written(&c, "separation", SHAPE(size));
  if (ready(&c))
    WITHOUT_LOCK(found = hdsdf_rows(t, gamma, length, joints, placements, size, samples, pairs, distance, wrench, separation));
  return ended(&c, found < 0 ? no_memory() : none());
}

PyMethodDef hdsdf_functions[] = {
    FUNCTION("hdsdf_rows", call_hdsdf_rows, "D, its wrench and the signed distance without shaping, of pairs at samples."),
    END_OF_FUNCTIONS,
};
