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

namespace clearance {

// Immutable once built; safe to read from many threads. Deterministic.
class SurfaceFields {
 public:
  // sensor_M: where the sensor was, in the voxels' frame; normals point towards it. `voxels` must
  // outlive the fields. noise_m: standard deviation of one point along its ray.
  SurfaceFields(const LocalVoxels& voxels, const BlockTable& table, const Eigen::Vector3d& sensor_M,
                double noise_m, const GpOptions& options);

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
  const BlockIndex& block_of(uint32_t voxel) const {
    return voxels_.blocks[block_of_[voxel]].block;
  }

 private:
  // The centroids that a voxel's field is trained on, from its own block's origin.
  struct Neighbourhood {
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
  };
  struct Location {
    uint32_t chunk = 0, batch = 0;
    uint8_t lane = 0, count = 0;
  };

  void Gather(size_t block, const BlockTable& table, std::vector<Neighbourhood>& out);
  void TrainChunk(uint32_t chunk, const BlockTable& table, const Eigen::Vector3d& sensor_M);
  void FindNormalsAndShifts(const Chunk& chunk, const Batch& batch,
                            const std::vector<Neighbourhood>& neighbourhoods,
                            const Eigen::Vector3d& sensor_M);
  Samples EvaluateReference(uint32_t voxel, const std::array<Lanes, 3>& x) const;

  const LocalVoxels& voxels_;
  GpOptions options_;
  float length_m_;
  float stray_share_, shift_gain_;
  std::vector<Chunk> chunks_;
  std::vector<Location> location_;                                     // by voxel
  std::vector<uint32_t> block_of_;                                     // by voxel
  std::vector<std::array<uint32_t, GpBatch::kMaxPoints>> neighbours_;  // by voxel
  std::vector<uint8_t> stray_;                                         // by voxel
  std::vector<Eigen::Vector3f> normal_;                                // by voxel
  std::vector<Eigen::Vector3f> shift_;  // by voxel; undoes the curvature bias of the foot
  std::vector<std::optional<LocalGpField>> reference_;  // by voxel, kernels other than SE
};

}  // namespace clearance
