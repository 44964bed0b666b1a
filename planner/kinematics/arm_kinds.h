/* The angles of six turning joints with E_1 … E_6 = G, for each kind of arm: E_i = exp([S_i] θ_i) is the motion about axis
   i (direction h_i, point p_i, all joints at 0), of which the last two meet, and G is wanted. `other` are the angles (6)
   of joints that may be anywhere. Returned is the number of those found (TRIED, 6), which last steps make exact. */

#ifndef HDPLAN_ARM_KINDS_H
#define HDPLAN_ARM_KINDS_H

#include "subproblems.h"

enum { SIX = 6, TRIED = 256 };            /* axes, tries */
enum { WRIST, PARALLEL, MEETING, KINDS }; /* axes 4, 5, 6 meet; 2, 3, 4 are parallel; 5 and 6 meet, no more */

int by_wrist(const axis* axes, const double* goal, const double* other, double (*found)[SIX]);
int by_parallel(const axis* axes, const double* goal, const double* other, double (*found)[SIX]);

/* Of any other arm: by a search along θ₄. */
int by_search(const axis* axes, const double* goal, const double* other, double (*found)[SIX]);

#endif
