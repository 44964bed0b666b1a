/* The walk down two trees of parts with the directions known, as in `parts_loop.py`: pairs of nodes that the
   directions settle, and pairs of single parts that they do not. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

#define MOST_CHILDREN 64 /* of a node, as in `parts.py` */

/* A tree: the children of a node are the nodes before it from `first` to `last`; a part has itself there. */
typedef struct {
  long long nodes;
  const long long *first, *last;
  const double *corners, *radius, *size;
} parts;

/* One of the two bodies: its parts, if it has any; and for each direction and s = 0, 1, −1 the direction in the body's
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

/* A pair of nodes, and what the directions give for it. */
typedef struct {
  double distance, bound;
} gap;

/* Pairs of nodes still open: `height` of them, `room` at most; and the direction that settled a pair last. */
typedef struct {
  long long *pairs, room, height, newest;
} walk_stack;

/* max v·x over the points x of a node, along the direction in a row of `ways`. */
static double reach(const side* body, long long node, long long row) {
  const double* way = body->ways + 3 * row;
  if (!body->of) return body->offsets[row];
  const double* corners = body->of->corners + 12 * node;
  double best = dot(way, corners);
  for (int i = 1; i < 4; ++i) best = most_of(best, dot(way, corners + 3 * i));
  const double radius = body->of->radius[node];
  return body->offsets[row] + best + (radius != 0.0 ? radius * norm(way) : radius);
}

/* The distance at the midpoint, and the bound over the interval, by one direction. */
static gap gap_along(const side* a, const side* b, const state* is, long long i, long long j, long long direction) {
  double gaps[3];
  for (int s = 0; s < 3; ++s) gaps[s] = -reach(a, i, 3 * direction + s) - reach(b, j, 3 * direction + s);
  return (gap){gaps[0], most_of(least_of(gaps[1], gaps[2]) - is->second, gaps[0] - is->first)};
}

static int settles(const state* is, gap found) {
  return (found.distance > is->within || found.distance >= is->known) &&
         (found.bound >= is->enough || !(is->proven >= is->enough));
}

/* Try the directions one after the other, the newest first, until they settle a pair. Returns whether they do, the
   best distance and bound, and the direction of the best distance. */
static int try_directions(const side* a, const side* b, const state* is, long long i, long long j, long long* newest,
                          gap* found, long long* way) {
  *found = (gap){-INFINITY, -INFINITY};
  *way = 0;
  for (long long tried = -1; tried < a->directions; ++tried) {
    const long long direction = tried < 0 ? *newest : tried;
    if (tried == *newest) continue;
    const gap along = gap_along(a, b, is, i, j, direction);
    if (along.distance > found->distance) {
      found->distance = along.distance;
      *way = direction;
    }
    if (along.bound > found->bound) found->bound = along.bound;
    if (settles(is, *found)) {
      *newest = direction;
      return 1;
    }
  }
  return 0;
}

static int is_part(const side* body, long long node) { return !body->of || body->of->first[node] == node; }

/* Put the pairs of the children of the larger node with the other one on the stack, the closest on top. Returns 0
   where there is no room. */
static int open_up(const side* a, const side* b, const state* is, long long i, long long j, long long way,
                   walk_stack* stack) {
  const int larger = a->of && (!b->of || a->of->size[i] > b->of->size[j]);
  const long long begin = larger ? a->of->first[i] : b->of->first[j];
  const long long end = larger ? a->of->last[i] : b->of->last[j];
  double distances[MOST_CHILDREN];
  long long* pairs = stack->pairs + 2 * stack->height;
  if (end - begin > MOST_CHILDREN || stack->height + end - begin > stack->room) return 0;
  for (long long node = begin; node < end; ++node) {
    const long long one = larger ? node : i, other = larger ? j : node;
    const double distance = gap_along(a, b, is, one, other, way).distance;
    long long place = node - begin;
    for (; place > 0 && distances[place - 1] < distance; --place) {
      distances[place] = distances[place - 1];
      pairs[2 * place] = pairs[2 * place - 2];
      pairs[2 * place + 1] = pairs[2 * place - 1];
    }
    distances[place] = distance;
    pairs[2 * place] = one;
    pairs[2 * place + 1] = other;
  }
  stack->height += end - begin;
  return 1;
}

/* Take pairs of nodes from the top of the stack until it is empty or `most` pairs of parts are left open; return how
   many are, or −1 where the stack has no room for more. */
