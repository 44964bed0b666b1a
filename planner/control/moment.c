/* Derivatives by the joints of wrenches on the first bodies of pairs, as in `moment.py`. */

#include "../../distance/compiled/border.h"

/* Rows (sample, pair), `count` of them: columns (…, n, 6) of samples, and by which sign a joint moves a pair (…, n). */
typedef struct {
  long long count, n;
  const double *columns, *moves, *wrench;
  const long long *samples, *pairs;
} requested_rows;

/* ∂Δ/∂q (count, n). */
static void turn(const requested_rows* of, double* gradient) {
  for (long long row = 0; row < of->count; ++row) {
    const double *column = of->columns + 6 * of->n * of->samples[row], *wrench = of->wrench + 6 * row;
    const double* moves = of->moves + of->n * of->pairs[row];
    for (long long j = 0; j < of->n; ++j, column += 6, ++gradient) {
      double sum = column[0] * wrench[0];
      for (int i = 1; i < 6; ++i) sum += column[i] * wrench[i];
      *gradient = sum * moves[j];
    }
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_by_joints) {
  arguments taken = begin("by_joints", given, count);
  requested_rows of = {.columns = numbers(&taken, "columns", SHAPE(ANY, ANY, 6))};
  const long long batch = taken.shape[0];
  of.n = taken.shape[1];
  of.moves = numbers(&taken, "moves", SHAPE(ANY, of.n));
  const long long pairs = taken.shape[0];
  of.samples = indices(&taken, "samples", 0, batch, SHAPE(ANY));
  of.count = taken.shape[0];
  of.pairs = indices(&taken, "pairs", 0, pairs, SHAPE(of.count));
  of.wrench = numbers(&taken, "wrench", SHAPE(of.count, 6));
  double* gradient = written(&taken, "gradient", SHAPE(of.count, of.n));
  if (ready(&taken)) WITHOUT_LOCK(turn(&of, gradient));
  return ended(&taken, none());
}

PyMethodDef moment_functions[] = {
    FUNCTION("by_joints", call_by_joints, "Derivatives of pairs by the joints, from wrenches."),
    END_OF_FUNCTIONS,
};
