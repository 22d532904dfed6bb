#include "server/map/world_map.h"

#include <algorithm>
#include <cmath>

#include "server/map/eviction.h"

namespace clearance {

WorldMap::WorldMap(const MapConfig& config) : config_(config), static_map_(config.voxel_size_m) {}

std::optional<uint64_t> WorldMap::last_frame_id(const std::string& source_id) const {
  const auto it = last_frame_ids_.find(source_id);
  if (it == last_frame_ids_.end()) return std::nullopt;
  return it->second;
}

AppliedChanges WorldMap::Apply(const MapUpdate& update) {
  AppliedChanges changes;
  changes.static_blocks = static_map_.Apply(update.static_surface, fusion_);
  stamp_ns_ = std::max(stamp_ns_, update.stamp_ns);  // several sources need not be in step
  for (const ObjectUpdate& u : update.objects) {
    auto it = objects_.find(u.id);
    const bool created = u.event == ObjectEvent::kCreated;
    if (created) {
      uint32_t generation = 1;
      if (it != objects_.end()) {
        generation = it->second.generation() + 1;
        Retire(it->second);
        objects_.erase(it);
      } else {
        for (const ObjectSubmap& old : retired_) {
          if (old.id() == u.id) generation = std::max(generation, old.generation() + 1);
        }
      }
      it =
          objects_
              .emplace(u.id, ObjectSubmap(u.id, generation, config_.voxel_size_m, update.source_id))
              .first;
    } else if (it == objects_.end()) {
      continue;
    }
    changes.objects.push_back({u.id, it->second.Apply(u, update, fusion_), created});
  }
  for (auto it = objects_.begin(); it != objects_.end();) {
    const auto u = std::find_if(update.objects.begin(), update.objects.end(),
                                [&](const ObjectUpdate& o) { return o.id == it->first; });
    it->second.Age(stamp_ns_, u != update.objects.end() && u->observed, config_);
    if (it->second.life_state() == LifeState::kRetired) {
      Retire(it->second);
      it = objects_.erase(it);
    } else {
      ++it;
    }
  }
  last_frame_ids_[update.source_id] = update.frame_id;
  AppendPose(sensor_path_, {update.stamp_ns, update.T_W_X}, kMaxSensorPoses);
  ++revision_;
  return changes;
}

void WorldMap::Retire(ObjectSubmap& object) {
  object.Retire();
  retired_.push_back(std::move(object));
  if (retired_.size() > kMaxRetiredObjects) retired_.erase(retired_.begin());
}

AppliedChanges WorldMap::Edit(const RegionEdit& edit) {
  Aabb box;
  std::function<double(const Eigen::Vector3d&)> sdf;
  if (edit.box) {
    box = *edit.box;
    sdf = [box](const Eigen::Vector3d& p) {
      const Eigen::Vector3d q = (p - box.center()).cwiseAbs() - 0.5 * box.sizes();
      return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
    };
  } else {
    const Eigen::Vector3d r = Eigen::Vector3d::Constant(edit.sphere_radius_m);
    box = Aabb(*edit.sphere_centre - r, *edit.sphere_centre + r);
    sdf = [edit](const Eigen::Vector3d& p) {
      return (p - *edit.sphere_centre).norm() - edit.sphere_radius_m;
    };
  }
  AppliedChanges changes;
  changes.static_blocks = static_map_.Edit(edit.action, box, sdf, config_.truncation(), fusion_);
  ++revision_;
  return changes;
}

std::vector<BlockIndex> WorldMap::Evict(const Eigen::Vector3d& centre_W, double radius_m) {
  ++revision_;
  return EvictBeyond(static_map_, centre_W, radius_m);
}

void WorldMap::Save(ByteWriter* out) const {
  const auto save = [out](const ObjectSubmap& object) {
    out->Put(object.id().value());
    out->Put(object.generation());
    object.Save(out);
  };
  out->Put<uint64_t>(objects_.size());
  for (const auto& [id, object] : objects_) save(object);
  out->Put<uint64_t>(retired_.size());
  for (const ObjectSubmap& object : retired_) save(object);
  out->Put<uint64_t>(last_frame_ids_.size());
  for (const auto& [source, frame_id] : last_frame_ids_) {
    out->PutText(source);
    out->Put(frame_id);
  }
  SavePath(sensor_path_, out);
  out->Put(stamp_ns_);
  out->Put(revision_);
}

absl::StatusOr<WorldMap> WorldMap::Load(const MapConfig& config, ByteReader* in,
                                        const SurfaceSource& surface) {
  WorldMap world(config);
  absl::StatusOr<SurfaceMap> static_map = surface(kStaticWorld, 0);
  if (!static_map.ok()) return static_map.status();
  world.static_map_ = *std::move(static_map);
  std::vector<ObjectSubmap> objects;
  const auto load = [&](std::vector<ObjectSubmap>* out) -> absl::Status {
    for (size_t left = in->GetCount(sizeof(Eigen::Matrix4d)); left > 0 && in->ok(); --left) {
      const ObjectId id(in->Get<uint16_t>());
      absl::StatusOr<SurfaceMap> own = surface(id, in->Get<uint32_t>());
      if (!own.ok()) return own.status();
      out->push_back(ObjectSubmap::Load(in, *std::move(own)));
    }
    return absl::OkStatus();
  };
  if (absl::Status s = load(&objects); !s.ok()) return s;
  for (ObjectSubmap& object : objects) world.objects_.emplace(object.id(), std::move(object));
  if (absl::Status s = load(&world.retired_); !s.ok()) return s;
  for (size_t left = in->GetCount(1); left > 0 && in->ok(); --left) {
    std::string source(in->GetText());
    world.last_frame_ids_[std::move(source)] = in->Get<uint64_t>();
  }
  world.sensor_path_ = LoadPath(in);
  world.stamp_ns_ = in->Get<int64_t>();
  world.revision_ = in->Get<uint64_t>();
  if (!in->ok()) return in->Finish();
  return world;
}

uint64_t WorldMap::MemoryBytes() const {
  uint64_t bytes = static_map_.MemoryBytes();
  for (const auto& [id, object] : objects_) bytes += object.surface().MemoryBytes();
  for (const ObjectSubmap& object : retired_) bytes += object.surface().MemoryBytes();
  return bytes;
}

}  // namespace clearance
