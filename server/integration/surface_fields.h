// The local Gaussian-process fields of one frame: one for each surface voxel, on the centroids of
// its 3x3x3 neighbourhood.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "server/field/gp_batch.h"
#include "server/field/gp_options.h"
#include "server/field/local_gp_field.h"
#include "server/integration/block_table.h"
#include "server/integration/local_voxels.h"
#include "server/map/surface_map.h"

namespace clearance {

// Immutable once trained; safe to read from many threads. Deterministic.
class SurfaceFields {
 public:
  // sensor_M: where the sensor was, in the voxels' frame; normals point towards it. `voxels` and
  // `table` must outlive the fields. noise_m: standard deviation of one point along its ray.
  SurfaceFields(const LocalVoxels& voxels, const BlockTable& table, const Eigen::Vector3d& sensor_M,
                double noise_m, const GpOptions& options);

  // Trains the fields of the voxels with wanted[i], which alone may be evaluated then. What they
  // give does not depend on which others are wanted. Once.
  void Train(const std::vector<uint8_t>& wanted);

  // A field at eight points, metres from the origin of its voxel's block.
  struct Samples {
    Lanes latent, variance;        // o and v of GpSample
    std::array<Lanes, 3> to_foot;  // from the point to the nearest surface point, m
  };
  Samples Evaluate(uint32_t voxel, const std::array<Lanes, 3>& x) const;

  // Unit normal of the centroids around a voxel, towards the sensor.
  const Eigen::Vector3f& normal(uint32_t voxel) const { return normal_[voxel]; }
  // Voxels of few points beside voxels of many are noise; they have no field. By voxel, 0 or 1.
  const std::vector<uint8_t>& strays() const { return stray_; }
  uint32_t block_id(uint32_t voxel) const { return block_of_[voxel]; }
  const BlockIndex& block_of(uint32_t voxel) const {
    return voxels_.blocks[block_of_[voxel]].block;
  }

 private:
  // The centroids that a voxel's field is trained on, from its own block's origin.
  struct Neighbourhood {
    uint32_t own = 0;
    int count = 0;
    std::array<uint32_t, GpBatch::kMaxPoints> voxel;
    std::array<Eigen::Vector3f, GpBatch::kMaxPoints> point;
    std::array<float, GpBatch::kMaxPoints> noise_variance;
  };
  struct Batch {
    size_t storage = 0;  // in the chunk's
    int size = 0;
    std::array<uint32_t, kLanes> voxel;  // unused lanes repeat the first
  };
  // Blocks trained together; chunks are of fixed extent, so results do not depend on threads.
  struct Chunk {
    size_t first_block = 0, last_block = 0;
    std::vector<Lanes> storage;
    std::vector<Batch> batches;
    std::vector<uint32_t> neighbours;  // voxels that the fields are trained on
  };
  struct Location {
    uint32_t chunk = 0, batch = 0, neighbours = 0;  // the last two in the chunk's
    uint8_t lane = 0, count = 0;
  };

  // Voxels around a block by HaloOffset, -1 where there is no surface.
  using Halo = std::array<int32_t, kHaloVoxels>;
  Halo HaloOf(size_t block) const;
  void FindStrays(size_t block);
  void Need(const std::vector<uint8_t>& wanted);
  void Gather(size_t block, std::vector<Neighbourhood>& out) const;
  void TrainChunk(uint32_t chunk);
  void FindNormalsAndShifts(const Chunk& chunk, const Batch& batch,
                            const Neighbourhood* const neighbourhoods[kLanes]);
  Samples EvaluateReference(uint32_t voxel, const std::array<Lanes, 3>& x) const;

  const LocalVoxels& voxels_;
  const BlockTable& table_;
  Eigen::Vector3d sensor_M_;
  GpOptions options_;
  float length_m_;
  float stray_share_, shift_gain_;
  std::vector<Chunk> chunks_;
  std::vector<Location> location_;       // by voxel
  std::vector<uint32_t> block_of_;       // by voxel
  std::vector<uint8_t> stray_;           // by voxel
  std::vector<uint8_t> needed_;          // by voxel: wanted, or beside one that is
  std::vector<Eigen::Vector3f> normal_;  // by voxel
  std::vector<Eigen::Vector3f> shift_;   // by voxel; undoes the curvature bias of the foot
  std::vector<std::optional<LocalGpField>> reference_;  // by voxel, kernels other than SE
};

}  // namespace clearance
