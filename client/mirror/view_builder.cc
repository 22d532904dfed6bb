#include "client/mirror/view_builder.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/compression.h"
#include "proto/wire/map_config.h"
#include "proto/wire/object_state.h"
#include "server/map/field_codec.h"
#include "server/query/object_index.h"
#include "server/query/object_tree.h"
#include "server/query/shape_codec.h"

namespace clearance::client {
namespace {

// Sites are kept twice: as they are, and in the lanes of the tree.
constexpr uint64_t kBytesPerSite = 2 * sizeof(SurfaceSite);
constexpr uint64_t kMaxSites = uint64_t{1} << 24;
// Queries address voxels within +-2^30.
constexpr int32_t kMaxBlockIndex = 1 << 27;

uint64_t BytesOf(const ObjectShape* shape) {
  return shape == nullptr ? 0 : shape->sites.size() * kBytesPerSite;
}

bool IsAddressable(const BlockIndex& b) {
  const auto fits = [](int32_t i) { return i >= -kMaxBlockIndex && i < kMaxBlockIndex; };
  return fits(b.x) && fits(b.y) && fits(b.z);
}

absl::StatusOr<MapConfig> ConfigOf(const v1::WatchHello& hello) {
  const absl::StatusOr<wire::MapSettings> settings =
      wire::MapSettingsFromProto(hello.info().config(), "hello.info.config");
  if (!settings.ok()) return settings.status();
  MapConfig config;
  config.voxel_size_m = settings->voxel_size_m.value_or(config.voxel_size_m);
  config.max_distance_m = settings->max_distance_m.value_or(config.max_distance_m);
  config.truncation_m = settings->truncation_m.value_or(config.truncation_m);
  config.max_range_m = settings->max_range_m.value_or(config.max_range_m);
  config.bounds = settings->bounds;
  config.object_lost_after_s = settings->lost_after_s.value_or(config.object_lost_after_s);
  config.object_retired_after_s = settings->retire_after_s.value_or(config.object_retired_after_s);
  config.max_horizon_s = settings->max_horizon_s.value_or(config.max_horizon_s);
  if (hello.stale_after_s() > 0) config.stale_after_s = hello.stale_after_s();
  if (absl::Status s = config.Validate(); !s.ok()) return s;
  return config;
}

absl::Status Gap(const std::string& what) {
  return absl::FailedPreconditionError(absl::StrFormat("watch: %s; watch again", what));
}

}  // namespace

absl::StatusOr<ViewBuilder::ViewPtr> ViewBuilder::Take(const v1::WatchMapResponse& message) {
  absl::StatusOr<ViewPtr> view = TakePart(message);
  if (!view.ok()) {
    Interrupt();
    config_.reset();  // nothing is taken before the next hello
  }
  return view;
}

absl::StatusOr<ViewBuilder::ViewPtr> ViewBuilder::TakePart(const v1::WatchMapResponse& message) {
  absl::Status status;
  bool last = false;
  switch (message.message_case()) {
    case v1::WatchMapResponse::kHello:
      epoch_ = message.stamp().epoch();
      status = TakeHello(message.hello());
      break;
    case v1::WatchMapResponse::kCheckpoint:
      if (message.checkpoint().part() == 0) status = Begin(true, 0);
      if (status.ok()) status = TakeContent(message.checkpoint(), true);
      working_revision_ = message.stamp().revision();
      last = message.checkpoint().last_part();
      break;
    case v1::WatchMapResponse::kDelta: {
      const v1::WatchDelta& delta = message.delta();
      if (delta.part() == 0) {
        status = Begin(false, delta.prev_revision());
        working_revision_ = delta.revision();
      }
      if (status.ok() &&
          (delta.prev_revision() != working_prev_ || delta.revision() != working_revision_ ||
           delta.revision() <= delta.prev_revision())) {
        status = Gap(absl::StrFormat("part %d of another delta", delta.part()));
      }
      if (status.ok()) status = TakeContent(delta, false);
      if (!status.ok()) break;
      for (const v1::ObjectKey& key : delta.evicted_objects()) {
        const auto it =
            objects_.find({ObjectId(static_cast<uint16_t>(key.object_id())), key.generation()});
        if (it == objects_.end()) continue;
        Refund(BytesOf(it->second.shape.get()));
        objects_.erase(it);
      }
      last = delta.last_part();
      break;
    }
    case v1::WatchMapResponse::MESSAGE_NOT_SET:
      status = absl::InvalidArgumentError("watch: a message without content");
      break;
  }
  if (!status.ok()) return status;
  if (!last) return ViewPtr();
  return Finish(message.stamp());
}

void ViewBuilder::Interrupt() {
  working_.reset();
  objects_.clear();
  surfaces_.clear();
}

absl::Status ViewBuilder::TakeHello(const v1::WatchHello& hello) {
  Interrupt();
  if (hello.format_version() != kBlockFormatVersion) {
    return absl::FailedPreconditionError(
        absl::StrFormat("watch: the server's blocks have format %d, this client reads %d; use a "
                        "client of the server's version",
                        hello.format_version(), kBlockFormatVersion));
  }
  absl::StatusOr<MapConfig> config = ConfigOf(hello);
  if (!config.ok()) return config.status();
  if (stale_after_s_) config->stale_after_s = *stale_after_s_;
  config_ = *std::move(config);
  resumes_ = hello.resumes();
  if (resumes_ && (current_ == nullptr || current_->epoch != epoch_)) {
    return Gap("the server resumes what was never received");
  }
  return absl::OkStatus();
}

absl::Status ViewBuilder::Begin(bool checkpoint, uint64_t prev_revision) {
  if (!config_) return Gap("content before hello");
  Interrupt();
  if (!checkpoint &&
      (current_ == nullptr || current_->epoch != epoch_ || current_->revision != prev_revision)) {
    return Gap(absl::StrFormat(
        "a delta from revision %d, but revision %d was received last", prev_revision,
        current_ == nullptr || current_->epoch != epoch_ ? 0 : current_->revision));
  }
  working_.emplace();
  working_->config = *config_;
  working_->epoch = epoch_;
  working_checkpoint_ = checkpoint;
  working_prev_ = prev_revision;
  next_part_ = 0;
  if (checkpoint) {
    working_->field = DistanceField(config_->voxel_size_m, config_->max_distance_m);
    memory_bytes_ = 0;
    return absl::OkStatus();
  }
  working_->field = current_->field;
  memory_bytes_ = current_memory_bytes_;
  for (const ObjectView& object : current_->objects) {
    objects_.emplace(ObjectKey(object.id, object.generation), object);
  }
  return absl::OkStatus();
}

template <typename Part>
absl::Status ViewBuilder::TakeContent(const Part& part, bool is_checkpoint) {
  if (!working_ || working_checkpoint_ != is_checkpoint || part.part() != next_part_) {
    return Gap(absl::StrFormat("part %d, expected part %d", part.part(), next_part_));
  }
  ++next_part_;
  for (const v1::FieldBlocks& blocks : part.blocks()) {
    if (absl::Status s = TakeBlocks(blocks); !s.ok()) return s;
  }
  for (const v1::ObjectState& object : part.objects()) {
    if (absl::Status s = TakeObject(object); !s.ok()) return s;
  }
  return absl::OkStatus();
}

absl::Status ViewBuilder::Charge(uint64_t bytes) {
  memory_bytes_ += bytes;
  if (memory_bytes_ <= limits_.max_memory_bytes) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrFormat(
      "the mirrored map takes more than %d bytes (memory_limit_bytes); raise it or set bounds",
      limits_.max_memory_bytes));
}

