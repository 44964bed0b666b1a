/* The exact distance of the rows of the broad phase, for other loops. */

#ifndef HDPLAN_EXACT_LOOP_H
#define HDPLAN_EXACT_LOOP_H

#include "close_pairs.h"
#include "gjk.h"

/* The solids of the bodies and boxes in the pairs of `tables`: vertices from first[k] on, three rows of width[k]
   numbers, and four rows of clusters[k] for the balls around their clusters, swept by a disc, an ellipsoid (none: not positive) and a ball, placed on the joint of the body or box. */
typedef struct {
  long long bodies, boxes;
  const long long *first, *width, *clusters;
  const double *rows, *discs, *radii, *balls, *places, *margins;
} solids;

/* The signed distance of a pair at placements of the joints, less the margin: exact, or a lower bound of it that is more
   than `far`; its wrench about the world's origin goes to `wrench`. `normal` (3) is a unit vector: at first the direction to try
   first, then the normal in the second solid's frame. */
double exact(const solids* of, const tables* pairs, long long pair, const double* frames, double far, double* normal,
             double* wrench);

/* The distance alone, margins not taken off, if it is more than 0, or a lower bound of it that is more than `far`, or an
   upper bound that is at most `near`; some number below 0 where the two overlap. */
double gap(const solids* of, const tables* pairs, long long pair, const double* frames, double near, double far,
           double* normal);

/* The least a·p of the points p of a pair's first solid less the largest b·p of its second's, in the world. */
double gap_along(const solids* of, const tables* pairs, long long pair, const double* frames, const double* a,
                 const double* b);

#endif
