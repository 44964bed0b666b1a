/* The fastest law along a path: `time_optimal.py` says what it is, and has the same in NumPy, equal to the bit. */

#include <math.h>

#include "../../distance/compiled/border.h"

/* Rows a ü + b u̇² ≤ c at the points of an even grid, of `step`: each (points, rows); no |ü| and no u̇² exceeds `most`. */
typedef struct {
  long long points, rows;
  const double *a, *b, *c;
  double step, most;
} limits;

/* Lines a u + b x ≤ c on one side, with a more than 0, or, from below, with −a in its place. */
typedef struct {
  double *a, *b, *c;
  long long count;
} side;

/* The squared path_speeds x that are left. */
typedef struct {
  double low, high;
  int none;
} range;

static void keep(range* left, double b, double c) {
  if (b > 0.0) {
    if (c / b < left->high) left->high = c / b;
  } else if (b < 0.0) {
    if (c / b > left->low) left->low = c / b;
  } else if (c < 0.0) {
    left->none = 1;
  }
}

static void put(side* above, side* below, range* left, double a, double b, double c) {
  if (a == 0.0) {
    keep(left, b, c);
    return;
  }
  side* const to = a > 0.0 ? above : below;
  to->a[to->count] = a > 0.0 ? a : -a;
  to->b[to->count] = b;
  to->c[to->count++] = c;
}

/* All lines on the acceleration u and the squared path_speed x at point i: the rows there and, with x + 2 step u, those of the
   next point, whose x is in `next`. */
static range gather(const limits* of, long long i, range next, side* above, side* below) {
  range left = {0.0, of->most, 0};
  const double twice = 2.0 * of->step;
  above->count = below->count = 0;
  for (long long r = i * of->rows; r < (i + 1) * of->rows; ++r) {
    const long long then = r + of->rows;
    put(above, below, &left, of->a[r], of->b[r], of->c[r]);
    put(above, below, &left, of->a[then] + twice * of->b[then], of->b[then], of->c[then]);
  }
  put(above, below, &left, twice, 1.0, next.high);
  put(above, below, &left, -twice, -1.0, -next.low);
  put(above, below, &left, 1.0, 0.0, of->most);
  put(above, below, &left, -1.0, 0.0, of->most);
  return left;
}

/* Which x leave a u: each line from above with each from below. */
static range eliminated(range left, const side* above, const side* below) {
  for (long long p = 0; p < above->count; ++p)
    for (long long q = 0; q < below->count; ++q)
      keep(&left, above->b[p] * below->a[q] + below->b[q] * above->a[p],
           above->c[p] * below->a[q] + below->c[q] * above->a[p]);
  return left;
}

/* Put the squared path_speeds of the fastest law (points) into x; the ends of their sets (points) are scratch. Returns whether
   there is one. */
static int time_optimal(const limits* of, side above, side below, double rounding, double slack, double* lows,
                        double* highs, double* x) {
  const long long last = of->points - 1;
  range next = {0.0, 0.0, 0};
  lows[last] = highs[last] = 0.0;
  for (long long i = last - 1; i >= 0; --i) {
    range left = gather(of, i, next, &above, &below);
    left = eliminated(left, &above, &below);
    if (left.none || left.low > left.high + rounding) return 0;
    if (left.low > left.high) left.low = left.high;
    lows[i] = left.low;
    highs[i] = left.high;
    next = left;
  }
  if (last < 0 || lows[0] > rounding) return 0;
  x[0] = 0.0;
  for (long long i = 0; i < last; ++i) {
    next = (range){lows[i + 1], highs[i + 1], 0};
    gather(of, i, next, &above, &below);
    double most = of->most;
    for (long long p = 0; p < above.count; ++p) {
      const double by_speed = above.b[p] * x[i], rounded = slack * (fabs(above.c[p]) + fabs(by_speed));
      const double u = (above.c[p] - by_speed + rounded) / above.a[p];
      if (u < most) most = u;
    }
    const double reached = x[i] + 2.0 * of->step * most;
    x[i + 1] = reached < next.low ? next.low : reached > next.high ? next.high : reached;
  }
  return 1;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

static side take_side(double* memory, long long count) {
  return (side){memory, memory ? memory + count : NULL, memory ? memory + 2 * count : NULL, 0};
}

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
  const long long lines = 2 * of.rows + 4;
  const side above = take_side(scratch(&taken, 3 * lines), lines), below = take_side(scratch(&taken, 3 * lines), lines);
  double* ends = scratch(&taken, 2 * of.points);
  int found = 0;
  if (ready(&taken))
    WITHOUT_LOCK(found = time_optimal(&of, above, below, rounding, slack, ends, ends + of.points, x));
  return ended(&taken, PyBool_FromLong(found));
}

PyMethodDef time_optimal_functions[] = {
    FUNCTION("time_optimal", call_time_optimal, "Whether there is a law within limits, and the squared path_speeds of the fastest."),
    END_OF_FUNCTIONS,
};
