/* The search of `separation_bounds.py` for one pair: best box first, each halved alone.

   The normal between the bodies is that of `gjk.c` on their vertices. Its distance only decides which boxes are worth
   halving: the bound holds along any unit normal. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"
#include "../kinematics/forward_loop.h"
#include "gjk.h"

#define PI 3.14159265358979323846

/* Vertices (count, 3), in the frame of a joint or in the world; and the same in the joint's frame, as `gjk.c` has them. */
typedef struct {
  long long joint, count;
  const double* vertices;
  double* rows;
  solid body;
} hull;

/* --- the bound over a box --------------------------------------------------------------------------------------- */

/* A box of joint values: the coordinates that move the first body against the second have `moves` 1, those that move the
   second −1; half widths (n), and the columns (n, 6) at its centre. */
typedef struct {
  long long n;
  const double *moves, *half, *columns;
} ranges;

/* How far coordinate j shifts a point p along a unit vector n at most, at the rate u = v + ω × p, if those before it turn
   it by Σ h_i: e_j = min(s |u|, h |n·u| + ½ h² |u| + s |u| min(2, Σ h_i)), s = 2 sin(h / 2); of one that slides s = h,
   and there is no second term. */
static double shift(const double* column, double h, const double* n, const double* point, double* before) {
  const double *velocity = column, *turning = column + 3, rate[3] = {
      velocity[0] + turning[1] * point[2] - turning[2] * point[1],
      velocity[1] + turning[2] * point[0] - turning[0] * point[2],
      velocity[2] + turning[0] * point[1] - turning[1] * point[0],
  };
  const double speed = norm(rate), along = fabs(dot(n, rate));
  const int turns = dot(turning, turning) > 0.25;
  const double chord = turns ? 2.0 * sin((h < PI ? h : PI) / 2.0) : h;
  double bend = chord * least_of(*before, 2.0);
  if (turns) {
    bend = 0.5 * h * h + bend;
    *before += h;
  }
  return least_of(chord * speed, h * along + bend * speed);
}

/* The least of n·v − Σ e_j(v) over a body's vertices in the world, n = sign · normal; that vertex' e_j go to `shifts`,
   `trial` (n) is scratch. */
static double lowest(const ranges* over, const hull* body, const double* normal, double side, double* trial,
                     double* shifts) {
  double least = INFINITY;
  for (long long i = 0; i < body->count; ++i) {
    const double* vertex = body->vertices + 3 * i;
    double height = side * dot(normal, vertex), before = 0.0;
    for (long long j = 0; j < over->n; ++j) {
      if (over->moves[j] != side) continue;
      trial[j] = shift(over->columns + 6 * j, over->half[j], normal, vertex, &before);
      height -= trial[j];
    }
    if (!(height < least)) continue;
    least = height;
    for (long long j = 0; j < over->n; ++j)
      if (over->moves[j] == side) shifts[j] = trial[j];
  }
  return least;
}

/* One pair, and room for the kinematics and the vertices at one configuration. */
typedef struct {
  const tree* arm;
  hull a, b;
  double radii;
  const double *moves, *low, *high;
  double *placements, *columns, *trial, *shifts, *at_a, *at_b;
  double least; /* distance at a centre so far */
} search;

/* The solid of a hull: rows of all x, y and z, whose rest repeats the first vertex. */
static void make_solid(hull* of) {
  const long long width = (of->count + 7) / 8 * 8;
  for (long long k = 0; k < width; ++k)
    for (int i = 0; i < 3; ++i) of->rows[i * width + k] = of->vertices[3 * (k < of->count ? k : 0) + i];
  of->body = (solid){.width = width, .rows = of->rows};
}

/* About the distance of the two bodies without their balls, negative where they meet, and a unit vector, from b to a
   where they do not. */
static double apart(const search* of, double* normal) {
  const double *a = of->placements + 12 * of->a.joint, *b = of->placements + 12 * of->b.joint;
  double seen[12], local[3] = {1.0, 0.0, 0.0};
  seen_from(b, a, seen);
  const double distance = gap_of(&(two_solids){&of->a.body, &of->b.body, seen}, -INFINITY, INFINITY, local);
  turned(b, local, normal);
  return distance;
}

static hull place(const hull* body, const double* placements, double* vertices) {
  for (long long i = 0; i < body->count; ++i)
    placed(placements + 12 * body->joint, body->vertices + 3 * i, vertices + 3 * i);
  return (hull){.count = body->count, .vertices = vertices};
}

/* The bound over the box (centre, half), and the coordinate that contributes most to its looseness. */
static double look(search* of, const double* centre, const double* half, long long* widest) {
  const long long n = of->arm->n;
  const ranges over = {n, of->moves, half, of->columns};
  double normal[3];
  forward(of->arm, 1, centre, of->placements, of->columns);
  const hull a = place(&of->a, of->placements, of->at_a), b = place(&of->b, of->placements, of->at_b);
  const double distance = apart(of, normal) - of->radii;
  if (distance < of->least) of->least = distance;
  for (long long j = 0; j < n; ++j) of->shifts[j] = 0.0;
  const double above = lowest(&over, &a, normal, 1.0, of->trial, of->shifts);
  const double bound = above + lowest(&over, &b, normal, -1.0, of->trial, of->shifts) - of->radii;
  *widest = 0;
  for (long long j = 1; j < n; ++j)
    if (of->shifts[j] > of->shifts[*widest]) *widest = j;
  return bound;
}

/* --- the search ------------------------------------------------------------------------------------------------- */

/* Boxes, each a row of centre (n), half widths (n) and bound: a heap, the least bound first; `widest` goes with it. */
typedef struct {
  long long row, count;
  double* boxes;
  long long* widest;
} heap;

