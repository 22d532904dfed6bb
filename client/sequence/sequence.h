// A recorded sequence in a folder: sequence.json, trajectory.tum, depth or cloud, labels, motions.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "client/sequence/object_table.h"
#include "client/sequence/trajectory.h"
#include "proto/wire/frame.h"

namespace clearance::client {

struct SequenceInfo {
  std::string name;
  bool depth_camera = false;  // else a lidar
  DepthImage intrinsics;      // of a depth camera: size, fx.., scale; no pixels
  double max_range_m = 0;     // 0: not said
  std::optional<double> voxel_size_m;
  uint64_t frame_count = 0;
};

// Reads frames at random. Immutable after Open: frames may be read from several threads.
class Sequence {
 public:
  // Reads everything but the observations. NOT_FOUND where the folder is missing or has no
  // sequence.json; DATA_LOSS naming file, line or key where it is incomplete or inconsistent.
  static absl::StatusOr<Sequence> Open(const std::filesystem::path& folder);

  const std::filesystem::path& folder() const { return folder_; }
  const SequenceInfo& info() const { return info_; }
  uint64_t size() const { return info_.frame_count; }
  int64_t stamp_ns(uint64_t index) const { return trajectory_.stamps_ns[index]; }
  // The folder's name as a map or source id: lower case, other characters become '-'.
  std::string Id() const;

  // Frame `index` < size(), with frame_id = index. DATA_LOSS naming file and byte where a file of
  // it is missing, truncated, corrupt or of another size.
  absl::StatusOr<Frame> Read(uint64_t index) const;

 private:
  absl::StatusOr<DepthImage> ReadDepth(uint64_t index) const;
  absl::Status CheckMotionsAreKnown(const std::vector<uint16_t>& labels, uint64_t index) const;

  std::filesystem::path folder_;
  SequenceInfo info_;
  SensorPath trajectory_;
  bool has_label_images_ = false;
  bool has_motions_ = false;
  MotionTable motions_;
  std::map<ObjectId, std::string> class_names_;
};

}  // namespace clearance::client
