#include "server/query/point_answer.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace clearance {
namespace {

// Half a cube's diagonal over its side.
constexpr float kHalfDiagonal = 0.8660254f;
// Eq. (5)'s weight is 1 - sigma with a sigma in [0, 1]; ours is in voxels, and no map counts
// nothing.
constexpr float kMinWeight = 0.01f;

bool IsStale(const MapView& view, const QueryOptions& options) {
  if (!options.now.has_value()) return false;
  const std::chrono::duration<double> age = *options.now - view.published_at;
  return age.count() > view.config.stale_after_s;
}

}  // namespace

PointAnswerer::PointAnswerer(const MapView& view, const ObjectIndex& index,
                             const std::vector<uint8_t>& enabled, const QueryOptions& options)
    : view_(view),
      index_(index),
      options_(options),
      lookup_(view.field),
      objects_(index, enabled, static_cast<float>(options.sigma_margin)),
      covering_(index, enabled, 0),
      unknown_(view.field),
      voxel_size_m_(static_cast<float>(view.field.voxel_size_m())),
      sigma_margin_(static_cast<float>(options.sigma_margin)) {
  const double map_maximum_m = view.config.max_distance_m;
  const double asked_m = options.max_distance_m > 0 ? options.max_distance_m : map_maximum_m;
  max_distance_m_ = static_cast<float>(std::min(asked_m, map_maximum_m));
  with_static_ = options.layers.only_objects.empty();
  with_objects_ = !options.layers.static_only && !index.entries.empty();
  if (IsStale(view, options)) common_flags_ |= state_byte::kStale;
  for (int code = 0; code < 32; ++code) {
    sigma_of_code_m_[code] = SigmaVoxelsOfCode(code) * voxel_size_m_;
  }
}

void PointAnswerer::Answer(const Eigen::Matrix3Xd& points_W, Eigen::Index begin, Eigen::Index end,
                           DistanceBatch* batch) {
  std::array<Eigen::Vector3d, kLookupGroup> group;
  std::array<StaticAnswer, kLookupGroup> answers;
  std::array<bool, kLookupGroup> addressable;
  for (Eigen::Index first = begin; first < end; first += kLookupGroup) {
    const int count = static_cast<int>(std::min<Eigen::Index>(kLookupGroup, end - first));
    for (int i = 0; i < count; ++i) {
      group[i] = points_W.col(first + i);
      addressable[i] = lookup_.IsAddressable(group[i]);
      if (!addressable[i]) group[i].setZero();
    }
    lookup_.Answer(group.data(), count, answers.data());
    for (int i = 0; i < count; ++i) {
      if (addressable[i]) {
        AnswerOne(group[i], answers[i], first + i, batch);
      } else {
        if (options_.unknown_distances) batch->unknown_distances_m[first + i] = 0;
        Write({.score_m = max_distance_m_}, state_byte::kOutsideBounds | common_flags_, first + i,
              batch);
      }
    }
  }
}

void PointAnswerer::AnswerOne(const Eigen::Vector3d& p_W, const StaticAnswer& of_static,
                              Eigen::Index column, DistanceBatch* batch) {
  const double horizon_s = HorizonOf(column);
  Combined combined = FromStatic(of_static);
  if (with_objects_) {
    if (options_.fusion == Fusion::kWeighted) {
      TakeWeighted(p_W, horizon_s, &combined);
    } else {
      TakeNearest(p_W, horizon_s, &combined);
    }
  }
  uint8_t state = State(p_W, of_static, horizon_s, combined.score_m) | common_flags_;
  if (combined.entry >= 0 && horizon_s > 0) state |= state_byte::kPredicted;
  if (options_.unknown_distances) {
    batch->unknown_distances_m[column] = unknown_.Distance(p_W, max_distance_m_);
  }
  Write(combined, state, column, batch);
}

PointAnswerer::Combined PointAnswerer::FromStatic(const StaticAnswer& of_static) const {
  Combined combined;
  combined.score_m = max_distance_m_;
  if (!with_static_ || !of_static.has_site) return combined;
  const float sigma_m = sigma_of_code_m_[of_static.sigma_code];
  const float score_m = of_static.distance_voxels * voxel_size_m_ - sigma_margin_ * sigma_m;
  if (score_m >= max_distance_m_) return combined;
  combined.score_m = score_m;
  combined.sigma_m = sigma_m;
  combined.gradient_W = of_static.gradient_W;
  combined.found = true;
  return combined;
}

void PointAnswerer::TakeNearest(const Eigen::Vector3d& p_W, double horizon_s, Combined* combined) {
  ObjectAnswer answer;
  if (!objects_.Nearest(p_W, horizon_s, combined->score_m, &answer)) return;
  combined->score_m = answer.distance_m - sigma_margin_ * answer.sigma_m;
  combined->sigma_m = answer.sigma_m;
  combined->gradient_W = answer.gradient_W;
  combined->entry = static_cast<int>(answer.entry);
  combined->found = true;
}

