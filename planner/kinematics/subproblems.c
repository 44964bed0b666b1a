#include "subproblems.h"

static const double NOTHING = 1e-7; /* of a sine, or a part of a vector, that leaves an angle open */

double angle_between(const double* h, const double* from, const double* to, double other) {
  double across[3];
  cross(from, to, across);
  const double sine = dot(h, across), cosine = dot(from, to) - dot(h, from) * dot(h, to);
  return hypot(sine, cosine) <= NOTHING * NOTHING ? other : atan2(sine, cosine);
}

/* The angles with a cos + b sin = c, in number 0 to 2; `other` where any is one. Where c is too large by less than
   `slack` of √(a² + b²), two on either side of where it is nearest, for last steps to make true. */
static int on_circle(double a, double b, double c, double slack, double other, double* angles) {
  const double size = hypot(a, b), middle = atan2(b, a);
  if (size <= NOTHING) {
    angles[0] = other;
    return fabs(c) <= SPECIAL_CASE;
  }
  const double cosine = c / size;
  const double beyond = fabs(cosine) - 1.0;
  if (!(beyond <= slack)) return 0;
  const double half = acos(beyond > 0.0 ? copysign(1.0 - beyond, cosine) : cosine);
  angles[0] = middle + half;
  angles[1] = middle - half;
  return 2;
}

int to_part(const double* h, const double* vector, const double* along, double value, double slack, double other,
                   double* angles) {
  double across[3];
  cross(h, vector, across);
  const double fixed = dot(h, vector) * dot(h, along);
  return on_circle(dot(along, vector) - fixed, dot(along, across), value - fixed, slack, other, angles);
}

void feet(const axis* a, const axis* b, double* on_a, double* on_b) {
  double between[3];
  difference(b->p, a->p, between);
  const double cosine = dot(a->h, b->h), sine2 = 1.0 - cosine * cosine;
  const double near_a = dot(a->h, between), near_b = -dot(b->h, between);
  double s = near_a, t = 0.0;
  if (sine2 > SPECIAL_CASE * SPECIAL_CASE) {
    s = (near_a + cosine * near_b) / sine2;
    t = (near_b + cosine * near_a) / sine2;
  }
  for (int i = 0; i < 3; ++i) {
    on_a[i] = a->p[i] + s * a->h[i];
    on_b[i] = b->p[i] + t * b->h[i];
  }
}

static double value_of(int degree, const double* p, double x) {
  double sum = p[degree];
  for (int i = degree - 1; i >= 0; --i) sum = sum * x + p[i];
  return sum;
}

/* The root of a polynomial between two places with values of different signs: Newton's steps, halves where they leave. */
static double root_between(int degree, const double* p, const double* slope, double low, double high, int rises) {
  double x = 0.5 * (low + high);
  for (int step = 0; step < 100; ++step) {
    const double value = value_of(degree, p, x);
    if (value == 0.0) return x;
    if ((value > 0.0) == rises)
      high = x;
    else
      low = x;
    const double next = x - value / value_of(degree - 1, slope, x);
    const double chosen = next > low && next < high ? next : 0.5 * (low + high);
    if (fabs(chosen - x) <= 1e-15) return chosen;
    x = chosen;
  }
  return x;
}

/* The roots in [−1, 1], and a little beyond, of Σ p[i] xⁱ, of degree 4 or less, in rising order: between its extrema, the
   roots of its derivative, there is one or none. */
static int roots_of(int degree, const double* p, double* roots, double* ends) {
  const double reach = 1.02;
  double slope[4] = {0.0}, more[6];
  int count = 0, between = 1;
  if (degree == 0) return 0;
  for (int i = 1; i <= degree; ++i) slope[i - 1] = i * p[i];
  ends[0] = -reach;
  between += roots_of(degree - 1, slope, ends + 1, more);
  ends[between] = reach;
  for (int i = 0; i < between; ++i) {
    const double low = value_of(degree, p, ends[i]), high = value_of(degree, p, ends[i + 1]);
    if ((low < 0.0) != (high < 0.0))
      roots[count++] = root_between(degree, p, slope, ends[i], ends[i + 1], high > low);
  }
  return count;
}

/* The same of degree 4. An extremum that misses 0 by less than `slack` of the coefficients counts as two roots, as far on
   either side as they would be if it had crossed 0 by as much. */
static int almost_roots_of(const double* p, double slack, double* roots) {
  double ends[6], size = 0.0;
  int count = roots_of(4, p, roots, ends);
  for (int i = 0; i <= 4; ++i) size = fmax(size, fabs(p[i]));
  for (int i = 1; slack > 0.0 && i < 5 && ends[i] < 1.02; ++i) {
    const double x = ends[i], missed = fabs(value_of(4, p, x)), curve = fabs(2.0 * p[2] + x * (6.0 * p[3] + 12.0 * x * p[4]));
    if (!(missed <= slack * size)) continue;
    const double aside = fmin(sqrt(2.0 * missed / fmax(curve, 1e-300)), 0.1);
    roots[count++] = x - aside;
    roots[count++] = x + aside;
  }
  return count;
}

/* The angles with q0 + q1 c + q2 s + q3 c² + q4 c s + q5 s² = 0, by the tangent of half the angle on one half of the
   circle, and its inverse on the other. */
