#include "client/sequence/sequence.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/sequence/ply_cloud.h"
#include "client/sequence/png_image.h"
#include "client/sequence/text.h"

namespace clearance::client {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

std::string FileName(uint64_t index, const char* extension) {
  return absl::StrFormat("%06d.%s", index, extension);
}

absl::Status BadKey(const fs::path& path, std::string_view key, std::string_view expected) {
  return absl::DataLossError(absl::StrFormat("%s: key \"%s\": expected %s", path.string(),
                                             std::string(key), std::string(expected)));
}

// A positive number at `key`, or nothing where the key is absent.
absl::StatusOr<std::optional<double>> Positive(const Json& json, const char* key,
                                               const fs::path& path) {
  const auto entry = json.find(key);
  if (entry == json.end()) return std::optional<double>();
  if (!entry->is_number() || !std::isfinite(entry->get<double>()) || entry->get<double>() <= 0) {
    return BadKey(path, key, "a number above 0");
  }
  return std::optional<double>(entry->get<double>());
}

absl::Status ReadIntrinsics(const Json& sensor, const fs::path& path, DepthImage& image) {
  const struct {
    const char* key;
    double* target;
    bool positive;
  } numbers[] = {{"fx", &image.fx, true},
                 {"fy", &image.fy, true},
                 {"cx", &image.cx, false},
                 {"cy", &image.cy, false},
                 {"depth_scale_m", &image.depth_scale_m, true}};
  for (const auto& number : numbers) {
    const auto entry = sensor.find(number.key);
    if (entry == sensor.end() || !entry->is_number() ||
        (number.positive && entry->get<double>() <= 0)) {
      return BadKey(path, absl::StrCat("sensor.", number.key),
                    number.positive ? "a number above 0" : "a number");
    }
    *number.target = entry->get<double>();
  }
  for (auto [key, target] : {std::pair{"width", &image.width}, {"height", &image.height}}) {
    const auto entry = sensor.find(key);
    if (entry == sensor.end() || !entry->is_number_unsigned() || entry->get<uint64_t>() == 0 ||
        entry->get<uint64_t>() > 65535) {
      return BadKey(path, absl::StrCat("sensor.", key), "a size in pixels from 1 to 65535");
    }
    *target = entry->get<uint32_t>();
  }
  return absl::OkStatus();
}

absl::StatusOr<SequenceInfo> ParseInfo(const std::string& text, const fs::path& path) {
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded() || !json.is_object()) {
    return absl::DataLossError(
        absl::StrFormat("%s: expected a JSON object (%d bytes read)", path.string(), text.size()));
  }
  SequenceInfo info;
  if (const auto name = json.find("name"); name != json.end() && name->is_string()) {
    info.name = name->get<std::string>();
  }
  const auto count = json.find("frame_count");
  if (count == json.end() || !count->is_number_unsigned() || count->get<uint64_t>() == 0) {
    return BadKey(path, "frame_count", "a number of frames above 0");
  }
  info.frame_count = count->get<uint64_t>();
  const auto voxel_size = Positive(json, "voxel_size_m", path);
  if (!voxel_size.ok()) return voxel_size.status();
  info.voxel_size_m = *voxel_size;
  const auto sensor = json.find("sensor");
  if (sensor == json.end() || !sensor->is_object()) return BadKey(path, "sensor", "an object");
  const auto type = sensor->find("type");
  const std::string type_name =
      type != sensor->end() && type->is_string() ? type->get<std::string>() : "";
  if (type_name != "depth_camera" && type_name != "lidar") {
    return BadKey(path, "sensor.type", "\"depth_camera\" or \"lidar\"");
  }
  info.depth_camera = type_name == "depth_camera";
  const auto range = Positive(*sensor, "max_range_m", path);
  if (!range.ok()) return range.status();
  info.max_range_m = range->value_or(0);
  if (info.depth_camera) {
    if (absl::Status s = ReadIntrinsics(*sensor, path, info.intrinsics); !s.ok()) return s;
  }
  return info;
}

}  // namespace

