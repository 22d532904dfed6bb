#include "server/integration/frame_integrator.h"

#include <algorithm>
#include <map>
#include <utility>

#include "server/integration/claimed_space.h"
#include "server/integration/label_rims.h"
#include "server/integration/label_split.h"
#include "server/integration/object_motion.h"
#include "server/integration/standing.h"
#include "server/integration/swept_space.h"

namespace clearance {
namespace {

RangeImage MakeRangeImage(const Frame& frame, double max_range_m, double voxel_size_m) {
  if (const auto* depth = std::get_if<DepthImage>(&frame.observation)) {
    return RangeImage::FromDepth(*depth, max_range_m);
  }
  // Half a voxel at the longest range: finer pixels would say the same thing more often.
  return RangeImage::FromCloud(std::get<PointCloud>(frame.observation),
                               0.5 * voxel_size_m / max_range_m, max_range_m);
}

void Append(std::vector<ReleasedBlock>& all, const std::vector<ReleasedBlock>& more) {
  if (more.empty()) return;
  std::map<BlockIndex, BlockMask> merged;
  for (const std::vector<ReleasedBlock>* part : {&std::as_const(all), &more}) {
    for (const ReleasedBlock& r : *part) {
      BlockMask& mask = merged[r.block];
      for (size_t w = 0; w < mask.size(); ++w) mask[w] |= r.voxels[w];
    }
  }
  all.clear();
  for (const auto& [block, voxels] : merged) all.push_back({block, voxels});
}

// Points were clipped already; free evidence outside the map's bounds goes here.
void ClipToBounds(std::vector<FreeBlock>& free, const Aabb& bounds, double h) {
  std::erase_if(free, [&](FreeBlock& f) {
    const Eigen::Vector3d low = BlockOrigin(f.block, h);
    const Aabb box(low, low + Eigen::Vector3d::Constant(kBlockSide * h));
    if (bounds.contains(box)) return false;
    if (!bounds.intersects(box)) return true;
    BlockMask inside{};
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (bounds.contains(VoxelCentre(VoxelAt(f.block, o), h))) Set(inside, o);
    }
    for (size_t w = 0; w < inside.size(); ++w) {
      f.confident[w] &= inside[w];
      f.probable[w] &= inside[w];
      f.contradicted[w] &= inside[w];
    }
    return f.probable == BlockMask{} && f.contradicted == BlockMask{};
  });
}

// Surface between clipped points (bridged gaps) may still lie outside the map's bounds.
void ClipToBounds(BandObservations& band, const Aabb& bounds, double h) {
  BandObservations kept;
  for (const BandObservations::Block& b : band.blocks) {
    const uint32_t begin = kept.offset.size();
    for (uint32_t i = b.begin; i < b.end; ++i) {
      if (!bounds.contains(VoxelCentre(VoxelAt(b.block, band.offset[i]), h))) continue;
      kept.offset.push_back(band.offset[i]);
      kept.distance_m.push_back(band.distance_m[i]);
      kept.weight.push_back(band.weight[i]);
    }
    const uint32_t end = kept.offset.size();
    if (end > begin) kept.blocks.push_back({b.block, begin, end});
  }
  band = std::move(kept);
}

}  // namespace

IntegratorOptions IntegratorOptions::For(const MapConfig& config) {
  IntegratorOptions options;
  options.band.truncation_m = config.truncation();
  options.free_space.voxel_size_m = config.voxel_size_m;
  options.free_space.max_range_m = config.max_range_m;
  return options;
}

absl::StatusOr<MapUpdate> FrameIntegrator::Integrate(const Frame& frame,
                                                     const WorldMap& map) const {
  StageTimes times;
  StageLaps laps(&times);
  return Integrate(frame, map, laps);
}

absl::StatusOr<MapUpdate> FrameIntegrator::Integrate(const Frame& frame, const WorldMap& map,
                                                     StageLaps& laps) const {
  if (absl::Status s = ValidateFrame(frame); !s.ok()) return s;
  const MapConfig& config = map.config();
  const double max_range_m =
      frame.max_range_m > 0 ? std::min(frame.max_range_m, config.max_range_m) : config.max_range_m;
  MapUpdate update;
  update.source_id = frame.source_id;
  update.frame_id = frame.frame_id;
  update.stamp_ns = frame.stamp_ns;
  update.T_W_X = frame.T_W_X;

  // Alg. 1: split by label; static cloud to R^0.
  LabelSplit split = SplitByLabel(frame, max_range_m, config.bounds);
  std::vector<ObjectTask> tasks =
      FollowObjects(frame, split.points_X, std::move(split.object_points),
                    options_.min_object_points, map, update.violations);
  laps.Lap("split");
  if (!split.empty()) {
    RangeImage image = MakeRangeImage(frame, max_range_m, config.voxel_size_m);
    LetStanding(image, frame.T_W_X, map, tasks);
    split.static_points = WithoutLabelRims(image, split.points_X, std::move(split.static_points));
    const std::vector<std::optional<PlacedShape>> shapes = ShapesInFrame(tasks, map);
    split.static_points =
        WithoutObjectReturns(image, split.points_X, std::move(split.static_points), frame.T_W_X,
                             shapes, map.static_map());
    const LocalVoxels static_voxels =
        GatherVoxels(split.points_X, split.static_points, frame.T_W_X, config.voxel_size_m);
    laps.Lap("voxelise");
    update.static_surface.band = ObserveBand(static_voxels, image, frame.T_W_X, kStaticWorld,
                                             map.static_map(), options_.band);
    laps.Lap("band");
    // Free voxels of every cloud go to R^0, never an object's distances.
    FreeSpaceOptions free_space = options_.free_space;
    free_space.max_range_m = max_range_m;
    update.static_surface.free =
        ObserveFreeSpace(image, frame.T_W_X, static_voxels, map.static_map(), free_space);
    if (config.bounds) {
      ClipToBounds(update.static_surface.band, *config.bounds, config.voxel_size_m);
      ClipToBounds(update.static_surface.free, *config.bounds, config.voxel_size_m);
    }
    laps.Lap("free_space");

    // Each object in its own frame: points to L first, voxels and band there, surface to R^j.
    int seen = 0;
    const StaticReturns returns(static_voxels);
    for (size_t i = 0; i < tasks.size(); ++i) {
      ObjectTask& task = tasks[i];
      if (shapes[i]) {
        Append(update.static_surface.released, ReleaseSwept(task, *shapes[i], map, returns));
      }
      if (task.points.empty()) continue;
      ++seen;
      const LocalVoxels claimed =
          GatherVoxels(split.points_X, task.points, frame.T_W_X, config.voxel_size_m);
      Append(update.static_surface.released, ReleaseClaimed(claimed, returns, map.static_map()));
      if (!task.integrate) continue;
      const Pose T_L_X = task.update.T_W_L.inverse() * frame.T_W_X;
      const LocalVoxels voxels =
          GatherVoxels(split.points_X, task.points, T_L_X, config.voxel_size_m);
      const auto known = map.objects().find(task.update.id);
      const bool fresh = known == map.objects().end() || task.update.event == ObjectEvent::kCreated;
      const SurfaceMap nothing(config.voxel_size_m);
      task.update.surface.band =
          ObserveBand(voxels, image, T_L_X, task.update.id,
                      fresh ? nothing : known->second.surface(), options_.band);
    }
    const double objects_ms = laps.Lap("objects");
    if (seen > 0) laps.Append("per_object", objects_ms / seen);
  }
  for (ObjectTask& task : tasks) update.objects.push_back(std::move(task.update));
  return update;
}

}  // namespace clearance
