#include "server/esdf/field_updater.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <atomic>
#include <mutex>
#include <random>
#include <string>
#include <thread>

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

// Every byte of a field, in order.
std::string Bytes(const DistanceField& field) {
  std::string bytes;
  field.ForEach(
      [&](const BlockIndex& b, const std::shared_ptr<const FieldBlock>& data, uint8_t tile) {
        bytes.append(reinterpret_cast<const char*>(&b), sizeof(b));
        bytes.push_back(static_cast<char>(tile));
        if (data) bytes.append(reinterpret_cast<const char*>(data.get()), sizeof(FieldBlock));
      });
  return bytes;
}

TEST(FieldUpdater, GivesTheSameBytesForAnyNumberOfThreads) {
  std::vector<std::string> bytes;
  for (size_t threads : {1, 2, 7}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
    ChangingWorld world(11, Eigen::Vector3d(-5, 3, 1));
    FieldUpdater updater(Config(), FusionOptions());
    std::string all;
    for (int step = 0; step < 15; ++step) all += Bytes(updater.Update(world.map(), world.Step()));
    bytes.push_back(all);
  }
  EXPECT_GT(bytes[0].size(), 1000000u);
  EXPECT_EQ(bytes[0], bytes[1]);
  EXPECT_EQ(bytes[0], bytes[2]);
}

TEST(FieldUpdater, LeavesEarlierFieldsUnchanged) {
  ChangingWorld world(12, Eigen::Vector3d::Zero());
  FieldUpdater updater(Config(), FusionOptions());
  std::vector<DistanceField> fields;
  std::vector<std::string> bytes;
  // More revisions than the pool's generations, let go of at odd times.
  for (int step = 0; step < 30; ++step) {
    fields.push_back(updater.Update(world.map(), world.Step()));
    bytes.push_back(Bytes(fields.back()));
    if (step % 3 == 2) {
      fields.erase(fields.begin() + step / 6);
      bytes.erase(bytes.begin() + step / 6);
    }
  }
  for (size_t i = 0; i < fields.size(); ++i) EXPECT_EQ(Bytes(fields[i]), bytes[i]) << i;
}

TEST(FieldUpdater, ReusesBlocksOnlyAfterEveryReaderLetGo) {
  ChangingWorld world(13, Eigen::Vector3d::Zero());
  FieldUpdater updater(Config(), FusionOptions());
  std::mutex mutex;
  DistanceField latest;
  std::atomic<bool> done = false;
  std::atomic<int> torn = 0;
  std::thread reader([&] {
    while (!done) {
      DistanceField field;
      {
        const std::lock_guard<std::mutex> lock(mutex);
        field = latest;
      }
      const std::string first = Bytes(field);
      torn += Bytes(field) != first;
    }
  });
  for (int step = 0; step < 40; ++step) {
    DistanceField field = updater.Update(world.map(), world.Step());
    const std::lock_guard<std::mutex> lock(mutex);
    latest = std::move(field);
  }
  done = true;
  reader.join();
  EXPECT_EQ(torn, 0);
}

TEST(FieldUpdater, SharesTheBlocksThatDidNotChange) {
  ExactWorld world(0.1);
  std::mt19937 rng(5);
  for (int i = 0; i < 6; ++i) {
    world.solids().push_back(RandomSolid(rng, Eigen::Vector3d(6.0 * i, 0, 0), 1.0));
  }
  std::vector<Aabb> all;
  for (const auto& solid : world.solids()) all.push_back(world.Bounds(solid));
  FieldUpdater updater(Config(), FusionOptions());
  const DistanceField before = updater.Update(world.map(), world.Show(all));
  const Aabb last = world.Bounds(world.solids().back());
  world.solids().pop_back();
  const DistanceField after = updater.Update(world.map(), world.Show({last}));
  size_t shared = 0, far = 0;
  before.ForEach([&](const BlockIndex& b, const std::shared_ptr<const FieldBlock>& data, uint8_t) {
    const Aabb reach(last.min() - Eigen::Vector3d::Constant(4), last.max());
    if (!data || BlockOrigin(b, 0.1).x() > reach.min().x()) return;
    ++far;
    shared += after.FindBlock(b) == data.get();
  });
  EXPECT_GT(far, 100u);
  EXPECT_EQ(shared, far);
}

TEST(FieldUpdater, WorksNoHarderInALargerMap) {
  const auto work = [](int others) {
    ExactWorld world(0.1);
    std::mt19937 rng(6);
    world.solids().push_back(RandomSolid(rng, Eigen::Vector3d::Zero(), 0.5));
    for (int i = 0; i < others; ++i) {
      world.solids().push_back(RandomSolid(rng, Eigen::Vector3d(12.0 + 3.0 * i, 0, 0), 1.0));
    }
    std::vector<Aabb> all;
    for (const auto& solid : world.solids()) all.push_back(world.Bounds(solid));
    FieldUpdater updater(Config(), FusionOptions());
    updater.Update(world.map(), world.Show(all));
    const Aabb old = world.Bounds(world.solids()[0]);
    world.solids()[0].T_W_P.translation().y() += 0.5;
    updater.Update(world.map(), world.Show({old, world.Bounds(world.solids()[0])}));
    return updater.stats();
  };
  const FieldUpdater::Stats small = work(0), large = work(20);
  EXPECT_GT(small.swept_blocks, 50u);
  EXPECT_EQ(small.extracted_blocks, large.extracted_blocks);
  EXPECT_EQ(small.scanned_blocks, large.scanned_blocks);
  EXPECT_EQ(small.swept_blocks, large.swept_blocks);
  EXPECT_EQ(small.written_blocks, large.written_blocks);
}

