#include "server/esdf/field_updater.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>

#include "tests/esdf/exact_world.h"

namespace clearance {
namespace {

using testing::CompareWithExact;
using testing::ExactWorld;
using testing::FieldErrors;
using testing::RandomSolid;

MapConfig Config(double voxel_size_m = 0.1, double max_distance_m = 2.0) {
  MapConfig config;
  config.voxel_size_m = voxel_size_m;
  config.max_distance_m = max_distance_m;
  return config;
}

// A world whose solids come, move and go at random about `centre`.
class ChangingWorld {
 public:
  ChangingWorld(uint32_t seed, const Eigen::Vector3d& centre, double extent_m = 3.0)
      : rng_(seed), centre_(centre), extent_m_(extent_m), world_(0.1) {}

  const SurfaceMap& map() const { return world_.map(); }
  size_t solids() const { return world_.solids().size(); }

  std::vector<BlockIndex> Step() {
    std::vector<Solid>& solids = world_.solids();
    std::vector<Aabb> touched;
    const uint32_t choice = rng_() % 3;
    if (solids.size() < 4 || choice == 0) {
      solids.push_back(RandomSolid(rng_, centre_, extent_m_));
      touched.push_back(world_.Bounds(solids.back()));
    } else {
      const size_t i = rng_() % solids.size();
      touched.push_back(world_.Bounds(solids[i]));
      if (choice == 1) {
        // From a nudge within a voxel to a jump across blocks.
        const double reach = rng_() % 2 ? 0.08 : 1.0;
        std::uniform_real_distribution<double> u(-reach, reach);
        solids[i].T_W_P.translation() += Eigen::Vector3d(u(rng_), u(rng_), u(rng_));
        touched.push_back(world_.Bounds(solids[i]));
      } else {
        solids.erase(solids.begin() + static_cast<int64_t>(i));
      }
    }
    return world_.Show(touched);
  }

 private:
  using Solid = testing::Solid;
  std::mt19937 rng_;
  Eigen::Vector3d centre_;
  double extent_m_;
  ExactWorld world_;
};

void ExpectAccurate(const FieldErrors& e) {
  EXPECT_GT(e.voxels, 1000u);
  EXPECT_EQ(e.phantoms, 0u);
  EXPECT_EQ(e.missing, 0u);
  EXPECT_LE(std::abs(e.mean), 0.03);
  EXPECT_LE(e.max, 0.5);
  printf("        voxels %zu  error mean %.4f  p99 %.3f  max %.3f voxel\n", e.voxels, e.mean, e.p99,
         e.max);
}

class FieldAfterChanges : public ::testing::TestWithParam<std::pair<uint32_t, double>> {};

TEST_P(FieldAfterChanges, IsAsExactAsOneBuiltFromScratch) {
  const auto [seed, offset] = GetParam();
  ChangingWorld world(seed, Eigen::Vector3d(offset, -offset, 0.5 * offset));
  FieldUpdater incremental(Config(), FusionOptions());
  DistanceField field;
  for (int step = 0; step < 100; ++step) {
    const std::vector<BlockIndex> changed = world.Step();
    field = incremental.Update(world.map(), changed);
    if (step % 25 == 24) ExpectAccurate(CompareWithExact(field, incremental.sites(), 5));
  }
  FieldUpdater scratch(Config(), FusionOptions());
  const DistanceField fresh = scratch.Update(world.map(), world.map().BandBlocks());
  ExpectAccurate(CompareWithExact(fresh, scratch.sites(), 5));
}

INSTANTIATE_TEST_SUITE_P(Places, FieldAfterChanges,
                         ::testing::Values(std::pair{1u, 0.0}, std::pair{2u, -2.4},
                                           std::pair{3u, 1e4}, std::pair{4u, -1e4}));

}  // namespace
}  // namespace clearance
