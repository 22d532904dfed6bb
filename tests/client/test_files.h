// Sequence folders that tests write themselves.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace clearance::client {

// A folder of its own for a test, gone with it.
class TestFolder {
 public:
  TestFolder();
  ~TestFolder();
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path Write(const std::string& name, const std::string& bytes) const;
  std::string Read(const std::string& name) const;

 private:
  std::filesystem::path path_;
};

std::string Gray16Png(uint32_t width, uint32_t height, const std::vector<uint16_t>& pixels);

// x, y, z as float, label as ushort.
std::string PlyCloud(const std::vector<float>& xyz, const std::vector<uint16_t>& labels);

// Complete sequences of three frames: a 4 x 3 depth camera with labels, or a lidar; object 7 moves
// by 0.1 m along x from frame to frame.
void WriteDepthSequence(const TestFolder& folder);
void WriteCloudSequence(const TestFolder& folder);

}  // namespace clearance::client
