/* Two trees of free lines that grow towards each other: RRT-Connect (J. Kuffner, S. LaValle, 2000), which slides along
   obstacles. In narrow places nearly every straight line ends at once; its part along the surfaces that it
   meets continues. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"
#include "free_loop.h"

enum { SURFACES = 3, STEPS = 16 };

#define SHORTEST_LINE 1e-3 /* least length of a line that is kept */
#define STOP_SHORT 1e-3    /* [m] that a line ends before what it meets, at most half of it */
#define NEARER 0.8         /* share of the way to a target that is left, at most, where the other tree is to follow */
#define AWAY 0.1           /* share of a step along a surface by which it leaves the surface */

/* Nodes (capacity, n), of which `count` are there, and the row of each one's parent. */
typedef struct {
  long long capacity, *count, *parents;
  double* nodes;
} branches;

/* What is needed to grow: room for a direction, a target of a step, and the normals of surfaces that are met. */
typedef struct {
  line* along;
  long long n;
  double longest, *way, *end, *normals;
} growth;

static double product_of(long long n, const double* a, const double* b) {
  double sum = 0.0;
  for (long long i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

/* |a − b|² */
static double square_apart(long long n, const double* a, const double* b) {
  double sum = 0.0;
  for (long long i = 0; i < n; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

static long long nearest(const branches* of, long long n, const double* q) {
  double least = INFINITY;
  long long found = 0;
  for (long long k = 0; k < *of->count; ++k) {
    const double square = square_apart(n, of->nodes + n * k, q);
    if (square < least) {
      least = square;
      found = k;
    }
  }
  return found;
}

static long long add(branches* of, long long n, long long parent, const double* q) {
  const long long row = (*of->count)++;
  for (long long i = 0; i < n; ++i) of->nodes[n * row + i] = q[i];
  of->parents[row] = parent;
  return row;
}

/* Take from a direction its parts into the surfaces that are met, and add a little that leads away from the last; returns
   its length, 0 where nothing is left. */
static double slide(const growth* of, long long surfaces) {
  const long long n = of->n;
  double* way = of->way;
  for (long long s = surfaces - 1; s >= 0; --s) {
    const double* normal = of->normals + n * s;
    const double into = product_of(n, way, normal);
    for (long long i = 0; into < 0.0 && i < n; ++i) way[i] -= into * normal[i];
  }
  const double length = sqrt(product_of(n, way, way));
  for (long long i = 0; surfaces && i < n; ++i) way[i] += AWAY * length * of->normals[n * (surfaces - 1) + i];
  return length;
}

/* Remember the surface that was met at q; returns how many there are. */
static long long meet(const growth* of, const double* q, long long surfaces) {
  double* normal = of->normals + of->n * surfaces;
  uphill(of->along, q, normal);
  const double length = sqrt(product_of(of->n, normal, normal));
  if (!(length > 0.0)) return SURFACES;
  for (long long i = 0; i < of->n; ++i) normal[i] /= length;
  return surfaces + 1;
}

/* Grow from a node towards a target, as far as it goes in STEPS lines; returns the last node, and in `arrived` whether
   it is the target. */
static long long grow(const growth* of, branches* tree, long long from, const double* target, int* arrived) {
  const long long n = of->n;
  long long surfaces = 0;
  *arrived = 0;
  for (int step = 0; step < STEPS && *tree->count < tree->capacity; ++step) {
    const double* q = tree->nodes + n * from;
    for (long long i = 0; i < n; ++i) of->way[i] = target[i] - q[i];
    const double left = slide(of, surfaces);
    if (!(left > SHORTEST_LINE)) break;
    const double share = least_of(1.0, of->longest / left);
    for (long long i = 0; i < n; ++i) {
      const double end = surfaces || share < 1.0 ? q[i] + share * of->way[i] : target[i];
      of->end[i] = most_of(of->along->of->lower[i], least_of(of->along->of->upper[i], end));
    }
    double reached = free_until(of->along, q, of->end, 0);
    const int met = reached < 1.0;
    if (met) reached -= least_of(0.5 * reached, STOP_SHORT / most_of(of->along->rates[of->along->hit], STOP_SHORT));
    if (reached * share * left > SHORTEST_LINE) {
      for (long long i = 0; i < n; ++i) of->end[i] = met ? q[i] + reached * (of->end[i] - q[i]) : of->end[i];
      from = add(tree, n, from, of->end);
      *arrived = !met && !surfaces && share == 1.0;
      if (*arrived) break;
      if (!met) surfaces = 0;
    } else if (surfaces == SURFACES) {
      break;
    }
    if (met && surfaces == SURFACES) break;
    if (met) surfaces = meet(of, tree->nodes + n * from, surfaces);
  }
  return from;
}

/* Grow two trees, in turn, towards `count` targets, and the other one then to what was reached, where this was a good part
   of the way, until they meet: the nodes there are in `joint`, else −1. */
static void grow_both(const growth* of, branches* trees, long long count, const double* targets, long long* joint) {
  joint[0] = joint[1] = -1;
  for (long long k = 0; k < count; ++k) {
    const int side = k % 2;
    branches *one = trees + side, *other = trees + 1 - side;
    const double* target = targets + of->n * k;
    int arrived;
    const long long before = *one->count, from = nearest(one, of->n, target);
    const long long reached = grow(of, one, from, target, &arrived);
    if (*one->count == before) continue;
    const double *q = one->nodes + of->n * reached, *begun = one->nodes + of->n * from;
    if (square_apart(of->n, q, target) > NEARER * NEARER * square_apart(of->n, begun, target)) continue;
    const long long met = grow(of, other, nearest(other, of->n, q), q, &arrived);
    if (!arrived) continue;
    joint[side] = reached;
    joint[1 - side] = met;
    return;
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

/* Take a tree: `counts` holds the number of its nodes. */
static branches tree_of(arguments* taken, long long n, long long* count, const char* nodes, const char* parents) {
  branches found = {.count = count, .nodes = written(taken, nodes, SHAPE(ANY, n))};
  found.capacity = taken->shape[0];
  found.parents = written_indices(taken, parents, SHAPE(found.capacity));
  if (!taken->failed && (*count < 1 || *count > found.capacity)) wrong(taken, nodes, "as many as are counted, and one");
  return found;
}

WRAPPER(call_grow_trees) {
  arguments taken = begin("grow_trees", given, count);
  const space* of = record(&taken, "space", "space");
  const long long n = of ? of->n : 0;
  growth growing = {.n = n, .longest = number(&taken, "longest")};
  const double* targets = numbers(&taken, "targets", SHAPE(ANY, n));
  const long long attempts = taken.shape[0];
  long long* counts = written_indices(&taken, "counts", SHAPE(2));
  branches trees[2];
  trees[0] = tree_of(&taken, n, counts, "first_nodes", "first_parents");
  trees[1] = tree_of(&taken, n, counts ? counts + 1 : NULL, "second_nodes", "second_parents");
  long long* joint = written_indices(&taken, "joint", SHAPE(2));
  double* room = scratch(&taken, of ? line_numbers(of) + (2 + SURFACES) * n : 0);
  long long* rows = scratch_indices(&taken, of ? of->pairs : 0);
  if (ready(&taken)) {
    line along = line_in(of, room, rows);
    growing.along = &along;
    growing.way = room + line_numbers(of);
    growing.end = growing.way + n;
    growing.normals = growing.end + n;
    WITHOUT_LOCK(grow_both(&growing, trees, attempts, targets, joint));
  }
  return ended(&taken, none());
}

PyMethodDef trees_functions[] = {
    FUNCTION("grow_trees", call_grow_trees, "Grow two trees towards targets and each other, until they meet."),
    END_OF_FUNCTIONS,
};
