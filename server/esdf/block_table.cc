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
  record.copy_from = record.data.get();
  record.filled = false;
  std::shared_ptr<FieldBlock> fresh = pool_.Take();
  // The pool keeps a retired block as it is at least until the next Begin().
  if (record.data) pool_.Retire(std::move(record.data));
  record.data = std::move(fresh);
}

FieldBlock& BlockTable::Fill(int32_t id) {
  BlockRecord& record = records_[id];
  if (record.filled) return *record.data;
  record.filled = true;
  if (record.copy_from) {
    *record.data = *record.copy_from;
  } else {
    FieldVoxel empty;
    empty.attributes = record.tile;
    record.data->voxels.fill(empty);
  }
  return *record.data;
}

void BlockTable::MakeUniform(int32_t id, uint8_t tile) {
  BlockRecord& record = records_[id];
  record.tile = tile;
  if (!record.data) return;
  pool_.Retire(std::move(record.data));
  record.data = nullptr;
}

uint64_t BlockTable::MemoryBytes() const {
  uint64_t bytes = pool_.size() * sizeof(FieldBlock) + records_.size() * sizeof(BlockRecord);
  for (const BlockRecord& r : records_) {
    if (r.references.size() > 8) bytes += r.references.capacity() * sizeof(int32_t);
    if (r.data) bytes += sizeof(FieldBlock);
  }
  return bytes + ids_.capacity() * (sizeof(BlockIndex) + sizeof(int32_t) + 1);
}

}  // namespace clearance
