// A spherical range image seen from the voxel grid: which cubes it saw wholly empty.
#pragma once

#include "server/integration/range_image.h"
#include "server/integration/range_pyramid.h"
#include "server/map/map_update.h"
#include "server/map/voxel.h"

namespace clearance {

class SphericalView {
 public:
  SphericalView(const RangeImage& image, const Pose& T_W_X, double voxel_size_m,
                double max_range_m);

  // Sets block.confident: of the probable voxels, those with nothing but returns beyond the cube in
  // every direction that meets it, one pixel more included. Sparse parts of the image never are.
  void ObserveConfident(FreeBlock& block) const;

 private:
  // How the whole block appears: decides all of its voxels, or leaves them open.
  enum class Seen { kFree, kOpen, kNever };
  struct Look {
    Seen seen = Seen::kNever;
    int level = 0;  // whose 3 x 3 cells cover the footprint of any of its voxels
  };
  Look LookAt(const Eigen::Vector3f& centre_X) const;

  const RangeImage* image_;
  RangePyramid pyramid_;
  double h_;
  float max_range_m_;
  Pose T_X_W_;
  Eigen::Matrix3f steps_X_;  // a voxel along each axis of W, in X
};

}  // namespace clearance
