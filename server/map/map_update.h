// The outcome of integrating one frame, as plain data: WorldMap::Apply is the only thing that needs it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/core/frame.h"
#include "server/core/object_id.h"
#include "server/core/pose.h"
#include "server/map/voxel.h"

namespace clearance {

// Observations d_k with weight (1 - v_k) at voxel centres of the surface band (paper Eq. (5)'s input),
// grouped by block; blocks sorted and unique.
struct BandObservations {
  struct Block {
    BlockIndex block;
    uint32_t begin = 0, end = 0;  // range in the arrays below
  };
  std::vector<Block> blocks;
  std::vector<uint16_t> offset;   // in the block, rising within a block
  std::vector<float> distance_m;  // signed, > 0 outside
  std::vector<float> weight;      // 1 - v, in (0, 1]; 0: what is stored was seen again
};

// Free evidence of one block. confident is a subset of probable.
struct FreeBlock {
  BlockIndex block;
  BlockMask confident{};     // the whole cube was seen empty this frame
  BlockMask probable{};      // some ray passed through the cube this frame
  BlockMask contradicted{};  // rays went through the surface stored in this voxel
  BlockMask refuted{};       // of these, the ones whose surface goes at once
  BlockMask hit{};           // a static return lies in the cube; excludes the others
};

// Surface that must go at once: an object claims the space.
struct ReleasedBlock {
  BlockIndex block;
  BlockMask voxels{};
};

struct SurfaceUpdate {
  BandObservations band;
  std::vector<FreeBlock> free;          // sorted by block, unique
  std::vector<ReleasedBlock> released;  // sorted by block, unique; applied before the band
};

struct FusionOptions {
  float max_weight = 20.f;   // cap, so that surfaces can move
  float min_weight = 0.3f;   // below it a voxel's mean is not surface yet
};

enum class ObjectEvent {
  kCreated,     // first sight, or a new generation
  kMoved,       // pose known in this frame (chained or absolute), seen or not
  kCoasted,     // no usable motion: constant twist
  kReanchored,  // pose regained after a gap
};

struct ObjectUpdate {
  ObjectId id;
  ObjectEvent event = ObjectEvent::kMoved;
  Pose T_W_L = Pose::Identity();  // at this frame, re-orthonormalised
  std::optional<Pose> H_W;        // world motion since the object's previous pose, where known
  double motion_period_s = 0;     // time that H_W spans
  bool observed = false;          // had points in this frame
  std::string class_name;         // empty: unchanged
  SurfaceUpdate surface;          // in L
};

struct MapUpdate {
  std::string source_id;
  uint64_t frame_id = 0;
  int64_t stamp_ns = 0;
  Pose T_W_X = Pose::Identity();
  SurfaceUpdate static_surface;       // in W
  std::vector<ObjectUpdate> objects;  // by id, unique
  std::vector<Violation> violations;  // refused object motions; the frame counts
};

}  // namespace clearance