static double* box_of(const heap* of, long long i) { return of->boxes + of->row * i; }
static double bound_of(const heap* of, long long i) { return box_of(of, i)[of->row - 1]; }

static void put(heap* into, long long i, const double* box, long long widest) {
  double* to = box_of(into, i);
  for (long long j = 0; j < into->row; ++j) to[j] = box[j];
  into->widest[i] = widest;
}

/* Replace the first box by another, which sinks. */
static void replace_first(heap* into, const double* box, long long widest) {
  long long i = 0;
  for (;;) {
    long long child = 2 * i + 1;
    if (child + 1 < into->count && bound_of(into, child + 1) < bound_of(into, child)) ++child;
    if (child >= into->count || bound_of(into, child) >= box[into->row - 1]) break;
    put(into, i, box_of(into, child), into->widest[child]);
    i = child;
  }
  put(into, i, box, widest);
}

/* Put a box last: it rises. */
static void push(heap* into, const double* box, long long widest) {
  long long i = into->count++;
  while (i > 0) {
    const long long parent = (i - 1) / 2;
    if (bound_of(into, parent) <= box[into->row - 1]) break;
    put(into, i, box_of(into, parent), into->widest[parent]);
    i = parent;
  }
  put(into, i, box, widest);
}

/* The two halves of a box along a coordinate, with their bounds. */
static void halve(search* of, const double* box, long long split, double* one, double* other, long long* widest) {
  const long long n = of->arm->n;
  for (long long j = 0; j < 2 * n; ++j) one[j] = box[j];
  one[n + split] /= 2.0;
  for (long long j = 0; j < 2 * n; ++j) other[j] = one[j];
  one[split] -= one[n + split];
  other[split] += one[n + split];
  one[2 * n] = look(of, one, one + n, widest);
  other[2 * n] = look(of, other, other + n, widest + 1);
}

/* A lower bound of the distance of a pair over the box of the limits, and in *looked how many boxes it took, until it is
   `tight`, a distance is not more than `wanted`, or there are `most`; `halves` is room for two boxes. */
static double separation(search* of, double wanted, double tight, long long most, heap* boxes, double* halves,
                         long long* looked) {
  const long long n = of->arm->n;
  double *first = boxes->boxes, *other = halves + boxes->row;
  long long widest[2];
  make_solid(&of->a);
  make_solid(&of->b);
  for (long long j = 0; j < n; ++j) {
    first[j] = 0.5 * (of->low[j] + of->high[j]);
    first[n + j] = of->moves[j] != 0.0 ? 0.5 * (of->high[j] - of->low[j]) : 0.0;
  }
  first[2 * n] = look(of, first, first + n, boxes->widest);
  boxes->count = 1;
  *looked = 1;
  while (bound_of(boxes, 0) < tight * of->least && of->least > wanted && *looked < most) {
    halve(of, first, boxes->widest[0], halves, other, widest);
    *looked += 2;
    replace_first(boxes, halves, widest[0]);
    push(boxes, other, widest[1]);
  }
  return bound_of(boxes, 0);
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static hull take_hull(arguments* taken, long long joints) {
  hull body = {.joint = whole(taken, "joint", 0, joints - 1)};
  body.vertices = numbers(taken, "vertices", SHAPE(ANY, 3));
  body.count = taken->shape[0];
  if (body.count < 1) wrong(taken, "vertices", "one or more");
  return body;
}

/* Room for the kinematics of an arm and the vertices of two bodies. */
static void take_room(arguments* taken, search* of, long long joints, long long n) {
  of->placements = scratch(taken, 12 * joints + 8 * n + 6 * (of->a.count + of->b.count + 7));
  if (!of->placements) return;
  of->columns = of->placements + 12 * joints;
  of->trial = of->columns + 6 * n;
  of->shifts = of->trial + n;
  of->at_a = of->shifts + n;
  of->at_b = of->at_a + 3 * of->a.count;
  of->a.rows = of->at_b + 3 * of->b.count;
  of->b.rows = of->a.rows + 3 * (of->a.count + 7);
}

WRAPPER(call_separation) {
  arguments taken = begin("separation", given, count);
  search of = {.arm = record(&taken, "tree", "tree"), .least = INFINITY};
  const long long n = of.arm ? of.arm->n : 0, joints = of.arm ? of.arm->joints : 1, row = 2 * n + 1;
  if (n < 1) wrong(&taken, "tree", "one that moves");
  of.a = take_hull(&taken, joints);
  of.b = take_hull(&taken, joints);
  of.radii = number(&taken, "radii");
  of.moves = numbers(&taken, "moves", SHAPE(n));
  of.low = numbers(&taken, "low", SHAPE(n));
  of.high = numbers(&taken, "high", SHAPE(n));
  const double wanted = number(&taken, "wanted"), tight = number(&taken, "tight");
  const long long most = whole(&taken, "most", 0, 1LL << 30);
  take_room(&taken, &of, joints, n);
  heap boxes = {.row = row, .boxes = scratch(&taken, (most + 2) * row), .widest = scratch_indices(&taken, most + 2)};
  double *halves = scratch(&taken, 2 * row), bound = 0.0;
  long long looked = 0;
  if (ready(&taken)) WITHOUT_LOCK(bound = separation(&of, wanted, tight, most, &boxes, halves, &looked));
  return ended(&taken, Py_BuildValue("dL", bound, looked));
}

PyMethodDef separation_functions[] = {
    FUNCTION("separation", call_separation,
             "A lower bound of a pair's distance over all joint values; boxes looked at."),
    END_OF_FUNCTIONS,
};
