/* The broad phase, for loops that do something with the rows that are close. */

#ifndef HDPLAN_CLOSE_PAIRS_H
#define HDPLAN_CLOSE_PAIRS_H

/* Everything about the pairs that stays, as `BodyPairs` has it. `middles` are the boxes' centres on their joints; the
   planes of box b are four rows of width[b] numbers from first[b] on; of the pairs in `order`, the first `standing`
   have a box in the world. There are at least `joints`. */
typedef struct {
  long long joints, bodies, boxes, pairs, standing, slots, widest;
  const long long *body_joint, *box_joint, *order, *joint_a, *joint_b, *body, *box, *first, *width;
  const double *centres, *reach, *middles, *balls, *at, *half, *table, *planes;
} tables;

/* Where a link body is, seen from a halfspace body: its vertices (slots, 3) in that frame; x_ik (slots, width), how far
   vertex i is beyond plane k, less the body's radius; the least of x_ik along every plane (width); and room to work. */
typedef struct { double *points, *x, *least, *work; } projection;

/* What is done with a row that is close; with planes, no plane separates it, and how it is projected is known. */
typedef void action(void* given, long long sample, long long pair, double apart, projection* of);

/* Room for any pair; `points` is to be freed. Returns 0, or −1 without memory. */
int make_projection(const tables* t, projection* of);

/* The largest of `width` numbers, a multiple of four. */
double largest(long long width, const double* values);

/* Project a body on the planes of another one; returns the largest least x: more than 0 only where a plane separates. */
double project(const double* a, const double* b, long long slots, const double* body, long long width,
               const double* restrict planes, projection* of);

/* Visit the rows (sample, pair) that are close, pair by pair. Returns 0, or −1 without memory. */
int visit(const tables* t, long long batch, long long joints, const double* placements, const double* centres,
          const double* reach, double least, action* act, void* given);

#endif
