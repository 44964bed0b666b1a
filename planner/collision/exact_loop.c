/* The exact distance of pairs at samples, as in `exact.py`. */

#include "exact_loop.h"

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

static solid solid_of(const solids* of, long long k) {
  const double* radii = of->radii + 3 * k;
  return (solid){of->width[k], of->clusters[k], of->rows + of->first[k], radii[0] > 0.0 ? radii : NULL, of->discs[k], of->balls[k]};
}

/* A frame in another: found = A B, rotations row by row, then origins. */
static void composed(const double* a, const double* b, double* found) {
  product(a, b, found);
  placed(a, b + 9, found + 9);
}

/* The two solids of a pair, and where they are: the second in the world, and the first seen from it. */
typedef struct {
  solid first, second;
  double at_b[12], seen[12];
} placed_solids;

static void place_solids(const solids* of, const tables* pairs, long long pair, const double* frames, placed_solids* found) {
  const long long body = pairs->body[pair], other = of->bodies + pairs->box[pair];
  double at_a[12];
  found->first = solid_of(of, body);
  found->second = solid_of(of, other);
  composed(frames + 12 * pairs->joint_a[pair], of->places + 12 * body, at_a);
  composed(frames + 12 * pairs->joint_b[pair], of->places + 12 * other, found->at_b);
  seen_from(found->at_b, at_a, found->seen);
}

double gap(const solids* of, const tables* pairs, long long pair, const double* frames, double near, double far,
           double* normal) {
  placed_solids at;
  place_solids(of, pairs, pair, frames, &at);
  return gap_of(&(two_solids){&at.first, &at.second, at.seen}, near, far, normal);
}

/* How far a solid on a joint reaches along a vector of the world. */
static double reach_of(const solids* of, long long k, const double* frame, const double* v) {
  const solid body = solid_of(of, k);
  const double* place = of->places + 12 * k;
  double local[3], own[3];
  turned_back(frame, v, local);
  turned_back(place, local, own);
  return dot(v, frame + 9) + dot(local, place + 9) + reach_along(&body, own);
}

double gap_along(const solids* of, const tables* pairs, long long pair, const double* frames, const double* a,
                 const double* b) {
  const double back[3] = {-a[0], -a[1], -a[2]};
  const double *first = frames + 12 * pairs->joint_a[pair], *second = frames + 12 * pairs->joint_b[pair];
  return -reach_of(of, pairs->body[pair], first, back) - reach_of(of, of->bodies + pairs->box[pair], second, b);
}

double exact(const solids* of, const tables* pairs, long long pair, const double* frames, double far, double* normal,
             double* wrench) {
  const double margin = of->margins[pairs->box[pair]];
  double point[3], world[3];
  placed_solids at;
  place_solids(of, pairs, pair, frames, &at);
  const double distance = signed_distance(&(two_solids){&at.first, &at.second, at.seen}, margin + far, normal, point);
  turned(at.at_b, normal, wrench);
  placed(at.at_b, point, world);
  cross(world, wrench, wrench + 3);
  return distance - margin;
}

/* Rows (sample, pair), `count` of them, of placements (batch, joints, 12): D (count) and wrench (count, 6). */
static void exact_rows(const solids* of, const tables* pairs, long long joints, long long count, const double* placements,
                       const long long* sample, const long long* pair, double far, double* distance, double* wrench) {
  for (long long row = 0; row < count; ++row) {
    const double* frames = placements + 12 * sample[row] * joints;
    double normal[3] = {0.0, 0.0, 1.0};
    distance[row] = exact(of, pairs, pair[row], frames, far, normal, wrench + 6 * row);
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
  of.clusters = indices(&taken, "clusters", 0, MANY, SHAPE(all));
  of.rows = numbers(&taken, "rows", SHAPE(ANY));
  const long long held = taken.shape[0];
  for (long long k = 0; !taken.failed && k < all; ++k) {
    if (of.width[k] % 8 != 0 || of.first[k] + 3 * of.width[k] + 4 * of.clusters[k] > held)
      wrong(&taken, "width", "rows within `rows`");
    else if (of.clusters[k] % 8 != 0 || (of.clusters[k] && of.clusters[k] * 32 != of.width[k]))
      wrong(&taken, "clusters", "as many as there are vertices for, or 0");
  }
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
  const double far = number(&taken, "far");
  double* distance = written(&taken, "distance", SHAPE(rows));
  double* wrench = written(&taken, "wrench", SHAPE(rows, 6));
  if (ready(&taken))
    WITHOUT_LOCK(exact_rows(of, pairs, joints, rows, placements, sample, pair, far, distance, wrench));
  return ended(&taken, none());
}

PyMethodDef exact_functions[] = {
    FUNCTION("solids", make_solids, "The solids of bodies and boxes."),
    FUNCTION("exact_rows", call_exact_rows, "The exact signed distance and its wrench, of pairs at samples."),
    END_OF_FUNCTIONS,
};
