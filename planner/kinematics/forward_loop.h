/* The forward kinematics, for other loops. */

#ifndef HDPLAN_FORWARD_LOOP_H
#define HDPLAN_FORWARD_LOOP_H

/* A tree of joints, each with one coordinate: joint i + 1 turns about axis i or slides along it, and is placed by row i
   (rotation row by row, then origin) on its parent, an earlier joint. */
typedef struct {
  long long joints, n; /* the world is joint 0 */
  const long long *parents, *coordinates, *turns;
  const double *placed, *axes;
} tree;

/* Placements (batch, joints, 12) and columns (batch, n, 6) at configurations (batch, n). */
void forward(const tree* arm, long long batch, const double* q, double* placements, double* columns);

#endif