static int on_conic(const double* q, double slack, double* angles) {
  const double p[5] = {q[0] + q[1] + q[3], 2.0 * (q[2] + q[4]), 2.0 * (q[0] - q[3]) + 4.0 * q[5],
                       2.0 * (q[2] - q[4]), q[0] - q[1] + q[3]};
  const double reversed[5] = {p[4], p[3], p[2], p[1], p[0]};
  double roots[PER_HALF];
  int count = 0;
  for (int half = 0; half < 2; ++half) {
    const int found = almost_roots_of(half ? reversed : p, slack, roots);
    for (int i = 0; i < found; ++i) angles[count++] = half ? PI - 2.0 * atan(roots[i]) : 2.0 * atan(roots[i]);
  }
  return count;
}

/* --- the first three joints ------------------------------------------------------------------------------------- */

int place_point(const axis* axes, const double* w, const double* t, double slack, const double* other,
                       double (*found)[3]) {
  const double *h1 = axes[0].h, *h2 = axes[1].h, *h3 = axes[2].h;
  double o1[3], o2[3], d[3], tau[3], arm[3], part[3][3], angles[2 * PER_HALF];
  feet(&axes[0], &axes[1], o1, o2);
  difference(o2, o1, d);
  difference(t, o1, tau);
  difference(w, axes[2].p, arm);
  const double along = dot(h3, arm), twist = dot(h1, h2), offset = norm(d);
  double e2[3], e1[3];
  for (int i = 0; i < 3; ++i) { /* u = part[0] + part[1] cos + part[2] sin */
    part[0][i] = axes[2].p[i] + along * h3[i] - o2[i];
    part[1][i] = arm[i] - along * h3[i];
    e2[i] = h1[i] - twist * h2[i];
  }
  cross(h3, arm, part[2]);
  const double lean = norm(e2);
  const int meet = offset <= SPECIAL_CASE, parallel = lean <= SPECIAL_CASE;
  if (meet && parallel) return 0;
  for (int i = 0; i < 3; ++i) {
    e1[i] = meet ? 0.0 : d[i] / offset;
    e2[i] = parallel ? 0.0 : e2[i] / lean;
  }
  /* rows of 1, cos, sin: |u|² (its cos², sin² parts have one size), b₁ and b₂ as above, h₂·u */
  double size[3], b1[3], b2[3], height[3];
  size[0] = dot(part[0], part[0]) + dot(part[1], part[1]);
  size[1] = 2.0 * dot(part[0], part[1]);
  size[2] = 2.0 * dot(part[0], part[2]);
  for (int i = 0; i < 3; ++i) {
    height[i] = dot(h2, part[i]);
    b1[i] = -0.5 * size[i];
    b2[i] = -twist * height[i];
  }
  b1[0] += 0.5 * (dot(tau, tau) - offset * offset);
  b2[0] += dot(h1, tau);
  int count;
  if (meet || parallel) {
    const double* row = meet ? b1 : b2;
    count = on_circle(row[1], row[2], -row[0], slack, other[2], angles);
  } else { /* (b₁ / |d|)² + (b₂ / lean)² = |u|² − (h₂·u)² */
    double conic[6];
    const double x = 1.0 / (offset * offset), y = 1.0 / (lean * lean), *rows[3] = {b1, b2, height},
                 weights[3] = {x, y, 1.0};
    for (int i = 0; i < 6; ++i) conic[i] = i < 3 ? -size[i] : 0.0;
    for (int r = 0; r < 3; ++r) {
      const double *b = rows[r], weight = weights[r];
      conic[0] += weight * b[0] * b[0];
      conic[1] += weight * 2.0 * b[0] * b[1];
      conic[2] += weight * 2.0 * b[0] * b[2];
      conic[3] += weight * b[1] * b[1];
      conic[4] += weight * 2.0 * b[1] * b[2];
      conic[5] += weight * b[2] * b[2];
    }
    count = on_conic(conic, slack, angles);
  }
  int kept = 0;
  for (int k = 0; k < count; ++k) {
    const double c = cos(angles[k]), s = sin(angles[k]);
    double u[3], second[2], y[3], moved[3];
    for (int i = 0; i < 3; ++i) u[i] = part[0][i] + part[1][i] * c + part[2][i] * s;
    const double first = meet ? 0.0 : (b1[0] + b1[1] * c + b1[2] * s) / offset;
    const double last = parallel ? 0.0 : (b2[0] + b2[1] * c + b2[2] * s) / lean;
    int ways = 1;
    if (meet)
      ways = to_part(h2, u, e2, last, slack, other[1], second);
    else if (parallel)
      ways = to_part(h2, u, e1, first, slack, other[1], second);
    else {
      for (int i = 0; i < 3; ++i) moved[i] = first * e1[i] + last * e2[i];
      second[0] = angle_between(h2, u, moved, other[1]);
    }
    for (int way = 0; way < ways && kept < FEW; ++way) {
      turn_by(h2, second[way], u, y);
      for (int i = 0; i < 3; ++i) y[i] += d[i];
      found[kept][0] = angle_between(h1, y, tau, other[0]);
      found[kept][1] = second[way];
      found[kept++][2] = angles[k];
    }
  }
  return kept;
}
