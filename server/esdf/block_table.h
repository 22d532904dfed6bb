// The working side of the closest-site field: blocks with links to their neighbours, written copy
// on write so that published fields keep what they show.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/container/inlined_vector.h"
#include "server/core/bytes.h"
#include "server/esdf/block_extraction.h"
#include "server/esdf/block_pool.h"
#include "server/esdf/sweep.h"
#include "server/map/distance_field.h"

namespace clearance {

inline constexpr int32_t kNoBlock = -1;

// One block of space. Either has data, or is uniform: no site, and every voxel has the state `tile`
// (0: nothing known).
struct BlockRecord {
  BlockIndex index;
  std::array<int32_t, kFaces> neighbour;  // record ids, kNoBlock where there is none
  std::shared_ptr<FieldBlock> data;
  std::shared_ptr<FieldBlock> replaced;  // what `data` was before this update; null: `tile`
  bool filled = true;
  uint8_t tile = 0;
  int32_t sites = kNoBlock;  // id in the site table
  uint32_t written_in = 0;   // update in which `data` became ours to write
  uint32_t scanned_in = 0;   // update in which removed sites were looked for
  bool queued = false;
  uint8_t offered = 0;        // faces across which neighbours have something to offer
  uint32_t extracted_in = 0;  // update in which the block was last read from the map
  BlockShadow shadow;
  // Site blocks that this block's voxels name, sorted.
  absl::InlinedVector<int32_t, 8> references;
};

class BlockTable {
 public:
  int32_t Find(const BlockIndex& index) const {
    auto it = ids_.find(index);
    return it == ids_.end() ? kNoBlock : it->second;
  }
  int32_t FindOrCreate(const BlockIndex& index);
  int32_t Neighbour(int32_t id, int face);  // created when absent

  BlockRecord& operator[](int32_t id) { return records_[id]; }
  const BlockRecord& operator[](int32_t id) const { return records_[id]; }
  size_t size() const { return records_.size(); }

  // Starts an update: blocks written from now on are new copies.
  void Begin();
  uint32_t update() const { return update_; }

  // Makes the block's data ours to write until the next Begin(), in two steps: Prepare() takes
  // memory (one thread), Fill() copies what was there (one thread a block, before any use).
  void Prepare(int32_t id);
  FieldBlock& Fill(int32_t id);
  FieldBlock& Write(int32_t id) {
    Prepare(id);
    return Fill(id);
  }
  // Blocks that Prepare() was called for since Begin(), in that order.
  const std::vector<int32_t>& written() const { return written_; }
  // Once every write is done, for each written block: drops what was replaced, or takes it back,
  // where both are alike.
  void Commit(int32_t id);
  void TakeBack(int32_t id);
  // Gives the data up: the block is uniform from now on.
  void MakeUniform(int32_t id, uint8_t tile);

  // Without the blocks that are in use: whoever shows them counts those.
  uint64_t MemoryBytes() const;
  void ReleaseSpare() { pool_.ReleaseSpare(); }

  // For snapshots, between two updates: the records in the order of their ids, so that work that
  // goes on visits them as it would have done. `data` gets the blocks, in that order; they do not
  // change any more.
  void Save(ByteWriter* out, std::vector<std::shared_ptr<const FieldBlock>>* data) const;
  // Into an empty table. `next_block` gives the saved blocks one by one, null when there are no
  // more. DATA_LOSS for bytes that Save did not write; `site_blocks` is how many there are.
  absl::Status Load(ByteReader* in, size_t site_blocks,
                    const std::function<std::shared_ptr<FieldBlock>()>& next_block);

 private:
  absl::flat_hash_map<BlockIndex, int32_t> ids_;
  std::deque<BlockRecord> records_;
  std::vector<int32_t> written_;
  uint32_t update_ = 0;
  BlockPool pool_;
};

}  // namespace clearance
