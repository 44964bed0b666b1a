/* Motions about and along axes, and placements as in vectors.h. */

#ifndef HDPLAN_MOTIONS_H
#define HDPLAN_MOTIONS_H

#include "../../distance/compiled/vectors.h"

static const double PI = 3.14159265358979323846;

/* A line along a unit direction h through a point p. */
typedef struct {
  double h[3], p[3];
} axis;

/* found = v turned about a unit direction: v cos + (h × v) sin + h (h·v)(1 − cos). */
static inline void turn(const double* h, double cosine, double sine, const double* v, double* found) {
  double across[3];
  cross(h, v, across);
  const double along = dot(h, v) * (1.0 - cosine);
  for (int i = 0; i < 3; ++i) found[i] = v[i] * cosine + across[i] * sine + h[i] * along;
}

/* found = E x, a point moved by an angle about an axis. */
static inline void move_point(const axis* about, double angle, const double* x, double* found) {
  double arm[3], moved[3];
  difference(x, about->p, arm);
  turn(about->h, cos(angle), sin(angle), arm, moved);
  for (int i = 0; i < 3; ++i) found[i] = about->p[i] + moved[i];
}

static inline void turn_by(const double* h, double angle, const double* v, double* found) {
  turn(h, cos(angle), sin(angle), v, found);
}

static inline void to_identity(double* placement) {
  for (int i = 0; i < 12; ++i) placement[i] = i == 0 || i == 4 || i == 8;
}

/* found = A B of two placements. */
static inline void compose(const double* a, const double* b, double* found) {
  product(a, b, found);
  placed(a, b + 9, found + 9);
}

static inline void invert(const double* a, double* found) {
  double back[3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) found[3 * i + j] = a[3 * j + i];
  turned(found, a + 9, back);
  for (int i = 0; i < 3; ++i) found[9 + i] = -back[i];
}

/* moved = P E, P followed by a motion about an axis, or along it. */
static inline void follow(const double* before, const axis* about, int turns, double value, double* moved) {
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

/* How far apart two angles are, whole turns aside. */
static inline double apart(double a, double b) { return fabs(remainder(a - b, 2.0 * PI)); }

#endif
