/* Symmetric systems by Cholesky's factorization. */

#ifndef HDPLAN_CHOLESKY_H
#define HDPLAN_CHOLESKY_H

/* Solve H x = y in place, H of `size` rows in columns of its lower half: H[c + d, c] at band[c * width + d], zero for
   d ≥ width; a dense matrix has width = size. Returns whether H is positive definite; if not, y is lost. */
int solved(long long size, long long width, double* band, double* vector);

/* Solve with another y, by the factors that `solved` left in the band. */
void solved_again(long long size, long long width, const double* band, double* vector);

#endif
