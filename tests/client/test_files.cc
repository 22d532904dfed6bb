#include "tests/client/test_files.h"

#include <png.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <fstream>
#include <iterator>

namespace clearance::client {
namespace {

namespace fs = std::filesystem;

constexpr char kTrajectory[] =
    "# timestamp tx ty tz qx qy qz qw\n"
    "1317042272.349000 0 0 1.5 0 0 0 1\n"
    "1317042272.459000 0.5 0 1.5 0 0 0 1\n"
    "1317042272.569000 1.0 0 1.5 0 0 0 1\n";
constexpr char kMotions[] =
    "frame,object_id,tx,ty,tz,qx,qy,qz,qw\n"
    "1,7,0.1,0,0,0,0,0,1\n"
    "2,7,0.1,0,0,0,0,0,1\n";

}  // namespace

TestFolder::TestFolder() {
  static std::atomic<int> count = 0;
  path_ = fs::temp_directory_path() /
          ("clearance_" + std::to_string(getpid()) + "_" + std::to_string(count++));
  fs::create_directories(path_);
}

TestFolder::~TestFolder() {
  std::error_code error;
  fs::remove_all(path_, error);
}

fs::path TestFolder::Write(const std::string& name, const std::string& bytes) const {
  const fs::path path = path_ / name;
  fs::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << bytes;
  return path;
}

std::string TestFolder::Read(const std::string& name) const {
  std::ifstream in(path_ / name, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(in), {});
}

std::string Gray16Png(uint32_t width, uint32_t height, const std::vector<uint16_t>& pixels) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = width;
  image.height = height;
  image.format = PNG_FORMAT_LINEAR_Y;
  png_alloc_size_t size = 0;
  png_image_write_to_memory(&image, nullptr, &size, 0, pixels.data(), 0, nullptr);
  std::string bytes(size, '\0');
  png_image_write_to_memory(&image, bytes.data(), &size, 0, pixels.data(), 0, nullptr);
  bytes.resize(size);
  return bytes;
}

std::string PlyCloud(const std::vector<float>& xyz, const std::vector<uint16_t>& labels) {
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment a test\nelement vertex " +
                      std::to_string(labels.size()) +
                      "\nproperty float x\nproperty float y\nproperty float z\n"
                      "property ushort label\nend_header\n";
  for (size_t i = 0; i < labels.size(); ++i) {
    bytes.append(reinterpret_cast<const char*>(&xyz[3 * i]), 12);
    bytes.append(reinterpret_cast<const char*>(&labels[i]), 2);
  }
  return bytes;
}

void WriteDepthSequence(const TestFolder& folder) {
  folder.Write("sequence.json", R"({"name": "tiny", "frame_count": 3, "voxel_size_m": 0.1,
    "sensor": {"type": "depth_camera", "width": 4, "height": 3, "fx": 4.0, "fy": 4.0, "cx": 1.5,
               "cy": 1.0, "depth_scale_m": 0.001, "max_range_m": 8.0}})");
  folder.Write("trajectory.tum", kTrajectory);
  folder.Write("object_motions.csv", kMotions);
  for (int i = 0; i < 3; ++i) {
    const std::string name = "/00000" + std::to_string(i) + ".png";
    std::vector<uint16_t> depth(12, static_cast<uint16_t>(2000 + i)), label(12, 0);
    depth[0] = 0;
    depth[5] = 65535;
    label[11] = 7;
    folder.Write("depth" + name, Gray16Png(4, 3, depth));
    folder.Write("label" + name, Gray16Png(4, 3, label));
  }
}

void WriteCloudSequence(const TestFolder& folder) {
  folder.Write("sequence.json", R"({"frame_count": 3, "voxel_size_m": 0.2,
    "sensor": {"type": "lidar", "max_range_m": 40}})");
  folder.Write("trajectory.tum", kTrajectory);
  folder.Write("object_motions.csv", kMotions);
  folder.Write("objects.csv", "object_id,class,moving\n7,Van,1\n");
  for (int i = 0; i < 3; ++i) {
    folder.Write("cloud/00000" + std::to_string(i) + ".ply",
                 PlyCloud({1, 2, 3, -4, -5, static_cast<float>(i)}, {0, 7}));
  }
}

}  // namespace clearance::client
