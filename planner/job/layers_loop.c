/* Costs of steps between two layers of configurations: `Layers._between`, equal to NumPy's but for rounding. */

#include "../../distance/compiled/border.h"

#include <math.h>

/* Two layers, (count, n) and (others, n), of n joints: their speeds, and whether whole turns of each do not matter. */
typedef struct {
  long long n, count, others;
  const double *rows, *last, *quick;
  const long long* circles;
} layers;

/* The cost of one step, infinite where a joint moves farther than it may; most are after a joint or two. */
static double cost_of(const layers* of, const double* from, const double* to, double farthest, double turn) {
  double cost = 0.0;
  for (long long j = 0; j < of->n; ++j) {
    double step = to[j] - from[j];
    if (of->circles[j]) step -= turn * nearbyint(step / turn);
    if (!(fabs(step) <= farthest)) return INFINITY;
    step /= of->quick[j];
    cost += step * step;
  }
  return cost;
}

static void steps_between(const layers* of, double farthest, double turn, double* costs) {
  for (long long i = 0; i < of->count; ++i)
    for (long long k = 0; k < of->others; ++k)
      *costs++ = cost_of(of, of->last + of->n * k, of->rows + of->n * i, farthest, turn);
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_steps_between) {
  arguments taken = begin("steps_between", given, count);
  layers of;
  of.last = numbers(&taken, "last", SHAPE(ANY, ANY));
  of.others = taken.shape[0];
  of.n = taken.shape[1];
  of.rows = numbers(&taken, "rows", SHAPE(ANY, of.n));
  of.count = taken.shape[0];
  of.quick = numbers(&taken, "quick", SHAPE(of.n));
  of.circles = indices(&taken, "circles", 0, 2, SHAPE(of.n));
  const double farthest = number(&taken, "farthest"), turn = number(&taken, "turn");
  double* costs = written(&taken, "costs", SHAPE(of.count, of.others));
  if (ready(&taken)) WITHOUT_LOCK(steps_between(&of, farthest, turn, costs));
  return ended(&taken, none());
}

PyMethodDef layers_functions[] = {
    FUNCTION("steps_between", call_steps_between, "What `Layers._between` returns."),
    END_OF_FUNCTIONS,
};
