#include "server/integration/swept_space.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "server/integration/block_table.h"
#include "server/integration/dilation.h"
#include "server/integration/label_rims.h"
#include "server/integration/stored_surface.h"

namespace clearance {
namespace {

// Static surface with returns in so many frames is not the object's, whatever lies on it.
constexpr int kFirmReturns = 5;
// Both maps measure the same surface when they differ by no more, in voxels.
constexpr double kSameVoxels = 1.0;
constexpr float kSameFacing = 0.5f;         // cosine
constexpr double kSameClutterVoxels = 0.5;  // where either has no direction

// New objects are followed back this far, at most so many poses.
constexpr double kBack_s = 1.6;
constexpr size_t kBackPoses = 24, kTrailPoses = 32;
constexpr uint64_t kNewObservations = 32;

// Pixels that may see a ball, columns and rows from .. to.
RangeImage::PixelBox PixelsOf(const RangeImage& image, const Eigen::Vector3f& centre_X,
                              float radius_m) {
  const RangeImage::PixelBox all{0, 0, image.width() - 1, image.height() - 1};
  if (!image.is_pinhole() || centre_X.z() < 2 * radius_m) return all;
  const float nearest = centre_X.z() - radius_m;
  const auto span = [&](float at, float f, float c, int size, int* first, int* last) {
    const float low = f * std::min((at - radius_m) / nearest, (at - radius_m) / centre_X.z()) + c;
    const float high = f * std::max((at + radius_m) / nearest, (at + radius_m) / centre_X.z()) + c;
    *first = static_cast<int>(std::clamp(low - 1.f, 0.f, static_cast<float>(size)));
    *last = static_cast<int>(std::clamp(high + 1.f, -1.f, static_cast<float>(size - 1)));
  };
  RangeImage::PixelBox box;
  span(centre_X.x(), image.fx(), image.cx(), image.width(), &box.u0, &box.u1);
  span(centre_X.y(), image.fy(), image.cy(), image.height(), &box.v0, &box.v1);
  return box;
}

bool IsFirm(const SurfaceMap& map, const Eigen::Vector3d& p_W) {
  const VoxelIndex v = VoxelOf(p_W, map.voxel_size_m());
  const float* weight = map.WeightBlock(BlockOf(v));
  return weight && weight[OffsetOf(v)] > 0 && map.EvidenceAt(v).returns >= kFirmReturns;
}

class ObjectReturns {
 public:
  ObjectReturns(const Pose& T_W_X, const PlacedShape& shape, const SurfaceMap& static_map)
      : T_W_X_(T_W_X), shape_(shape), static_map_(static_map) {
    const Aabb& box = shape.box_L();
    centre_X_ = (T_W_X.inverse() * (shape.T_W_L() * box.center())).cast<float>();
    radius_m_ = static_cast<float>(0.5 * box.sizes().norm());
  }
  const Eigen::Vector3f& centre_X() const { return centre_X_; }
  float radius_m() const { return radius_m_; }

  bool Has(const Eigen::Vector3f& p_X) const {
    if ((p_X - centre_X_).squaredNorm() > radius_m_ * radius_m_) return false;
    const Eigen::Vector3d p_W = T_W_X_ * p_X.cast<double>();
    const double within_m = kSameVoxels * static_map_.voxel_size_m();
    return shape_.At(p_W, 0, within_m) && !IsFirm(static_map_, p_W);
  }

 private:
  const Pose& T_W_X_;
  const PlacedShape& shape_;
  const SurfaceMap& static_map_;
  Eigen::Vector3f centre_X_;
  float radius_m_;
};

// Static surface that looks like an object does, block by block.
class Traces {
 public:
  Traces(const StaticReturns& returns, const SurfaceMap& map) : returns_(returns), map_(map) {}

  void Release(const PlacedShape& shape) {
    const double h = map_.voxel_size_m();
    const Aabb box = shape.box_W();
    if (box.isEmpty()) return;
    const BlockIndex low = BlockOf(VoxelOf(box.min(), h)), high = BlockOf(VoxelOf(box.max(), h));
    for (BlockIndex b{low.x, 0, 0}; b.x <= high.x; ++b.x) {
      for (b.y = low.y; b.y <= high.y; ++b.y) {
        for (b.z = low.z; b.z <= high.z; ++b.z) ReleaseIn(b, shape);
      }
    }
  }
  std::vector<ReleasedBlock> Released() const {
    std::vector<ReleasedBlock> out;
    for (const auto& [block, released] : released_) out.push_back({block, released});
    return out;
  }

 private:
  void ReleaseIn(const BlockIndex& block, const PlacedShape& shape) {
    StoredSurface stored(map_, block);
    if (stored.empty()) return;
    const double h = map_.voxel_size_m();
    BlockMask near;
    bool near_known = false;
    BlockMask* released = nullptr;
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (!(stored.weight(o) > 0.f)) continue;
      const auto at = shape.At(VoxelCentre(VoxelAt(block, o), h), stored.mean(o), kSameVoxels * h);
      if (!at) continue;
      const Eigen::Vector3f normal = stored.Normal(o);
      if (normal.isZero() || at->normal_W.isZero()) {
        if (std::abs(at->distance_m - stored.mean(o)) > kSameClutterVoxels * h) continue;
      } else if (normal.dot(at->normal_W) < kSameFacing) {
        continue;
      }
      if (!near_known) near = Near(block);
      near_known = true;
      if (Test(near, o)) continue;
      if (!released) released = &released_[block];
      Set(*released, o);
    }
  }

