/* Vectors of three numbers, matrices (3, 3) row by row, and placements: a rotation row by row, then an origin. Sums run
   from left to right everywhere, so that equal products have equal bits. Written
   out, as compilers leave such short loops as they are. No `found` is one of the others. */

#ifndef HDPLAN_VECTORS_H
#define HDPLAN_VECTORS_H

#include <math.h>

/* The smaller and the larger of two numbers; what is not a number stays so, and proves nothing. */
static inline double least_of(double a, double b) { return a != a || a < b ? a : b; }
static inline double most_of(double a, double b) { return a != a || a > b ? a : b; }

/* a·b */
static inline double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* |a| */
static inline double norm(const double* a) { return sqrt(dot(a, a)); }

/* found = a × b */
static inline void cross(const double* a, const double* b, double* found) {
  found[0] = a[1] * b[2] - a[2] * b[1];
  found[1] = a[2] * b[0] - a[0] * b[2];
  found[2] = a[0] * b[1] - a[1] * b[0];
}

/* found = a − b */
static inline void difference(const double* a, const double* b, double* found) {
  found[0] = a[0] - b[0];
  found[1] = a[1] - b[1];
  found[2] = a[2] - b[2];
}

/* found = R v */
static inline void turned(const double* rotation, const double* vector, double* found) {
  found[0] = dot(rotation, vector);
  found[1] = dot(rotation + 3, vector);
  found[2] = dot(rotation + 6, vector);
}

/* found = Rᵀ v */
static inline void turned_back(const double* rotation, const double* vector, double* found) {
  found[0] = rotation[0] * vector[0] + rotation[3] * vector[1] + rotation[6] * vector[2];
  found[1] = rotation[1] * vector[0] + rotation[4] * vector[1] + rotation[7] * vector[2];
  found[2] = rotation[2] * vector[0] + rotation[5] * vector[1] + rotation[8] * vector[2];
}

/* found = A B */
static inline void product(const double* a, const double* b, double* found) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      found[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* found = R p + o, a point of the frame that is placed by R and o. */
static inline void placed(const double* placement, const double* point, double* found) {
  found[0] = dot(placement, point) + placement[9];
  found[1] = dot(placement + 3, point) + placement[10];
  found[2] = dot(placement + 6, point) + placement[11];
}

/* found = B⁻¹ A, the frame that is placed by A as seen from the one that is placed by B. */
static inline void seen_from(const double* b, const double* a, double* found) {
  double apart[3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) found[3 * i + j] = b[i] * a[j] + b[3 + i] * a[3 + j] + b[6 + i] * a[6 + j];
  difference(a + 9, b + 9, apart);
  turned_back(b, apart, found + 9);
}

#endif