// Paper Sec. III-E: the maps' distances by Eq. (5)'s weighted sum. `combined` holds the static
// map's.
void PointAnswerer::TakeWeighted(const Eigen::Vector3d& p_W, double horizon_s, Combined* combined) {
  float weight_sum = 0, score_sum = 0, variance_sum = 0;
  Eigen::Vector3f gradient_sum = Eigen::Vector3f::Zero();
  const auto add = [&](float score_m, float sigma_m, const Eigen::Vector3f& gradient_W) {
    const float weight = std::max(kMinWeight, 1.f - sigma_m / voxel_size_m_);
    weight_sum += weight;
    score_sum += weight * score_m;
    variance_sum += weight * weight * sigma_m * sigma_m;
    gradient_sum += weight * gradient_W;
  };
  if (combined->found) add(combined->score_m, combined->sigma_m, combined->gradient_W);
  float nearest_m = combined->score_m;
  objects_.Within(p_W, horizon_s, max_distance_m_, &scratch_);
  // In the order of the entries' ids, so that the sum does not depend on the tree.
  std::sort(scratch_.begin(), scratch_.end(), [&](const ObjectAnswer& a, const ObjectAnswer& b) {
    return index_.entries[a.entry].object < index_.entries[b.entry].object;
  });
  for (const ObjectAnswer& answer : scratch_) {
    const float score_m = answer.distance_m - sigma_margin_ * answer.sigma_m;
    add(score_m, answer.sigma_m, answer.gradient_W);
    if (score_m < nearest_m) {
      nearest_m = score_m;
      combined->entry = static_cast<int>(answer.entry);
    }
  }
  if (weight_sum == 0) return;
  combined->found = true;
  combined->score_m = score_sum / weight_sum;
  combined->sigma_m = std::sqrt(variance_sum) / weight_sum;
  const float norm = gradient_sum.norm();
  combined->gradient_W =
      norm > 1e-6f ? Eigen::Vector3f(gradient_sum / norm) : Eigen::Vector3f::Zero();
}

uint8_t PointAnswerer::State(const Eigen::Vector3d& p_W, const StaticAnswer& of_static,
                             double horizon_s, float score_m) {
  if (view_.config.bounds.has_value() && !view_.config.bounds->contains(p_W)) {
    return state_byte::kOutsideBounds;
  }
  uint8_t state = of_static.state & state_byte::kStateMask;
  bool low_confidence = of_static.state & 4;
  if (!with_static_ && state == static_cast<uint8_t>(VoxelState::kOccupied)) {
    state = static_cast<uint8_t>(VoxelState::kFree);
    low_confidence = true;
  }
  // A cube's centre and all its surface are within a diagonal of the point. (The weighted sum says
  // nothing of the nearest surface.)
  const bool near =
      score_m <= 2 * kHalfDiagonal * voxel_size_m_ || options_.fusion == Fusion::kWeighted;
  bool object_low_confidence = false;
  if (with_objects_ && near && ObjectCovers(p_W, horizon_s, &object_low_confidence)) {
    // A static surface in the voxel keeps its own confidence.
    if (state != static_cast<uint8_t>(VoxelState::kOccupied))
      low_confidence = object_low_confidence;
    state = static_cast<uint8_t>(VoxelState::kOccupied);
  }
  return state | (low_confidence ? state_byte::kLowConfidence : 0);
}

// Whether an object holds the centre of the point's voxel or its surface passes through the cube:
// the plane at the nearest surface point is then within the cube's half width along the normal.
bool PointAnswerer::ObjectCovers(const Eigen::Vector3d& p_W, double horizon_s,
                                 bool* low_confidence) {
  const double voxel_size_m = view_.field.voxel_size_m();
  const Eigen::Vector3d centre_W = VoxelCentre(VoxelOf(p_W, voxel_size_m), voxel_size_m);
  covering_.Within(centre_W, horizon_s, kHalfDiagonal * voxel_size_m_, &scratch_);
  bool covered = false;
  for (const ObjectAnswer& answer : scratch_) {
    const float reach_m = 0.5f * voxel_size_m_ * answer.gradient_W.lpNorm<1>();
    if (answer.distance_m > reach_m) continue;
    const bool lost = index_.entries[answer.entry].life_state == LifeState::kLost;
    *low_confidence = covered ? *low_confidence && lost : lost;
    covered = true;
  }
  return covered;
}

double PointAnswerer::HorizonOf(Eigen::Index column) const {
  const double horizon_s =
      options_.horizons_s.empty() ? options_.horizon_s : options_.horizons_s[column];
  return horizon_s > 0 && std::isfinite(horizon_s) ? horizon_s : 0.0;
}

void PointAnswerer::Write(const Combined& combined, uint8_t state, Eigen::Index column,
                          DistanceBatch* batch) {
  const bool clamped = !combined.found || std::abs(combined.score_m) >= max_distance_m_;
  if (clamped) state |= state_byte::kClamped;
  const bool gradient = combined.found && !combined.gradient_W.isZero(0.f);
  if (!gradient) state |= state_byte::kNoGradient;
  batch->distances_m[column] = std::clamp(combined.score_m, -max_distance_m_, max_distance_m_);
  batch->states[column] = state;
  if (options_.gradients) {
    batch->gradients_W.col(column) =
        gradient ? combined.gradient_W : Eigen::Vector3f(Eigen::Vector3f::Zero());
  }
  if (options_.objects) {
    batch->object_ids[column] = combined.entry < 0 ? 0 : index_.entries[combined.entry].id.value();
  }
  if (options_.sigmas) batch->sigmas_m[column] = combined.sigma_m;
}

}  // namespace clearance
