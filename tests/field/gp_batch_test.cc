#include "server/field/gp_batch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "server/field/local_gp_field.h"

namespace clearance {
namespace {

using Eigen::Vector3f;

constexpr float kLength = 0.08f;

struct Neighbourhood {
  std::vector<Vector3f> points;
  std::vector<float> noise;
};

// Centroids near a curved surface through 3x3x3 voxels of 10 cm, as the live path has them.
Neighbourhood RandomNeighbourhood(std::mt19937& rng, int count) {
  std::uniform_real_distribution<float> u(-0.15f, 0.15f), noise(0.005f, 0.05f);
  Neighbourhood n;
  for (int i = 0; i < count; ++i) {
    const float x = u(rng), y = u(rng);
    n.points.emplace_back(x, y, 1.5f * x * x - 0.4f * y + 0.05f * u(rng));
    n.noise.push_back(noise(rng));
  }
  return n;
}

std::vector<Lanes> TrainBatch(const std::vector<Neighbourhood>& lanes, int size) {
  std::vector<Lanes> storage(GpBatch::Size(size));
  GpBatch gp(storage.data(), size);
  for (int lane = 0; lane < kLanes; ++lane) {
    const Neighbourhood& n = lanes[lane];
    const int count = static_cast<int>(n.points.size());
    for (int i = 0; i < count; ++i) gp.SetPoint(i, lane, n.points[i], n.noise[i]);
    for (int i = count; i < size; ++i) gp.Pad(i, lane);
  }
  gp.Train(kLength);
  return storage;
}

std::vector<Neighbourhood> RandomLanes(uint32_t seed, int& size) {
  std::mt19937 rng(seed);
  std::uniform_int_distribution<int> count(1, GpBatch::kMaxPoints);
  std::vector<Neighbourhood> lanes;
  size = 0;
  for (int lane = 0; lane < kLanes; ++lane) {
    lanes.push_back(RandomNeighbourhood(rng, count(rng)));
    size = std::max(size, static_cast<int>(lanes.back().points.size()));
  }
  return lanes;
}

TEST(GpBatch, EqualsTheOracleInEveryLane) {
  std::mt19937 rng(11);
  std::uniform_real_distribution<float> u(-0.12f, 0.12f);
  const Kernel kernel(KernelType::kSquaredExponential, kLength);
  for (uint32_t seed = 0; seed < 20; ++seed) {
    int size = 0;
    const std::vector<Neighbourhood> lanes = RandomLanes(seed, size);
    std::vector<Lanes> storage = TrainBatch(lanes, size);
    const GpBatch gp(storage.data(), size);
    for (int lane = 0; lane < kLanes; ++lane) {
      const Neighbourhood& n = lanes[lane];
      const int count = static_cast<int>(n.points.size());
      auto oracle =
          LocalGpField::Train(Eigen::Map<const Eigen::Matrix3Xf>(n.points[0].data(), 3, count),
                              Eigen::Map<const Eigen::ArrayXf>(n.noise.data(), count), kernel);
      ASSERT_TRUE(oracle);
      std::vector<Vector3f> shift(count);
      Eigen::Matrix3Xf shifts(3, count);
      for (int i = 0; i < count; ++i) {
        shift[i] = 0.1f * Vector3f(u(rng), u(rng), u(rng));
        shifts.col(i) = shift[i];
      }
      oracle->ShiftPoints(shifts);
      std::array<Lanes, 3> x;
      for (int k = 0; k < kLanes; ++k) {
        for (int axis = 0; axis < 3; ++axis) x[axis][k] = u(rng);
      }
      const GpBatch::Samples s = gp.Evaluate(lane, count, shift.data(), kLength, x);
      for (int k = 0; k < kLanes; ++k) {
        const GpSample truth = oracle->Evaluate({x[0][k], x[1][k], x[2][k]});
        EXPECT_NEAR(s.latent[k], truth.latent, 2e-4f);
        EXPECT_NEAR(s.variance[k], truth.variance, 2e-4f);
        if (truth.latent < 0.2f) continue;  // the foot divides by it
        const Vector3f foot(s.foot[0][k], s.foot[1][k], s.foot[2][k]);
        EXPECT_NEAR((foot - truth.foot).norm(), 0, 5e-4f) << seed << " " << lane << " " << k;
      }
    }
  }
}

TEST(GpBatch, LaneDoesNotDependOnItsNeighboursNorOnPadding) {
  int size = 0;
  std::vector<Neighbourhood> lanes = RandomLanes(3, size);
  lanes[2].points.resize(std::min<size_t>(lanes[2].points.size(), 9));
  lanes[2].noise.resize(lanes[2].points.size());
  int other_size = 0;
  std::vector<Neighbourhood> others = RandomLanes(4, other_size);
  others[5] = lanes[2];
  std::vector<Lanes> a = TrainBatch(lanes, GpBatch::kMaxPoints);
  std::vector<Lanes> b = TrainBatch(others, std::max(other_size, 9));
  const GpBatch gp_a(a.data(), GpBatch::kMaxPoints), gp_b(b.data(), std::max(other_size, 9));
  const int count = static_cast<int>(lanes[2].points.size());
  const std::vector<Vector3f> shift(count, Vector3f::Zero());
  std::array<Lanes, 3> x;
  for (int k = 0; k < kLanes; ++k) {
    for (int axis = 0; axis < 3; ++axis) x[axis][k] = 0.01f * (k + axis);
  }
  const GpBatch::Samples s = gp_a.Evaluate(2, count, shift.data(), kLength, x);
  const GpBatch::Samples t = gp_b.Evaluate(5, count, shift.data(), kLength, x);
  for (int k = 0; k < kLanes; ++k) {
    EXPECT_EQ(s.latent[k], t.latent[k]);
    EXPECT_EQ(s.variance[k], t.variance[k]);
    for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(s.foot[axis][k], t.foot[axis][k]);
  }
}

TEST(GpBatch, FootOfEveryLaneEqualsTheOracles) {
  int size = 0;
  const std::vector<Neighbourhood> lanes = RandomLanes(8, size);
  std::vector<Lanes> storage = TrainBatch(lanes, size);
  std::array<Lanes, 3> x, foot;
  for (int lane = 0; lane < kLanes; ++lane) {
    for (int axis = 0; axis < 3; ++axis) x[axis][lane] = lanes[lane].points[0][axis];
  }
  GpBatch(storage.data(), size).Foot(x.data(), kLength, foot.data());
  for (int lane = 0; lane < kLanes; ++lane) {
    const Neighbourhood& n = lanes[lane];
    const int count = static_cast<int>(n.points.size());
    const auto oracle =
        LocalGpField::Train(Eigen::Map<const Eigen::Matrix3Xf>(n.points[0].data(), 3, count),
                            Eigen::Map<const Eigen::ArrayXf>(n.noise.data(), count),
                            Kernel(KernelType::kSquaredExponential, kLength));
    const Vector3f truth = oracle->Evaluate(n.points[0]).foot;
    EXPECT_NEAR((Vector3f(foot[0][lane], foot[1][lane], foot[2][lane]) - truth).norm(), 0, 2e-4f);
  }
}

TEST(Lanes, ExponentialIsAccurateAndVanishesFarAway) {
  for (float a = 0; a > -79.f; a -= 0.37f) {
    const Lanes e = ExpOfNegative(Splat(a));
    EXPECT_NEAR(e[3] / std::exp(static_cast<double>(a)), 1, 4e-7) << a;
  }
  EXPECT_EQ(ExpOfNegative(Splat(-1e9f))[0], 0.f);
  EXPECT_EQ(ExpOfNegative(Splat(0.f))[0], 1.f);
}

}  // namespace
}  // namespace clearance
