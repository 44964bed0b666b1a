/* The HD-SDF of one row of the broad phase, for other loops. */

#ifndef HDPLAN_HDSDF_LOOP_H
#define HDPLAN_HDSDF_LOOP_H

#include "close_pairs.h"

/* D of a row that `project` has looked at; its wrench about the world's origin goes to `wrench`. */
double hdsdf(long long gamma, double length, const double* b, long long slots, const double* weights, long long width,
             const double* planes, double apart, projection* of, double* wrench);

#endif
