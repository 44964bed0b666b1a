/* The HD-SDF of `distance/symbolic/halfspaces.py`, written by hand: the same equations, several times as fast. A lower
   bound in sign, an approximation in value; the CasADi function is the definition, and the two agree but for rounding.

   Why it is fast: one plane after another lies in memory, so that every step of the sums runs over planes in the widest
   vectors of the processor; roots are found without `pow`; and numbers of vertices and planes are arguments, so that no
   robot and no obstacle needs a compilation. */

#include "hdsdf_loop.h"

#include <stdlib.h>

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/clones.h"
#include "../../distance/compiled/vectors.h"

#define TINY 1e-150 /* as in `one_axis` */

/* base^exponent */
INLINE double power(double base, int exponent) {
  if (exponent == 1) return base;
  if (exponent == 2) return base * base;
  if (exponent == 3) return base * base * base;
  if (exponent == 4) return base * base * (base * base);
  double found = 1.0;
  for (; exponent; exponent >>= 1, base *= base)
    if (exponent & 1) found *= base;
  return found;
}

/* One step of Halley's method towards the cube root. */
INLINE double halley(double s, double y) {
  const double cube = y * y * y;
  return y * ((cube + 2.0 * s) / (2.0 * cube + s));
}

/* s^(1/p), s ≥ 1: the cube root by Halley's method, three times, from q (1 + 2 q) / (2 + q), q = s^(1/4). */
INLINE double root(double s, int p) {
  if (p == 1) return s;
  if (p == 2) return sqrt(s);
  if (p == 3) {
    const double q = sqrt(sqrt(s));
    return halley(s, halley(s, halley(s, q * (1.0 + 2.0 * q) / (2.0 + q))));
  }
  if (p == 4) return sqrt(sqrt(s));
  return pow(s, 1.0 / p);
}

/* Phi(u) / u of the shaping function; its derivative by u goes to *slope. */
INLINE double shaping(double u, double length, int gamma, double* slope) {
  const double size = u < 0.0 ? -u : u;
  const double small = size < length ? size : length, large = size < length ? length : size;
  const double raised = power(small / large, gamma), whole_share = 1.0 / (1.0 + raised);
  const double share = (size <= length ? raised : 1.0) * whole_share;
  const double rest = (size <= length ? 1.0 : raised) * whole_share;
  *slope = share * (1.0 + gamma * rest);
  return share;
}

/* One evaluation: x_ik (slots, width), overwritten by the derivatives of D by x_ik; the least x of every plane; what
   each plane adds, g_k, and the factor of its derivatives, both (width). */
typedef struct {
  long long slots, width;
  const double* weights;
  const double* restrict least;
  double *restrict x, *restrict g, *restrict factor;
} sums;

INLINE double nothing(const sums* at) {
  for (long long k = 0; k < at->slots * at->width; ++k) at->x[k] = 0.0;
  return 0.0;
}

/* D where planes separate the bodies: those planes count, each with its Hölder minimum
   g_k = Phi(l_k / (Σ_i w_i (l_k / x_ik)^p)^(1/p)), and D = Phi((Σ_k g_k^p)^(1/p)). */
INLINE double shaped_outside(const int gamma, double length, const sums* at) {
  const int p = gamma + 1;
  const long long slots = at->slots, width = at->width;
  const double *restrict least = at->least, *weights = at->weights;
  double *restrict x = at->x, *restrict g = at->g, *restrict factor = at->factor;
  double top = 0.0, total = 0.0, slope;
  for (long long k = 0; k < width; ++k) {
    double sum = 0.0, along;
    g[k] = factor[k] = 0.0;
    if (!(least[k] > TINY)) continue;
    for (long long i = 0; i < slots; ++i) {
      const double ratio = least[k] / x[i * width + k];
      x[i * width + k] = ratio;
      sum += weights[i] * power(ratio, p);
    }
    const double inverse = 1.0 / root(sum, p), u = least[k] * inverse;
    g[k] = u * shaping(u, length, gamma, &along);
    factor[k] = along * power(inverse, p + 1);
    top = g[k] > top ? g[k] : top;
  }
  if (!(top > TINY)) top = 1.0; /* underflow: D is 0 */
  for (long long k = 0; k < width; ++k) total += power(g[k] / top, p);
  if (!(total > 0.0)) return nothing(at);
  const double outer = root(total, p);
  double value = top * outer;
  value *= shaping(value, length, gamma, &slope);
  for (long long k = 0; k < width; ++k) factor[k] *= slope * power(g[k] / (top * outer), p - 1);
  for (long long i = 0; i < slots; ++i)
    for (long long k = 0; k < width; ++k)
      x[i * width + k] = factor[k] > 0.0 ? weights[i] * factor[k] * power(x[i * width + k], p + 1) : 0.0;
  return value;
}

