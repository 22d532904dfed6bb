// How far unknown space is from a point.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "absl/container/flat_hash_map.h"
#include "server/map/distance_field.h"

namespace clearance {

// Searches one field outwards, block by block. Keeps what it learnt of the blocks it saw; not
// shared between threads; the field must not change meanwhile.
class UnknownSearch {
 public:
  explicit UnknownSearch(const DistanceField& field) : field_(field) {}

  // Distance from an addressable point (see StaticLookup) to the nearest cube of a voxel whose
  // state is UNKNOWN, metres, 0 inside one, at most `max_distance_m`. Exact to the cubes. Space
  // that the field stores nothing of is unknown.
  float Distance(const Eigen::Vector3d& p_W, double max_distance_m);

 private:
  enum class Content : uint8_t { kNoneUnknown, kAllUnknown, kMixed };
  struct Block {
    Content content = Content::kAllUnknown;
    BlockMask unknown{};  // where content is kMixed
  };

  const Block& Summary(const BlockIndex& block);
  void SearchBlock(const BlockIndex& block, const Eigen::Vector3d& p_voxels, double* best_squared);

  const DistanceField& field_;
  absl::flat_hash_map<BlockIndex, Block> summaries_;
};

}  // namespace clearance
