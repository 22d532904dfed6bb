#include "server/service/watch_messages.h"

#include <algorithm>
#include <set>
#include <string>

#include "proto/wire/array.h"
#include "proto/wire/compression.h"
#include "proto/wire/geometry.h"
#include "proto/wire/object_state.h"
#include "server/map/field_codec.h"
#include "server/map/field_differences.h"
#include "server/query/shape_codec.h"
#include "server/service/map_replies.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

// Before compression: well below the 4 MiB that clients of every language take by default.
constexpr size_t kPartBytes = 1u << 20;
constexpr size_t kObjectBytes = 512;  // about what an object's state takes

wire::ObjectState StateOf(const ObjectView& object) {
  wire::ObjectState state;
  state.id = object.id;
  state.generation = object.generation;
  state.class_name = object.class_name;
  state.source_id = object.source_id;
  state.life_state = static_cast<v1::LifeState>(object.life_state);
  state.T_W_L = object.T_W_L;
  state.twist = object.twist;
  state.screw_W = object.screw_W;
  state.position_sigma_m = object.position_sigma_m;
  state.velocity_sigma_mps = object.velocity_sigma_mps;
  state.first_seen_ns = object.first_seen_ns;
  state.last_seen_ns = object.last_seen_ns;
  state.observations = object.observations;
  return state;
}

// Whether a reader of one has nothing to learn from the other; surfaces apart.
bool SameState(const ObjectView& a, const ObjectView& b) {
  return a.class_name == b.class_name && a.source_id == b.source_id &&
         a.life_state == b.life_state && a.T_W_L.matrix() == b.T_W_L.matrix() &&
         a.twist.linear_mps == b.twist.linear_mps &&
         a.twist.angular_radps == b.twist.angular_radps && a.screw_W == b.screw_W &&
         a.position_sigma_m == b.position_sigma_m && a.velocity_sigma_mps == b.velocity_sigma_mps &&
         a.first_seen_ns == b.first_seen_ns && a.last_seen_ns == b.last_seen_ns &&
         a.observations == b.observations;
}

void AppendIndex(const BlockIndex& block, std::string* bytes) {
  const int32_t index[3] = {block.x, block.y, block.z};
  bytes->append(reinterpret_cast<const char*>(index), sizeof(index));
}

template <typename Message>
void SetPayload(std::string bytes, Message* out) {
  wire::Payload payload = wire::PackPayload(std::move(bytes));
  out->set_payload(std::move(payload.bytes));
  out->set_compression(payload.compression);
  out->set_payload_bytes(payload.payload_bytes);
}

const ObjectView* Find(const MapView* view, const ObjectView& object) {
  if (view == nullptr) return nullptr;
  const auto it = std::lower_bound(
      view->objects.begin(), view->objects.end(), object, [](const auto& a, const auto& b) {
        return std::pair(a.id, a.generation) < std::pair(b.id, b.generation);
      });
  const bool found =
      it != view->objects.end() && it->id == object.id && it->generation == object.generation;
  return found ? &*it : nullptr;
}

}  // namespace

void FillHello(const MappingEngine& engine, bool resumes, v1::WatchHello* hello) {
  FillMapInfo(engine, false, hello->mutable_info());
  hello->set_resumes(resumes);
  hello->set_format_version(kBlockFormatVersion);
  hello->set_stale_after_s(engine.config().stale_after_s);
}

bool WatchMessages::Wanted(const BlockIndex& block, const WatchSelection& selection) const {
  if (!selection.bounds) return true;
  const double voxel_m = view_->field.voxel_size_m();
  const Eigen::Vector3d low = BlockOrigin(block, voxel_m);
  const Eigen::Vector3d high = low.array() + kBlockSide * voxel_m;
  return selection.bounds->intersects(Aabb(low, high));
}

WatchMessages WatchMessages::Checkpoint(ViewPtr view, const WatchSelection& selection) {
  WatchMessages messages(std::move(view));
  messages.checkpoint_ = true;
  if (!selection.poses_only) {
    for (const auto& block : DifferencesBetween({}, messages.view_->field)) {
      if (messages.Wanted(block.index, selection)) messages.blocks_.push_back(block.index);
    }
  }
  for (const ObjectView& object : messages.view_->objects) {
    messages.objects_.push_back({&object, !selection.poses_only});
  }
  return messages;
}

