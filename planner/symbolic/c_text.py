"""The C that `hdplan codegen` writes, with placeholders for the scene's own parts."""

from __future__ import annotations

from string import Template

HEADER = Template("""\
/* $scene: forward kinematics, distances and penalty, written by hdplan $version.

   C99 with nothing but the C library's mathematics. Nothing is allocated, nothing is kept between calls: functions may
   be called from several threads. All loops have fixed lengths, so that the time of a call is bounded, and a call takes
   about $stack bytes of stack.

   Lengths are in metres, angles in radians. Poses are matrices (4, 4), row by row, in the world: [R p; 0 0 0 1]. Joint
   values q, ${PREFIX}_JOINTS of them, are in the order of ${prefix}_joint_names, [rad] or [m]; joints that follow
   others move along. */

#ifndef ${PREFIX}_H
#define ${PREFIX}_H

#define ${PREFIX}_JOINTS $joints     /* planned joints */
#define ${PREFIX}_LINKS $links      /* links and held objects */
#define ${PREFIX}_OBSTACLES $obstacles  /* obstacles, whose poses are inputs */
#define ${PREFIX}_PAIRS $pairs      /* pairs of bodies that are compared */

#ifdef __cplusplus
extern "C" {
#endif

extern const char *const ${prefix}_joint_names[$some_joints];
extern const double ${prefix}_lower[$some_joints], ${prefix}_upper[$some_joints]; /* [rad] or [m]; may be infinite */
extern const char *const ${prefix}_link_names[$some_links];
extern const char *const ${prefix}_obstacle_names[$some_obstacles];
extern const double ${prefix}_obstacle_poses[16 * $some_obstacles]; /* where the scene has them, at its beginning */
extern const char *const ${prefix}_pair_names[$some_pairs][2];     /* link and obstacle, or link and link */

/* The poses of all links: q (${PREFIX}_JOINTS) -> poses (${PREFIX}_LINKS, 16). Returns 0; 1 for values that are not
   finite: all poses are then NAN. */
int ${prefix}_kinematics(const double *q, double *poses);

/* The HD-SDF D of every pair [m], and its gradient by q [m/rad] or [m/m], of bodies enlarged by the scene's clearances:
   q (${PREFIX}_JOINTS), obstacles (${PREFIX}_OBSTACLES, 16) -> distance (${PREFIX}_PAIRS), gradient (${PREFIX}_PAIRS,
   ${PREFIX}_JOINTS), or NULL where it is not wanted. D > 0 proves that the pair is apart by more than the clearance; D
   is no metric distance. Returns 0; 1 for values that are not finite or poses that are not rigid: all results are then
   NAN. */
int ${prefix}_clearance(const double *q, const double *obstacles, double *distance, double *gradient);

/* The planner's penalty of a configuration, the sum of min(D, 0)^2 / 2 [m^2] over all pairs, of bodies enlarged also by
   how much earlier it sets in (planner.activation); and its gradient (${PREFIX}_JOINTS) by q, or NULL. As above. */
int ${prefix}_penalty(const double *q, const double *obstacles, double *penalty, double *gradient);

#ifdef __cplusplus
}
#endif

#endif
""")