/* The Hölder maximum of −x_ik along every plane, shaped: g_k = Phi(−l_k (1 + Σ_i w_i (x_ik / l_k)^p)^(1/p)). */
INLINE void depths(const int gamma, double length, const sums* at) {
  const int p = gamma + 1;
  const long long width = at->width;
  const double* restrict least = at->least;
  double *restrict g = at->g, *restrict factor = at->factor;
  for (long long k = 0; k < width; ++k) {
    factor[k] = least[k] < -TINY ? -1.0 / least[k] : 0.0;
    g[k] = least[k] < -TINY ? 0.0 : 1.0;
  }
  for (long long i = 0; i < at->slots; ++i) {
    const double weight = at->weights[i];
    double* restrict row = at->x + i * width;
    for (long long k = 0; k < width; ++k) {
      const double ratio = (row[k] < 0.0 ? -row[k] : 0.0) * factor[k];
      row[k] = ratio;
      g[k] += weight * power(ratio, p);
    }
  }
  for (long long k = 0; k < width; ++k) {
    double along;
    const double raised = root(g[k], p), u = least[k] < -TINY ? least[k] * raised : 0.0;
    g[k] = u * shaping(u, length, gamma, &along);
    factor[k] = along * power(1.0 / raised, p - 1);
  }
}

/* D where no plane separates them: the Hölder minimum of the depths, D = Phi(g / (Σ_k (g / g_k)^p)^(1/p)), g the largest
   g_k, which is closest to zero. */
INLINE double shaped_inside(const int gamma, double length, const sums* at) {
  const int p = gamma + 1;
  const long long width = at->width;
  double *restrict g = at->g, *restrict factor = at->factor, slope, four[4] = {0.0};
  depths(gamma, length, at);
  const double top = largest(width, g);
  if (!(top < -TINY)) return nothing(at);
  for (long long k = 0; k < width; ++k) g[k] = top / g[k];
  for (long long k = 0; k < width; k += 4)
    for (int j = 0; j < 4; ++j) four[j] += power(g[k + j], p);
  const double inverse = 1.0 / root((four[0] + four[1]) + (four[2] + four[3]), p);
  double value = top * inverse;
  value *= shaping(value, length, gamma, &slope);
  for (long long k = 0; k < width; ++k) factor[k] *= slope * power(g[k] * inverse, p + 1);
  for (long long i = 0; i < at->slots; ++i) {
    const double weight = at->weights[i];
    double* restrict row = at->x + i * width;
    for (long long k = 0; k < width; ++k) row[k] = weight * factor[k] * power(row[k], p - 1);
  }
  return value;
}

/* The default order is a constant: its powers and roots are written out. Outside, columns of x are summed one after the
   other, which wider vectors only slow down. */
CLONES
static double inside(int gamma, double length, const sums* at) {
  return gamma == 2 ? shaped_inside(2, length, at) : shaped_inside(gamma, length, at);
}

static double outside(int gamma, double length, const sums* at) {
  return gamma == 2 ? shaped_outside(2, length, at) : shaped_outside(gamma, length, at);
}

/* The force and the moment about the frame's origin, from the derivatives by x_ik: Σ_i f_i and Σ_i p_i × f_i,
   f_i = Σ_k x_ik n_k, in four sums side by side, as wide as vectors are. */
