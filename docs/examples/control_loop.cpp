// A control loop in C++ with what `hdplan codegen planar_arm -o planar_arm_c` wrote: every millisecond the arm turns
// toward a goal, pushed away by the penalty, while a ball comes along.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iterator>

#include "planar_arm.h"

int main() {
  constexpr int joints = PLANAR_ARM_JOINTS, pairs = PLANAR_ARM_PAIRS;
  const double goal[joints] = {1.0, 0.4}, period = 1e-3, stiffness = 4.0, push = 2e4;
  double q[joints] = {-0.8, 2.0}, obstacles[16 * PLANAR_ARM_OBSTACLES];
  std::copy(std::begin(planar_arm_obstacle_poses), std::end(planar_arm_obstacle_poses), obstacles);
  double closest = 1.0, spent = 0.0;
  for (int cycle = 0; cycle < 6000; ++cycle) {
    obstacles[3] = 0.45 + 0.3 * std::max(0.0, 3.0 - cycle * period);  // the ball's x and y: it comes from afar
    obstacles[7] = 0.75;
    const auto began = std::chrono::steady_clock::now();
    double penalty, pull[joints], distance[pairs];
    if (planar_arm_penalty(q, obstacles, &penalty, pull) != 0) return 1;  // a number that is none: stop
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
    spent += took.count();
    for (int j = 0; j < joints; ++j) {
      const double speed = stiffness * (goal[j] - q[j]) - push * pull[j];
      q[j] = std::clamp(q[j] + period * std::clamp(speed, -1.0, 1.0), planar_arm_lower[j], planar_arm_upper[j]);
    }
    if (planar_arm_clearance(q, obstacles, distance, nullptr) != 0) return 1;
    closest = std::min(closest, *std::min_element(distance, distance + pairs));
  }
  std::printf("at %.3f %.3f rad; least D %.4f m; %.1f us for an evaluation\n", q[0], q[1], closest, 1e6 * spent / 6000);
  return closest > 0.0 ? 0 : 1;
}
