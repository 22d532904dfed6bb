#include "server/integration/surface_band.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/integration/band_value.h"
#include "server/integration/converged_surface.h"
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

// Neighbours in the order of KnownSurface::confirmed.
BlockIndex Beside(BlockIndex b, int n) {
  if (n == KnownSurface::kOwn) return b;
  (n < 2 ? b.x : n < 4 ? b.y : b.z) += n & 1 ? 1 : -1;
  return b;
}
constexpr int kAroundAt[7] = {4, 22, 10, 16, 12, 14, 13};  // in BlockTable::Around

// The voxels of one block of the band.
struct BlockTests {
  BlockIndex block;
  bool has_open = false;                         // surface voxels within reach that are evaluated
  std::vector<std::pair<int32_t, int>> tests{};  // surface voxel that decides, offset; sorted
  BlockMask confirmed{};                         // stored surface that this frame agrees with
};

struct BlockResult {
  BlockIndex block;
  std::vector<uint16_t> offset{};
  std::vector<float> distance_m{}, weight{};
};

class BandObserver {
 public:
  BandObserver(const LocalVoxels& voxels, const RangeImage& image, const Pose& T_M_X, ObjectId id,
               const SurfaceMap& existing, double noise_m, const BandOptions& options)
      : voxels_(voxels),
        image_(image),
        T_M_X_(T_M_X),
        T_X_M_(T_M_X.inverse()),
        R_X_M_(T_X_M_.linear().cast<float>()),
        id_(id),
        existing_(existing),
        options_(options),
        table_(voxels),
        fields_(voxels, table_, T_M_X.translation(), noise_m, options.gp),
        reach_voxels_(ReachVoxels(options, voxels.voxel_size_m)),
        known_(FindKnownSurface(voxels, existing, noise_m)),
        open_(known_.size()) {
    for (size_t b = 0; b < open_.size(); ++b) {
      for (uint32_t i = voxels.blocks[b].begin; i < voxels.blocks[b].end; ++i) {
        if (!Test(known_[b].converged, voxels.offset[i])) Set(open_[b], voxels.offset[i]);
      }
    }
  }

  // By rising block.
  std::vector<BlockResult> Observe() {
    const std::vector<BlockIndex> open = BandBlocksOf(voxels_, open_, reach_voxels_);
    std::vector<BlockIndex> all = open;
    for (size_t b = 0; b < known_.size(); ++b) {
      for (int n = 0; n <= KnownSurface::kOwn; ++n) {
        if (known_[b].confirmed[n] == BlockMask{}) continue;
        all.push_back(Beside(voxels_.blocks[b].block, n));
      }
    }
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    std::vector<BlockTests> tests(all.size());
    size_t next_open = 0;
    for (size_t i = 0; i < all.size(); ++i) {
      tests[i].block = all[i];
      tests[i].has_open = next_open < open.size() && open[next_open] == all[i];
      next_open += tests[i].has_open;
    }
    tbb::parallel_for(size_t{0}, tests.size(), [&](size_t i) { FindTests(tests[i]); });
    std::vector<uint8_t> wanted(voxels_.offset.size());
    for (const BlockTests& block : tests) {
      for (const auto& [voxel, offset] : block.tests) wanted[voxel] = 1;
    }
    fields_.Train(wanted);
    std::vector<BlockResult> results(tests.size());
    tbb::parallel_for(size_t{0}, tests.size(),
                      [&](size_t i) { results[i] = ObserveBlock(tests[i]); });
    return results;
  }

 private:
  // Voxels by their field; each field is evaluated at eight of them at once.
  void FindTests(BlockTests& out) const {
    if (out.has_open) {
      const std::array<int32_t, kBlockVoxels> nearest =
          NearestSurface(voxels_, table_, fields_.strays(), out.block, reach_voxels_,
                         RowsWithin(table_, open_, out.block, reach_voxels_));
      for (int o = 0; o < kBlockVoxels; ++o) {
        if (nearest[o] >= 0 && IsOpen(nearest[o])) out.tests.emplace_back(nearest[o], o);
      }
      std::sort(out.tests.begin(), out.tests.end());
    }
    const std::array<int32_t, 27> around = table_.Around(out.block);
    for (int n = 0; n <= KnownSurface::kOwn; ++n) {
      const int32_t from = around[kAroundAt[n]];
      if (from < 0) continue;
      const BlockMask& mask = known_[from].confirmed[n == KnownSurface::kOwn ? n : n ^ 1];
      for (size_t w = 0; w < mask.size(); ++w) out.confirmed[w] |= mask[w];
    }
    for (const auto& [voxel, offset] : out.tests) {
      out.confirmed[offset >> 6] &= ~(uint64_t{1} << (offset & 63));
    }
  }

