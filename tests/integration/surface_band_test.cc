#include "server/integration/surface_band.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "server/field/local_gp_field.h"
#include "server/integration/gap_bridging.h"
#include "server/integration/smallest_axis.h"
#include "tests/testing/band_accuracy.h"

namespace clearance {
namespace {

using Eigen::Vector3d;
using testing::BandError;
using testing::FusedBand;
using testing::FusionRun;
using testing::ViewedScene;

constexpr double kVoxel = 0.1;

struct Observed {
  LocalVoxels voxels;  // bridges included
  RangeImage image;
  BandObservations band;
};

Observed ObserveOnce(const DepthImage& depth, const Pose& T_W_X, double h, ObjectId id = {}) {
  RangeImage image = RangeImage::FromDepth(depth, 10.0);
  Eigen::Matrix3Xf points_X(3, depth.depth.size());
  std::vector<uint32_t> indices;
  for (size_t i = 0; i < depth.depth.size(); ++i) {
    const int u = static_cast<int>(i % depth.width), v = static_cast<int>(i / depth.width);
    if (!image.has_surface(u, v) || image.label(u, v) != id.value()) continue;
    points_X.col(i) = image.Point(u, v);
    indices.push_back(static_cast<uint32_t>(i));
  }
  BandOptions options;
  options.truncation_m = 2 * h;
  const LocalVoxels voxels = GatherVoxels(points_X, indices, T_W_X, h);
  BandObservations band = ObserveBand(voxels, image, T_W_X, id, SurfaceMap(h), options);
  return {WithBridges(voxels, image, T_W_X, id, 0), std::move(image), std::move(band)};
}

template <typename Fn>
void ForEach(const BandObservations& band, double h, const Fn& fn) {
  for (const BandObservations::Block& b : band.blocks) {
    for (uint32_t i = b.begin; i < b.end; ++i) {
      fn(VoxelCentre(VoxelAt(b.block, band.offset[i]), h), band.distance_m[i], band.weight[i]);
    }
  }
}

TEST(SurfaceBand, CrossingsOfEverySceneLieOnTheTrueSurface) {
  for (const ViewedScene& scene : testing::StandardScenes()) {
    const ViewedScene placed = scene.Moved(testing::RandomPose(17, 30.0));
    const FusionRun run;
    const FusedBand fused = testing::FuseScene(placed, run);
    const BandError e = testing::MeasureBand(fused, placed.scene, run.fusion);
    EXPECT_GT(e.crossing.size(), 3000u) << scene.scene.name();
    EXPECT_LT(BandError::Mean(e.crossing), 0.02 * kVoxel) << scene.scene.name();
    EXPECT_LT(BandError::Quantile(e.crossing, 0.99), 0.35 * kVoxel) << scene.scene.name();
    EXPECT_LT(BandError::Quantile(e.crossing, 0.9995), kVoxel) << scene.scene.name();
    EXPECT_LT(e.crossing.back(), 2 * kVoxel) << scene.scene.name();
    EXPECT_LT(e.wrong_sign, 0.005) << scene.scene.name();
    EXPECT_GT(e.covered, 0.985) << scene.scene.name();
  }
}

TEST(SurfaceBand, CrossingsStayTrueTenKilometresFromTheOrigin) {
  Pose far = testing::RandomPose(5, 1.0);
  far.translation() += Vector3d(-10'000, 8'000, 120);
  const ViewedScene placed = testing::SphereScene().Moved(far);
  const FusionRun run;
  const BandError e =
      testing::MeasureBand(testing::FuseScene(placed, run), placed.scene, run.fusion);
  EXPECT_LT(BandError::Mean(e.crossing), 0.01 * kVoxel);
  EXPECT_GT(e.covered, 0.99);
}

TEST(SurfaceBand, CrossingsStandNoise) {
  for (double noise_m : {0.01, 0.02, 0.05}) {
    FusionRun run;
    run.noise_m = noise_m;
    const ViewedScene placed = testing::BoxScene().Moved(testing::RandomPose(3, 30.0));
    const BandError e =
        testing::MeasureBand(testing::FuseScene(placed, run), placed.scene, run.fusion);
    EXPECT_LT(BandError::Rms(e.crossing), noise_m * 0.5) << noise_m;
    EXPECT_LT(e.wrong_sign, 0.02) << noise_m;
    EXPECT_GT(e.covered, 0.99) << noise_m;
  }
}

TEST(SurfaceBand, PoleThinnerThanAVoxelSurvivesFusionWhereverItStands) {
  for (uint32_t seed = 0; seed < 6; ++seed) {
    const ViewedScene placed = testing::PoleScene().Moved(testing::RandomPose(40 + seed, 3.0));
    const FusionRun run;
    const FusedBand fused = testing::FuseScene(placed, run);
    const std::vector<Vector3d> crossings =
        testing::ZeroCrossings(fused.map, run.fusion.min_weight);
    const testing::Solid& pole = placed.scene.solids().back();
    // Along its height, some crossing at every 10 cm.
    int present = 0, all = 0;
    for (double z = -1.0; z <= 1.0; z += 0.1, ++all) {
      const Vector3d axis = pole.T_W_P * Vector3d(0, 0, z);
      present += std::any_of(crossings.begin(), crossings.end(), [&](const Vector3d& c) {
        return (c - axis).norm() < 0.04 + 0.866 * kVoxel;
      });
    }
    EXPECT_GE(present, all - 2) << seed;
  }
}

TEST(SurfaceBand, NoCrossingFloatsBehindASilhouette) {
  // A box seen from one place: what is farther than half a voxel from true surface would be a wall
  // between "seen past" and "hidden".
  for (uint32_t seed = 0; seed < 4; ++seed) {
    FusionRun run;
    run.max_views = 1;
    const ViewedScene placed = testing::BoxScene().Moved(testing::RandomPose(60 + seed, 3.0));
    const FusedBand fused = testing::FuseScene(placed, run);
    const BandError e = testing::MeasureBand(fused, placed.scene, run.fusion);
    EXPECT_LT(e.crossing.back(), kVoxel);
    const auto far = std::lower_bound(e.crossing.begin(), e.crossing.end(), 0.5 * kVoxel);
    EXPECT_LT(static_cast<double>(e.crossing.end() - far) / e.crossing.size(), 0.003);
  }
}

// The field of one surface voxel by the oracle, with the centroids' curvature misses removed.
class OracleFields {
 public:
  explicit OracleFields(const LocalVoxels& voxels, const Vector3d& sensor) : voxels_(voxels) {
    for (const LocalVoxels::Block& b : voxels.blocks) {
      for (uint32_t i = b.begin; i < b.end; ++i) {
        const VoxelIndex v = VoxelAt(b.block, voxels.offset[i]);
        at_[{v.x(), v.y(), v.z()}] = i;
        index_.push_back(v);
        centre_.push_back(BlockOrigin(b.block, kVoxel) + voxels.centroid[i].cast<double>());
      }
    }
    for (uint32_t i = 0; i < centre_.size(); ++i) {
      const Neighbourhood n = NeighbourhoodOf(i);
      Eigen::Vector3f normal =
          SmallestAxis(n.points.data(), n.noise.data(), static_cast<int>(n.points.size()),
                       (sensor - centre_[i]).normalized().cast<float>());
      if (normal.dot((sensor - centre_[i]).cast<float>()) < 0) normal = -normal;
      normal_.push_back(normal);
      const GpSample own = TrainOn(n).Evaluate(Eigen::Vector3f::Zero());
      const float miss = -normal.dot(own.foot);
      miss_.push_back(std::abs(miss) < 0.5f * kVoxel ? Eigen::Vector3f(miss * normal)
                                                     : Eigen::Vector3f(Eigen::Vector3f::Zero()));
    }
  }

