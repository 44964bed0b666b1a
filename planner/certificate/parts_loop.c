/* The walk down two trees of parts with the directions known, as `parts_loop.py` has it: pairs of nodes that the
   directions settle, and pairs of single parts that they do not. */

#include <math.h>

#include "../../distance/compiled/border.h"

#define MOST 64 /* children of a node, as in `parts.py` */

typedef struct {
  long long nodes;
  const long long *first, *last;
  const double *corners, *radius, *size;
} parts;

/* One of the two bodies: its parts, if it has any; and for each direction and s = 0, 1, -1 the direction in the body's
   frame, and how far along it the frame's origin is, or the whole body. */
typedef struct {
  long long directions;
  const parts* of;
  const double *ways, *offsets;
} side;

/* The least distance and bound of all settled pairs, what settles a pair, and how far the bodies move. */
typedef struct {
  double least, proven, known, within, enough, first, second;
} state;

static double reach(const side* body, long long node, long long row) {
  const double *way = body->ways + 3 * row, *c;
  double best, along;
  int i;
  if (!body->of) return body->offsets[row];
  c = body->of->corners + 12 * node;
  best = way[0] * c[0] + way[1] * c[1] + way[2] * c[2];
  for (i = 1, c += 3; i < 4; ++i, c += 3) {
    along = way[0] * c[0] + way[1] * c[1] + way[2] * c[2];
    best = along > best ? along : best;
  }
  along = body->of->radius[node];
  if (along) along *= sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
  return body->offsets[row] + best + along;
}

/* The distance at the midpoint, and the bound over the interval, by one direction. */
static double by(const side* a, const side* b, const state* is, long long i, long long j, long long k, double* bound) {
  double gaps[3], low, high;
  int s;
  for (s = 0; s < 3; ++s) gaps[s] = -reach(a, i, 3 * k + s) - reach(b, j, 3 * k + s);
  low = (gaps[1] < gaps[2] ? gaps[1] : gaps[2]) - is->second;
  high = gaps[0] - is->first;
  *bound = low > high ? low : high;
  return gaps[0];
}

static int settled(const state* is, double distance, double bound) {
  return (distance > is->within || distance >= is->known) && (bound >= is->enough || !(is->proven >= is->enough));
}

/* Take pairs of nodes from the end of `stack` until it is empty or `most` pairs of parts are left open; return how many
   are, or −1 where the stack has no room (`high` pairs) for more. `at`: how many pairs are on it, and the direction
   that settled a pair last. */
