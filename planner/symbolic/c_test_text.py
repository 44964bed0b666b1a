"""The files that `hdplan codegen` writes beside the C: how to build it, and a program that tests it."""

from __future__ import annotations

from string import Template

CMAKE = Template("""\
cmake_minimum_required(VERSION 3.10)
project($prefix C)

add_library($prefix STATIC $prefix.c)
set_target_properties($prefix PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF)
target_include_directories($prefix PUBLIC $${CMAKE_CURRENT_SOURCE_DIR})
target_link_libraries($prefix PUBLIC m)

add_executable(${prefix}_test ${prefix}_test.c)
set_target_properties(${prefix}_test PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF)
target_link_libraries(${prefix}_test PRIVATE $prefix)
enable_testing()
add_test(NAME ${prefix}_test COMMAND ${prefix}_test)
""")

TEST = Template("""\
/* $scene: $count configurations, with every obstacle somewhere else each time, and hdplan's own numbers of them.
   Returns 0 if $prefix.c gives the same. Written by hdplan $version. */

#include "$prefix.h"

#include <math.h>
#include <stdio.h>

#define COUNT $count
#define CLOSE 1e-9

static const double q[COUNT][$some_joints] = {$q};
static const double obstacles[COUNT][16 * $some_obstacles] = {$poses};
static const double poses[COUNT][16 * $some_links] = {$expected_poses};
static const double distance[COUNT][$some_pairs] = {$distance};
static const double slope[COUNT][$some_joints] = {$slope};  /* the gradients' sum, that of pair p by 1 / (1 + p) */
static const double penalty[COUNT] = {$penalty};
static const double pull[COUNT][$some_joints] = {$pull};    /* the penalty's gradient */

/* How far numbers are from those expected, in shares of the largest, or of `scale`. */
static double amiss(const double *found, const double *expected, int count, double scale) {
  double worst = 0.0;
  int i;
  for (i = 0; i < count; ++i) scale = fmax(scale, fabs(expected[i]));
  for (i = 0; i < count; ++i) {
    if (isnan(found[i])) return INFINITY;
    worst = fmax(worst, fabs(found[i] - expected[i]) / scale);
  }
  return worst;
}

int main(void) {
  static double found[16 * $some_links], distances[$some_pairs], gradients[$some_pairs * $some_joints];
  double worst[5] = {0.0, 0.0, 0.0, 0.0, 0.0}, sum[$some_joints], value;
  int k, p, j, failed = 0;
  for (k = 0; k < COUNT; ++k) {
    failed |= ${prefix}_kinematics(q[k], found);
    failed |= ${prefix}_clearance(q[k], obstacles[k], distances, gradients);
    for (j = 0; j < ${PREFIX}_JOINTS; ++j)
      for (sum[j] = 0.0, p = 0; p < ${PREFIX}_PAIRS; ++p) sum[j] += gradients[p * ${PREFIX}_JOINTS + j] / (1.0 + p);
    worst[0] = fmax(worst[0], amiss(found, poses[k], 16 * ${PREFIX}_LINKS, 1.0));
    worst[1] = fmax(worst[1], amiss(distances, distance[k], ${PREFIX}_PAIRS, 1.0));
    worst[2] = fmax(worst[2], amiss(sum, slope[k], ${PREFIX}_JOINTS, 1.0));
    failed |= ${prefix}_penalty(q[k], obstacles[k], &value, sum);
    worst[3] = fmax(worst[3], amiss(&value, &penalty[k], 1, 1e-4));
    worst[4] = fmax(worst[4], amiss(sum, pull[k], ${PREFIX}_JOINTS, 1e-4));
  }
  printf("largest errors: poses %.1e, distances %.1e, their gradients %.1e, ", worst[0], worst[1], worst[2]);
  printf("penalty %.1e, its gradient %.1e\\n", worst[3], worst[4]);
  for (k = 0; k < 5; ++k) failed |= !(worst[k] <= CLOSE);
  puts(failed ? "failed" : "passed");
  return failed;
}
""")
