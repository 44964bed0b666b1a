/* The exact signed distance of two convex bodies: GJK where they are apart (E. G. Gilbert, D. W. Johnson, S. S. Keerthi,
   1988), and where they overlap the expanding polytope (G. van den Bergen, 2001). */

#ifndef HDPLAN_GJK_H
#define HDPLAN_GJK_H

/* The hull of vertices, swept by a disc normal to z, by an ellipsoid and by a ball, in its own frame. The rows of all x,
   of all y and of all z are `width` numbers long, a multiple of eight; what is left of them repeats a vertex. Where there
   are `clusters`, a multiple of eight or none, each 32 vertices after the other are one, and four rows follow: the x, y, z and
   radii of balls around them. */
typedef struct {
  long long width, clusters;
  const double *rows, *radii; /* of the ellipsoid, or null */
  double disc, ball;
} solid;

/* Two bodies, a placed in the frame of b: a rotation row by row, then an origin. */
typedef struct {
  const solid *a, *b;
  const double* place;
} two_solids;

/* The signed distance of a and b, or a lower bound of it that is more than `far`; with the unit normal from b to a, the
   direction in which it is looked for first, and the point of a that is nearest, or deepest, both in the frame of b. It
   is the gap of the bodies along the normal: where rounding ends the search, it is too small and never too large. */
double signed_distance(const two_solids* of, double far, double* normal, double* point);

/* The distance alone, if it is more than 0, or a lower bound of it that is more than `far`, or an upper bound that is
   at most `near`; some number below 0 where they overlap. */
double gap_of(const two_solids* of, double near, double far, double* normal);

/* How far a body reaches along a vector, in its own frame: the largest v·p of its points p. */
double reach_along(const solid* body, const double* v);

#endif