  struct Answer {
    double along_normal, length, plane;
  };
  Answer At(const Vector3d& x) const {
    uint32_t nearest = 0;
    for (uint32_t i = 1; i < centre_.size(); ++i) {
      if ((x - centre_[i]).norm() < (x - centre_[nearest]).norm()) nearest = i;
    }
    const Neighbourhood n = NeighbourhoodOf(nearest);
    LocalGpField field = TrainOn(n);
    Eigen::Matrix3Xf shift(3, n.points.size());
    for (size_t k = 0; k < n.voxel.size(); ++k) shift.col(k) = miss_[n.voxel[k]];
    field.ShiftPoints(shift);
    const Eigen::Vector3f from_centre = (x - centre_[nearest]).cast<float>();
    const Eigen::Vector3f away = from_centre - field.Evaluate(from_centre).foot;
    return {normal_[nearest].dot(away), away.norm(), normal_[nearest].dot(from_centre)};
  }

 private:
  struct Neighbourhood {  // around its own centroid
    std::vector<uint32_t> voxel;
    std::vector<Eigen::Vector3f> points;
    std::vector<float> noise;
  };
  Neighbourhood NeighbourhoodOf(uint32_t i) const {
    Neighbourhood n;
    double total = 0;
    for (int k = 0; k < 27; ++k) {
      const auto it = at_.find(
          {index_[i].x() + k / 9 - 1, index_[i].y() + k / 3 % 3 - 1, index_[i].z() + k % 3 - 1});
      if (it == at_.end()) continue;
      n.voxel.push_back(it->second);
      n.points.push_back((centre_[it->second] - centre_[i]).cast<float>());
      total += voxels_.count[it->second];
    }
    for (uint32_t j : n.voxel) {
      const double ratio = std::max(1.0, total / n.voxel.size() / voxels_.count[j]);
      n.noise.push_back(
          static_cast<float>(GpOptions{}.noise_variance * std::min(ratio * ratio, 100.0)));
    }
    return n;
  }
  static LocalGpField TrainOn(const Neighbourhood& n) {
    const Eigen::Index count = static_cast<Eigen::Index>(n.points.size());
    return *LocalGpField::Train(
        Eigen::Map<const Eigen::Matrix3Xf>(n.points[0].data(), 3, count),
        Eigen::Map<const Eigen::ArrayXf>(n.noise.data(), count),
        Kernel(KernelType::kSquaredExponential, GpOptions{}.length_scale_voxels * kVoxel));
  }

