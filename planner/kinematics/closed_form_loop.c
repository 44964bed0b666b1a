/* Every configuration of six turning joints that places a link, in closed form: the canonical subproblems of Paden and
   Kahan as Elias and Wen put them together ("IK-Geo: Unified robot inverse kinematics using subproblem decomposition",
   2025), for any arm whose last two axes meet. With E_i = exp([S_i] θ_i) the motion about axis i (direction h_i, point
   p_i, all joints at 0), M the link's placement there and T the wanted one, E_1 … E_6 = T M⁻¹ = G is solved, from any
   joint on, as a closed loop has no first one: E_{r+1} … E_6 (G⁻¹ E_1 … E_r G) = G; or backwards, by
   E_6⁻¹ … E_1⁻¹ = G⁻¹. Any two neighbours that meet are thus the last ones. Lengths in [m], angles in [rad]. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/cholesky.h"
#include "../../distance/compiled/vectors.h"

/* axes, configurations, tries; angles of a conic on half a circle, and what they make */
enum { SIX = 6, MOST = 16, TRIED = 256, PER_HALF = 10, FEW = 2 * PER_HALF };
enum { WRIST, PARALLEL, MEETING, KINDS };         /* axes 4, 5, 6 meet; 2, 3, 4 are parallel; 5 and 6 meet, no more */

static const double CLOSE = 1e-3;     /* [m] or sine below which axes meet, or are parallel: last steps make up for it */
static const double NOTHING = 1e-7;   /* of a sine, or a part of a vector, that leaves an angle open */
/* Shares by which what is solved may miss, at the border of what is reached: least, and for each [m] or sine by which
   axes miss each other that are said to meet, or to be parallel. */
static const double LEAST_SLACK = 1e-5, SLACK_PER_GAP = 50.0;
static const double EXACT = 1e-10;    /* [m] and [rad] by which a configuration may miss the pose */
static const double SAME = 1e-6;      /* [rad] between two configurations that are one */
static const double FAR = 0.3;         /* [rad] beyond a limit of what the last steps need not bring back */
static const double LOST = 1e-3;   /* [m] and [rad] still missed after half of the steps */
static const double SINGULAR = 0.02;   /* [m] and [rad] for 1 rad, least: below it two configurations may be close by */
static const double AT_LIMIT = 1e-9;  /* [rad or m] beyond a limit that is rounding */
static const double DAMPING = 1e-12;  /* λ² of the last steps */
static const double PI = 3.14159265358979323846;

typedef struct {
  double h[3], p[3];
} axis;

/* A chain of n joints, each about (turns) or along a direction through a point, the link's placement `tip` where all
   are 0, which six of them are solved, from which of these on, in which direction, and how. */
typedef struct {
  long long n, kind, first, backwards;
  const long long *turns, *solved;
  const double *directions, *points, *tip, *lower, *upper;
} chain;

/* --- motions ---------------------------------------------------------------------------------------------------- */

/* found = v turned about a unit direction: v cos + (h × v) sin + h (h·v)(1 − cos). */
static void turn(const double* h, double cosine, double sine, const double* v, double* found) {
  double across[3];
  cross(h, v, across);
  const double along = dot(h, v) * (1.0 - cosine);
  for (int i = 0; i < 3; ++i) found[i] = v[i] * cosine + across[i] * sine + h[i] * along;
}

/* found = E x, a point moved by an angle about an axis. */
static void move_point(const axis* about, double angle, const double* x, double* found) {
  double arm[3], moved[3];
  difference(x, about->p, arm);
  turn(about->h, cos(angle), sin(angle), arm, moved);
  for (int i = 0; i < 3; ++i) found[i] = about->p[i] + moved[i];
}

static void turn_by(const double* h, double angle, const double* v, double* found) {
  turn(h, cos(angle), sin(angle), v, found);
}

static void to_identity(double* placement) {
  for (int i = 0; i < 12; ++i) placement[i] = i == 0 || i == 4 || i == 8;
}

/* found = A B of two placements. */
static void compose(const double* a, const double* b, double* found) {
  product(a, b, found);
  placed(a, b + 9, found + 9);
}

