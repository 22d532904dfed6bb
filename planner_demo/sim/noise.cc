#include "planner_demo/sim/noise.h"

#include <algorithm>

#include "planner_demo/sim/random.h"

namespace clearance::sim {
namespace {

enum Stream : uint64_t { kDepth = 1, kMotion = 2 };

// Calls visit(other) for each pixel of the square around pixel (row, column).
template <typename Visit>
void ForNeighbours(const Scan& scan, int row, int column, int pixels, bool wraps, Visit visit) {
  for (int r = std::max(0, row - pixels); r <= std::min(scan.rows - 1, row + pixels); ++r) {
    for (int c = column - pixels; c <= column + pixels; ++c) {
      if (!wraps && (c < 0 || c >= scan.columns)) continue;
      visit(static_cast<size_t>(r) * scan.columns + (c + scan.columns) % scan.columns);
    }
  }
}

}  // namespace

void AddDepthNoise(double sigma_m, double max_range_m, uint64_t seed, int frame, Scan& scan) {
  if (sigma_m <= 0.0) return;
  Random random = Random::ForItem(seed, kDepth, frame);
  for (size_t i = 0; i < scan.ranges_m.size(); ++i) {
    const double error_m = random.Normal(sigma_m);  // one draw a pixel, whatever it sees
    if (scan.ranges_m[i] <= 0.0) continue;
    scan.ranges_m[i] += error_m;
    if (scan.ranges_m[i] <= 0.0 || scan.ranges_m[i] > max_range_m) {
      scan.ranges_m[i] = 0.0;
      scan.labels[i] = 0;
    }
  }
}

void ShrinkLabels(int pixels, bool wraps, Scan& scan) {
  if (pixels <= 0) return;
  const std::vector<uint16_t> before = scan.labels;
  for (int row = 0; row < scan.rows; ++row) {
    for (int column = 0; column < scan.columns; ++column) {
      const size_t i = static_cast<size_t>(row) * scan.columns + column;
      if (before[i] == 0) continue;
      ForNeighbours(scan, row, column, pixels, wraps, [&](size_t other) {
        if (before[other] != before[i]) scan.labels[i] = 0;
      });
    }
  }
}

void GrowLabels(int pixels, bool wraps, Scan& scan) {
  if (pixels <= 0) return;
  const std::vector<uint16_t> before = scan.labels;
  for (int row = 0; row < scan.rows; ++row) {
    for (int column = 0; column < scan.columns; ++column) {
      const size_t i = static_cast<size_t>(row) * scan.columns + column;
      if (before[i] == 0) continue;
      ForNeighbours(scan, row, column, pixels, wraps, [&](size_t other) {
        if (before[other] != 0 || scan.ranges_m[other] <= 0.0) return;
        uint16_t& label = scan.labels[other];
        label = label == 0 ? before[i] : std::min(label, before[i]);
      });
    }
  }
}

Eigen::Isometry3d AddMotionNoise(const Eigen::Isometry3d& H_W, const Eigen::Vector3d& centre_W,
                                 double sigma_m, uint64_t seed, uint16_t object_id, int frame) {
  if (sigma_m <= 0.0) return H_W;
  constexpr double kRotationPerMetre = 0.5;
  Random random = Random::ForItem(seed, kMotion, (static_cast<uint64_t>(object_id) << 32) + frame);
  const auto draw = [&random](double sigma) {
    const double x = random.Normal(sigma);
    const double y = random.Normal(sigma);
    return Eigen::Vector3d(x, y, random.Normal(sigma));
  };
  const Eigen::Vector3d shift_W = draw(sigma_m);
  const Eigen::Vector3d turn_W = draw(kRotationPerMetre * sigma_m);
  Eigen::Isometry3d error = Eigen::Isometry3d::Identity();
  error.linear() = Eigen::AngleAxisd(turn_W.norm(), turn_W.normalized()).toRotationMatrix();
  error.translation() = centre_W - error.linear() * centre_W + shift_W;
  return error * H_W;
}

}  // namespace clearance::sim