CLONES
static void pulls(const sums* at, const double* points, const halfspaces* planes, double* force, double* moment) {
  const long long width = at->width;
  const double *nx = planes->rows, *ny = nx + width, *nz = ny + width;
  for (long long i = 0; i < at->slots; ++i) {
    const double* x = at->x + i * width;
    double pull[3], across[3], fx[4] = {0.0}, fy[4] = {0.0}, fz[4] = {0.0};
    for (long long k = 0; k < width; k += 4)
      for (int j = 0; j < 4; ++j) {
        fx[j] += x[k + j] * nx[k + j];
        fy[j] += x[k + j] * ny[k + j];
        fz[j] += x[k + j] * nz[k + j];
      }
    pull[0] = (fx[0] + fx[1]) + (fx[2] + fx[3]);
    pull[1] = (fy[0] + fy[1]) + (fy[2] + fy[3]);
    pull[2] = (fz[0] + fz[1]) + (fz[2] + fz[3]);
    cross(points + 3 * i, pull, across);
    for (int j = 0; j < 3; ++j) {
      force[j] += pull[j];
      moment[j] += across[j];
    }
  }
}

double hdsdf(int gamma, double length, const double* b, const link_body* body, const halfspaces* planes, double apart,
             projection* at, double* wrench) {
  const long long width = planes->width;
  const sums of = {.slots = body->slots, .width = width, .weights = body->weights, .least = at->least, .x = at->x,
                   .g = at->work, .factor = at->work + width};
  double force[3] = {0.0}, moment[3] = {0.0}, across[3];
  const double distance = apart > TINY ? outside(gamma, length, &of) : inside(gamma, length, &of);
  pulls(&of, at->points, planes, force, moment);
  turned(b, force, wrench);
  turned(b, moment, wrench + 3);
  cross(b + 9, wrench, across);
  for (int i = 0; i < 3; ++i) wrench[3 + i] += across[i];
  return distance;
}

double hdsdf_of_pair(const tables* of, int gamma, double length, long long pair, const double* frames, projection* at,
                     double* separation, double* wrench) {
  const double *a = frames + 12 * of->joint_a[pair], *b = frames + 12 * of->joint_b[pair];
  const link_body body = body_of(of, pair);
  const halfspaces planes = planes_of(of, pair);
  *separation = project(a, b, &body, &planes, at);
  return hdsdf(gamma, length, b, &body, &planes, *separation, at, wrench);
}

/* Rows (sample, pair), `count` of them, of placements (batch, joints, 12). */
typedef struct {
  const tables* of;
  long long joints, count;
  const double* placements;
  const long long *samples, *pairs;
} requested_rows;

/* D (count), wrench (count, 6) and D̃ (count). Returns 0, or −1 without memory. */
static int hdsdf_rows(const requested_rows* rows, int gamma, double length, double* distance, double* wrench,
                      double* separation) {
  projection found;
  if (make_projection(rows->of, &found)) return -1;
  for (long long row = 0; row < rows->count; ++row) {
    const double* frames = rows->placements + 12 * rows->samples[row] * rows->joints;
    distance[row] = hdsdf_of_pair(rows->of, gamma, length, rows->pairs[row], frames, &found, separation + row,
                                  wrench + 6 * row);
  }
  free(found.points);
  return 0;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_hdsdf_rows) {
  arguments taken = begin("hdsdf_rows", given, count);
  requested_rows rows = {.of = record(&taken, "tables", "tables")};
  const int gamma = (int)whole(&taken, "gamma", 1, 1000);
  const double length = number(&taken, "length");
  rows.placements = numbers(&taken, "placements", SHAPE(ANY, ANY, 12));
  const long long batch = taken.shape[0];
  rows.joints = taken.shape[1];
  if (rows.of && rows.joints < rows.of->joints) wrong(&taken, "placements", "those of all joints");
  rows.samples = indices(&taken, "samples", 0, batch, SHAPE(ANY));
  rows.count = taken.shape[0];
  rows.pairs = indices(&taken, "pairs", 0, rows.of ? rows.of->pairs : 0, SHAPE(rows.count));
  double* distance = written(&taken, "distance", SHAPE(rows.count));
  double* wrench = written(&taken, "wrench", SHAPE(rows.count, 6));
  double* separation = written(&taken, "separation", SHAPE(rows.count));
  int failed = 0;
  if (ready(&taken)) WITHOUT_LOCK(failed = hdsdf_rows(&rows, gamma, length, distance, wrench, separation));
  return ended(&taken, failed ? no_memory() : none());
}

PyMethodDef hdsdf_functions[] = {
    FUNCTION("hdsdf_rows", call_hdsdf_rows,
             "D, its wrench and the signed distance without shaping, of pairs at samples."),
    END_OF_FUNCTIONS,
};
