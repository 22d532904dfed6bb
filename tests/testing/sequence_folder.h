// Reads a recorded or simulated sequence folder for tests and evaluation programs.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "server/core/frame.h"

namespace clearance::testing {

struct SequenceFolder {
  std::filesystem::path path;
  bool lidar = false;
  double voxel_size_m = 0.1, max_range_m = 25.0;
  double fx = 0, fy = 0, cx = 0, cy = 0, depth_scale_m = 0;
  std::vector<int64_t> stamps_ns;
  std::vector<Pose> T_W_X;
  std::map<int, std::vector<ObjectMotion>> motions;  // by frame

  int size() const { return static_cast<int>(T_W_X.size()); }
};

// The folder CLEARANCE_DATA_DIR/name, by default ../shared/data/name; empty where it is missing.
std::filesystem::path DataFolder(const std::string& name);

// Both throw std::runtime_error naming the file that is missing or wrong.
SequenceFolder OpenSequence(const std::filesystem::path& path);
Frame ReadFrame(const SequenceFolder& sequence, int k);

struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Eigen::Vector3i> triangles;
};
TriangleMesh ReadMesh(const std::filesystem::path& path);

}  // namespace clearance::testing