  // Voxels within one voxel of a static return.
  BlockMask Near(const BlockIndex& block) const {
    std::array<const BlockMask*, 27> around;
    for (int k = 0; k < 27; ++k) {
      const Eigen::Vector3i step = StepAround(k);
      around[k] = &returns_.In({block.x + step.x(), block.y + step.y(), block.z + step.z()});
    }
    return Dilated(around);
  }

  const StaticReturns& returns_;
  const SurfaceMap& map_;
  std::map<BlockIndex, BlockMask> released_;
};

bool PoseIsKnown(const ObjectUpdate& update) {
  return update.event == ObjectEvent::kMoved || update.event == ObjectEvent::kReanchored;
}

// Where a new object was, as far as its poses and its present motion tell.
std::vector<Pose> Trail(const ObjectUpdate& update, const ObjectSubmap& object,
                        const std::vector<PoseStamp>& history) {
  std::vector<Pose> trail;
  for (size_t i = history.size() - std::min(history.size(), kTrailPoses); i < history.size(); ++i) {
    trail.push_back(history[i].pose);
  }
  if (!update.H_W || history.empty() || history.size() > kTrailPoses) return trail;
  const double period_s = update.motion_period_s;
  const Screw screw =
      object.screw_W().isZero(0) ? Screw(LogScrew(*update.H_W) / period_s) : object.screw_W();
  const double moved = screw.head<3>().norm() * period_s;
  if (!(moved > 0)) return trail;
  for (size_t i = 1; i <= kBackPoses && static_cast<double>(i) * period_s <= kBack_s; ++i) {
    trail.push_back(ExpScrew(screw * (-static_cast<double>(i) * period_s)) * history.front().pose);
  }
  return trail;
}

}  // namespace

std::vector<std::optional<PlacedShape>> ShapesInFrame(const std::vector<ObjectTask>& tasks,
                                                      const WorldMap& map) {
  std::vector<std::optional<PlacedShape>> shapes(tasks.size());
  for (size_t i = 0; i < tasks.size(); ++i) {
    const auto known = map.objects().find(tasks[i].update.id);
    if (!PoseIsKnown(tasks[i].update) || known == map.objects().end()) continue;
    const PlacedShape shape(known->second.surface(), tasks[i].update.T_W_L);
    if (!shape.box_L().isEmpty()) shapes[i] = shape;
  }
  return shapes;
}

std::vector<uint32_t> WithoutObjectReturns(RangeImage& image, const Eigen::Matrix3Xf& points_X,
                                           std::vector<uint32_t> static_points, const Pose& T_W_X,
                                           const std::vector<std::optional<PlacedShape>>& shapes,
                                           const SurfaceMap& static_map) {
  if (std::none_of(shapes.begin(), shapes.end(), [](const auto& s) { return s.has_value(); })) {
    return static_points;
  }
  image.NeedLabels();
  std::vector<uint8_t> marked(image.is_pinhole() ? image.measures().size() : 0);
  bool any = false;
  for (const std::optional<PlacedShape>& shape : shapes) {
    if (!shape) continue;
    const ObjectReturns returns(T_W_X, *shape, static_map);
    const RangeImage::PixelBox box = PixelsOf(image, returns.centre_X(), returns.radius_m());
    if (box.u1 < box.u0 || box.v1 < box.v0) continue;
    any = true;
    tbb::parallel_for(box.v0, box.v1 + 1, [&](int v) {
      for (int u = box.u0; u <= box.u1; ++u) {
        if (image.label(u, v) != 0 || !(image.measure(u, v) > 0.f)) continue;
        if (!returns.Has(image.Point(u, v))) continue;
        const size_t pixel = static_cast<size_t>(v) * image.width() + u;
        image.set_label(pixel, kRimLabel);
        if (image.is_pinhole()) marked[pixel] = 1;
      }
    });
    if (image.is_pinhole()) continue;
    std::erase_if(static_points, [&](uint32_t i) { return returns.Has(points_X.col(i)); });
  }
  if (any && image.is_pinhole()) {  // columns are pixels
    std::erase_if(static_points, [&](uint32_t i) { return marked[i] != 0; });
  }
  return static_points;
}

std::vector<ReleasedBlock> ReleaseSwept(const ObjectTask& task, const PlacedShape& now,
                                        const WorldMap& map, const StaticReturns& returns) {
  const ObjectSubmap& object = map.objects().at(task.update.id);
  Traces traces(returns, map.static_map());
  traces.Release(now);
  // Looks back become rarer: at the 1st, 2nd, 4th, ... observation.
  const uint64_t n = object.observations();
  const auto history = object.View(map.stamp_ns()).history;
  const bool due = task.update.observed || history->size() == 1;
  if (due && n <= kNewObservations && (n & (n - 1)) == 0) {
    for (const Pose& pose : Trail(task.update, object, *history)) traces.Release(now.MovedTo(pose));
  }
  return traces.Released();
}

}  // namespace clearance
