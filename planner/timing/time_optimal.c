/* The fastest law along a path: `time_optimal.py` defines it, and computes it in NumPy, equal to the bit. */

#include <math.h>

#include "../../distance/compiled/border.h"

/* Rows a ü + b u̇² ≤ c at the points of an even grid, of `step`: each (points, rows); no |ü| and no u̇² exceeds `most`. */
typedef struct {
  long long points, rows;
  const double *a, *b, *c;
  double step, most;
} limits;

/* Lines a u + b x ≤ c on one side, with a more than 0, or, from below, with −a in its place. A line's number is that of its
   row, or, of the next point's rows, that and `rows`; MORE of them follow. */
typedef struct {
  double *a, *b, *c;
  long long* number;
  long long count;
} side;

enum { NEXT_HIGH, NEXT_LOW, MOST_ABOVE, MOST_BELOW, MORE, NONE = -1 };

/* The squared path speeds x that are left, and the numbers of the lines, one or two, that bound them from above. */
typedef struct {
  double low, high;
  int none;
  long long first, second;
} range;

static void keep(range* left, double b, double c, long long first, long long second) {
  if (b > 0.0) {
    if (c / b < left->high) {
      left->high = c / b;
      left->first = first;
      left->second = second;
    }
  } else if (b < 0.0) {
    if (c / b > left->low) left->low = c / b;
  } else if (c < 0.0) {
    left->none = 1;
  }
}

static void put(side* above, side* below, range* left, double a, double b, double c, long long number) {
  if (a == 0.0) {
    keep(left, b, c, number, NONE);
    return;
  }
  side* const to = a > 0.0 ? above : below;
  to->number[to->count] = number;
  to->a[to->count] = a > 0.0 ? a : -a;
  to->b[to->count] = b;
  to->c[to->count++] = c;
}

/* All lines on the acceleration u and the squared path speed x at point i: the rows there and, with x + 2 step u, those of the
   next point, whose x is in `next`. */
static range gather(const limits* of, long long i, range next, side* above, side* below) {
  range left = {0.0, of->most, 0, NONE, NONE};
  const double twice = 2.0 * of->step;
  const long long all = 2 * of->rows;
  above->count = below->count = 0;
  for (long long row = 0; row < of->rows; ++row) {
    const long long r = i * of->rows + row, then = r + of->rows;
    put(above, below, &left, of->a[r], of->b[r], of->c[r], row);
    put(above, below, &left, of->a[then] + twice * of->b[then], of->b[then], of->c[then], of->rows + row);
  }
  put(above, below, &left, twice, 1.0, next.high, all + NEXT_HIGH);
  put(above, below, &left, -twice, -1.0, -next.low, all + NEXT_LOW);
  put(above, below, &left, 1.0, 0.0, of->most, all + MOST_ABOVE);
  put(above, below, &left, -1.0, 0.0, of->most, all + MOST_BELOW);
  return left;
}

/* Which x leave a u: each line from above with each from below. */
static range eliminated(range left, const side* above, const side* below) {
  for (long long p = 0; p < above->count; ++p)
    for (long long q = 0; q < below->count; ++q)
      keep(&left, above->b[p] * below->a[q] + below->b[q] * above->a[p],
           above->c[p] * below->a[q] + below->c[q] * above->a[p], above->number[p], below->number[q]);
  return left;
}

/* Put the squared path speeds of the fastest law (points) into x, and the upper ends of their sets into highs; the lower
   ones (points) are scratch. What bounds them, by numbers of lines: `held` (points, 2) the sets, `pushed` (points) the step
   to a point. Returns whether there is a law. */
static int time_optimal(const limits* of, side above, side below, double rounding, double slack, double* lows,
                        double* highs, double* x, long long* held, long long* pushed) {
  const long long last = of->points - 1;
  range next = {0.0, 0.0, 0, NONE, NONE};
  if (last < 0) return 0;
  lows[last] = highs[last] = 0.0;
  held[2 * last] = held[2 * last + 1] = pushed[0] = NONE;
  for (long long i = last - 1; i >= 0; --i) {
    range left = gather(of, i, next, &above, &below);
    left = eliminated(left, &above, &below);
    if (left.none || left.low > left.high + rounding) return 0;
    if (left.low > left.high) left.low = left.high;
    lows[i] = left.low;
    highs[i] = left.high;
    held[2 * i] = left.first;
    held[2 * i + 1] = left.second;
    next = left;
  }
  if (lows[0] > rounding) return 0;
  x[0] = 0.0;
  for (long long i = 0; i < last; ++i) {
    next = (range){lows[i + 1], highs[i + 1], 0, NONE, NONE};
    gather(of, i, next, &above, &below);
    double most = of->most;
    long long number = 2 * of->rows + MOST_ABOVE;
    for (long long p = 0; p < above.count; ++p) {
      const double by_speed = above.b[p] * x[i], rounded = slack * (fabs(above.c[p]) + fabs(by_speed));
      const double u = (above.c[p] - by_speed + rounded) / above.a[p];
      if (u < most) {
        most = u;
        number = above.number[p];
      }
    }
    const double reached = x[i] + 2.0 * of->step * most;
    x[i + 1] = reached < next.low ? next.low : reached > next.high ? next.high : reached;
    pushed[i + 1] = reached < next.low ? 2 * of->rows + NEXT_LOW : reached > next.high ? 2 * of->rows + NEXT_HIGH : number;
  }
  return 1;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_time_optimal) {
  arguments taken = begin("time_optimal", given, count);
  limits of = {.a = numbers(&taken, "a", SHAPE(ANY, ANY))};
  of.points = taken.shape[0];
  of.rows = taken.shape[1];
  of.b = numbers(&taken, "b", SHAPE(of.points, of.rows));
  of.c = numbers(&taken, "c", SHAPE(of.points, of.rows));
  of.step = number(&taken, "step");
  of.most = number(&taken, "most");
  const double rounding = number(&taken, "rounding"), slack = number(&taken, "slack");
  double* x = written(&taken, "x", SHAPE(of.points));
  double* highs = written(&taken, "highs", SHAPE(of.points));
  long long* held = written_indices(&taken, "held", SHAPE(of.points, 2));
  long long* pushed = written_indices(&taken, "pushed", SHAPE(of.points));
  const long long lines = 2 * of.rows + MORE;
  double* sides = scratch(&taken, 6 * lines);
  long long* numbers_of = scratch_indices(&taken, 2 * lines);
  double* lows = scratch(&taken, of.points);
  int found = 0;
  if (ready(&taken)) {
    const side above = {sides, sides + lines, sides + 2 * lines, numbers_of, 0};
    const side below = {sides + 3 * lines, sides + 4 * lines, sides + 5 * lines, numbers_of + lines, 0};
    WITHOUT_LOCK(found = time_optimal(&of, above, below, rounding, slack, lows, highs, x, held, pushed));
  }
  return ended(&taken, PyBool_FromLong(found));
}

PyMethodDef time_optimal_functions[] = {
    FUNCTION("time_optimal", call_time_optimal, "Whether there is a law within limits, and the squared path speeds of the fastest."),
    END_OF_FUNCTIONS,
};
