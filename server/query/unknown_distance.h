// How far unknown space, or the inner side of surfaces, is from a point.
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
  // kUnknown: voxels whose state is UNKNOWN, and all that the field stores nothing of. kInner:
  // voxels whose centre is on the inner side of a surface.
  enum class Sought { kUnknown, kInner };
  explicit UnknownSearch(const DistanceField& field, Sought sought = Sought::kUnknown)
      : field_(field), sought_(sought) {}

  // Distance from an addressable point (see StaticLookup) to the nearest cube of a sought voxel,
  // metres, 0 inside one, at most `max_distance_m`. Exact to the cubes.
  float Distance(const Eigen::Vector3d& p_W, double max_distance_m);

 private:
  enum class Content : uint8_t { kNone, kAll, kMixed };
  struct Block {
    Content content = Content::kNone;
    BlockMask sought{};  // where content is kMixed
  };

  const Block& Summary(const BlockIndex& block);
  void SearchBlock(const BlockIndex& block, const Eigen::Vector3d& p_voxels, double* best_squared);

  const DistanceField& field_;
  const Sought sought_;
  absl::flat_hash_map<BlockIndex, Block> summaries_;
};

}  // namespace clearance
