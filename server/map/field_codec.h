// Blocks of a distance field as bytes, for whoever follows a map or keeps it.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/map/distance_field.h"

namespace clearance {

// Of the bytes below and of object_codec's. Readers refuse others.
inline constexpr uint32_t kBlockFormatVersion = 1;

// Appends one block. One byte says how it is told: by its tile (one more byte), whole, or, where
// the reader has `before`, by the voxels that differ. A site is told by its place in the block
// instead of the vector to it, so that voxels with one site have equal bytes, which compress well.
void AppendBlock(const FieldBlock* block, uint8_t tile, const FieldBlock* before,
                 std::string* bytes);

// Reads blocks one after the other from bytes that anybody may have damaged.
class BlockReader {
 public:
  explicit BlockReader(std::string_view bytes) : rest_(bytes) {}

  struct Block {
    std::shared_ptr<const FieldBlock> data;  // nullptr: `tile`
    uint8_t tile = DistanceField::kNoTile;
  };
  // `before`: what the reader holds at this block, nullptr for no voxels. DATA_LOSS where the bytes
  // end early, ask for voxels that are not there, or hold what no field does.
  absl::StatusOr<Block> Next(const FieldBlock* before);
  bool done() const { return rest_.empty(); }

 private:
  std::string_view rest_;
};

}  // namespace clearance