void ViewBuilder::Refund(uint64_t bytes) { memory_bytes_ -= std::min(memory_bytes_, bytes); }

absl::Status ViewBuilder::TakeBlocks(const v1::FieldBlocks& blocks) {
  if (blocks.has_object()) return absl::OkStatus();  // of a layer that this format does not have
  const auto indices = wire::DecodeArray<int32_t>(blocks.indices_i32(), 3, "blocks.indices_i32");
  if (!indices.ok()) return indices.status();
  const auto removed = wire::DecodeArray<int32_t>(blocks.removed_i32(), 3, "blocks.removed_i32");
  if (!removed.ok()) return removed.status();
  const absl::StatusOr<std::string> payload = wire::UnpackPayload(
      blocks.payload(), blocks.compression(), blocks.payload_bytes(), "blocks.payload");
  if (!payload.ok()) return payload.status();
  DistanceField& field = working_->field;
  BlockReader reader(*payload);
  for (size_t i = 0; i + 2 < indices->size(); i += 3) {
    const BlockIndex index{(*indices)[i], (*indices)[i + 1], (*indices)[i + 2]};
    if (!IsAddressable(index)) {
      return absl::DataLossError(absl::StrFormat("blocks.indices_i32[%d]: (%d, %d, %d) is too far",
                                                 i / 3, index.x, index.y, index.z));
    }
    absl::StatusOr<BlockReader::Block> block = reader.Next(field.FindBlock(index));
    if (!block.ok()) return block.status();
    if (field.FindBlock(index)) Refund(sizeof(FieldBlock));
    uint64_t bytes = block->data ? sizeof(FieldBlock) : 0;
    if (!field.FindRegion({index.x >> 3, index.y >> 3, index.z >> 3})) {
      bytes += sizeof(DistanceField::Region);
    }
    if (absl::Status s = Charge(bytes); !s.ok()) return s;
    field.Set(index, std::move(block->data), block->tile);
  }
  if (!reader.done()) return absl::DataLossError("blocks.payload: more bytes than blocks");
  for (size_t i = 0; i + 2 < removed->size(); i += 3) {
    const BlockIndex index{(*removed)[i], (*removed)[i + 1], (*removed)[i + 2]};
    if (!IsAddressable(index)) continue;
    if (field.FindBlock(index)) Refund(sizeof(FieldBlock));
    field.Set(index, nullptr);
  }
  return absl::OkStatus();
}

