#include "server/esdf/block_table.h"

namespace clearance {

int32_t BlockTable::FindOrCreate(const BlockIndex& index) {
  const int32_t id = static_cast<int32_t>(records_.size());
  auto [it, created] = ids_.emplace(index, id);
  if (!created) return it->second;
  BlockRecord& record = records_.emplace_back();
  record.index = index;
  for (int f = 0; f < kFaces; ++f) {
    const int32_t other =
        Find({index.x + kFaceStep[f][0], index.y + kFaceStep[f][1], index.z + kFaceStep[f][2]});
    record.neighbour[f] = other;
    if (other != kNoBlock) records_[other].neighbour[f ^ 1] = id;
  }
  return id;
}

int32_t BlockTable::Neighbour(int32_t id, int face) {
  const int32_t other = records_[id].neighbour[face];
  if (other != kNoBlock) return other;
  const BlockIndex b = records_[id].index;
  return FindOrCreate(
      {b.x + kFaceStep[face][0], b.y + kFaceStep[face][1], b.z + kFaceStep[face][2]});
}

void BlockTable::Begin() {
  ++update_;
  written_.clear();
  pool_.NextGeneration();
}

void BlockTable::Prepare(int32_t id) {
  BlockRecord& record = records_[id];
  if (record.data && record.written_in == update_) return;
  if (record.written_in != update_) written_.push_back(id);
  record.written_in = update_;
  record.filled = false;
  record.replaced = std::move(record.data);
  record.data = pool_.Take();
}

FieldBlock& BlockTable::Fill(int32_t id) {
  BlockRecord& record = records_[id];
  if (record.filled) return *record.data;
  record.filled = true;
  if (record.replaced) {
    *record.data = *record.replaced;
  } else {
    FieldVoxel empty;
    empty.attributes = record.tile;
    record.data->voxels.fill(empty);
  }
  return *record.data;
}

void BlockTable::Commit(int32_t id) {
  BlockRecord& record = records_[id];
  if (record.replaced) pool_.Retire(std::move(record.replaced));
  record.replaced = nullptr;
}

void BlockTable::TakeBack(int32_t id) {
  BlockRecord& record = records_[id];
  pool_.Retire(std::move(record.data));
  record.data = std::move(record.replaced);
  record.replaced = nullptr;
}

void BlockTable::MakeUniform(int32_t id, uint8_t tile) {
  BlockRecord& record = records_[id];
  record.tile = tile;
  if (!record.data) return;
  pool_.Retire(std::move(record.data));
  record.data = nullptr;
}

void BlockTable::Save(ByteWriter* out, std::vector<std::shared_ptr<const FieldBlock>>* data) const {
  out->Put<uint64_t>(records_.size());
  for (const BlockRecord& r : records_) {
    out->Put(r.index);
    out->Put<uint8_t>(r.data != nullptr);
    out->Put(r.tile);
    out->Put(r.sites);
    out->Put(r.shadow);
    out->Put<uint32_t>(static_cast<uint32_t>(r.references.size()));
    for (int32_t s : r.references) out->Put(s);
    if (r.data) data->push_back(r.data);
  }
}

absl::Status BlockTable::Load(ByteReader* in, size_t site_blocks,
                              const std::function<std::shared_ptr<FieldBlock>()>& next_block) {
  const auto names_sites = [site_blocks](int32_t s) {
    return s >= 0 && static_cast<size_t>(s) < site_blocks;
  };
  const size_t count = in->GetCount(sizeof(BlockIndex));
  ids_.reserve(count);
  for (size_t i = 0; i < count && in->ok(); ++i) {
    if (FindOrCreate(in->Get<BlockIndex>()) != static_cast<int32_t>(i)) {
      return in->Error("a block is listed twice");
    }
    BlockRecord& r = records_.back();
    if (in->Get<uint8_t>() != 0) {
      r.data = next_block();
      if (!r.data) return in->Error("a block's voxels are missing");
    }
    r.tile = in->Get<uint8_t>();
    r.sites = in->Get<int32_t>();
    if (r.sites != kNoBlock && !names_sites(r.sites)) return in->Error("bad site block");
    r.shadow = in->Get<BlockShadow>();
    for (uint32_t left = in->Get<uint32_t>(); left > 0 && in->ok(); --left) {
      r.references.push_back(in->Get<int32_t>());
      if (!names_sites(r.references.back())) return in->Error("bad reference");
    }
  }
  return in->ok() ? absl::OkStatus() : in->Finish();
}

uint64_t BlockTable::MemoryBytes() const {
  uint64_t bytes = pool_.size() * sizeof(FieldBlock) + records_.size() * sizeof(BlockRecord);
  for (const BlockRecord& r : records_) {
    if (r.references.size() > 8) bytes += r.references.capacity() * sizeof(int32_t);
  }
  return bytes + ids_.capacity() * (sizeof(BlockIndex) + sizeof(int32_t) + 1);
}

}  // namespace clearance
