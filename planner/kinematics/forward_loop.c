/* The forward kinematics of many configurations: the recursion of `forward.py`, equal to NumPy's but for rounding. */

#include "forward_loop.h"

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

static const double WORLD[12] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0};

/* Rodrigues: R = a aᵀ + cos q (I − a aᵀ) + sin q [a]× */
static void rotation_about(const double* axis, double angle, double* rotation) {
  const double cosine = cos(angle), sine = sin(angle);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      rotation[3 * i + j] = axis[i] * axis[j] + cosine * ((i == j ? 1.0 : 0.0) - axis[i] * axis[j]);
  rotation[1] -= sine * axis[2];
  rotation[2] += sine * axis[1];
  rotation[3] += sine * axis[2];
  rotation[5] -= sine * axis[0];
  rotation[6] -= sine * axis[1];
  rotation[7] += sine * axis[0];
}

/* The placement of a joint that has `value`, and its column: the velocity of the point at the world's origin, and the
   angular velocity, for a unit rate; about an axis d through o they are o × d and d, along it d and 0. */
static void move_joint(const tree* arm, long long row, double value, const double* parent, double* placement,
                       double* column) {
  const double *local = arm->placed + 12 * row, *axis = arm->axes + 3 * row;
  double unmoved[9], rotation[9], *origin = placement + 9, direction[3];
  product(parent, local, unmoved);
  placed(parent, local + 9, origin);
  turned(unmoved, axis, direction);
  if (arm->turns[row]) {
    rotation_about(axis, value, rotation);
    product(unmoved, rotation, placement);
    cross(origin, direction, column);
    for (int i = 0; i < 3; ++i) column[3 + i] = direction[i];
    return;
  }
  for (int i = 0; i < 9; ++i) placement[i] = unmoved[i];
  for (int i = 0; i < 3; ++i) {
    column[i] = direction[i];
    column[3 + i] = 0.0;
    origin[i] += direction[i] * value;
  }
}

void forward(const tree* arm, long long batch, const double* q, double* placements, double* columns) {
  for (long long sample = 0; sample < batch; ++sample) {
    for (int i = 0; i < 12; ++i) placements[i] = WORLD[i];
    for (long long row = 0; row < arm->joints - 1; ++row) {
      const long long coordinate = arm->coordinates[row];
      move_joint(arm, row, q[coordinate], placements + 12 * arm->parents[row], placements + 12 * (row + 1),
                 columns + 6 * coordinate);
    }
    q += arm->n;
    placements += 12 * arm->joints;
    columns += 6 * arm->n;
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(make_tree) {
  arguments taken = begin("tree", given, count);
  const long long joints = whole(&taken, "joints", 1, 1LL << 16);
  tree arm = {.joints = joints, .n = whole(&taken, "n", 0, 1LL << 16)};
  arm.parents = indices(&taken, "parents", 0, joints, SHAPE(joints - 1));
  arm.coordinates = indices(&taken, "coordinates", 0, arm.n, SHAPE(joints - 1));
  arm.turns = indices(&taken, "turns", 0, 2, SHAPE(joints - 1));
  arm.placed = numbers(&taken, "placed", SHAPE(joints - 1, 12));
  arm.axes = numbers(&taken, "axes", SHAPE(joints - 1, 3));
  for (long long row = 0; !taken.failed && row < joints - 1; ++row)
    if (arm.parents[row] > row) wrong(&taken, "parents", "earlier joints");
  return made(&taken, "tree", &arm, sizeof arm);
}

WRAPPER(call_forward) {
  arguments taken = begin("forward", given, count);
  const tree* arm = record(&taken, "tree", "tree");
  const long long joints = arm ? arm->joints : 0, n = arm ? arm->n : 0;
  const double* q = numbers(&taken, "q", SHAPE(ANY, n));
  const long long batch = taken.shape[0];
  double* placements = written(&taken, "placements", SHAPE(batch, joints, 12));
  double* columns = written(&taken, "columns", SHAPE(batch, n, 6));
  if (ready(&taken)) WITHOUT_LOCK(forward(arm, batch, q, placements, columns));
  return ended(&taken, none());
}

PyMethodDef forward_functions[] = {
    FUNCTION("tree", make_tree, "A tree of joints."),
    FUNCTION("forward", call_forward, "Placements and columns at configurations."),
    END_OF_FUNCTIONS,
};