static long long walk(const side* a, const side* b, state* is, walk_stack* stack, long long most, long long* open) {
  long long left = 0;
  while (stack->height > 0 && left < most) {
    --stack->height;
    const long long i = stack->pairs[2 * stack->height], j = stack->pairs[2 * stack->height + 1];
    gap found;
    long long way;
if (try_directions(a, b, is, i, j, &stack->newest, &found, &way)) {
      is->least = found.distance < is->least ? found.distance : is->least;
      is->proven = found.bound < is->proven ? found.bound : is->proven;
    } else if (is_part(a, i) && is_part(b, j)) {
      open[2 * left] = i;
      open[2 * left + 1] = j;
      ++left;
    } else if (!open_up(a, b, is, i, j, way, stack)) {
      return -1;
    }
  }
  return left;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_parts) {
  arguments taken = begin("parts", given, count);
  parts of;
  of.corners = numbers(&taken, "corners", SHAPE(ANY, 4, 3));
  of.nodes = taken.shape[0];
  of.radius = numbers(&taken, "radius", SHAPE(of.nodes));
  of.size = numbers(&taken, "size", SHAPE(of.nodes));
  of.first = indices(&taken, "first", 0, of.nodes, SHAPE(of.nodes));
  of.last = indices(&taken, "last", 0, of.nodes + 1, SHAPE(of.nodes));
  for (long long node = 0; !taken.failed && node < of.nodes; ++node) {
    const long long first = of.first[node], last = of.last[node];
    const int children = first < last && last <= node && last - first <= MOST_CHILDREN;
    if (!children && !(first == node && last == node + 1)) wrong(&taken, "last", "one beyond a part, or 64 nodes before");
  }
  return made(&taken, "parts", &of, sizeof of);
}

WRAPPER(make_side) {
  arguments taken = begin("side", given, count);
  side body;
  body.of = record_or_none(&taken, "parts", "parts");
  body.ways = numbers(&taken, "ways", SHAPE(ANY, 3, 3));
  body.directions = taken.shape[0];
  body.offsets = numbers(&taken, "offsets", SHAPE(body.directions, 3));
  return made(&taken, "side", &body, sizeof body);
}

static int has_node(const side* body, long long node) { return node >= 0 && node < (body->of ? body->of->nodes : 1); }

WRAPPER(call_walk) {
  arguments taken = begin("walk", given, count);
  const side *a = record(&taken, "a", "side"), *b = record(&taken, "b", "side");
  double* numbers_of = written(&taken, "state", SHAPE(7));
  walk_stack stack = {.pairs = written_indices(&taken, "stack", SHAPE(ANY, 2))};
  stack.room = taken.shape[0];
  long long* place = written_indices(&taken, "place", SHAPE(2));
  long long* open = written_indices(&taken, "open", SHAPE(ANY, 2));
  const long long most = taken.shape[0];
  if (!ready(&taken)) return ended(&taken, NULL);
  stack.height = place[0];
  stack.newest = place[1];
  if (a->directions != b->directions) wrong(&taken, "b", "along the directions of `a`");
  if (stack.height < 0 || stack.height > stack.room) wrong(&taken, "place", "on the stack");
  if (stack.newest < 0 || stack.newest >= a->directions) wrong(&taken, "place", "one of the directions");
  for (long long k = 0; !taken.failed && k < stack.height; ++k)
    if (!has_node(a, stack.pairs[2 * k]) || !has_node(b, stack.pairs[2 * k + 1])) wrong(&taken, "stack", "pairs of nodes");
  if (taken.failed) return ended(&taken, NULL);
  state is = {.least = numbers_of[0], .proven = numbers_of[1], .known = numbers_of[2], .within = numbers_of[3],
              .enough = numbers_of[4], .first = numbers_of[5], .second = numbers_of[6]};
  long long left = 0;
  WITHOUT_LOCK(left = walk(a, b, &is, &stack, most, open));
  if (left < 0) wrong(&taken, "stack", "as high as both trees are deep");
  numbers_of[0] = is.least;
  numbers_of[1] = is.proven;
  place[0] = stack.height;
  place[1] = stack.newest;
  return ended(&taken, PyLong_FromLongLong(left));
}

PyMethodDef parts_functions[] = {
    FUNCTION("parts", make_parts, "A tree of parts."),
    FUNCTION("side", make_side, "One of two bodies, and directions."),
    FUNCTION("walk", call_walk, "Settle pairs of nodes; returns how many pairs of parts are left open."),
    END_OF_FUNCTIONS,
};