static void invert(const double* a, double* found) {
  double back[3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) found[3 * i + j] = a[3 * j + i];
  turned(found, a + 9, back);
  for (int i = 0; i < 3; ++i) found[9 + i] = -back[i];
}

/* moved = P E, P followed by a motion about an axis, or along it. */
static void follow(const double* before, const axis* about, int turns, double value, double* moved) {
  const double *h = about->h, c = turns ? cos(value) : 1.0, s = turns ? sin(value) : 0.0;
  double motion[12], origin[3];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) motion[3 * i + j] = h[i] * h[j] * (1.0 - c);
    motion[4 * i] += c;
  }
  for (int i = 0; i < 3; ++i) { /* and s times h × */
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    motion[3 * j + i] += s * h[k];
    motion[3 * i + j] -= s * h[k];
  }
  turned(motion, about->p, origin);
  for (int i = 0; i < 3; ++i) motion[9 + i] = turns ? about->p[i] - origin[i] : h[i] * value;
  compose(before, motion, moved);
}

/* --- subproblems ------------------------------------------------------------------------------------------------ */

/* The angle by which `from` turns about h into the direction of `to`; `other` where either lies along h. */
static double angle_between(const double* h, const double* from, const double* to, double other) {
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
    return fabs(c) <= CLOSE;
  }
  const double cosine = c / size;
  const double beyond = fabs(cosine) - 1.0;
  if (!(beyond <= slack)) return 0;
  const double half = acos(beyond > 0.0 ? copysign(1.0 - beyond, cosine) : cosine);
  angles[0] = middle + half;
  angles[1] = middle - half;
  return 2;
}

/* The angles by which `vector` turns about h so that its part along `along` is `value`. */
static int to_part(const double* h, const double* vector, const double* along, double value, double slack, double other,
                   double* angles) {
  double across[3];
  cross(h, vector, across);
  const double fixed = dot(h, vector) * dot(h, along);
  return on_circle(dot(along, vector) - fixed, dot(along, across), value - fixed, slack, other, angles);
}

