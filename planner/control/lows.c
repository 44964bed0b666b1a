/* Where the distances of pairs are lowest on a way, as in `lows.py`. */

#include <math.h>
#include <stdlib.h>

#include "barrier_safety.h"

#include "../../distance/compiled/border.h"
#include "../collision/close_pairs.h"
#include "../collision/exact_loop.h"
#include "../collision/hdsdf_loop.h"

/* Pairs with their distance: the HD-SDF's order and length, or the solids between which it is exact. */
typedef struct {
  const tables* pairs;
  const solids* solids;
  long long gamma;
  double length;
} barrier;

/* A query of pairs, the first of which has the number `first`: `next` marks those of which only the first sample counts;
   those `inside` are straightened and shifted by `bent`. Wanted are pairs that are lower than their floors by `lower`. */
typedef struct {
  const barrier* of;
  long long first, joints, numbers, insides;
  const long long *next, *inside;
  const double *placements, *floors, *bent;
  double lower;
} query;

/* What was found: of each pair by how much it is above its floor where it is lowest, where that is, and the wrench. */
typedef struct {
  long long count, room, *samples, *pairs;
  double *over, *wrenches;
} lows;

/* A search: the pair that was looked at last, with where it is lowest so far; and room to project on planes. */
typedef struct {
  const query* query;
  lows* found;
  long long pair, sample;
  double value, wrench[6];
  projection room;
} search;

static int is_inside(const query* of, long long pair) {
  for (long long k = 0; k < of->insides; ++k)
    if (of->inside[k] == pair) return 1;
  return 0;
}

/* Keep the pair that was looked at last if it is low. Undoing the shaping keeps the order of its distances. */
static void finish(search* at) {
  const query* of = at->query;
  lows* found = at->found;
  double value = at->value, slope = 1.0;
  if (at->pair < 0 || !(value < INFINITY)) return;
  if (!of->of->solids && is_inside(of, at->pair))
    value = straightened(value, (double)of->of->gamma, of->of->length, &slope) + of->bent[at->pair];
  const double over = value - of->floors[at->pair], steep = slope > 0.0 ? 1.0 / slope : 0.0;
  if (!(over < of->lower)) return;
  const long long row = found->count++;
  if (row >= found->room) return;
  found->over[row] = over;
  found->samples[row] = at->sample;
  found->pairs[row] = at->pair;
  for (int i = 0; i < 6; ++i) found->wrenches[6 * row + i] = steep * at->wrench[i];
}

/* Δ of a pair of the tables at a sample; its wrench goes to `wrench`. No sample begins where another ended: depths are
   exact to 1e-9 m, and of a pair that does not move they must not differ from sample to sample. */
static double distance_of(search* at, long long sample, long long pair, double floor, double* wrench) {
  const barrier* of = at->query->of;
  const double* frames = at->query->placements + 12 * sample * at->query->joints;
  if (of->solids) {
    double normal[3] = {0.0, 0.0, 1.0};
    return exact(of->solids, of->pairs, pair, frames, floor, normal, wrench);
  }
  double separation;
  return hdsdf_of_pair(of->pairs, (int)of->gamma, of->length, pair, frames, &at->room, &separation, wrench);
}

/* Look at a row of pair `number`, `pair` of the tables; rows of one pair come after each other. */
static void look(search* at, long long sample, long long number, long long pair) {
  const query* of = at->query;
  double wrench[6];
  if (number != at->pair) {
    finish(at);
    at->pair = number;
    at->value = INFINITY;
  }
  if (sample > 0 && of->next[number]) return;
  const double value = distance_of(at, sample, pair, of->floors[number], wrench);
  if (!(value < at->value)) return;
  at->value = value;
  at->sample = sample;
  for (int i = 0; i < 6; ++i) at->wrench[i] = wrench[i];
}

/* A row of the broad phase. */
static void look_at_row(void* given, long long sample, long long pair, double apart, projection* of) {
  search* at = given;
  (void)apart, (void)of;
  look(at, sample, at->query->first + pair, pair);
}

/* The lows of pairs that no plane of `near` separates, at `batch` samples. Returns 0, or −1 without memory. */
static int lows_near(const query* of, const tables* near, long long batch, double least, lows* found) {
  search at = {.query = of, .found = found, .pair = -1};
  if (make_projection(of->of->pairs, &at.room)) return -1;
  const int failed = visit(near, batch, of->joints, of->placements, NULL, near->reach, least, look_at_row, &at);
  finish(&at);
  free(at.room.points);
  return failed;
}

