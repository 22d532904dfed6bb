// FieldUpdater on its way into a snapshot and out of it.
#include <utility>

#include "server/esdf/field_updater.h"

namespace clearance {

FieldUpdater::Saved FieldUpdater::Save() const {
  Saved saved;
  ByteWriter out;
  out.Put<uint64_t>(sites_.size());
  for (const SiteBlock& sites : sites_) sites.Save(&out);
  table_.Save(&out, &saved.blocks);
  saved.table = out.Take();
  return saved;
}

absl::StatusOr<FieldUpdater> FieldUpdater::Load(const MapConfig& config,
                                                const FusionOptions& fusion, std::string_view table,
                                                std::string_view blocks) {
  FieldUpdater updater(config, fusion);
  ByteReader in(table, "distance field");
  for (size_t left = in.GetCount(sizeof(BlockIndex)); left > 0; --left) {
    absl::StatusOr<SiteBlock> sites = SiteBlock::Load(&in);
    if (!sites.ok()) return sites.status();
    updater.sites_.push_back(*std::move(sites));
  }
  const auto next_block = [&blocks]() -> std::shared_ptr<FieldBlock> {
    if (blocks.size() < sizeof(FieldBlock)) return nullptr;
    auto block = std::make_shared<FieldBlock>();
    std::memcpy(block->voxels.data(), blocks.data(), sizeof(FieldBlock));
    blocks.remove_prefix(sizeof(FieldBlock));
    return block;
  };
  if (absl::Status s = updater.table_.Load(&in, updater.sites_.size(), next_block); !s.ok()) {
    return s;
  }
  if (absl::Status s = in.Finish(); !s.ok()) return s;
  if (!blocks.empty()) return in.Error("more voxels than blocks");
  const int32_t records = static_cast<int32_t>(updater.table_.size());
  for (const SiteBlock& sites : updater.sites_) {
    for (int32_t id : sites.referrers) {
      if (id < 0 || id >= records) return in.Error("bad referrer");
    }
  }
  for (int32_t id = 0; id < records; ++id) updater.PublishBlock(id);
  return updater;
}

}  // namespace clearance