absl::StatusOr<Sequence> Sequence::Open(const fs::path& folder) {
  Sequence sequence;
  std::error_code error;
  sequence.folder_ = fs::canonical(folder, error);
  if (error || !fs::is_directory(sequence.folder_, error)) {
    return absl::NotFoundError(
        absl::StrFormat("%s: no such folder; expected a sequence folder", folder.string()));
  }
  const fs::path& root = sequence.folder_;
  const fs::path info_path = root / "sequence.json";
  if (!fs::exists(info_path, error)) {
    return absl::NotFoundError(
        absl::StrFormat("%s: has no sequence.json; expected a sequence folder", folder.string()));
  }
  const auto text = ReadWholeFile(info_path);
  if (!text.ok()) return text.status();
  auto info = ParseInfo(*text, info_path);
  if (!info.ok()) return info.status();
  sequence.info_ = *std::move(info);
  auto trajectory = ReadTrajectory(root / "trajectory.tum");
  if (!trajectory.ok()) return trajectory.status();
  sequence.trajectory_ = *std::move(trajectory);
  if (sequence.trajectory_.stamps_ns.size() != sequence.info_.frame_count) {
    return absl::DataLossError(
        absl::StrFormat("%s: got %d poses, expected %d (frame_count of sequence.json)",
                        (root / "trajectory.tum").string(), sequence.trajectory_.stamps_ns.size(),
                        sequence.info_.frame_count));
  }
  sequence.has_label_images_ = fs::is_directory(root / "label", error);
  if (fs::exists(root / "object_motions.csv", error)) {
    auto motions = ReadObjectMotions(root / "object_motions.csv");
    if (!motions.ok()) return motions.status();
    sequence.motions_ = *std::move(motions);
    sequence.has_motions_ = true;
  }
  if (fs::exists(root / "objects.csv", error)) {
    auto names = ReadClassNames(root / "objects.csv");
    if (!names.ok()) return names.status();
    sequence.class_names_ = *std::move(names);
  }
  return sequence;
}

std::string Sequence::Id() const {
  std::string id = folder_.filename().string();
  for (char& c : id) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    const bool allowed = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
    if (!allowed) c = '-';
  }
  if (id.empty() || id[0] < 'a' || id[0] > 'z') id.insert(0, "s-");
  return id.substr(0, 63);
}

absl::StatusOr<DepthImage> Sequence::ReadDepth(uint64_t index) const {
  DepthImage image = info_.intrinsics;
  const auto read = [&](const char* name, std::vector<uint16_t>* pixels) -> absl::Status {
    const fs::path path = folder_ / name / FileName(index, "png");
    auto png = ReadGray16Png(path);
    if (!png.ok()) return png.status();
    if (png->width != image.width || png->height != image.height) {
      return absl::DataLossError(
          absl::StrFormat("%s: got %d x %d pixels, expected %d x %d (sequence.json)", path.string(),
                          png->width, png->height, image.width, image.height));
    }
    *pixels = std::move(png->pixels);
    return absl::OkStatus();
  };
  if (absl::Status s = read("depth", &image.depth); !s.ok()) return s;
  if (has_label_images_) {
    if (absl::Status s = read("label", &image.labels); !s.ok()) return s;
  }
  return image;
}

absl::Status Sequence::CheckMotionsAreKnown(const std::vector<uint16_t>& labels,
                                            uint64_t index) const {
  if (has_motions_) return absl::OkStatus();
  const auto object = std::find_if(labels.begin(), labels.end(), [](uint16_t l) { return l != 0; });
  if (object == labels.end()) return absl::OkStatus();
  return absl::DataLossError(
      absl::StrFormat("%s: missing, expected since frame %d has points of object %d",
                      (folder_ / "object_motions.csv").string(), index, *object));
}

absl::StatusOr<Frame> Sequence::Read(uint64_t index) const {
  if (index >= size()) {
    return absl::OutOfRangeError(
        absl::StrFormat("%s: got frame %d, expected 0 to %d", folder_.string(), index, size() - 1));
  }
  Frame frame;
  frame.frame_id = index;
  frame.stamp_ns = trajectory_.stamps_ns[index];
  frame.T_W_X = trajectory_.T_W_X[index];
  frame.max_range_m = info_.max_range_m;
  const std::vector<uint16_t>* labels = nullptr;
  if (info_.depth_camera) {
    auto depth = ReadDepth(index);
    if (!depth.ok()) return depth.status();
    labels = &frame.observation.emplace<DepthImage>(*std::move(depth)).labels;
  } else {
    auto cloud = ReadPlyCloud(folder_ / "cloud" / FileName(index, "ply"));
    if (!cloud.ok()) return cloud.status();
    labels = &frame.observation.emplace<PointCloud>(*std::move(cloud)).labels;
  }
  if (absl::Status s = CheckMotionsAreKnown(*labels, index); !s.ok()) return s;
  if (const auto motions = motions_.find(index); motions != motions_.end()) {
    frame.motions = motions->second;
    for (ObjectMotion& motion : frame.motions) {
      const auto name = class_names_.find(motion.object_id);
      if (name != class_names_.end()) motion.class_name = name->second.substr(0, 64);
    }
  }
  return frame;
}

}  // namespace clearance::client
