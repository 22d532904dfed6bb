#include "planner_demo/sequence/sequence_writer.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "planner_demo/sim/scenes/scenes.h"
#include "planner_demo/sim/simulator.h"

namespace clearance::sim {
namespace {

namespace fs = std::filesystem;

class SequenceWriterTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              ("sequence_writer_" +
               std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string Read(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    EXPECT_TRUE(in.good()) << name;
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
  }

  // Rows of a CSV or blank-separated file of numbers, without the header.
  std::vector<std::vector<double>> Rows(const std::string& name, bool header) const {
    std::istringstream in(Read(name));
    std::vector<std::vector<double>> rows;
    std::string line;
    if (header) std::getline(in, line);
    while (std::getline(in, line)) {
      for (char& c : line) c = c == ',' ? ' ' : c;
      std::istringstream numbers(line);
      rows.emplace_back();
      for (double value; numbers >> value;) rows.back().push_back(value);
    }
    return rows;
  }

  static Eigen::Isometry3d Pose(const std::vector<double>& row, int from) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = Eigen::Vector3d(row[from], row[from + 1], row[from + 2]);
    T.linear() = Eigen::Quaterniond(row[from + 6], row[from + 3], row[from + 4], row[from + 5])
                     .toRotationMatrix();
    return T;
  }

  std::vector<uint16_t> Png(const std::string& name, int width, int height) const {
    png_image image;
    std::memset(&image, 0, sizeof(image));
    image.version = PNG_IMAGE_VERSION;
    // The simplified reader would convert gamma, so rows are read by the low-level one.
    FILE* file = std::fopen((folder_ / name).c_str(), "rb");
    EXPECT_NE(file, nullptr) << name;
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(png);
    png_init_io(png, file);
    png_read_png(png, info, PNG_TRANSFORM_SWAP_ENDIAN, nullptr);
    EXPECT_EQ(png_get_image_width(png, info), static_cast<unsigned>(width));
    EXPECT_EQ(png_get_image_height(png, info), static_cast<unsigned>(height));
    EXPECT_EQ(png_get_bit_depth(png, info), 16);
    std::vector<uint16_t> pixels;
    png_bytepp rows = png_get_rows(png, info);
    for (int row = 0; row < height; ++row) {
      const auto* begin = reinterpret_cast<const uint16_t*>(rows[row]);
      pixels.insert(pixels.end(), begin, begin + width);
    }
    png_destroy_read_struct(&png, &info, nullptr);
    std::fclose(file);
    return pixels;
  }

  fs::path folder_;
};

TEST_F(SequenceWriterTest, WritesCamerasAsImagesThatHoldTheScan) {
  Scene scene = MakeCubes(1, 3);
  scene.sensor = DepthCamera::WithHorizontalView(64, 48, 1.1, 2e-4, 8.0);
  SequenceOptions options;
  options.source = "a \"test\"";
  ASSERT_TRUE(WriteSequence(scene, options, folder_).ok());
  const auto info = nlohmann::json::parse(Read("sequence.json"));
  EXPECT_EQ(info["name"], "cubes-0");
  EXPECT_EQ(info["source"], "a \"test\"");
  EXPECT_EQ(info["frame_count"], 3);
  EXPECT_EQ(info["sensor"]["type"], "depth_camera");
  EXPECT_EQ(info["sensor"]["width"], 64);

  Simulator again(scene, {}, 0);
  int labelled = 0;
  for (int k = 0; k < 3; ++k) {
    const SimulatedFrame frame = again.Next();
    const std::string name = "00000" + std::to_string(k) + ".png";
    const auto depth = Png("depth/" + name, 64, 48);
    const auto label = Png("label/" + name, 64, 48);
    EXPECT_EQ(label, frame.scan.labels);
    for (size_t i = 0; i < depth.size(); ++i) {
      EXPECT_NEAR(depth[i] * 2e-4, frame.scan.ranges_m[i], 1.001e-4);
      labelled += label[i] > 0;
    }
  }
  EXPECT_GT(labelled, 50);
}

TEST_F(SequenceWriterTest, WritesLidarsAsCloudsOfTheirReturns) {
  Scene scene = MakeHall(2, 2);
  scene.sensor = Lidar{16, 64, -0.3, 0.3, 20.0};
  ASSERT_TRUE(WriteSequence(scene, {}, folder_).ok());
  Simulator again(scene, {}, 0);
  const std::vector<Eigen::Vector3d> directions = RayDirections(scene.sensor);
  for (int k = 0; k < 2; ++k) {
    const SimulatedFrame frame = again.Next();
    const std::string bytes = Read("cloud/00000" + std::to_string(k) + ".ply");
    const size_t body = bytes.find("end_header\n") + 11;
    size_t at = body;
    for (size_t i = 0; i < directions.size(); ++i) {
      if (frame.scan.ranges_m[i] == 0.0) continue;
      ASSERT_LE(at + 14, bytes.size());
      float xyz[3];
      uint16_t label;
      std::memcpy(xyz, bytes.data() + at, 12);
      std::memcpy(&label, bytes.data() + at + 12, 2);
      at += 14;
      EXPECT_EQ(label, frame.scan.labels[i]);
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_FLOAT_EQ(xyz[axis], frame.scan.ranges_m[i] * directions[i][axis]);
      }
    }
    EXPECT_EQ(at, bytes.size());
    EXPECT_NE(bytes.find("element vertex " + std::to_string((at - body) / 14) + "\n"),
              std::string::npos);
  }
}

