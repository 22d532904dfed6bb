// A depth image seen from the voxel grid: which cells it sees, and what lies in front of them.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "server/integration/range_image.h"
#include "server/integration/range_pyramid.h"
#include "server/map/voxel.h"

namespace clearance {

class PinholeView {
 public:
  // Depth is evidence up to max_depth_m.
  PinholeView(const RangeImage& image, const Pose& T_W_X, double voxel_size_m, double max_depth_m);

  const RangeImage& image() const { return *image_; }
  const RangePyramid& pyramid() const { return pyramid_; }
  float voxel_size_m() const { return static_cast<float>(h_); }
  float max_depth_m() const { return max_depth_m_; }
  const Eigen::Matrix3f& R_X_W() const { return R_X_W_; }
  // Half the extent of a voxel's cube along the axes of X.
  const Eigen::Vector3f& half_extent_X() const { return half_extent_X_; }
  // Greatest |x / z| and |y / z| of any pixel.
  float max_slope_u() const;
  float max_slope_v() const;

  // In X, the centre of the block's first voxel.
  Eigen::Vector3f FirstCentre(const BlockIndex& block) const;

  // What the image says about a cube of `side_voxels` from the lower corner of `first`.
  enum class Seen { kNothing, kPart, kFree };
  struct Cell {
    Seen seen = Seen::kNothing;
    float nearest = 0;  // depth; <= 0 where the cube reaches behind the camera
  };
  Cell Look(const VoxelIndex& first, int side_voxels) const;

  // Blocks that some ray may reach, in order.
  std::vector<BlockIndex> VisibleBlocks() const;

 private:
  const RangeImage* image_;
  RangePyramid pyramid_;
  double h_;
  float max_depth_m_;
  Pose T_W_X_, T_X_W_;
  Eigen::Matrix3f R_X_W_;
  Eigen::Vector3f half_extent_X_;
};

}  // namespace clearance