static long long walk(const side* a, const side* b, long long count, state* is, long long* stack, long long high,
                      long long* at, long long most, long long* open) {
  double values[MOST];
  long long left = 0;
  while (at[0] > 0 && left < most) {
    long long i, j, tried, way = 0, begin, end, node, place;
    double distance = -INFINITY, bound = -INFINITY;
    int done = 0, larger;
    --at[0];
    i = stack[2 * at[0]];
    j = stack[2 * at[0] + 1];
    for (tried = -1; tried < count && !done; ++tried) {
      long long k = tried < 0 ? at[1] : tried;
      double low, value;
      if (tried == at[1]) continue;
      value = by(a, b, is, i, j, k, &low);
      if (value > distance) distance = value, way = k;
      if (low > bound) bound = low;
      if (settled(is, distance, bound)) done = 1, at[1] = k;
    }
    if (done) {
      is->least = distance < is->least ? distance : is->least;
      is->proven = bound < is->proven ? bound : is->proven;
      continue;
    }
    if ((!a->of || a->of->first[i] == i) && (!b->of || b->of->first[j] == j)) {
      open[2 * left] = i;
      open[2 * left + 1] = j;
      ++left;
      continue;
    }
    larger = a->of && (!b->of || a->of->size[i] > b->of->size[j]);
    begin = larger ? a->of->first[i] : b->of->first[j];
    end = larger ? a->of->last[i] : b->of->last[j];
    if (end - begin > MOST || at[0] + end - begin > high) return -1;
    for (node = begin; node < end; ++node) { /* the closest is looked at first */
      double low, value = larger ? by(a, b, is, node, j, way, &low) : by(a, b, is, i, node, way, &low);
      for (place = node - begin; place > 0 && values[place - 1] < value; --place) {
        values[place] = values[place - 1];
        stack[2 * (at[0] + place)] = stack[2 * (at[0] + place) - 2];
        stack[2 * (at[0] + place) + 1] = stack[2 * (at[0] + place) - 1];
      }
      values[place] = value;
      stack[2 * (at[0] + place)] = larger ? node : i;
      stack[2 * (at[0] + place) + 1] = larger ? j : node;
    }
    at[0] += end - begin;
  }
  return left;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static PyObject* make_parts(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("parts", given, count);
  parts p;
  long long k;
  PyObject* found;
  (void)self;
  p.corners = numbers(&c, "corners", SHAPE(ANY, 4, 3));
  p.nodes = c.shape[0];
  p.radius = numbers(&c, "radius", SHAPE(p.nodes));
  p.size = numbers(&c, "size", SHAPE(p.nodes));
  p.first = rows(&c, "first", 0, p.nodes, SHAPE(p.nodes));
  p.last = rows(&c, "last", 0, p.nodes + 1, SHAPE(p.nodes));
  for (k = 0; !c.failed && k < p.nodes; ++k)
    if (p.last[k] <= p.first[k] || p.last[k] - p.first[k] > MOST) wrong(&c, "last", "beyond `first`, by MOST or less");
  found = made(&c, "parts", &p, sizeof p);
  return ended(&c, found);
}

static PyObject* make_side(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("side", given, count);
  side s;
  PyObject* found;
  (void)self;
  s.of = record_or_none(&c, "parts", "parts");
  s.ways = numbers(&c, "ways", SHAPE(ANY, 3, 3));
  s.directions = c.shape[0];
  s.offsets = numbers(&c, "offsets", SHAPE(s.directions, 3));
  found = made(&c, "side", &s, sizeof s);
  return ended(&c, found);
}

static PyObject* call_walk(PyObject* self, PyObject* const* given, Py_ssize_t count) {
  call c = begin("walk", given, count);
  const side *a = record(&c, "a", "side"), *b = record(&c, "b", "side");
  double* of = written(&c, "state", SHAPE(7));
  long long *stack = written_rows(&c, "stack", SHAPE(ANY, 2)), *at, *open, high = c.shape[0], most, left = 0, k;
  state is;
  (void)self;
  at = written_rows(&c, "place", SHAPE(2));
  open = written_rows(&c, "open", SHAPE(ANY, 2));
  most = c.shape[0];
  if (!ready(&c)) return ended(&c, NULL);
  if (a->directions != b->directions) wrong(&c, "b", "along the directions of `a`");
  if (at[0] < 0 || at[0] > high || at[1] < 0 || at[1] >= a->directions) wrong(&c, "place", "on the stack, and a direction");
  for (k = 0; !c.failed && k < at[0]; ++k)
    if (stack[2 * k] < 0 || stack[2 * k] >= (a->of ? a->of->nodes : 1) || stack[2 * k + 1] < 0 ||
        stack[2 * k + 1] >= (b->of ? b->of->nodes : 1))
      wrong(&c, "stack", "pairs of nodes");
  if (c.failed) return ended(&c, NULL);
  is.least = of[0], is.proven = of[1], is.known = of[2], is.within = of[3], is.enough = of[4];
  is.first = of[5], is.second = of[6];
  WITHOUT_LOCK(left = walk(a, b, a->directions, &is, stack, high, at, most, open));
  of[0] = is.least, of[1] = is.proven;
  if (left < 0) wrong(&c, "stack", "as high as both trees are deep");
  return ended(&c, PyLong_FromLongLong(left));
}

PyMethodDef parts_functions[] = {
    FUNCTION("parts", make_parts, "A tree of parts."),
    FUNCTION("side", make_side, "One of two bodies, and directions."),
    FUNCTION("walk", call_walk, "Settle pairs of nodes; returns how many pairs of parts are left open."),
    END_OF_FUNCTIONS,
};
