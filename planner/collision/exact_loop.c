/* The exact distance of pairs at samples, as `exact.py` says. */

#include "exact_loop.h"

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

static solid solid_of(const solids* of, long long k) {
  const double* radii = of->radii + 3 * k;
  return (solid){of->width[k], of->rows + of->first[k], radii[0] > 0.0 ? radii : NULL, of->discs[k], of->balls[k]};
}

/* A frame in another: found = A B, rotations row by row, then origins. */
static void composed(const double* a, const double* b, double* found) {
  product(a, b, found);
  placed(a, b + 9, found + 9);
}

double exact(const solids* of, const tables* pairs, long long pair, const double* frames, double* normal, double* wrench) {
  const long long body = pairs->body[pair], box = pairs->box[pair], other = of->bodies + box;
  const double margin = of->margins[box];
  const solid first = solid_of(of, body), second = solid_of(of, other);
  double at_a[12], at_b[12], seen[12], apart[3], point[3];
  composed(frames + 12 * pairs->joint_a[pair], of->places + 12 * body, at_a);
  composed(frames + 12 * pairs->joint_b[pair], of->places + 12 * other, at_b);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) seen[3 * i + j] = at_b[i] * at_a[j] + at_b[3 + i] * at_a[3 + j] + at_b[6 + i] * at_a[6 + j];
  difference(at_a + 9, at_b + 9, apart);
  turned_back(at_b, apart, seen + 9);
  const two_solids both = {&first, &second, seen};
  const double distance = signed_distance(&both, margin, normal, point);
  double world[3];
  turned(at_b, normal, wrench);
  placed(at_b, point, world);
  cross(world, wrench, wrench + 3);
  return distance - margin;
}

/* Rows (sample, pair), `count` of them, of placements (batch, joints, 12): D (count) and wrench (count, 6). */
static void exact_rows(const solids* of, const tables* pairs, long long joints, long long count, const double* placements,
                       const long long* sample, const long long* pair, double* distance, double* wrench) {
  for (long long row = 0; row < count; ++row) {
    const double* frames = placements + 12 * sample[row] * joints;
    double normal[3] = {0.0, 0.0, 1.0};
    distance[row] = exact(of, pairs, pair[row], frames, normal, wrench + 6 * row);
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_solids) {
  arguments taken = begin("solids", given, count);
  solids of = {.bodies = whole(&taken, "bodies", 0, MANY)};
  of.first = indices(&taken, "first", 0, MANY, SHAPE(ANY));
  const long long all = taken.shape[0];
  of.boxes = all - of.bodies;
  if (of.boxes < 0) wrong(&taken, "first", "one for each of the bodies, then of the boxes");
  of.width = indices(&taken, "width", 8, MANY, SHAPE(all));
  of.rows = numbers(&taken, "rows", SHAPE(ANY));
  const long long held = taken.shape[0];
  for (long long k = 0; !taken.failed && k < all; ++k)
    if (of.width[k] % 8 != 0 || of.first[k] + 3 * of.width[k] > held) wrong(&taken, "width", "rows within `rows`");
  of.discs = numbers(&taken, "discs", SHAPE(all));
  of.radii = numbers(&taken, "radii", SHAPE(all, 3));
  of.balls = numbers(&taken, "balls", SHAPE(all));
  of.places = numbers(&taken, "places", SHAPE(all, 12));
  of.margins = numbers(&taken, "margins", SHAPE(taken.failed ? 0 : of.boxes));
  return made(&taken, "solids", &of, sizeof of);
}

WRAPPER(call_exact_rows) {
  arguments taken = begin("exact_rows", given, count);
  const solids* of = record(&taken, "solids", "solids");
  const tables* pairs = record(&taken, "tables", "tables");
  if (of && pairs && (of->bodies != pairs->bodies || of->boxes != pairs->boxes)) wrong(&taken, "tables", "of these solids");
  const double* placements = numbers(&taken, "placements", SHAPE(ANY, ANY, 12));
  const long long batch = taken.shape[0], joints = taken.shape[1];
  if (pairs && joints < pairs->joints) wrong(&taken, "placements", "those of all joints");
  const long long* sample = indices(&taken, "samples", 0, batch, SHAPE(ANY));
  const long long rows = taken.shape[0];
  const long long* pair = indices(&taken, "pairs", 0, pairs ? pairs->pairs : 0, SHAPE(rows));
  double* distance = written(&taken, "distance", SHAPE(rows));
  double* wrench = written(&taken, "wrench", SHAPE(rows, 6));
  if (ready(&taken))
    WITHOUT_LOCK(exact_rows(of, pairs, joints, rows, placements, sample, pair, distance, wrench));
  return ended(&taken, none());
}

PyMethodDef exact_functions[] = {
    FUNCTION("solids", make_solids, "The solids of bodies and boxes."),
    FUNCTION("exact_rows", call_exact_rows, "The exact signed distance and its wrench, of pairs at samples."),
    END_OF_FUNCTIONS,
};
