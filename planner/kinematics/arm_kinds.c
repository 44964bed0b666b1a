#include "arm_kinds.h"

/* Shares by which what is solved may miss, at the border of what is reached: least, and for each [m] or sine by which
   axes that count as meeting, or as parallel, miss each other. */
static const double LEAST_SLACK = 1e-5, SLACK_PER_GAP = 50.0;

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
    if (lean <= SPECIAL_CASE) most = fmax(most, lean);
    if (apart <= SPECIAL_CASE) most = fmax(most, apart);
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
int by_wrist(const axis* axes, const double* goal, const double* other, double (*found)[SIX]) {
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
int by_parallel(const axis* axes, const double* goal, const double* other, double (*found)[SIX]) {
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

/* The attempt that continues from another, the nearest by its first three angles; −1 where none is near. */
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

/* Keep what is least missed at one place, of its two neighbours, without a change of sign: two ways may be close. */
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

int by_search(const axis* axes, const double* goal, const double* other, double (*found)[SIX]) {
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
