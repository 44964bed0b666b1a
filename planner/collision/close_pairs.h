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

/* A link body: vertices (slots, 3), weights (slots) and the radius of the ball that sweeps them. */
typedef struct {
  long long slots;
  const double *vertices, *weights;
  double radius;
} link_body;

/* The planes of a halfspace body: a row of all x, of all y and of all z of the normals, and one of the supports. */
typedef struct {
  long long width; /* a multiple of four */
  const double* rows;
} halfspaces;

/* Where a link body is, seen from a halfspace body: its vertices (slots, 3) in that frame; x_ik (slots, width), how far
   vertex i is beyond plane k, less the body's radius; the least of x_ik along every plane (width); and room to work. */
typedef struct {
  double *points, *x, *least, *work;
} projection;

/* What is done with a row that is close; with planes, no plane separates it, and how it is projected is known. */
typedef void action(void* given, long long sample, long long pair, double apart, projection* of);

link_body body_of(const tables* of, long long pair);
halfspaces planes_of(const tables* of, long long pair);

/* The largest of `width` numbers, a multiple of four: four at a time, as wide as vectors are. */
static inline double largest(long long width, const double* values) {
  double most[4];
  for (int j = 0; j < 4; ++j) most[j] = values[j];
  for (long long k = 4; k < width; k += 4)
    for (int j = 0; j < 4; ++j) most[j] = values[k + j] > most[j] ? values[k + j] : most[j];
  most[0] = most[1] > most[0] ? most[1] : most[0];
  most[2] = most[3] > most[2] ? most[3] : most[2];
  return most[2] > most[0] ? most[2] : most[0];
}

/* Room for any pair; `points` is to be freed. Returns 0, or −1 without memory. */
int make_projection(const tables* of, projection* found);

/* Project a body in frame a on the planes of a body in frame b. Returns the largest least x: more than 0 only where a
   plane separates the two. */
double project(const double* a, const double* b, const link_body* body, const halfspaces* planes, projection* found);

/* Visit the rows (sample, pair) of balls that reach their box, pair by pair, that no plane of the box's body separates
   by `least`. With `centres` (bodies, batch, 3) given, those of standing boxes only, without planes. Returns 0, or −1
   without memory. */
int visit(const tables* of, long long batch, long long joints, const double* placements, const double* centres,
          const double* reach, double least, action* act, void* given);

#endif
