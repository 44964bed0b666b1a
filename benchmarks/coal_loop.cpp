// coal's exact signed distance of two convex bodies in a C++ loop over many poses: what it costs without Python.
//
//     coal_loop FILE ROUNDS
//
// FILE, doubles: for each body the numbers of vertices and triangles, the vertices, the triangles' corners; the number
// of poses; for each pose 12 numbers of A and 12 of B, [R row by row | t]. Prints a line for each round: processor time
// per query [s] and the sum of all distances.

#include <coal/distance.h>
#include <coal/shape/convex.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <memory>
#include <vector>

using Hull = coal::Convex<coal::Triangle>;

static std::shared_ptr<Hull> read_body(const double*& at) {
  const auto vertices = static_cast<unsigned>(*at++), triangles = static_cast<unsigned>(*at++);
  auto points = std::make_shared<std::vector<coal::Vec3s>>();
  auto faces = std::make_shared<std::vector<coal::Triangle>>();
  for (unsigned k = 0; k < vertices; ++k, at += 3) points->emplace_back(at[0], at[1], at[2]);
  for (unsigned k = 0; k < triangles; ++k, at += 3)
    faces->emplace_back(static_cast<size_t>(at[0]), static_cast<size_t>(at[1]), static_cast<size_t>(at[2]));
  return std::make_shared<Hull>(points, vertices, faces, triangles);
}

static coal::Transform3s read_pose(const double* at) {
  coal::Matrix3s turn;
  turn << at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7], at[8];
  return coal::Transform3s(turn, coal::Vec3s(at[9], at[10], at[11]));
}

int main(int count, char** names) {
  if (count != 3) return 2;
  std::ifstream file(names[1], std::ios::binary | std::ios::ate);
  std::vector<double> numbers(static_cast<size_t>(file.tellg()) / sizeof(double));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(double)));
  const double* at = numbers.data();
  const auto a = read_body(at), b = read_body(at);
  const auto poses = static_cast<size_t>(*at++);
  coal::ComputeDistance distance(a.get(), b.get());
  coal::DistanceRequest request;
  request.enable_signed_distance = true;
  request.gjk_tolerance = request.epa_tolerance = 1e-10;
  coal::DistanceResult result;
  for (int round = 0; round < std::atoi(names[2]); ++round) {
    double sum = 0;
    const std::clock_t begin = std::clock();
    for (size_t k = 0; k < poses; ++k) {
      const coal::Transform3s place_a = read_pose(at + 24 * k), place_b = read_pose(at + 24 * k + 12);
      result.clear();
      sum += distance(place_a, place_b, request, result);
    }
    std::printf("%.17g %.17g\n", static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC / poses, sum);
  }
}