/* The points of two axes that are nearest to each other; of parallel ones any such two. */
static void feet(const axis* a, const axis* b, double* on_a, double* on_b) {
  double between[3];
  difference(b->p, a->p, between);
  const double cosine = dot(a->h, b->h), sine2 = 1.0 - cosine * cosine;
  const double near_a = dot(a->h, between), near_b = -dot(b->h, between);
  double s = near_a, t = 0.0;
  if (sine2 > CLOSE * CLOSE) {
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

/* The angles with E₁ E₂ E₃ w = t. With o₁, o₂ the feet of axes 1 and 2, d = o₂ − o₁, u = E₃ w − o₂ and τ = t − o₁, what
   a turn about axis 1 keeps gives
       d·R₂u = (|τ|² − |d|² − |u|²) / 2,     h₁·R₂u = h₁·τ,
   the parts of R₂u along d and along h₁'s part across h₂, at right angles to each other and to h₂. Without θ₂ that is
   a conic in (cos θ₃, sin θ₃); a line where axes 1 and 2 meet (d = 0) or are parallel. */
static int place_point(const axis* axes, const double* w, const double* t, double slack, const double* other,
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
  const int meet = offset <= CLOSE, parallel = lean <= CLOSE;
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

/* --- kinds of arms ---------------------------------------------------------------------------------------------- */

/* How much what is solved may miss: axes that only almost meet, or are only almost parallel, count as if they did. */
static double slack_of(const axis* axes, int kind) {
  double one[3], other[3], gap[3], most = 0.0;
  for (int i = 0; i < SIX - 1; ++i) { /* neighbours; of a wrist the fourth axis and where the others meet, too */
    const axis* a = axes + i;
    double across[3];
    feet(a, a + 1, one, other);
    difference(other, one, gap);
    cross(a->h, a[1].h, across);
    const double apart = norm(gap), lean = norm(across);
    if (lean <= CLOSE) most = fmax(most, lean);
    if (apart <= CLOSE) most = fmax(most, apart);
  }
  feet(&axes[4], &axes[5], one, other);
  difference(one, axes[3].p, gap);
  cross(axes[3].h, gap, other);
  if (kind == WRIST) most = fmax(most, norm(other));
  return LEAST_SLACK + SLACK_PER_GAP * most;
}

/* Where axes 5 and 6 meet. */
static void meeting(const axis* axes, double* w) {
  double unused[3];
  feet(&axes[4], &axes[5], w, unused);
}

/* v turned back by the first joints: (R₁ … R_k)ᵀ v. */
static void turned_back_by(const axis* axes, const double* angles, int joints, const double* v, double* found) {
  double now[3] = {v[0], v[1], v[2]};
  for (int j = 0; j < joints; ++j) {
    turn_by(axes[j].h, -angles[j], now, found);
    for (int i = 0; i < 3; ++i) now[i] = found[i];
  }
  for (int i = 0; i < 3; ++i) found[i] = now[i];
}

/* θ₆ with R₆ᵀ h₅ = R_Gᵀ R₁ … R₄ h₅. */
static double last_angle(const axis* axes, const double* goal, const double* angles, double other) {
  double front[3] = {axes[4].h[0], axes[4].h[1], axes[4].h[2]}, moved[3], back[3];
  for (int j = 3; j >= 0; --j) {
    turn_by(axes[j].h, angles[j], front, moved);
    for (int i = 0; i < 3; ++i) front[i] = moved[i];
  }
  turned_back(goal, front, back);
  return angle_between(axes[5].h, back, axes[4].h, other);
}

/* E₄, E₅, E₆ about one point turn only: h₄·R h₆ = h₄·R₅ h₆ with R = (R₁ R₂ R₃)ᵀ R_G. */
static int by_wrist(const axis* axes, const double* goal, const double* other, double (*found)[SIX]) {
  const double slack = slack_of(axes, WRIST);
  double w[3], t[3], first[FEW][3];
  int kept = 0;
  meeting(axes, w);
  placed(goal, w, t);
  const int count = place_point(axes, w, t, slack, other, first);
  const double *h4 = axes[3].h, *h5 = axes[4].h, *h6 = axes[5].h;
  double out[3];
  turned(goal, h6, out);
  for (int k = 0; k < count; ++k) {
    double toward[3], fifth[2];
    turned_back_by(axes, first[k], 3, out, toward);
    const int ways = to_part(h5, h6, h4, dot(h4, toward), slack, other[4], fifth);
    for (int way = 0; way < ways && kept < TRIED; ++way) {
      double at[3], *q = found[kept++];
      for (int i = 0; i < 3; ++i) q[i] = first[k][i];
      q[4] = fifth[way];
      turn_by(h5, q[4], h6, at);
      q[3] = angle_between(h4, at, toward, other[3]);
      q[5] = last_angle(axes, goal, q, other[5]);
    }
  }
  return kept;
}

/* What turns about h = h₂ = ± h₃ = ± h₄ keep: h·R₁ᵀ(t − p₁) = h·(w − p₁), h·R₁ᵀ R_G h₆ = h·R₅ h₆, R₅ᵀ h = R₆ R_Gᵀ R₁ h;
   then two joints of a plane. */
static int by_parallel(const axis* axes, const double* goal, const double* other, double (*found)[SIX]) {
  const double *h = axes[1].h, *h5 = axes[4].h, *h6 = axes[5].h, slack = slack_of(axes, PARALLEL);
  double w[3], t[3], arm[3], out[3], rest[3], first[2];
  int kept = 0;
  const double third_sign = dot(h, axes[2].h) < 0.0 ? -1.0 : 1.0, fourth_sign = dot(h, axes[3].h) < 0.0 ? -1.0 : 1.0;
  meeting(axes, w);
  placed(goal, w, t);
  difference(t, axes[0].p, arm);
  difference(w, axes[0].p, rest);
  turned(goal, h6, out);
  const int firsts = to_part(axes[0].h, arm, h, dot(h, rest), slack, -other[0], first); /* of R₁ᵀ */
  for (int a = 0; a < firsts; ++a) {
    double toward[3], fifth[2], point[3];
    turn_by(axes[0].h, first[a], out, toward);
    turn_by(axes[0].h, first[a], arm, point); /* E₁⁻¹ t, by p₁ */
    for (int i = 0; i < 3; ++i) point[i] += axes[0].p[i];
    const int fifths = to_part(h5, h6, h, dot(h, toward), slack, other[4], fifth);
    for (int b = 0; b < fifths; ++b) {
      double before[3], carried[3], after[3], at[3], from[3], to[3], lower[3], upper[3], third[2], moved[3], apart[3];
      turn_by(h5, -fifth[b], h, before); /* R₆ R_Gᵀ R₁ h = R₅ᵀ h */
      turn_by(axes[0].h, -first[a], h, carried);
      turned_back(goal, carried, after);
      const double sixth = angle_between(h6, after, before, other[5]);
      /* R₂ R₃ R₄ turns by φ: it takes R₅ R₆ v to R₁ᵀ R_G v, for the v across h */
      double across[3], v[3] = {0.0, 0.0, 0.0};
      int least = 0;
      for (int i = 1; i < 3; ++i)
        if (fabs(h[i]) < fabs(h[least])) least = i;
      v[least] = 1.0;
      cross(h, v, across); /* = R₅ R₆ v, so that v = R₆ᵀ R₅ᵀ across */
      turn_by(h5, -fifth[b], across, at);
      turn_by(h6, -sixth, at, from);
      turned(goal, from, at);
      turn_by(axes[0].h, first[a], at, to);
      const double phi = angle_between(h, across, to, 0.0);
      difference(w, axes[3].p, lower); /* E₂ E₃ p₄ = E₁⁻¹ t − R_φ (w − p₄) */
      turn_by(h, phi, lower, upper);
      for (int i = 0; i < 3; ++i) upper[i] = point[i] - upper[i] - axes[1].p[i];
      /* |E₃ p₄ − p₂| = |upper|, across h: x = p₃ − p₂, y = p₄ − p₃; x·R₃ y = … */
      double x[3], y[3];
      difference(axes[2].p, axes[1].p, x);
      difference(axes[3].p, axes[2].p, y);
      const double wanted = 0.5 * (dot(upper, upper) - dot(x, x) - dot(y, y));
      const int thirds = to_part(h, y, x, wanted, slack, third_sign * other[2], third);
      for (int c = 0; c < thirds && kept < TRIED; ++c) {
        double* q = found[kept++];
        turn_by(h, third[c], y, moved);
        for (int i = 0; i < 3; ++i) apart[i] = x[i] + moved[i];
        q[0] = -first[a];
        q[1] = angle_between(h, apart, upper, other[1]);
        q[2] = third_sign * third[c];
        q[3] = fourth_sign * (phi - q[1] - third[c]);
        q[4] = fifth[b];
        q[5] = sixth;
      }
    }
  }
  return kept;
}

/* With θ₄ given: E₁ E₂ E₃ (E₄ w) = t, and by how much h₅·R₅ h₆ = h₅·R₄ᵀ (R₁ R₂ R₃)ᵀ R_G h₆ is missed. */
typedef struct {
  double q[4], missed;
} try;

typedef struct {
  double fourth;
  int count;
  try tries[FEW];
} place;

/* A search along θ₄, and what it has found. */
typedef struct {
  const axis* axes;
  const double *goal, *other;
  double w[3], t[3], out[3]; /* where axes 5 and 6 meet, where they are to meet, R_G h₆ */
  double (*found)[SIX];
  int kept;
} search;

static void look_at(const search* along, double fourth, place* found) {
  const axis* axes = along->axes;
  double moved[3], first[FEW][3];
  move_point(&axes[3], fourth, along->w, moved);
  found->fourth = fourth;
  found->count = place_point(axes, moved, along->t, 0.0, along->other, first);
  for (int k = 0; k < found->count; ++k) {
    try* one = &found->tries[k];
    double toward[3];
    for (int i = 0; i < 3; ++i) one->q[i] = first[k][i];
    one->q[3] = fourth;
    turned_back_by(axes, one->q, 4, along->out, toward);
    one->missed = dot(axes[4].h, toward) - dot(axes[4].h, axes[5].h);
  }
}

static void keep(search* along, const try* one) {
  if (along->kept == TRIED) return;
  const axis* axes = along->axes;
  double toward[3], *q = along->found[along->kept++];
  for (int i = 0; i < 4; ++i) q[i] = one->q[i];
  turned_back_by(axes, q, 4, along->out, toward);
  q[4] = angle_between(axes[4].h, axes[5].h, toward, along->other[4]);
  q[5] = last_angle(axes, along->goal, q, along->other[5]);
}

/* How far apart two angles are, whole turns aside. */
static double apart(double a, double b) { return fabs(remainder(a - b, 2.0 * PI)); }

/* The try that goes on from another, the nearest by its first three angles; −1 where none is near. */
static int next_of(const try* from, const place* to) {
  int nearest = -1;
  double least = 0.7;
  for (int k = 0; k < to->count; ++k) {
    double most = 0.0;
    for (int i = 0; i < 3; ++i) most = fmax(most, apart(from->q[i], to->tries[k].q[i]));
    if (most < least) {
      least = most;
      nearest = k;
    }
  }
  return nearest;
}

/* Keep what lies between two places: where the miss changes its sign on a way from one to the other, the try where a
   straight line is 0; where a way begins or ends, which is looked for in both halves, what is little missed there. */
static void look_between(search* along, const place* low, const place* high, int depth) {
  const double at_end = 0.15;
  const place* ends[2] = {low, high};
  place middle;
  int folds = 0;
  for (int side = 0; side < 2; ++side)
    for (int k = 0; k < ends[side]->count; ++k) {
      const try* now = &ends[side]->tries[k];
      const int next = next_of(now, ends[!side]);
      const int goes_on = next >= 0 && next_of(&ends[!side]->tries[next], ends[side]) == k;
      if (!goes_on) {
        folds = 1;
        if (depth == 0 && fabs(now->missed) < at_end) keep(along, now);
        continue;
      }
      const double missed = ends[!side]->tries[next].missed;
      if (side || (now->missed < 0.0) == (missed < 0.0)) continue;
      look_at(along, low->fourth + (high->fourth - low->fourth) * now->missed / (now->missed - missed), &middle);
      const int between = next_of(now, &middle);
      keep(along, between < 0 ? now : &middle.tries[between]);
    }
  if (!folds || depth == 0) return;
  look_at(along, 0.5 * (low->fourth + high->fourth), &middle);
  look_between(along, low, &middle, depth - 1);
  look_between(along, &middle, high, depth - 1);
}

/* Keep what is least missed at one place, of its two neighbours, without a change of sign: two ways may be close by. */
static void look_about(search* along, const place* before, const place* now, const place* after) {
  const double small = 0.1;
  for (int k = 0; k < now->count; ++k) {
    const try* one = &now->tries[k];
    const int last = next_of(one, before), next = next_of(one, after);
    if (last < 0 || next < 0 || fabs(one->missed) > small) continue;
    const double missed = one->missed, sign = missed < 0.0 ? -1.0 : 1.0;
    if (sign * before->tries[last].missed < fabs(missed) || sign * after->tries[next].missed < fabs(missed)) continue;
    keep(along, &before->tries[last]);
    keep(along, one);
    keep(along, &after->tries[next]);
  }
}

static int by_search(const axis* axes, const double* goal, const double* other, double (*found)[SIX]) {
  enum { PLACES = 64, DEPTH = 4 };
  search along = {.axes = axes, .goal = goal, .other = other, .found = found};
  place around[PLACES];
  meeting(axes, along.w);
  placed(goal, along.w, along.t);
  turned(goal, axes[5].h, along.out);
  for (int i = 0; i < PLACES; ++i) look_at(&along, 2.0 * PI * i / PLACES, &around[i]);
  for (int i = 0; i < PLACES; ++i) {
    place next = around[(i + 1) % PLACES];
    look_about(&along, &around[(i + PLACES - 1) % PLACES], &around[i], &next);
    next.fourth = 2.0 * PI * (i + 1) / PLACES;
    look_between(&along, &around[i], &next, DEPTH);
  }
  return along.kept;
}

/* --- the whole arm ---------------------------------------------------------------------------------------------- */

/* Where the link is at angles of six axes, and where it is after each of these: at (SIX + 1, 12) and link (12); its
   error (6) [m, rad]. */
static void look(const axis* axes, const double* tip, const double* wanted, const double* q, double (*at)[12],
                 double* link, double* error) {
  double between[9];
  to_identity(at[0]);
  for (int j = 0; j < SIX; ++j) follow(at[j], &axes[j], 1, q[j], at[j + 1]);
  compose(at[SIX], tip, link);
  difference(wanted + 9, link + 9, error);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) between[3 * i + j] = dot(wanted + 3 * i, link + 3 * j);
  const double sine[3] = {0.5 * (between[7] - between[5]), 0.5 * (between[2] - between[6]),
                          0.5 * (between[3] - between[1])};
  const double size = norm(sine), angle = atan2(size, 0.5 * (between[0] + between[4] + between[8] - 1.0));
  for (int i = 0; i < 3; ++i) error[3 + i] = size > 1e-12 ? sine[i] / size * angle : (angle > 1.0 ? NAN : sine[i]);
}

/* The Jacobian J (6, 6) there, in world axes at the link's origin. */
static void slope_at(const axis* axes, double (*at)[12], const double* link, double* jacobian) {
  double w[3], lever[3], velocity[3], point[3];
  for (int j = 0; j < SIX; ++j) {
    turned(at[j], axes[j].h, w);
    placed(at[j], axes[j].p, point);
    difference(link + 9, point, lever);
    cross(w, lever, velocity);
    for (int i = 0; i < 3; ++i) {
      jacobian[SIX * i + j] = velocity[i];
      jacobian[SIX * (3 + i) + j] = w[i];
    }
  }
}

static double missed_by(const double* error) { return most_of(norm(error), norm(error + 3)); }

/* J Jᵀ + λ² I, by columns of its lower half. */
static void square_of(const double* jacobian, double* square) {
  for (int c = 0; c < SIX; ++c)
    for (int r = c; r < SIX; ++r) {
      double sum = r == c ? DAMPING : 0.0;
      for (int k = 0; k < SIX; ++k) sum += jacobian[SIX * r + k] * jacobian[SIX * c + k];
      square[SIX * c + r - c] = sum;
    }
}

/* way = Jᵀ pull. */
static void drawn_by(const double* jacobian, const double* pull, double* way) {
  for (int j = 0; j < SIX; ++j) {
    way[j] = 0.0;
    for (int i = 0; i < SIX; ++i) way[j] += jacobian[SIX * i + j] * pull[i];
  }
}

/* Newton's steps from angles that almost place the link. Returns whether they do in the end. */
static int refine(const axis* axes, const double* tip, const double* wanted, int steps, double* q) {
  double at[SIX + 1][12], link[12], error[SIX], jacobian[SIX * SIX], square[SIX * SIX], way[SIX];
  for (int step = 0;; ++step) {
    look(axes, tip, wanted, q, at, link, error);
    const double missed = missed_by(error);
    if (!(missed < 4.0) || step == steps || missed <= 1e-14) return missed <= EXACT;
    if (2 * step >= steps && missed > LOST) return 0;
    slope_at(axes, at, link, jacobian);
    square_of(jacobian, square);
    if (!solved(SIX, SIX, square, error)) return missed <= EXACT;
    drawn_by(jacobian, error, way);
    double most = 0.0;
    for (int j = 0; j < SIX; ++j) most = fmax(most, fabs(way[j]));
    for (int j = 0; j < SIX; ++j) q[j] += way[j] * (most > 0.3 ? 0.3 / most : 1.0);
    if (missed <= EXACT && most <= 1e-13) return 1;
  }
}

/* The direction (a unit vector) in which angles move the link least, and how little, per unit: by inverse iteration. */
static double least_moving(const axis* axes, const double* tip, const double* wanted, const double* q, double* way) {
  double at[SIX + 1][12], link[12], error[SIX], jacobian[SIX * SIX], square[SIX * SIX], moved = 0.0;
  look(axes, tip, wanted, q, at, link, error);
  slope_at(axes, at, link, jacobian);
  square_of(jacobian, square);
  for (int i = 0; i < SIX; ++i) error[i] = 1.0 + 0.1 * i;
  for (int again = 0; again < 3; ++again) {
    if (again) solved_again(SIX, SIX, square, error);
    else if (!solved(SIX, SIX, square, error)) return 1.0;
    drawn_by(jacobian, error, way);
    double size = 0.0;
    for (int j = 0; j < SIX; ++j) size += way[j] * way[j];
    for (int j = 0; j < SIX; ++j) way[j] /= sqrt(size);
    moved = 0.0;
    for (int i = 0; i < SIX; ++i) {
      error[i] = 0.0;
      for (int j = 0; j < SIX; ++j) error[i] += jacobian[SIX * i + j] * way[j];
      moved += error[i] * error[i];
    }
    moved = sqrt(moved);
    for (int i = 0; i < SIX; ++i) error[i] /= fmax(moved, 1e-300);
  }
  return moved;
}

/* The same angle a whole number of turns on, nearest to `seed` within the limits; not a number where there is none. */
static double within(double value, int turns, double seed, double lower, double upper) {
  if (turns) {
    value += 2.0 * PI * round((seed - value) / (2.0 * PI));
    if (value > upper + AT_LIMIT) value -= 2.0 * PI * ceil((value - upper - AT_LIMIT) / (2.0 * PI));
    if (value < lower - AT_LIMIT) value += 2.0 * PI * ceil((lower - AT_LIMIT - value) / (2.0 * PI));
  }
  if (!(value <= upper + AT_LIMIT && value >= lower - AT_LIMIT)) return NAN;
  return fmin(fmax(value, lower), upper);
}

/* Add a configuration, if there is none like it and room is left. Returns how many there are then. */
static int add_root(const double* q, double (*roots)[SIX], int count) {
  if (count == MOST) return count;
  for (int i = 0; i < count; ++i) {
    double most = 0.0;
    for (int j = 0; j < SIX; ++j) most = fmax(most, apart(q[j], roots[i][j]));
    if (most <= SAME) return count;
  }
  for (int j = 0; j < SIX; ++j) roots[count][j] = q[j];
  return count + 1;
}

/* Configurations (MOST, n), in number returned, with what is held at `values`. */
static int branches(const chain* arm, const double* wanted, const double* values, const double* seed, double* found) {
  axis axes[SIX], seen[SIX];
  double at[12], next[12], tip[12], back[12], goal[12], inverse[12], other[SIX], angles[TRIED][SIX];
  int kept = 0;
  to_identity(at);
  for (long long j = 0, s = 0, held = 0; j < arm->n; ++j) {
    const double *direction = arm->directions + 3 * j, *point = arm->points + 3 * j;
    axis about;
    if (s < SIX && arm->solved[s] == j) {
      turned(at, direction, axes[s].h);
      placed(at, point, axes[s].p);
      other[s++] = seed[j];
      continue;
    }
    for (int i = 0; i < 3; ++i) {
      about.h[i] = direction[i];
      about.p[i] = point[i];
    }
    follow(at, &about, arm->turns[j] != 0, values[held++], next);
    for (int i = 0; i < 12; ++i) at[i] = next[i];
  }
  compose(at, arm->tip, tip);
  invert(tip, back);
  compose(wanted, back, goal);
  invert(goal, inverse);
  double turned_seed[SIX];
  int order[SIX];
  for (int j = 0; j < SIX; ++j) {
    const int at_place = (int)arm->first + (arm->backwards ? SIX - 1 - j : j), joint = order[j] = at_place % SIX;
    seen[j] = axes[joint];
    if (at_place >= SIX) { /* E_{r+1} … E_6 (G⁻¹ E_1 … E_r G) = G */
      turned(inverse, axes[joint].h, seen[j].h);
      placed(inverse, axes[joint].p, seen[j].p);
    }
    turned_seed[j] = arm->backwards ? -other[joint] : other[joint];
  }
  const double* asked = arm->backwards ? inverse : goal;
  int count;
  if (arm->kind == WRIST)
    count = by_wrist(seen, asked, turned_seed, angles);
  else if (arm->kind == PARALLEL)
    count = by_parallel(seen, asked, turned_seed, angles);
  else
    count = by_search(seen, asked, turned_seed, angles);
  const int steps = arm->kind == MEETING ? 20 : 8;
  double roots[MOST][SIX], q[SIX], way[SIX];
  int rooted = 0;
  for (int k = 0; k < count; ++k) {
    int inside = 1;
    for (int j = 0; j < SIX; ++j) q[order[j]] = arm->backwards ? -angles[k][j] : angles[k][j];
    for (int j = 0; j < SIX; ++j) { /* far beyond a limit no step leads back */
      const long long joint = arm->solved[j];
      const double value = within(q[j], 1, seed[joint], arm->lower[joint] - FAR, arm->upper[joint] + FAR);
      inside = inside && value == value;
    }
    if (inside && refine(axes, tip, wanted, steps, q)) rooted = add_root(q, roots, rooted);
  }
  for (int k = 0; k < rooted; ++k) { /* almost singular, another one is close by, on the other side of where it would be */
    const double least = least_moving(axes, tip, wanted, roots[k], way);
    for (int each = 0; least < SINGULAR && each < 6; ++each) {
      const double length = fmin((each < 2 ? 8.0 : each < 4 ? 20.0 : 50.0) * least, 0.4) * (each % 2 ? -1.0 : 1.0);
      for (int j = 0; j < SIX; ++j) q[j] = roots[k][j] + length * way[j];
      if (refine(axes, tip, wanted, steps, q)) rooted = add_root(q, roots, rooted);
    }
  }
  for (int k = 0; k < rooted; ++k) {
    double* row = found + arm->n * kept;
    int inside = 1;
    for (long long j = 0, s = 0, held = 0; j < arm->n; ++j) {
      const int is_solved = s < SIX && arm->solved[s] == j;
      row[j] = within(is_solved ? roots[k][s] : values[held], arm->turns[j] != 0, seed[j], arm->lower[j], arm->upper[j]);
      s += is_solved;
      held += !is_solved;
      inside = inside && row[j] == row[j];
    }
    kept += inside;
  }
  return kept;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_chain) {
  arguments taken = begin("six_joints", given, count);
  chain arm = {.n = whole(&taken, "n", SIX, 64)};
  arm.kind = whole(&taken, "kind", 0, KINDS - 1);
  arm.first = whole(&taken, "first", 0, SIX - 1);
  arm.backwards = whole(&taken, "backwards", 0, 1);
  arm.turns = indices(&taken, "turns", 0, 2, SHAPE(arm.n));
  arm.solved = indices(&taken, "solved", 0, arm.n, SHAPE(SIX));
  arm.directions = numbers(&taken, "directions", SHAPE(arm.n, 3));
  arm.points = numbers(&taken, "points", SHAPE(arm.n, 3));
  arm.tip = numbers(&taken, "tip", SHAPE(12));
  arm.lower = numbers(&taken, "lower", SHAPE(arm.n));
  arm.upper = numbers(&taken, "upper", SHAPE(arm.n));
  for (int s = 1; !taken.failed && s < SIX; ++s)
    if (arm.solved[s] <= arm.solved[s - 1]) wrong(&taken, "solved", "in rising order");
  return made(&taken, "six_joints", &arm, sizeof arm);
}

/* All configurations of a pose (12) with each row of held values (rows, n − 6): found (16 rows, n), counts (rows). */
WRAPPER(call_branches) {
  arguments taken = begin("branches", given, count);
  const chain* arm = record(&taken, "chain", "six_joints");
  const long long n = arm ? arm->n : SIX;
  const double* wanted = numbers(&taken, "wanted", SHAPE(12));
  const double* held = numbers(&taken, "held", SHAPE(ANY, n - SIX));
  const long long rows = taken.shape[0];
  if (rows > 1LL << 24) wrong(&taken, "held", "fewer rows");
  const double* seed = numbers(&taken, "seed", SHAPE(n));
  double* found = written(&taken, "found", SHAPE(MOST * rows, n));
  long long* counts = written_indices(&taken, "counts", SHAPE(rows));
  if (ready(&taken)) {
    Py_BEGIN_ALLOW_THREADS;
    for (long long row = 0; row < rows; ++row) {
      counts[row] = branches(arm, wanted, held + (n - SIX) * row, seed, found);
      found += n * counts[row];
    }
    Py_END_ALLOW_THREADS;
  }
  return ended(&taken, none());
}

PyMethodDef closed_form_functions[] = {
    FUNCTION("six_joints", make_chain, "An arm that is solved in closed form."),
    FUNCTION("branches", call_branches, "Every configuration that places its link."),
    END_OF_FUNCTIONS,
};