SOURCE = Template("""\
/* $scene: see $prefix.h. Written by hdplan $version. */

#include "$prefix.h"

#include <math.h>
#include <stddef.h>

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "without -ffast-math: values that are no numbers must be seen"
#endif

/* ---- what CasADi wrote: the kinematics of the joints, and the distance of one pair with its wrench ---- */

$kernels
/* ---- the scene ---- */

#define VALUES $values  /* joints of the robot's model, those that follow others included */
#define FRAMES $frames  /* frames: the world, one for each of the joints, one for each obstacle */

const char *const ${prefix}_joint_names[$some_joints] = {$joint_names};
const double ${prefix}_lower[$some_joints] = {$lower};
const double ${prefix}_upper[$some_joints] = {$upper};
const char *const ${prefix}_link_names[$some_links] = {$link_names};
const char *const ${prefix}_obstacle_names[$some_obstacles] = {$obstacle_names};
const double ${prefix}_obstacle_poses[16 * $some_obstacles] = {$obstacle_poses};
const char *const ${prefix}_pair_names[$some_pairs][2] = {$pair_names};

typedef int kernel(const double **arg, double **res, int *iw, double *w, int mem);

static const struct { int frame; double placement[12]; } links[$some_links] = {$link_rows};
static const int leader[VALUES] = {$leader};      /* the planned joint with which each moves ... */
static const double factor[VALUES] = {$factor};  /* ... and by how much */

$tables
typedef struct {
  int frame, other;         /* that carry the two bodies */
  const double *body;       /* the vertices of one, their weights, and its radius */
  const double *planes;     /* the other's: normals and supports */
  kernel *distance;
  double earlier;           /* how much earlier the penalty sets in [m] */
  signed char moves[VALUES];  /* 1 where a joint moves the first body alone, -1 the other one alone, else 0 */
} pair;

static const pair pairs[$some_pairs] = {$pair_rows};

/* ---- the functions ---- */

static int all_finite(const double *values, int count) {
  int i;
  for (i = 0; i < count; ++i)
    if (!isfinite(values[i])) return 0;
  return 1;
}

static void spoil(double *values, int count) {
  int i;
  for (i = 0; values && i < count; ++i) values[i] = NAN;
}

/* Whether a pose is a rotation and a position, to rounding. */
static int rigid(const double *m) {
  double amiss = 0.0, dot, cross;
  int i, j;
  for (i = 0; i < 3; ++i)
    for (j = i; j < 3; ++j) {
      dot = m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j] - (i == j);
      amiss += dot * dot;
    }
  for (i = 0; i < 3; ++i) {  /* right-handed */
    cross = m[4 * ((i + 1) % 3)] * m[4 * ((i + 2) % 3) + 1] - m[4 * ((i + 2) % 3)] * m[4 * ((i + 1) % 3) + 1];
    amiss += (cross - m[4 * i + 2]) * (cross - m[4 * i + 2]);
  }
  amiss += m[12] * m[12] + m[13] * m[13] + m[14] * m[14] + (m[15] - 1.0) * (m[15] - 1.0);
  return amiss <= $rigid;
}

/* The frames of the world and the joints (12 each: the rotation row by row, then the origin), then those of the
   obstacles; behind them the screws of the joints (6 each), at state + 12 FRAMES. Returns 0, or 1. */
static int placed(const double *q, const double *obstacles, double *state) {
  const double *arg[$arguments];
  double *res[$results], w[$numbers], *pose = state + 12 * (VALUES + 1);
  int iw[$integers], i, j, k;
  if (!all_finite(q, ${PREFIX}_JOINTS)) return 1;
  for (k = 0; k < FRAMES - VALUES - 1; ++k, pose += 12, obstacles += 16) {
    if (!rigid(obstacles)) return 1;
    for (i = 0; i < 3; ++i) {
      for (j = 0; j < 3; ++j) pose[3 * i + j] = obstacles[4 * i + j];
      pose[9 + i] = obstacles[4 * i + 3];
    }
  }
  arg[0] = q;
  res[0] = state;
  res[1] = state + 12 * FRAMES;
  return ${prefix}_state(arg, res, iw, w, 0);
}

/* D of a pair of bodies that are `more` times enlarged by `earlier`, and its gradient, which may be NULL. */
static double distance_of(const pair *p, const double *state, double more, double *gradient) {
  const double *arg[$arguments], *screw = state + 12 * FRAMES;
  double *res[$results], w[$numbers], wrench[6], distance, slope;
  int iw[$integers], i, j;
  more *= p->earlier;
  arg[0] = state + 12 * p->frame;
  arg[1] = state + 12 * p->other;
  arg[2] = p->body;
  arg[3] = p->planes;
  arg[4] = &more;
  res[0] = &distance;
  res[1] = wrench;
  p->distance(arg, res, iw, w, 0);
  if (!gradient) return distance;
  for (j = 0; j < ${PREFIX}_JOINTS; ++j) gradient[j] = 0.0;
  for (j = 0; j < VALUES; ++j, screw += 6) {
    if (!p->moves[j]) continue;
    for (slope = 0.0, i = 0; i < 6; ++i) slope += screw[i] * wrench[i];
    gradient[leader[j]] += factor[j] * p->moves[j] * slope;
  }
  return distance;
}

int ${prefix}_kinematics(const double *q, double *poses) {
  double state[12 * FRAMES + 6 * VALUES];
  const double *arg[$arguments];
  double *res[$results], w[$numbers];
  int iw[$integers], i, j, k, l;
  if (!all_finite(q, ${PREFIX}_JOINTS)) {
    spoil(poses, 16 * ${PREFIX}_LINKS);
    return 1;
  }
  arg[0] = q;
  res[0] = state;
  res[1] = state + 12 * FRAMES;
  ${prefix}_state(arg, res, iw, w, 0);
  for (l = 0; l < ${PREFIX}_LINKS; ++l, poses += 16) {
    const double *frame = state + 12 * links[l].frame, *own = links[l].placement;
    for (i = 0; i < 3; ++i)
      for (j = 0; j < 4; ++j) {
        poses[4 * i + j] = j == 3 ? frame[9 + i] : 0.0;
        for (k = 0; k < 3; ++k) poses[4 * i + j] += frame[3 * i + k] * (j == 3 ? own[9 + k] : own[3 * k + j]);
      }
    for (j = 0; j < 4; ++j) poses[12 + j] = j == 3;
  }
  return 0;
}

int ${prefix}_clearance(const double *q, const double *obstacles, double *distance, double *gradient) {
  double state[12 * FRAMES + 6 * VALUES];
  int p;
  if (placed(q, obstacles, state)) {
    spoil(distance, ${PREFIX}_PAIRS);
    spoil(gradient, ${PREFIX}_PAIRS * ${PREFIX}_JOINTS);
    return 1;
  }
  for (p = 0; p < ${PREFIX}_PAIRS; ++p) {
    distance[p] = distance_of(pairs + p, state, 0.0, gradient);
    if (gradient) gradient += ${PREFIX}_JOINTS;
  }
  return 0;
}

int ${prefix}_penalty(const double *q, const double *obstacles, double *penalty, double *gradient) {
  double state[12 * FRAMES + 6 * VALUES], slope[${PREFIX}_JOINTS], distance;
  int j, p;
  if (placed(q, obstacles, state)) {
    spoil(penalty, 1);
    spoil(gradient, ${PREFIX}_JOINTS);
    return 1;
  }
  *penalty = 0.0;
  for (j = 0; gradient && j < ${PREFIX}_JOINTS; ++j) gradient[j] = 0.0;
  for (p = 0; p < ${PREFIX}_PAIRS; ++p) {
    distance = distance_of(pairs + p, state, 1.0, gradient ? slope : NULL);
    if (distance >= 0.0) continue;
    *penalty += 0.5 * distance * distance;
    for (j = 0; gradient && j < ${PREFIX}_JOINTS; ++j) gradient[j] += distance * slope[j];
  }
  return 0;
}
""")
