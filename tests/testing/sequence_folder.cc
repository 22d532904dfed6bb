#include "tests/testing/sequence_folder.h"

#include <png.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

namespace clearance::testing {
namespace {

namespace fs = std::filesystem;

std::string NumberedFile(int k, const char* extension) {
  std::ostringstream name;
  name.width(6);
  name.fill('0');
  name << k << extension;
  return name.str();
}

std::ifstream Open(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error("cannot open " + path.string());
  return in;
}

std::vector<double> Numbers(std::string line) {
  for (char& c : line) {
    if (c == ',') c = ' ';
  }
  std::istringstream in(line);
  std::vector<double> out;
  for (double x; in >> x;) out.push_back(x);
  return out;
}

Pose PoseOf(const double* t_q) {  // tx ty tz qx qy qz qw
  Pose T = Pose::Identity();
  T.translation() = Eigen::Vector3d(t_q[0], t_q[1], t_q[2]);
  T.linear() = Eigen::Quaterniond(t_q[6], t_q[3], t_q[4], t_q[5]).normalized().toRotationMatrix();
  return T;
}

std::vector<uint16_t> ReadPng16(const fs::path& path, uint32_t& width, uint32_t& height) {
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (!file) throw std::runtime_error("cannot open " + path.string());
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  std::vector<uint16_t> pixels;
  std::vector<png_bytep> rows;
  if (setjmp(png_jmpbuf(png))) {
    png_destroy_read_struct(&png, &info, nullptr);
    std::fclose(file);
    throw std::runtime_error("not a readable PNG: " + path.string());
  }
  png_init_io(png, file);
  png_read_info(png, info);
  if (png_get_bit_depth(png, info) != 16) png_set_expand_16(png);
  png_set_swap(png);
  png_read_update_info(png, info);
  width = png_get_image_width(png, info);
  height = png_get_image_height(png, info);
  pixels.resize(size_t{width} * height);
  for (uint32_t v = 0; v < height; ++v) {
    rows.push_back(reinterpret_cast<png_bytep>(pixels.data() + size_t{v} * width));
  }
  png_read_image(png, rows.data());
  png_destroy_read_struct(&png, &info, nullptr);
  std::fclose(file);
  return pixels;
}

struct PlyHeader {
  size_t vertices = 0, faces = 0;
  bool labels = false;
};

PlyHeader ReadPlyHeader(std::istream& in) {
  PlyHeader header;
  for (std::string line; std::getline(in, line) && line != "end_header";) {
    std::istringstream words(line);
    std::string word, what;
    words >> word >> what;
    if (word == "element" && what == "vertex") words >> header.vertices;
    if (word == "element" && what == "face") words >> header.faces;
    if (word == "property" && what == "ushort") header.labels = true;
  }
  return header;
}

PointCloud ReadCloud(const fs::path& path) {
  std::ifstream in = Open(path);
  const PlyHeader header = ReadPlyHeader(in);
  const size_t stride = 12 + (header.labels ? 2 : 0);
  std::vector<char> bytes(header.vertices * stride);
  if (!in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) {
    throw std::runtime_error("truncated " + path.string());
  }
  PointCloud cloud;
  cloud.points_X.resize(3, static_cast<Eigen::Index>(header.vertices));
  if (header.labels) cloud.labels.resize(header.vertices);
  for (size_t i = 0; i < header.vertices; ++i) {
    std::memcpy(cloud.points_X.col(static_cast<Eigen::Index>(i)).data(), &bytes[i * stride], 12);
    if (header.labels) std::memcpy(&cloud.labels[i], &bytes[i * stride + 12], 2);
  }
  return cloud;
}

}  // namespace

fs::path DataFolder(const std::string& name) {
  const char* root = std::getenv("CLEARANCE_DATA_DIR");
  const fs::path path = fs::path(root ? root : "../shared/data") / name;
  return fs::exists(path / "sequence.json") ? path : fs::path();
}

SequenceFolder OpenSequence(const fs::path& path) {
  SequenceFolder s;
  s.path = path;
  std::ifstream file = Open(path / "sequence.json");
  const nlohmann::json json = nlohmann::json::parse(file);
  const auto& sensor = json.at("sensor");
  s.lidar = sensor.at("type") == "lidar";
  s.voxel_size_m = json.at("voxel_size_m");
  s.max_range_m = sensor.at("max_range_m");
  if (!s.lidar) {
    s.fx = sensor.at("fx"), s.fy = sensor.at("fy");
    s.cx = sensor.at("cx"), s.cy = sensor.at("cy");
    s.depth_scale_m = sensor.at("depth_scale_m");
  }
  std::ifstream trajectory = Open(path / "trajectory.tum");
  for (std::string line; std::getline(trajectory, line);) {
    const std::vector<double> n = Numbers(line);
    if (n.size() != 8) continue;
    s.stamps_ns.push_back(static_cast<int64_t>(std::llround(n[0] * 1e9)));
    s.T_W_X.push_back(PoseOf(&n[1]));
  }
  std::ifstream motions(path / "object_motions.csv");
  for (std::string line; std::getline(motions, line);) {
    const std::vector<double> n = Numbers(line);
    if (n.size() != 9) continue;
    ObjectMotion motion;
    motion.object_id = ObjectId(static_cast<uint16_t>(n[1]));
    motion.pose = PoseOf(&n[2]);
    s.motions[static_cast<int>(n[0])].push_back(motion);
  }
  return s;
}

Frame ReadFrame(const SequenceFolder& s, int k) {
  Frame frame;
  frame.frame_id = static_cast<uint64_t>(k);
  frame.stamp_ns = s.stamps_ns.at(k);
  frame.source_id = s.path.filename().string();
  frame.T_W_X = s.T_W_X.at(k);
  frame.max_range_m = s.max_range_m;
  if (auto it = s.motions.find(k); it != s.motions.end()) frame.motions = it->second;
  if (s.lidar) {
    frame.observation = ReadCloud(s.path / "cloud" / NumberedFile(k, ".ply"));
    return frame;
  }
  DepthImage depth;
  depth.fx = s.fx, depth.fy = s.fy, depth.cx = s.cx, depth.cy = s.cy;
  depth.depth_scale_m = s.depth_scale_m;
  depth.depth = ReadPng16(s.path / "depth" / NumberedFile(k, ".png"), depth.width, depth.height);
  const fs::path label = s.path / "label" / NumberedFile(k, ".png");
  uint32_t width, height;
  if (fs::exists(label)) depth.labels = ReadPng16(label, width, height);
  frame.observation = std::move(depth);
  return frame;
}

TriangleMesh ReadMesh(const fs::path& path) {
  std::ifstream in = Open(path);
  const PlyHeader header = ReadPlyHeader(in);
  TriangleMesh mesh;
  for (size_t i = 0; i < header.vertices; ++i) {
    float p[3];
    in.read(reinterpret_cast<char*>(p), sizeof p);
    mesh.vertices.emplace_back(p[0], p[1], p[2]);
  }
  for (size_t i = 0; i < header.faces; ++i) {
    uint8_t corners = 0;
    int32_t c[3];
    in.read(reinterpret_cast<char*>(&corners), 1);
    in.read(reinterpret_cast<char*>(c), sizeof c);
    if (!in || corners != 3) throw std::runtime_error("not a triangle mesh: " + path.string());
    mesh.triangles.emplace_back(c[0], c[1], c[2]);
  }
  return mesh;
}

}  // namespace clearance::testing
