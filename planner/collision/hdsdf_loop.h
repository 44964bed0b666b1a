/* The HD-SDF of one row of the broad phase, or of one pair at one sample, for other loops. */

#ifndef HDPLAN_HDSDF_LOOP_H
#define HDPLAN_HDSDF_LOOP_H

#include "close_pairs.h"

/* D of a row that `project` has looked at, whose result is `apart`, the halfspace body placed at b; its wrench about the
   world's origin goes to `wrench`. What the projection holds of x is used up. */
double hdsdf(int gamma, double length, const double* b, const link_body* body, const halfspaces* planes, double apart,
             projection* at, double* wrench);

/* D of a pair of the tables, with the joints' frames (joints, 12) of one sample; D̃ goes to `separation`. */
double hdsdf_of_pair(const tables* of, int gamma, double length, long long pair, const double* frames, projection* at,
                     double* separation, double* wrench);

#endif
