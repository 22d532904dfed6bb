#include "planner_demo/sequence/sequence_writer.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "planner_demo/sequence/image_file.h"
#include "planner_demo/sequence/ply_file.h"
#include "planner_demo/sim/simulator.h"

namespace clearance::sim {
namespace {

namespace fs = std::filesystem;
constexpr char kPoseHeader[] = "frame,object_id,tx,ty,tz,qx,qy,qz,qw\n";

// "tx<separator>ty ... qw" with twelve digits.
std::string PoseText(const Eigen::Isometry3d& T, char separator) {
  Eigen::Quaterniond q(T.linear());
  q.normalize();
  std::string text;
  for (const double value : {T.translation().x(), T.translation().y(), T.translation().z(), q.x(),
                             q.y(), q.z(), q.w()}) {
    if (!text.empty()) text += separator;
    absl::StrAppendFormat(&text, "%.12f", value);
  }
  return text;
}

absl::Status WriteText(const fs::path& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  out << text;
  out.close();
  if (out.good()) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat("cannot write ", path.string()));
}

nlohmann::ordered_json SensorJson(const Sensor& sensor) {
  if (const auto* camera = std::get_if<DepthCamera>(&sensor)) {
    return {{"type", "depth_camera"},
            {"width", camera->width},
            {"height", camera->height},
            {"fx", camera->fx},
            {"fy", camera->fy},
            {"cx", camera->cx},
            {"cy", camera->cy},
            {"depth_scale_m", camera->depth_scale_m},
            {"max_range_m", camera->max_range_m}};
  }
  const Lidar& lidar = std::get<Lidar>(sensor);
  const auto degrees = [](double rad) {
    return std::round(rad * 180.0 / std::numbers::pi * 1e9) / 1e9;
  };
  return {{"type", "lidar"},
          {"columns", lidar.columns},
          {"beams", lidar.beams},
          {"elevation_min_deg", degrees(lidar.elevation_min_rad)},
          {"elevation_max_deg", degrees(lidar.elevation_max_rad)},
          {"max_range_m", lidar.max_range_m}};
}

std::string Description(const Scene& scene, const SequenceOptions& options) {
  const nlohmann::ordered_json info = {{"name", absl::StrCat(scene.name, "-", options.seed)},
                                       {"source", options.source},
                                       {"licence", "CC0-1.0"},
                                       {"sensor", SensorJson(scene.sensor)},
                                       {"frame_count", scene.frame_count},
                                       {"voxel_size_m", scene.voxel_size_m},
                                       {"rate_hz", scene.rate_hz},
                                       {"future_frames", scene.future_frames},
                                       {"depth_noise_m", options.noise.depth_sigma_m},
                                       {"motion_noise_m", options.noise.motion_sigma_m},
                                       {"label_shrink_px", options.noise.label_shrink_px},
                                       {"label_grow_px", options.noise.label_grow_px},
                                       {"late_label_frames", options.noise.late_label_frames},
                                       {"notes", scene.notes}};
  return info.dump(1) + "\n";
}

absl::Status WriteScan(const fs::path& folder, const Sensor& sensor,
                       const std::vector<Eigen::Vector3d>& directions_X,
                       const SimulatedFrame& frame) {
  const std::string name = absl::StrFormat("%06d", frame.frame);
  const Scan& scan = frame.scan;
  if (const auto* camera = std::get_if<DepthCamera>(&sensor)) {
    std::vector<uint16_t> depth(scan.ranges_m.size());
    std::vector<uint16_t> label = scan.labels;
    for (size_t i = 0; i < depth.size(); ++i) {
      const double steps = std::round(scan.ranges_m[i] / camera->depth_scale_m);
      depth[i] = steps <= 65535.0 ? static_cast<uint16_t>(steps) : 0;
      if (depth[i] == 0) label[i] = 0;
    }
    if (auto s = WritePng16(folder / "depth" / (name + ".png"), scan.columns, scan.rows, depth);
        !s.ok()) {
      return s;
    }
    return WritePng16(folder / "label" / (name + ".png"), scan.columns, scan.rows, label);
  }
  Eigen::Matrix3Xf points_X(3, scan.ranges_m.size());
  std::vector<uint16_t> labels;
  for (size_t i = 0; i < scan.ranges_m.size(); ++i) {
    if (scan.ranges_m[i] <= 0.0) continue;
    points_X.col(labels.size()) = (scan.ranges_m[i] * directions_X[i]).cast<float>();
    labels.push_back(scan.labels[i]);
  }
  points_X.conservativeResize(3, labels.size());
  return WriteCloud(folder / "cloud" / (name + ".ply"), points_X, labels);
}

// What the objects are, with the size of the box around each in its body frame.
std::string ObjectTable(const Scene& scene) {
  std::string table = "object_id,class,moving,length,width,height\n";
  for (const Mover& mover : scene.movers) {
    Eigen::AlignedBox3d box;
    for (const Solid& solid : mover.solids) box.extend(Bounds(solid));
    absl::StrAppendFormat(&table, "%d,%s,1,%.3f,%.3f,%.3f\n", mover.id, mover.class_name,
                          box.sizes().x(), box.sizes().y(), box.sizes().z());
  }
  return table;
}

absl::Status WriteGroundTruth(const Scene& scene, const fs::path& gt) {
  std::string poses = kPoseHeader;
  for (int frame = 0; frame < scene.frame_count + scene.future_frames; ++frame) {
    for (const Mover& mover : scene.movers) {
      absl::StrAppend(&poses, frame, ",", mover.id, ",",
                      PoseText(mover.T_W_L(frame / scene.rate_hz), ','), "\n");
    }
  }
  if (auto s = WriteText(gt / "object_poses.csv", poses); !s.ok()) return s;
  for (const Mover& mover : scene.movers) {
    const fs::path path = gt / "objects" / absl::StrCat(mover.id, ".ply");
    if (auto s = WriteMesh(path, Triangulate(mover.solids)); !s.ok()) return s;
  }
  return WriteMesh(gt / "static.ply", Triangulate(scene.static_solids));
}

absl::Status MakeFolders(const Scene& scene, const fs::path& folder) {
  const bool camera = std::holds_alternative<DepthCamera>(scene.sensor);
  std::error_code error;
  // Scans of a longer or another recording would mix with the new ones.
  for (const char* scans : {"depth", "label", "cloud"}) {
    if (fs::exists(folder / scans, error) && !fs::is_empty(folder / scans, error)) {
      return absl::AlreadyExistsError(absl::StrCat((folder / scans).string(),
                                                   " holds scans already: remove the folder or "
                                                   "name another one"));
    }
  }
  std::vector<fs::path> folders = {folder / "gt" / "objects"};
  if (camera) {
    folders.push_back(folder / "depth");
    folders.push_back(folder / "label");
  } else {
    folders.push_back(folder / "cloud");
  }
  for (const fs::path& path : folders) {
    fs::create_directories(path, error);
    if (error) {
      return absl::UnavailableError(
          absl::StrCat("cannot create ", path.string(), ": ", error.message()));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status WriteSequence(const Scene& scene, const SequenceOptions& options,
                           const std::string& folder_name) {
  const fs::path folder(folder_name);
  if (auto s = MakeFolders(scene, folder); !s.ok()) return s;

  Simulator simulator(scene, options.noise, options.seed);
  const std::vector<Eigen::Vector3d> directions_X = RayDirections(scene.sensor);
  std::string trajectory;
  std::string motions = kPoseHeader;
  std::string visibility = "frame,object_id,pixels\n";
  const std::string objects = ObjectTable(scene);
  for (int k = 0; k < scene.frame_count; ++k) {
    const SimulatedFrame frame = simulator.Next();
    if (auto s = WriteScan(folder, scene.sensor, directions_X, frame); !s.ok()) return s;
    absl::StrAppendFormat(&trajectory, "%.6f %s\n", frame.time_s, PoseText(frame.T_W_X, ' '));
    for (const SimulatedFrame::Motion& motion : frame.motions) {
      absl::StrAppend(&motions, k, ",", motion.object_id, ",", PoseText(motion.H_W, ','), "\n");
    }
    for (const auto& [id, pixels] : frame.true_pixels) {
      absl::StrAppend(&visibility, k, ",", id, ",", pixels, "\n");
    }
    if (options.progress) options.progress(k);
  }
  for (const auto& [name, text] :
       {std::pair<const char*, const std::string*>{"trajectory.tum", &trajectory},
        {"object_motions.csv", &motions},
        {"objects.csv", &objects},
        {"gt/visibility.csv", &visibility}}) {
    if (auto s = WriteText(folder / name, *text); !s.ok()) return s;
  }
  if (auto s = WriteGroundTruth(scene, folder / "gt"); !s.ok()) return s;
  // Last, so that a folder with a sequence.json is complete.
  return WriteText(folder / "sequence.json", Description(scene, options));
}

}  // namespace clearance::sim