WatchMessages WatchMessages::Delta(const ChangeLog& log, uint64_t revision,
                                   const WatchSelection& selection) {
  WatchMessages messages(log.newest());
  messages.prev_revision_ = revision;
  if (log.previous() && log.previous()->revision == revision) messages.before_ = log.previous();
  ChangeLog::Changes changes = log.Since(revision).value();
  if (!selection.poses_only) {
    messages.blocks_ = std::move(changes.blocks);
    std::erase_if(messages.blocks_,
                  [&](const BlockIndex& block) { return !messages.Wanted(block, selection); });
  }
  const std::set<ObjectKey> surfaces(changes.surfaces.begin(), changes.surfaces.end());
  for (const ObjectView& object : messages.view_->objects) {
    const bool surface =
        !selection.poses_only && surfaces.contains(ObjectKey(object.id, object.generation));
    const ObjectView* known = Find(messages.before_.get(), object);
    if (surface || known == nullptr || !SameState(*known, object)) {
      messages.objects_.push_back({&object, surface});
    }
  }
  messages.evicted_ = std::move(changes.evicted);
  return messages;
}

bool WatchMessages::Next(v1::WatchMapResponse* message) {
  message->Clear();
  if (done_) return false;
  ToProto(StampOf(*view_), message->mutable_stamp());
  size_t budget = kPartBytes;
  const auto fill = [&](auto* part) {
    if (next_block_ < blocks_.size()) FillBlocks(&budget, part->add_blocks());
    while (budget > 0 && next_object_ < objects_.size()) {
      if (FillObject(&budget, part->add_objects())) ++next_object_;
    }
    done_ = next_block_ == blocks_.size() && next_object_ == objects_.size();
    part->set_part(part_++);
    part->set_last_part(done_);
  };
  if (checkpoint_) {
    fill(message->mutable_checkpoint());
    return true;
  }
  v1::WatchDelta* delta = message->mutable_delta();
  delta->set_prev_revision(prev_revision_);
  delta->set_revision(view_->revision);
  fill(delta);
  if (!done_) return true;
  for (const auto& [id, generation] : evicted_) {
    v1::ObjectKey* key = delta->add_evicted_objects();
    key->set_object_id(id.value());
    key->set_generation(generation);
  }
  return true;
}

void WatchMessages::FillBlocks(size_t* budget, v1::FieldBlocks* out) {
  std::string indices, removed, payload;
  size_t used = 0;
  while (next_block_ < blocks_.size() && used < *budget) {
    const BlockIndex& block = blocks_[next_block_++];
    const DistanceField::Region* region =
        view_->field.FindRegion({block.x >> 3, block.y >> 3, block.z >> 3});
    const int slot = DistanceField::RegionOffset(block);
    const FieldBlock* data = region ? region->blocks[slot].get() : nullptr;
    const uint8_t tile = region ? region->tiles[slot] : DistanceField::kNoTile;
    if (data == nullptr && tile == DistanceField::kNoTile) {
      AppendIndex(block, &removed);
    } else {
      AppendIndex(block, &indices);
      AppendBlock(data, tile, before_ ? before_->field.FindBlock(block) : nullptr, &payload);
    }
    used = indices.size() + removed.size() + payload.size();
  }
  *budget -= std::min(*budget, used);
  out->set_indices_i32(std::move(indices));
  out->set_removed_i32(std::move(removed));
  SetPayload(std::move(payload), out);
}

bool WatchMessages::FillObject(size_t* budget, v1::ObjectState* out) {
  const Object& object = objects_[next_object_];
  wire::ToProto(StateOf(*object.view), out);
  *budget -= std::min(*budget, kObjectBytes);
  const ObjectShape* shape = object.view->shape.get();
  if (shape && !shape->bounds_L.isEmpty()) {
    wire::ToProto(Aabb(shape->bounds_L.cast<double>()), out->mutable_box_in_object());
  }
  if (!object.with_surface) return true;
  v1::ObjectSurface* surface = out->mutable_surface();
  const size_t total = shape ? shape->sites.size() : 0;
  surface->set_site_count(total);
  surface->set_first_site(next_site_);
  const ObjectView* known = Find(before_.get(), *object.view);
  std::string changes;
  if (total > 0 && next_site_ == 0 && known && known->shape &&
      total * kSiteBytes <= *budget + kSiteBytes &&
      AppendSiteChanges(known->shape->sites, shape->sites, &changes)) {
    *budget -= std::min(*budget, changes.size());
    surface->set_changes(true);
    SetPayload(std::move(changes), surface);
    return true;
  }
  const size_t count = std::min(total - next_site_, std::max<size_t>(1, *budget / kSiteBytes));
  std::string payload;
  if (count > 0) AppendSites(shape->sites, next_site_, count, &payload);
  *budget -= std::min(*budget, payload.size());
  SetPayload(std::move(payload), surface);
  next_site_ += count;
  if (next_site_ < total) return false;
  next_site_ = 0;
  return true;
}

}  // namespace clearance
