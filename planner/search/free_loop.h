/* Which part of a straight line between two configurations is free, for loops that grow trees of such lines. */

#ifndef HDPLAN_FREE_LOOP_H
#define HDPLAN_FREE_LOOP_H

#include "../collision/exact_loop.h"
#include "../kinematics/forward_loop.h"

/* Pairs that are to stay apart by more than their floors [m], by their solids; the bodies `around` these have few vertices,
   and are enough for most. Per unit of each of the m joints of the model, a point of
   the one moves by `reach` at most, seen from the other; `moves` is 1 where a joint moves the first alone, −1 the second.
   `radii` are those of the bodies' balls. */
typedef struct {
  const solids *solids, *around;
  const tables* pairs;
  const double *reach, *moves, *floors, *radii;
  long long joints; /* m */
} keeping;

/* A robot whose m joints are at factor · q[leader] + offset for its n planned ones, these within limits, and what is kept
   apart. No interval
   of a line is looked at in which something may move by less than `finest` [m]. */
typedef struct {
  const tree* arm;
  long long n, terms, pairs;
  const long long* leader;
  const double *factor, *offset, *lower, *upper;
  const keeping* const* kept;
  double finest;
} space;

/* Room for one line at a time: how far each joint moves along the whole line, and each pair at most [m]. `hit` is the pair
   that ended it, counted through all terms; `count` pairs have a floor above −∞. */
typedef struct {
  const space* of;
  const double *from, *to;
  double *moved, *rates, *normals, *joints, *placements, *columns, fastest;
  long long *active, count, hit;
  int whole;
} line;

long long line_numbers(const space* of); /* of the room that a line needs */
line line_in(const space* of, double* numbers, long long* indices);

/* The fraction of the way from one configuration to another up to which every pair is proven to stay apart by more than
   its floor; or 1 where it is so all the way, and anything less elsewhere, if it has to be `whole`. */
double free_until(line* along, const double* from, const double* to, int whole);

/* The derivative (n) of the gap of the pair that was hit, at a configuration. */
void uphill(line* along, const double* q, double* gradient);

#endif