TEST_F(SequenceWriterTest, WritesMotionsAndFuturesThatAgree) {
  Scene scene = MakeCrossing(4, 6);
  scene.sensor = Lidar{8, 32, -0.3, 0.3, 40.0};
  ASSERT_TRUE(WriteSequence(scene, {}, folder_).ok());
  const auto trajectory = Rows("trajectory.tum", false);
  ASSERT_EQ(trajectory.size(), 6u);
  for (int k = 0; k < 6; ++k) {
    EXPECT_NEAR(trajectory[k][0], k * 0.1, 1e-9);
    EXPECT_TRUE(Pose(trajectory[k], 1).isApprox(scene.T_W_X(k * 0.1), 1e-9));
  }
  std::map<std::pair<int, int>, Eigen::Isometry3d> poses;
  for (const auto& row : Rows("gt/object_poses.csv", true)) {
    ASSERT_EQ(row.size(), 9u);
    poses[{static_cast<int>(row[0]), static_cast<int>(row[1])}] = Pose(row, 2);
  }
  EXPECT_EQ(poses.size(), scene.movers.size() * (6u + 100u));
  EXPECT_TRUE(poses.at({105, 2}).isApprox(scene.movers[1].T_W_L(10.5), 1e-9));
  const auto motions = Rows("object_motions.csv", true);
  EXPECT_GT(motions.size(), 10u);
  for (const auto& row : motions) {
    const int k = static_cast<int>(row[0]);
    const int id = static_cast<int>(row[1]);
    EXPECT_TRUE((Pose(row, 2) * poses.at({k - 1, id})).isApprox(poses.at({k, id}), 1e-9));
  }
  for (const Mover& mover : scene.movers) {
    EXPECT_GT(fs::file_size(folder_ / "gt" / "objects" / (std::to_string(mover.id) + ".ply")),
              1000u);
  }
  EXPECT_NE(Read("gt/static.ply").find("element face"), std::string::npos);
}

TEST_F(SequenceWriterTest, NamesWhatTheObjectsAre) {
  Scene scene = MakeCubes(0, 1);
  scene.sensor = DepthCamera::WithHorizontalView(16, 12, 1.1, 2e-4, 8.0);
  ASSERT_TRUE(WriteSequence(scene, {}, folder_).ok());
  EXPECT_EQ(Read("objects.csv"),
            "object_id,class,moving,length,width,height\n"
            "1,Cube,1,0.300,0.300,0.300\n2,Cube,1,0.300,0.300,0.300\n"
            "3,Cube,1,0.300,0.300,0.300\n4,Cube,1,0.300,0.300,0.300\n");
}

TEST_F(SequenceWriterTest, RefusesToMixWithAnotherRecording) {
  Scene scene = MakeAnalytic("plane", 0, 1);
  scene.sensor = DepthCamera::WithHorizontalView(16, 12, 1.1, 2e-4, 8.0);
  ASSERT_TRUE(WriteSequence(scene, {}, folder_).ok());
  const absl::Status again = WriteSequence(scene, {}, folder_);
  EXPECT_EQ(again.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_NE(again.message().find("depth"), std::string::npos);
}

TEST_F(SequenceWriterTest, SaysWhichFolderItCannotWrite) {
  std::ofstream(folder_) << "a file where a folder should be";
  const absl::Status status = WriteSequence(MakeAnalytic("box", 0, 1), {}, folder_);
  EXPECT_FALSE(status.ok());
  EXPECT_NE(status.message().find(folder_.string()), std::string::npos);
}

}  // namespace
}  // namespace clearance::sim