absl::Status ViewBuilder::TakeObject(const v1::ObjectState& state) {
  const absl::StatusOr<wire::ObjectState> decoded = wire::ObjectStateFromProto(state, "objects");
  if (!decoded.ok()) return decoded.status();
  const ObjectKey key(decoded->id, decoded->generation);
  if (!objects_.contains(key) && objects_.size() >= limits_.max_objects) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("objects: more than %d", limits_.max_objects));
  }
  ObjectView& object = objects_[key];
  object.id = decoded->id;
  object.generation = decoded->generation;
  object.class_name = decoded->class_name;
  object.source_id = decoded->source_id;
  object.life_state = static_cast<LifeState>(decoded->life_state);
  object.T_W_L = decoded->T_W_L;
  object.twist = decoded->twist;
  object.screw_W = decoded->screw_W;
  object.position_sigma_m = decoded->position_sigma_m;
  object.velocity_sigma_mps = decoded->velocity_sigma_mps;
  object.first_seen_ns = decoded->first_seen_ns;
  object.last_seen_ns = decoded->last_seen_ns;
  object.observations = decoded->observations;
  return state.has_surface() ? TakeSurface(key, state.surface()) : absl::OkStatus();
}

absl::Status ViewBuilder::TakeSurface(const ObjectKey& key, const v1::ObjectSurface& surface) {
  if (surface.first_site() == 0) surfaces_[key] = {surface.site_count(), {}};
  const auto it = surfaces_.find(key);
  if (it == surfaces_.end() || it->second.sites.size() != surface.first_site() ||
      it->second.site_count != surface.site_count() || surface.site_count() > kMaxSites) {
    return absl::DataLossError(
        absl::StrFormat("object %d: sites from %d of %d do not follow what came before",
                        key.first.value(), surface.first_site(), surface.site_count()));
  }
  const absl::StatusOr<std::string> payload = wire::UnpackPayload(
      surface.payload(), surface.compression(), surface.payload_bytes(), "objects.surface.payload");
  if (!payload.ok()) return payload.status();
  Sites& sites = it->second.sites;
  const size_t before = sites.size();
  absl::Status status;
  if (surface.changes()) {
    const ObjectShape* known = objects_.at(key).shape.get();
    if (known == nullptr || before != 0) {
      return absl::DataLossError(
          absl::StrFormat("object %d: changes to a surface that is not there", key.first.value()));
    }
    status = ReadSiteChanges(*payload, known->sites, &sites);
  } else {
    status = ReadSites(*payload, &sites);
  }
  if (!status.ok()) return status;
  return Charge((sites.size() - before) * kBytesPerSite);
}

absl::Status ViewBuilder::FinishSurfaces() {
  for (auto& [key, surface] : surfaces_) {
    const auto it = objects_.find(key);
    if (it == objects_.end()) continue;  // evicted in the same breath
    if (surface.sites.size() != surface.site_count) {
      return absl::DataLossError(absl::StrFormat("object %d: %d of %d sites came",
                                                 key.first.value(), surface.sites.size(),
                                                 surface.site_count));
    }
    Refund(BytesOf(it->second.shape.get()));
    it->second.shape = surface.sites.empty() ? nullptr
                                             : BuildObjectShape(std::move(surface.sites),
                                                                working_->config.voxel_size_m);
  }
  return absl::OkStatus();
}

absl::StatusOr<ViewBuilder::ViewPtr> ViewBuilder::Finish(const v1::MapStamp& stamp) {
  if (stamp.epoch() != epoch_ || stamp.revision() != working_revision_) {
    return Gap("a stamp of another epoch or revision");
  }
  if (!std::isfinite(stamp.staleness_s()) || stamp.staleness_s() < 0) {
    return absl::InvalidArgumentError("watch: stamp.staleness_s is no duration");
  }
  if (absl::Status s = FinishSurfaces(); !s.ok()) return s;
  auto view = std::make_shared<MapView>(*std::move(working_));
  view->revision = stamp.revision();
  view->field_revision = stamp.field_revision();
  view->stamp_ns = stamp.stamp_ns();
  // By this process's clock; beyond a day it is stale anyway.
  const std::chrono::duration<double> age(std::min(stamp.staleness_s(), 86400.0));
  view->published_at = std::chrono::steady_clock::now() -
                       std::chrono::duration_cast<std::chrono::steady_clock::duration>(age);
  for (auto& [key, object] : objects_) view->objects.push_back(std::move(object));
  view->object_index = BuildObjectIndex(view->objects);
  current_ = std::move(view);
  current_memory_bytes_ = memory_bytes_;
  Interrupt();
  return current_;
}

}  // namespace clearance::client