TEST(FieldUpdater, IsEmptyAgainWhenAllSurfaceIsGone) {
  ExactWorld world(0.1);
  std::mt19937 rng(7);
  for (int i = 0; i < 3; ++i) {
    world.solids().push_back(RandomSolid(rng, Eigen::Vector3d::Zero(), 2.0));
  }
  std::vector<Aabb> all;
  for (const auto& solid : world.solids()) all.push_back(world.Bounds(solid));
  FieldUpdater updater(Config(), FusionOptions());
  EXPECT_FALSE(updater.Update(world.map(), world.Show(all)).empty());
  world.solids().clear();
  const DistanceField gone = updater.Update(world.map(), world.Show(all));
  EXPECT_EQ(gone.BlockCount(), 0u);
  EXPECT_TRUE(gone.empty());
}

TEST(FieldUpdater, SignsUnseenSpaceBehindASurfaceAndNothingElse) {
  ExactWorld world(0.1);
  testing::Solid ball;
  ball.kind = testing::Solid::Kind::kSphere;
  ball.T_W_P.translation() = Eigen::Vector3d(-7, 4, 2);
  ball.size.setConstant(1.6);
  world.solids().push_back(ball);
  FieldUpdater updater(Config(), FusionOptions());
  const DistanceField field = updater.Update(world.map(), world.Show({world.Bounds(ball)}));
  size_t inside = 0, outside = 0;
  field.ForEach([&](const BlockIndex& b, const std::shared_ptr<const FieldBlock>& data, uint8_t) {
    for (int o = 0; data && o < kBlockVoxels; ++o) {
      const FieldVoxel& v = data->voxels[o];
      const double d = ball.Distance(VoxelCentre(VoxelAt(b, o), 0.1));
      if (!v.has_site() || std::abs(d) < 0.01) continue;
      if (d > 0) {
        EXPECT_FALSE(v.negative()) << d;
        ++outside;
      } else if (d > -0.9) {
        EXPECT_TRUE(v.negative()) << d;
        ++inside;
      } else if (d < -1.1) {
        EXPECT_FALSE(v.negative()) << d;  // too deep to claim anything
      }
      if (d < -0.3) {
        EXPECT_EQ(v.state(), VoxelState::kUnknown);
      }
    }
  });
  EXPECT_GT(inside, 1000u);
  EXPECT_GT(outside, 1000u);
}

TEST(FieldUpdater, PublishesUniformSpaceBeyondReachAsTiles) {
  ExactWorld world(0.1);
  testing::Solid ball;
  ball.kind = testing::Solid::Kind::kSphere;
  ball.size.setConstant(0.5);
  world.solids().push_back(ball);
  FieldUpdater updater(Config(0.1, 1.0), FusionOptions());
  const Aabb box(Eigen::Vector3d::Constant(-4), Eigen::Vector3d::Constant(3.9));
  const DistanceField field = updater.Update(world.map(), world.Show({box}, true));
  size_t tiles = 0;
  field.ForEach(
      [&](const BlockIndex& b, const std::shared_ptr<const FieldBlock>& data, uint8_t tile) {
        const double d = ball.Distance(BlockOrigin(b, 0.1) + Eigen::Vector3d::Constant(0.4));
        if (!data) {
          ++tiles;
          EXPECT_EQ(tile & 3, static_cast<int>(VoxelState::kFree));
          EXPECT_GT(d, 1.0 - 0.7);
        }
      });
  EXPECT_GT(tiles, 300u);
  const FieldVoxel far = field.At(VoxelOf(Eigen::Vector3d(-3.5, 3, 3), 0.1));
  EXPECT_EQ(far.state(), VoxelState::kFree);
  EXPECT_FALSE(far.has_site());
}

TEST(FieldUpdater, ReachesTheLargestDistanceThatOffsetsCanHold) {
  ExactWorld world(0.1);
  testing::Solid ball;
  ball.kind = testing::Solid::Kind::kSphere;
  ball.size.setConstant(0.2);
  world.solids().push_back(ball);
  FieldUpdater updater(Config(0.1, 12.0), FusionOptions());
  const DistanceField field = updater.Update(world.map(), world.Show({world.Bounds(ball)}));
  std::mt19937 rng(8);
  std::uniform_real_distribution<double> u(-1, 1);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d p =
        Eigen::Vector3d(u(rng), u(rng), u(rng)).normalized() * (0.5 + 11.2 * std::abs(u(rng)));
    const FieldVoxel v = field.At(VoxelOf(p, 0.1));
    ASSERT_TRUE(v.has_site()) << p.transpose();
    const double d = ball.Distance(VoxelCentre(VoxelOf(p, 0.1), 0.1));
    EXPECT_NEAR(v.to_site_voxels().norm() * 0.1, d, 0.05);
  }
}

}  // namespace
}  // namespace clearance