  const LocalVoxels& voxels_;
  std::map<std::array<int, 3>, uint32_t> at_;
  std::vector<VoxelIndex> index_;
  std::vector<Vector3d> centre_;
  std::vector<Eigen::Vector3f> normal_, miss_;
};

TEST(SurfaceBand, DistancesAreThoseOfTheGaussianProcessAndNotOfAPlane) {
  const ViewedScene scene = testing::BoxScene();
  const Pose T_W_X = testing::LookAt({2.2, 1.4, 1.6}, {0.3, 0.2, 1.0});
  testing::AnalyticScene box_alone("box", {scene.scene.solids()[1]});
  const Observed o = ObserveOnce(box_alone.RenderDepth(T_W_X, {}), T_W_X, kVoxel);
  const OracleFields oracle(o.voxels, T_W_X.translation());
  size_t n = 0, same = 0, same_as_plane = 0;
  ForEach(o.band, kVoxel, [&](const Vector3d& x, float d, float) {
    ++n;
    const OracleFields::Answer truth = oracle.At(x);
    const auto equals = [d](double a) { return std::abs(std::abs(d) - std::abs(a)) < 1e-3; };
    same += equals(truth.along_normal) || equals(truth.length);
    same_as_plane += equals(truth.plane);
  });
  ASSERT_GT(n, 300u);
  EXPECT_GT(static_cast<double>(same) / n, 0.99);
  // On the flat faces both agree; near the edges a plane would be told apart.
  EXPECT_LT(static_cast<double>(same_as_plane) / n, 0.9);
}

TEST(SurfaceBand, WeightIsOneMinusLatentVarianceInFront) {
  const ViewedScene scene = testing::PlaneScene();
  const Pose T_W_X = scene.views[0];
  const Observed o = ObserveOnce(scene.scene.RenderDepth(T_W_X, {}), T_W_X, kVoxel);
  int near = 0, far = 0;
  ForEach(o.band, kVoxel, [&](const Vector3d&, float d, float weight) {
    EXPECT_GT(weight, 0.f);
    EXPECT_LE(weight, 1.f);
    EXPECT_LE(std::abs(d), 2 * kVoxel);
    if (d > 0 && d < 0.1 * kVoxel) near += weight > 0.9f;
    // exp(-d^2 / l^2) with l = 1 voxel.
    if (d > 0.75 * kVoxel) far += weight < 0.6f;
  });
  EXPECT_GT(near, 50);
  EXPECT_GT(far, 50);
}

TEST(SurfaceBand, WritesNothingBehindAnotherMapsSurface) {
  testing::AnalyticScene scene = testing::BoxScene().scene;
  scene.solids()[1].label = 7;
  const Pose T_W_X = testing::BoxScene().views[0];
  const DepthImage depth = scene.RenderDepth(T_W_X, {});
  const Observed floor = ObserveOnce(depth, T_W_X, kVoxel);
  const testing::Solid& box = scene.solids()[1];
  ForEach(floor.band, kVoxel, [&](const Vector3d& x, float d, float) {
    // Inside the box the floor's map knows nothing but what it sees beside it.
    if (d < 0 && x.z() > 0.1 * kVoxel) {
      EXPECT_GT(box.Distance(x), -0.5 * kVoxel);
    }
  });
  const Observed object = ObserveOnce(depth, T_W_X, kVoxel, ObjectId(7));
  size_t inside = 0;
  ForEach(object.band, kVoxel, [&](const Vector3d& x, float d, float) {
    if (d >= 0) return;
    ++inside;
    EXPECT_LT(scene.Distance(x), 0.8 * kVoxel);  // the ground below it is solid too
  });
  EXPECT_GT(inside, 100u);
}

TEST(SurfaceBand, DoesNotDependOnTheNumberOfThreads) {
  const ViewedScene scene = testing::CornerScene();
  const DepthImage depth = scene.scene.RenderDepth(scene.views[2], {}, 0.01, 1);
  const Observed many = ObserveOnce(depth, scene.views[2], kVoxel);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Observed single = ObserveOnce(depth, scene.views[2], kVoxel);
  EXPECT_EQ(many.band.offset, single.band.offset);
  EXPECT_EQ(many.band.distance_m, single.band.distance_m);
  EXPECT_EQ(many.band.weight, single.band.weight);
}

TEST(SurfaceBand, BlocksAreSortedUniqueAndNotEmpty) {
  const ViewedScene scene = testing::BoxScene();
  const Observed o =
      ObserveOnce(scene.scene.RenderDepth(scene.views[0], {}), scene.views[0], kVoxel);
  uint32_t next = 0;
  for (size_t i = 0; i < o.band.blocks.size(); ++i) {
    const BandObservations::Block& b = o.band.blocks[i];
    if (i > 0) {
      EXPECT_LT(o.band.blocks[i - 1].block, b.block);
    }
    EXPECT_EQ(b.begin, next);
    EXPECT_GT(b.end, b.begin);
    next = b.end;
    EXPECT_TRUE(std::is_sorted(o.band.offset.begin() + b.begin, o.band.offset.begin() + b.end));
  }
  EXPECT_EQ(next, o.band.offset.size());
  EXPECT_EQ(next, o.band.distance_m.size());
  EXPECT_EQ(next, o.band.weight.size());
}

TEST(SurfaceBand, EveryKernelServes) {
  for (KernelType kernel : {KernelType::kMatern32, KernelType::kRationalQuadratic}) {
    FusionRun run;
    run.max_views = 2;
    run.band.gp.kernel = kernel;
    const ViewedScene placed = testing::BoxScene().Moved(testing::RandomPose(8, 10.0));
    const BandError e =
        testing::MeasureBand(testing::FuseScene(placed, run), placed.scene, run.fusion);
    EXPECT_LT(BandError::Mean(e.crossing), 0.05 * kVoxel);
    EXPECT_GT(e.covered, 0.98);
  }
}

TEST(SurfaceBand, NoVoxelsGiveNoObservations) {
  const RangeImage image = RangeImage::FromDepth(DepthImage{}, 10.0);
  EXPECT_TRUE(ObserveBand({}, image, Pose::Identity(), {}, SurfaceMap(0.1), {}).offset.empty());
}

}  // namespace
}  // namespace clearance
