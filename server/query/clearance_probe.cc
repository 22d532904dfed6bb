#include "server/query/clearance_probe.h"

#include <algorithm>

namespace clearance {
namespace {

// Behind a surface the field calls what nobody saw inner to this depth; what is seen from both
// sides is thinner.
constexpr float kInnerDepth_m = 1;
// Farther away the inner side is of no interest.
constexpr float kInnerReach_voxels = 10;

}  // namespace

ClearanceProbe::ClearanceProbe(const MapView& view, const ObjectIndex& index,
                               const std::vector<uint8_t>& enabled, const LayerSelection& layers,
                               double sigma_margin, bool unknown_counts)
    : field_(view.field),
      lookup_(view.field),
      objects_(index, enabled, static_cast<float>(sigma_margin)),
      unknown_(view.field),
      inner_(view.field, UnknownSearch::Sought::kInner),
      voxel_size_m_(static_cast<float>(view.field.voxel_size_m())),
      max_distance_m_(static_cast<float>(view.config.max_distance_m)),
      sigma_margin_(static_cast<float>(sigma_margin)),
      with_static_(layers.only_objects.empty()),
      with_objects_(!layers.static_only && !index.entries.empty()),
      unknown_counts_(unknown_counts) {
  for (int code = 0; code < 32; ++code) {
    sigma_of_code_m_[code] = SigmaVoxelsOfCode(code) * voxel_size_m_;
  }
}

ProbeAnswer ClearanceProbe::At(const Eigen::Vector3d& p_W, double horizon_s, bool objects,
                               double unknown_limit_m) {
  ProbeAnswer answer;
  if (!lookup_.IsAddressable(p_W)) {
    answer.distance_m = max_distance_m_;
    answer.unknown_m = unknown_counts_ ? 0 : max_distance_m_;
    answer.inner_m = max_distance_m_;
    return answer;
  }
  float score_m = max_distance_m_;
  if (with_static_) {
    StaticAnswer of_static;
    lookup_.Answer(&p_W, 1, &of_static);
    if (of_static.has_site) {
      const float sigma_m = sigma_of_code_m_[of_static.sigma_code];
      const float static_m = of_static.distance_voxels * voxel_size_m_ - sigma_margin_ * sigma_m;
      score_m = std::min(score_m, static_m);
    }
  }
  if (objects && with_objects_) {
    ObjectAnswer object;
    if (objects_.Nearest(p_W, horizon_s, score_m, &object)) {
      score_m = object.distance_m - sigma_margin_ * object.sigma_m;
      answer.entry = static_cast<int>(object.entry);
    }
  }
  answer.distance_m = std::clamp(score_m, -max_distance_m_, max_distance_m_);
  if (unknown_counts_) {
    answer.unknown_m =
        unknown_.Distance(p_W, std::min<double>(std::max(answer.distance_m, 0.f), unknown_limit_m));
    answer.inner_m = answer.distance_m;
  } else {
    answer.unknown_m = answer.distance_m;
    answer.inner_m = InnerBound(p_W, answer.distance_m);
  }
  return answer;
}

float ClearanceProbe::InnerBound(const Eigen::Vector3d& p_W, float distance_m) {
  if (!with_static_) return max_distance_m_;
  // The inner side is marked to a depth: who is far from every surface is far from it.
  const float far_m = distance_m - kInnerDepth_m - 2 * voxel_size_m_;
  const float near_m = kInnerReach_voxels * voxel_size_m_;
  if (far_m >= near_m) return far_m;
  return inner_.Distance(p_W, std::min(std::max(distance_m, 0.f) + 2 * voxel_size_m_, near_m));
}

bool ClearanceProbe::OnBothSides(const Eigen::Vector3d& p_W) const {
  if (!with_static_ || !lookup_.IsAddressable(p_W)) return false;
  const Eigen::Vector3d shifted = p_W.array() - 0.5 * field_.voxel_size_m();
  const VoxelIndex low = VoxelOf(shifted, field_.voxel_size_m());
  bool any = false, all = true;
  for (int k = 0; k < 8; ++k) {
    const bool inner = field_.At(low + VoxelIndex(k >> 2, (k >> 1) & 1, k & 1)).negative();
    any |= inner;
    all &= inner;
  }
  return any && !all;
}

}  // namespace clearance
