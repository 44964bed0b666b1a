/* The HD-SDF of one row of the broad phase, for other loops. */

#ifndef HDPLAN_HDSDF_LOOP_H
#define HDPLAN_HDSDF_LOOP_H

#include "close_pairs.h"

/* D of a row that `project` has looked at, whose result is `apart`, the halfspace body placed at b; its wrench about the
   world's origin goes to `wrench`. What the projection holds of x is used up. */
double hdsdf(int gamma, double length, const double* b, const link_body* body, const halfspaces* planes, double apart,
             projection* at, double* wrench);

#endif
