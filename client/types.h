// What the SDK takes and gives: plain structs, no generated types.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/wire/frame.h"
#include "proto/wire/geometry.h"
#include "proto/wire/map_config.h"

namespace clearance::client {

struct MapStamp {
  uint64_t revision = 0;
  uint64_t field_revision = 0;
  uint64_t epoch = 0;
  int64_t stamp_ns = 0;
  double staleness_s = 0;
};

struct SnapshotInfo {
  std::string map, snapshot_id, comment;
  MapStamp stamp;  // the state that it holds
  uint64_t total_bytes = 0;
  uint32_t format_version = 0;
  int64_t created_unix_ns = 0;
};

// The state byte of a distance: state in the low two bits, flags above.
enum class SpaceState : uint8_t { kUnknown = 0, kFree = 1, kOccupied = 2 };
inline constexpr uint8_t kFlagPredicted = 0x04;
inline constexpr uint8_t kFlagClamped = 0x08;
inline constexpr uint8_t kFlagNoGradient = 0x10;
inline constexpr uint8_t kFlagOutsideBounds = 0x20;
inline constexpr uint8_t kFlagStale = 0x40;
inline constexpr uint8_t kFlagLowConfidence = 0x80;
inline SpaceState StateOf(uint8_t state_byte) { return static_cast<SpaceState>(state_byte & 3); }

struct QueryOptions {
  std::string map;                // empty: the client's
  std::optional<int64_t> at_ns;   // absolute time; excludes horizon_s
  double horizon_s = 0;           // after reference_ns, or the map's stamp where that is 0
  std::vector<float> horizons_s;  // one a point; excludes the two above
  int64_t reference_ns = 0;
  bool gradients = false;
  bool objects = false;
  bool sigmas = false;
  bool unknown_distances = false;
  bool weighted_fusion = false;  // the paper's mean instead of the minimum
  bool static_only = false;
  std::vector<uint32_t> only_objects, without_objects;
  double max_distance_m = 0;  // 0: the map's
  double sigma_margin = 0;
  uint64_t min_revision = 0;  // waits up to wait_s for it
  uint64_t epoch = 0;         // 0: any
  uint64_t pin_id = 0;
  double wait_s = 0;
};

enum class ObjectLife { kUnspecified, kTracked, kCoasting, kLost, kRetired };
std::string_view NameOf(ObjectLife life);

struct ObjectBrief {
  uint32_t object_id = 0;
  uint32_t generation = 0;
  std::string class_name;
  ObjectLife life = ObjectLife::kUnspecified;
  Pose T_W_L = Pose::Identity();  // at the answered time
  Twist twist;
};

struct StampedPose {
  int64_t stamp_ns = 0;
  Pose pose = Pose::Identity();
};

struct ObjectInfo {
  ObjectBrief brief;
  OrientedBox box;
  int64_t first_seen_ns = 0, last_seen_ns = 0;
  uint64_t observations = 0;
  std::vector<StampedPose> history;  // where asked for, oldest first
};

struct ObjectList {
  MapStamp stamp;
  int64_t reference_ns = 0;
  std::vector<ObjectInfo> objects;
};

// Answers in the order of the points; optional arrays are empty unless asked for.
struct DistanceAnswers {
  MapStamp stamp;
  int64_t reference_ns = 0;
  std::vector<float> distances_m;
  std::vector<uint8_t> states;
  Eigen::Matrix3Xf gradients_W;
  std::vector<uint32_t> object_ids;  // 0 = static
  std::vector<float> sigmas_m;
  std::vector<float> unknown_distances_m;
  std::vector<ObjectBrief> objects;
};

struct SliceOptions {
  QueryOptions query;  // horizons_s, objects, sigmas and unknown_distances unused
  double z_m = 0;
  std::optional<Aabb> bounds;  // x and y count; absent: all that was observed
  double resolution_m = 0;     // 0: chosen by the server
};

// Row by row; the centre of cell (column, row) is origin_W + resolution_m * (column, row, 0).
struct Slice {
  MapStamp stamp;
  int64_t reference_ns = 0;
  Eigen::Vector3d origin_W = Eigen::Vector3d::Zero();
  double resolution_m = 0;
  uint32_t columns = 0, rows = 0;
  std::vector<float> distances_m;
  std::vector<uint8_t> states;
  std::vector<uint32_t> object_ids;
  Eigen::Matrix3Xf gradients_W;
  std::vector<ObjectInfo> objects;
};

struct SourceInfo {
  std::string source_id;
  std::optional<uint64_t> last_frame_id;
  int64_t last_stamp_ns = 0;
  uint64_t frames_integrated = 0, frames_dropped = 0, frames_rejected = 0;
};

struct MapInfo {
  std::string map;
  wire::MapSettings settings;
  MapStamp stamp;
  std::optional<Aabb> observed_bounds;
  uint64_t memory_bytes = 0;
  uint32_t live_objects = 0, known_objects = 0;
  uint64_t static_voxels = 0;
  std::vector<SourceInfo> sources;
  std::vector<StampedPose> sensor_path;  // where asked for, oldest first
};

struct ServerInfo {
  std::string version, api_version, build;
  double uptime_s = 0;
  std::vector<std::string> maps;
  bool draining = false;
  uint64_t max_message_bytes = 0, max_query_points = 0, max_frame_points = 0, max_slice_cells = 0;
};

// Since the server's start, milliseconds.
struct Latency {
  std::string name;  // a stage of integration, or an RPC
  uint64_t count = 0;
  double mean_ms = 0, p50_ms = 0, p95_ms = 0, p99_ms = 0, max_ms = 0;
};

struct MapStats {
  std::string map;
  MapStamp stamp;
  uint64_t frames_integrated = 0, frames_dropped = 0, frames_rejected = 0, frames_duplicate = 0;
  uint64_t queue_length = 0, queue_capacity = 0;
  uint64_t memory_bytes = 0, static_voxels = 0, field_blocks = 0;
  uint32_t tracked_objects = 0, coasting_objects = 0, lost_objects = 0, retired_objects = 0;
  std::vector<Latency> stages;
};

struct ServerStats {
  std::vector<MapStats> maps;
  uint64_t resident_bytes = 0, open_streams = 0;
  uint32_t threads = 0;
  double uptime_s = 0;
  std::vector<Latency> calls;
};

struct MeshOptions {
  std::string map;
  std::optional<uint32_t> object_id;  // absent: the static map
  bool glb = false;                   // else PLY
  bool object_frame = false;          // else the world at the map's stamp
};

enum class GridKind { kMean = 1, kWeight = 2, kFreeSpace = 3, kDistance = 4 };
struct GridOptions {
  std::string map;
  std::optional<uint32_t> object_id;
  std::vector<GridKind> kinds;  // empty: mean and weight
};

struct ExportResult {
  MapStamp stamp;
  uint64_t bytes = 0;
  uint64_t vertices = 0, triangles = 0;  // of a mesh
};

// Receives a file in order; an error ends the transfer and is returned.
using ByteSink = std::function<absl::Status(std::string_view bytes)>;

}  // namespace clearance::client
