/* The reach rho of many bodies: `Chain.reach_around` and `Chain.local_reach`, equal to NumPy's but for rounding. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

/* A tree of n joints: joint j + 1 moves coordinate j, turning or sliding; of each joint (0: the world) its parent, an
   earlier one, which coordinates carry it, and nine numbers of the way to its parent, as in `Chain._inward`. */
typedef struct {
  long long n;
  const long long *parents, *revolute, *carried;
  const double* inward;
} chain;

/* A cylinder about the axis of a joint: its radius, and where it begins and ends along the axis. */
typedef struct {
  double radius, low, high;
} cylinder;

/* How far the point of the axis at this height is beside the axis of the parent. */
static double beside(const double* inward, double height) {
  const double *offset = inward + 2, *slope = inward + 5;
  const double away[3] = {offset[0] + height * slope[0], offset[1] + height * slope[1], offset[2] + height * slope[2]};
  return norm(away);
}

/* A cylinder about the axis of the parent around one about the axis of a joint. */
static cylinder around(const double* inward, cylinder own) {
  const double tilt = inward[8] * own.radius;
  const double one = inward[0] + inward[1] * own.low, other = inward[0] + inward[1] * own.high;
  return (cylinder){
      .radius = own.radius + most_of(beside(inward, own.low), beside(inward, own.high)),
      .low = least_of(one, other) - tilt,
      .high = most_of(other, one) + tilt,
  };
}

/* rho (bodies, n), zeros before, of bodies in cylinders (bodies, 3) on joints; travel (n, 2) of every coordinate. */
static void reach_around(const chain* of, long long bodies, const long long* joints, const double* cylinders,
                         const double* travel, double* rho) {
  for (long long body = 0; body < bodies; ++body, rho += of->n, cylinders += 3) {
    cylinder bound = {cylinders[0], cylinders[1], cylinders[2]};
    for (long long joint = joints[body]; joint > 0; joint = of->parents[joint]) {
      const long long j = joint - 1;
      rho[j] = of->revolute[j] ? bound.radius : 1.0;
      if (!of->revolute[j]) {
        bound.low += travel[2 * j];
        bound.high += travel[2 * j + 1];
      }
      bound = around(of->inward + 9 * joint, bound);
    }
  }
}

/* Intervals: the axes (count, n, 3) at their midpoints, points on them (count, n, 3), and by how much each coordinate
   moves away from there (count, n). */
typedef struct {
  long long count;
  const double *axes, *origins, *half;
} moves;

/* The reach of one body, whose ball has a centre and a radius, on interval k: for each joint from the last inward the
   distance of its axis from any point of the ball, wherever the joints between bring it, and rho at most. What is
   not a number stays so, and proves nothing. */
static void ball_reach(const chain* of, const moves* during, long long k, const long long* carried, const double* rho,
                       const double* centre, double radius, double* local) {
  const long long n = of->n;
  double after = 0.0; /* how far the joints between move the ball */
  for (long long j = n - 1; j >= 0; --j) {
    const double *axis = during->axes + 3 * (k * n + j), *origin = during->origins + 3 * (k * n + j);
    double arm[3], across[3];
    if (!carried[j]) continue;
    local[j] = 1.0;
    if (of->revolute[j]) {
      difference(centre, origin, arm);
      cross(arm, axis, across);
      const double away = norm(across) + radius + after;
      local[j] = least_of(away, rho[j]);
    }
    after += during->half[k * n + j] * local[j];
  }
}

/* The smaller of rho (bodies, n) and what the bounding balls allow on each interval: (count, bodies, n), zeros before,
   which are not touched where nothing moves: so they take no memory. */
static void local_reach(const chain* of, const moves* during, long long bodies, const long long* joints,
                        const double* rho, const double* centres, const double* radii, double* local) {
  for (long long k = 0; k < during->count; ++k)
    for (long long body = 0; body < bodies; ++body, centres += 3, local += of->n)
      if (joints[body] != 0)
        ball_reach(of, during, k, of->carried + of->n * joints[body], rho + of->n * body, centres, radii[body], local);
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_chain) {
  arguments taken = begin("chain", given, count);
  chain of;
  of.revolute = indices(&taken, "revolute", 0, 2, SHAPE(ANY));
  of.n = taken.shape[0];
  of.parents = indices(&taken, "parents", 0, of.n + 1, SHAPE(of.n + 1));
  of.carried = indices(&taken, "carried", 0, 2, SHAPE(of.n + 1, of.n));
  of.inward = numbers(&taken, "inward", SHAPE(of.n + 1, 9));
  for (long long joint = 1; !taken.failed && joint <= of.n; ++joint)
    if (of.parents[joint] >= joint) wrong(&taken, "parents", "earlier joints");
  return made(&taken, "chain", &of, sizeof of);
}

WRAPPER(call_reach_around) {
  arguments taken = begin("reach_around", given, count);
  const chain* of = record(&taken, "chain", "chain");
  const long long n = of ? of->n : 0;
  const long long* joints = indices(&taken, "joints", 0, n + 1, SHAPE(ANY));
  const long long bodies = taken.shape[0];
  const double* cylinders = numbers(&taken, "cylinders", SHAPE(bodies, 3));
  const double* travel = numbers(&taken, "travel", SHAPE(n, 2));
  double* rho = written(&taken, "rho", SHAPE(bodies, n));
  if (ready(&taken)) WITHOUT_LOCK(reach_around(of, bodies, joints, cylinders, travel, rho));
  return ended(&taken, none());
}

WRAPPER(call_local_reach) {
  arguments taken = begin("local_reach", given, count);
  const chain* of = record(&taken, "chain", "chain");
  const long long n = of ? of->n : 0;
  const long long* joints = indices(&taken, "joints", 0, n + 1, SHAPE(ANY));
  const long long bodies = taken.shape[0];
  const double* rho = numbers(&taken, "rho", SHAPE(bodies, n));
  const double* centres = numbers(&taken, "centers", SHAPE(ANY, bodies, 3));
  moves during = {.count = taken.shape[0]};
  const double* radii = numbers(&taken, "radii", SHAPE(bodies));
  during.axes = numbers(&taken, "axes", SHAPE(during.count, n, 3));
  during.origins = numbers(&taken, "origins", SHAPE(during.count, n, 3));
  during.half = numbers(&taken, "half", SHAPE(during.count, n));
  double* local = written(&taken, "local", SHAPE(during.count, bodies, n));
  if (ready(&taken)) WITHOUT_LOCK(local_reach(of, &during, bodies, joints, rho, centres, radii, local));
  return ended(&taken, none());
}

PyMethodDef reach_functions[] = {
    FUNCTION("chain", make_chain, "A tree of joints, as in `Chain`."),
    FUNCTION("reach_around", call_reach_around, "What `Chain.reach_around` returns."),
    FUNCTION("local_reach", call_local_reach, "What `Chain.local_reach` returns."),
    END_OF_FUNCTIONS,
};
