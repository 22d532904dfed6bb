#include "server/integration/surface_band.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/integration/band_value.h"
#include "server/integration/gap_bridging.h"
#include "server/integration/nearest_surface.h"
#include "server/integration/sight.h"
#include "server/integration/surface_fields.h"

namespace clearance {
namespace {

// A voxel's centre is of use up to where v = max_latent_variance: over a plane v = 1 -
// exp(-d^2 / l^2), and the nearest centroid may be half a voxel's diagonal aside.
float ReachVoxels(const BandOptions& options, double voxel_size_m) {
  const double l = options.gp.length_scale_voxels;
  const double along2 = -l * l * std::log(1.0 - options.gp.max_latent_variance);
  return static_cast<float>(
      std::min(options.truncation_m / voxel_size_m, 1.1 * std::sqrt(along2 + 0.5)));
}

struct BlockResult {
  std::vector<uint16_t> offset;
  std::vector<float> distance_m, weight;
};

class BandObserver {
 public:
  BandObserver(const LocalVoxels& voxels, const RangeImage& image, const Pose& T_M_X, ObjectId id,
               const SurfaceMap& existing, double noise_m, const BandOptions& options)
      : voxels_(voxels),
        image_(image),
        T_M_X_(T_M_X),
        T_X_M_(T_M_X.inverse()),
        id_(id),
        existing_(existing),
        options_(options),
        table_(voxels),
        fields_(voxels, table_, T_M_X.translation(), noise_m, options.gp),
        reach_voxels_(ReachVoxels(options, voxels.voxel_size_m)) {}

  float reach_voxels() const { return reach_voxels_; }

  BlockResult Observe(const BlockIndex& block) const {
    const std::array<int32_t, kBlockVoxels> nearest =
        NearestSurface(voxels_, table_, fields_.strays(), block, reach_voxels_);
    // Voxels by their field; each field is evaluated at eight of them at once.
    std::vector<std::pair<int32_t, int>> tests;
    tests.reserve(kBlockVoxels);
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (nearest[o] >= 0) tests.emplace_back(nearest[o], o);
    }
    std::sort(tests.begin(), tests.end());
    std::array<BandValue, kBlockVoxels> values{};
    for (size_t i = 0; i < tests.size();) {
      size_t end = i + 1;
      while (end < tests.size() && end - i < kLanes && tests[end].first == tests[i].first) ++end;
      EvaluateGroup(block, tests.data() + i, end - i, values);
      i = end;
    }
    const float* mean = existing_.MeanBlock(block);
    const float* weight = existing_.WeightBlock(block);
    BlockResult out;
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (!(values[o].weight > 0)) continue;
      const float w = weight ? GuessedWeight(values[o], mean[o], weight[o],
                                             static_cast<float>(voxels_.voxel_size_m))
                             : values[o].weight;
      if (!(w > 0)) continue;
      out.offset.push_back(static_cast<uint16_t>(o));
      out.distance_m.push_back(values[o].distance_m);
      out.weight.push_back(w);
    }
    return out;
  }

 private:
  void EvaluateGroup(const BlockIndex& block, const std::pair<int32_t, int>* tests, size_t count,
                     std::array<BandValue, kBlockVoxels>& values) const {
    const float h = static_cast<float>(voxels_.voxel_size_m);
    const uint32_t voxel = static_cast<uint32_t>(tests[0].first);
    const BlockIndex& own = fields_.block_of(voxel);
    const Eigen::Vector3f step(static_cast<float>(block.x - own.x),
                               static_cast<float>(block.y - own.y),
                               static_cast<float>(block.z - own.z));
    std::array<Lanes, 3> x;
    for (size_t k = 0; k < kLanes; ++k) {
      const int o = tests[std::min(k, count - 1)].second;
      const Eigen::Vector3f centre =
          VoxelAt({0, 0, 0}, o).cast<float>() + step * kBlockSide + Eigen::Vector3f::Constant(0.5f);
      for (int axis = 0; axis < 3; ++axis) x[axis][k] = centre[axis] * h;
    }
    const SurfaceFields::Samples s = fields_.Evaluate(voxel, x);
    const Eigen::Vector3f& normal = fields_.normal(voxel);
    const Eigen::Vector3f origin_X =
        (T_X_M_ * BlockOrigin(own, voxels_.voxel_size_m)).cast<float>();
    const Eigen::Matrix3f R_X_M = T_X_M_.linear().cast<float>();
    for (size_t k = 0; k < count; ++k) {
      if (!(s.variance[k] <= static_cast<float>(options_.gp.max_latent_variance))) continue;
      if (!(s.latent[k] > 0)) continue;
      const Eigen::Vector3f away(-s.to_foot[0][k], -s.to_foot[1][k], -s.to_foot[2][k]);
      const Eigen::Vector3f p_X = R_X_M * Eigen::Vector3f(x[0][k], x[1][k], x[2][k]) + origin_X;
      const Eigen::Vector3f normal_X = R_X_M * normal;
      const Sight sight = LookTowards(image_, p_X, h);
      const auto value =
          DecideBandValue(sight, normal.dot(away), away.norm(),
                          std::abs(normal_X.dot(p_X.normalized())), s.variance[k], id_.value(), h);
      if (value) values[tests[k].second] = *value;
    }
  }

  const LocalVoxels& voxels_;
  const RangeImage& image_;
  const Pose T_M_X_, T_X_M_;
  const ObjectId id_;
  const SurfaceMap& existing_;
  const BandOptions& options_;
  const BlockTable table_;
  const SurfaceFields fields_;
  const float reach_voxels_;
};

}  // namespace

BandObservations ObserveBand(const LocalVoxels& voxels, const RangeImage& image, const Pose& T_M_X,
                             ObjectId id, const SurfaceMap& existing, const BandOptions& options) {
  BandObservations out;
  if (voxels.empty()) return out;
  const double noise_m = image.noise_m();
  const LocalVoxels surface = WithBridges(voxels, image, T_M_X, id, noise_m);
  const BandObserver observer(surface, image, T_M_X, id, existing, noise_m, options);
  const std::vector<BlockIndex> blocks = BandBlocksOf(surface, observer.reach_voxels());
  std::vector<BlockResult> results(blocks.size());
  tbb::parallel_for(size_t{0}, blocks.size(),
                    [&](size_t i) { results[i] = observer.Observe(blocks[i]); });
  for (size_t i = 0; i < blocks.size(); ++i) {
    const BlockResult& r = results[i];
    if (r.offset.empty()) continue;
    const uint32_t begin = static_cast<uint32_t>(out.offset.size());
    out.offset.insert(out.offset.end(), r.offset.begin(), r.offset.end());
    out.distance_m.insert(out.distance_m.end(), r.distance_m.begin(), r.distance_m.end());
    out.weight.insert(out.weight.end(), r.weight.begin(), r.weight.end());
    out.blocks.push_back({blocks[i], begin, static_cast<uint32_t>(out.offset.size())});
  }
  return out;
}

}  // namespace clearance