/* The lows of pairs (count), `rows` of the tables, among samples. Returns 0, or −1 without memory. */
static int lows_among(const query* of, long long sampled, const long long* samples, long long count,
                      const long long* pairs, const long long* rows, lows* found) {
  search at = {.query = of, .found = found, .pair = -1};
  if (make_projection(of->of->pairs, &at.room)) return -1;
  for (long long k = 0; k < count; ++k)
    for (long long i = 0; i < sampled; ++i) look(&at, samples[i], pairs[k], rows[k]);
  finish(&at);
  free(at.room.points);
  return 0;
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_barrier) {
  arguments taken = begin("barrier", given, count);
  barrier of = {.pairs = record(&taken, "tables", "tables")};
  of.gamma = whole(&taken, "gamma", 1, 1000);
  of.length = number(&taken, "length");
  of.solids = record_or_none(&taken, "solids", "solids");
  if (of.solids && of.pairs && (of.solids->bodies != of.pairs->bodies || of.solids->boxes != of.pairs->boxes))
    wrong(&taken, "solids", "those of the tables");
  return made(&taken, "barrier", &of, sizeof of);
}

/* The arguments of both functions that describe the pairs; there are as many as floors. */
static long long take_pairs(arguments* taken, query* of) {
  of->of = record(taken, "barrier", "barrier");
  of->placements = numbers(taken, "placements", SHAPE(ANY, ANY, 12));
  const long long batch = taken->shape[0];
  of->joints = taken->shape[1];
  if (of->of && of->joints < of->of->pairs->joints) wrong(taken, "placements", "those of all joints");
  of->floors = numbers(taken, "floors", SHAPE(ANY));
  of->numbers = taken->shape[0];
  of->bent = numbers(taken, "bent", SHAPE(of->numbers));
  of->next = indices(taken, "next", 0, 2, SHAPE(of->numbers));
  of->inside = indices(taken, "inside", 0, of->numbers, SHAPE(ANY));
  of->insides = taken->shape[0];
  of->lower = number(taken, "lower");
  return batch;
}

static void take_lows(arguments* taken, lows* found) {
  found->over = written(taken, "over", SHAPE(ANY));
  found->room = taken->shape[0];
  found->samples = written_indices(taken, "samples", SHAPE(found->room));
  found->pairs = written_indices(taken, "pairs", SHAPE(found->room));
  found->wrenches = written(taken, "wrenches", SHAPE(found->room, 6));
}

WRAPPER(call_lows_near) {
  arguments taken = begin("lows_near", given, count);
  query of = {0};
  lows found = {0};
  int failed = 0;
  const long long batch = take_pairs(&taken, &of);
  const tables* near = record(&taken, "near", "tables");
  of.first = whole(&taken, "first", 0, MANY);
  if (near && of.of && near->pairs != of.of->pairs->pairs) wrong(&taken, "near", "the same pairs");
  if (near && near->joints > of.joints) wrong(&taken, "near", "pairs of joints that have placements");
  if (near && of.first + near->pairs > of.numbers) wrong(&taken, "first", "that of pairs with floors");
  const double least = number(&taken, "least");
  take_lows(&taken, &found);
  if (ready(&taken)) WITHOUT_LOCK(failed = lows_near(&of, near, batch, least, &found));
  return ended(&taken, failed ? no_memory() : PyLong_FromLongLong(found.count));
}

WRAPPER(call_lows_among) {
  arguments taken = begin("lows_among", given, count);
  query of = {0};
  lows found = {0};
  int failed = 0;
  const long long batch = take_pairs(&taken, &of);
  const long long* samples = indices(&taken, "at", 0, batch, SHAPE(ANY));
  const long long sampled = taken.shape[0];
  const long long* pairs = indices(&taken, "of", 0, of.numbers, SHAPE(ANY));
  const long long looked_at = taken.shape[0];
  const long long* rows = indices(&taken, "rows", 0, of.of ? of.of->pairs->pairs : 0, SHAPE(looked_at));
  take_lows(&taken, &found);
  if (ready(&taken)) WITHOUT_LOCK(failed = lows_among(&of, sampled, samples, looked_at, pairs, rows, &found));
  return ended(&taken, failed ? no_memory() : PyLong_FromLongLong(found.count));
}

PyMethodDef lows_functions[] = {
    FUNCTION("barrier", make_barrier, "Pairs with their distance."),
    FUNCTION("lows_near", call_lows_near, "Where pairs of the broad phase are lowest; returns their number."),
    FUNCTION("lows_among", call_lows_among, "Where pairs are lowest among samples; returns their number."),
    END_OF_FUNCTIONS,
};