  bool IsOpen(int32_t voxel) const {
    return Test(open_[fields_.block_id(voxel)], voxels_.offset[voxel]);
  }

  BlockResult ObserveBlock(const BlockTests& in) const {
    const BlockIndex& block = in.block;
    std::array<BandValue, kBlockVoxels> values{};
    const auto& tests = in.tests;
    for (size_t i = 0; i < tests.size();) {
      size_t end = i + 1;
      while (end < tests.size() && end - i < kLanes && tests[end].first == tests[i].first) ++end;
      EvaluateGroup(block, tests.data() + i, end - i, values);
      i = end;
    }
    BlockMask given = in.confirmed;
    for (const auto& [voxel, o] : tests) {
      if (values[o].weight > 0) Set(given, o);
    }
    const float* mean = existing_.MeanBlock(block);
    const float* weight = existing_.WeightBlock(block);
    BlockResult out{.block = block};
    for (int word = 0; word < 8; ++word) {
      for (uint64_t bits = given[word]; bits; bits &= bits - 1) {
        const int o = word * 64 + __builtin_ctzll(bits);
        BandValue value = values[o];
        if (Test(in.confirmed, o)) {
          value = {mean[o], 0.f};
        } else {
          if (weight) {
            value.weight =
                GuessedWeight(value, mean[o], weight[o], static_cast<float>(voxels_.voxel_size_m));
          }
          if (!(value.weight > 0)) continue;
        }
        out.offset.push_back(static_cast<uint16_t>(o));
        out.distance_m.push_back(value.distance_m);
        out.weight.push_back(value.weight);
      }
    }
    return out;
  }

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
    const Eigen::Vector3f normal_X = R_X_M_ * normal;
    std::array<Lanes, 3> x_X;
    for (int axis = 0; axis < 3; ++axis) {
      x_X[axis] =
          R_X_M_(axis, 0) * x[0] + R_X_M_(axis, 1) * x[1] + R_X_M_(axis, 2) * x[2] + origin_X[axis];
    }
    const std::array<Sight, kLanes> sights = LookTowards(image_, x_X, count, h);
    const Lanes cosine = (normal_X.x() * x_X[0] + normal_X.y() * x_X[1] + normal_X.z() * x_X[2]) /
                         Sqrt(x_X[0] * x_X[0] + x_X[1] * x_X[1] + x_X[2] * x_X[2]);
    for (size_t k = 0; k < count; ++k) {
      if (!(s.variance[k] <= static_cast<float>(options_.gp.max_latent_variance))) continue;
      if (!(s.latent[k] > 0)) continue;
      const Eigen::Vector3f away(-s.to_foot[0][k], -s.to_foot[1][k], -s.to_foot[2][k]);
      const auto value = DecideBandValue(sights[k], normal.dot(away), away.norm(),
                                         std::abs(cosine[k]), s.variance[k], id_.value(), h);
      if (value) values[tests[k].second] = *value;
    }
  }

  const LocalVoxels& voxels_;
  const RangeImage& image_;
  const Pose T_M_X_, T_X_M_;
  const Eigen::Matrix3f R_X_M_;
  const ObjectId id_;
  const SurfaceMap& existing_;
  const BandOptions& options_;
  const BlockTable table_;
  SurfaceFields fields_;
  const float reach_voxels_;
  std::vector<KnownSurface> known_;  // by block of voxels_
  std::vector<BlockMask> open_;      // what is not known
};

}  // namespace

BandObservations ObserveBand(const LocalVoxels& voxels, const RangeImage& image, const Pose& T_M_X,
                             ObjectId id, const SurfaceMap& existing, const BandOptions& options) {
  BandObservations out;
  if (voxels.empty()) return out;
  const double noise_m = image.noise_m();
  const LocalVoxels surface = WithBridges(voxels, image, T_M_X, id, noise_m);
  BandObserver observer(surface, image, T_M_X, id, existing, noise_m, options);
  for (const BlockResult& r : observer.Observe()) {
    if (r.offset.empty()) continue;
    const uint32_t begin = static_cast<uint32_t>(out.offset.size());
    out.offset.insert(out.offset.end(), r.offset.begin(), r.offset.end());
    out.distance_m.insert(out.distance_m.end(), r.distance_m.begin(), r.distance_m.end());
    out.weight.insert(out.weight.end(), r.weight.begin(), r.weight.end());
    out.blocks.push_back({r.block, begin, static_cast<uint32_t>(out.offset.size())});
  }
  return out;
}

}  // namespace clearance
