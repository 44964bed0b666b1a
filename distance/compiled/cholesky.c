/* Implements `cholesky.h`. */

#include "cholesky.h"

#include <math.h>

#include "clones.h"

static long long least(long long a, long long b) { return a < b ? a : b; }

/* H = L Lᵀ, and the forward substitution on the way; 1 / L[c, c] on the diagonal. */
CLONES
static int factorized(long long size, long long width, double* band, double* vector) {
  for (long long c = 0; c < size; ++c) {
    const long long below = least(size - c, width);
    double* column = band + width * c;
    if (!(column[0] > 0.0)) return 0;
    const double pivot = 1.0 / sqrt(column[0]);
    column[0] = pivot;
    vector[c] *= pivot;
    for (long long d = 1; d < below; ++d) column[d] *= pivot;
    for (long long i = 1; i < below; ++i) {
      const double factor = column[i], *restrict from = column + i;
      double* restrict to = band + width * (c + i);
      if (factor == 0.0) continue;
      for (long long d = 0; d < below - i; ++d) to[d] -= factor * from[d];
      vector[c + i] -= factor * vector[c];
    }
  }
  return 1;
}

/* Lᵀ x = y in place. */
static void substituted_back(long long size, long long width, const double* band, double* vector) {
  for (long long c = size - 1; c >= 0; --c) {
    const long long below = least(size - c, width);
    const double* column = band + width * c;
    double value = vector[c];
    for (long long d = 1; d < below; ++d) value -= column[d] * vector[c + d];
    vector[c] = value * column[0];
  }
}

int solved(long long size, long long width, double* band, double* vector) {
  if (!factorized(size, width, band, vector)) return 0;
  substituted_back(size, width, band, vector);
  return 1;
}

void solved_again(long long size, long long width, const double* band, double* vector) {
  for (long long c = 0; c < size; ++c) {
    const long long below = least(size - c, width);
    const double* column = band + width * c;
    vector[c] *= column[0];
    for (long long d = 1; d < below; ++d) vector[c + d] -= column[d] * vector[c];
  }
  substituted_back(size, width, band, vector);
}
