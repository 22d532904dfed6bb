#include "client/sequence/sequence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "tests/client/test_files.h"

namespace clearance::client {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string Text(const absl::Status& status) { return std::string(status.message()); }

TEST(Sequence, ReadsADepthSequence) {
  TestFolder folder;
  WriteDepthSequence(folder);
  const auto sequence = Sequence::Open(folder.path());
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_EQ(sequence->size(), 3u);
  EXPECT_EQ(sequence->info().voxel_size_m, 0.1);
  const auto frame = sequence->Read(2);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->frame_id, 2u);
  EXPECT_EQ(frame->stamp_ns, 1317042272569000000);
  EXPECT_EQ(frame->max_range_m, 8);
  EXPECT_EQ(frame->T_W_X.translation().x(), 1.0);
  const auto& depth = std::get<DepthImage>(frame->observation);
  EXPECT_EQ(depth.width, 4u);
  EXPECT_EQ(depth.cx, 1.5);
  EXPECT_EQ(depth.depth[0], 0);
  EXPECT_EQ(depth.depth[1], 2002);
  EXPECT_EQ(depth.depth[5], 65535);
  EXPECT_EQ(depth.labels[11], 7);
  ASSERT_EQ(frame->motions.size(), 1u);
  EXPECT_EQ(frame->motions[0].from_frame_id, 1u);
  EXPECT_TRUE(ValidateFrame(*frame).ok());
  EXPECT_TRUE(sequence->Read(0)->motions.empty());
}

TEST(Sequence, ReadsACloudSequenceWithClassNames) {
  TestFolder folder;
  WriteCloudSequence(folder);
  const auto sequence = Sequence::Open(folder.path());
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  const auto frame = sequence->Read(1);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->max_range_m, 40);
  EXPECT_EQ(std::get<PointCloud>(frame->observation).points_X.cols(), 2);
  EXPECT_EQ(frame->motions[0].class_name, "Van");
}

TEST(Sequence, WithoutLabelImagesAllIsStatic) {
  TestFolder folder;
  WriteDepthSequence(folder);
  fs::remove_all(folder.path() / "label");
  fs::remove(folder.path() / "object_motions.csv");
  const auto sequence = Sequence::Open(folder.path());
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_TRUE(std::get<DepthImage>(sequence->Read(0)->observation).labels.empty());
}

TEST(Sequence, ItsIdIsTheFoldersNameAsAMapsId) {
  TestFolder folder;
  const struct {
    const char* name;
    const char* id;
  } cases[] = {{"kitti_0005", "kitti_0005"}, {"My Street", "my-street"}, {"7scenes", "s-7scenes"}};
  for (const auto& c : cases) {
    fs::create_directories(folder.path() / c.name);
    fs::copy_options overwrite = fs::copy_options::overwrite_existing;
    WriteCloudSequence(folder);
    for (const char* file : {"sequence.json", "trajectory.tum"}) {
      fs::copy(folder.path() / file, folder.path() / c.name / file, overwrite);
    }
    EXPECT_EQ(Sequence::Open(folder.path() / c.name / "")->Id(), c.id);
  }
}

TEST(Sequence, AMissingFolderOrDescriptionIsNotFound) {
  const auto missing = Sequence::Open("/no/such/sequence");
  EXPECT_EQ(missing.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(Text(missing.status()), HasSubstr("/no/such/sequence: no such folder"));
  TestFolder folder;
  const auto empty = Sequence::Open(folder.path());
  EXPECT_EQ(empty.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(Text(empty.status()), HasSubstr("has no sequence.json"));
}

TEST(Sequence, EveryMissingFileIsNamed) {
  for (const char* file :
       {"trajectory.tum", "depth/000001.png", "label/000001.png", "object_motions.csv"}) {
    TestFolder folder;
    WriteDepthSequence(folder);
    fs::remove(folder.path() / file);
    const auto sequence = Sequence::Open(folder.path());
    const absl::Status status = sequence.ok() ? sequence->Read(1).status() : sequence.status();
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << file;
    EXPECT_THAT(Text(status), HasSubstr(file));
  }
  TestFolder folder;
  WriteCloudSequence(folder);
  fs::remove(folder.path() / "cloud/000001.ply");
  EXPECT_THAT(Text(Sequence::Open(folder.path())->Read(1).status()), HasSubstr("cloud/000001.ply"));
}

TEST(Sequence, EveryTruncatedFileIsNamed) {
  for (const char* file : {"sequence.json", "trajectory.tum", "object_motions.csv",
                           "depth/000001.png", "label/000001.png"}) {
    TestFolder folder;
    WriteDepthSequence(folder);
    const std::string bytes = folder.Read(file);
    folder.Write(file, bytes.substr(0, bytes.size() - 5));
    const auto sequence = Sequence::Open(folder.path());
    const absl::Status status = sequence.ok() ? sequence->Read(1).status() : sequence.status();
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << file;
    EXPECT_THAT(Text(status), HasSubstr(file));
  }
}

TEST(Sequence, AnImageOfAnotherSizeIsRefused) {
  TestFolder folder;
  WriteDepthSequence(folder);
  folder.Write("depth/000001.png", Gray16Png(3, 4, std::vector<uint16_t>(12, 1)));
  EXPECT_THAT(Text(Sequence::Open(folder.path())->Read(1).status()),
              HasSubstr("got 3 x 4 pixels, expected 4 x 3"));
}

TEST(Sequence, DescriptionsThatDoNotFitAreNamedByKey) {
  const struct {
    const char* from;
    const char* to;
    const char* text;
  } cases[] = {{"\"frame_count\": 3", "\"frame_count\": 4", "got 3 poses, expected 4"},
               {"\"frame_count\": 3", "\"frame_count\": -3", "frame_count"},
               {"\"voxel_size_m\": 0.1", "\"voxel_size_m\": 0", "voxel_size_m"},
               {"depth_camera", "sonar", "sensor.type"},
               {"\"fx\": 4.0", "\"fx\": 0", "sensor.fx"},
               {"\"width\": 4", "\"width\": 4.5", "sensor.width"},
               {"\"cx\": 1.5", "\"cx\": \"a\"", "sensor.cx"},
               {"\"max_range_m\": 8.0", "\"max_range_m\": -1", "max_range_m"}};
  for (const auto& c : cases) {
    TestFolder folder;
    WriteDepthSequence(folder);
    std::string json = folder.Read("sequence.json");
    json.replace(json.find(c.from), std::string(c.from).size(), c.to);
    folder.Write("sequence.json", json);
    const auto sequence = Sequence::Open(folder.path());
    EXPECT_EQ(sequence.status().code(), absl::StatusCode::kDataLoss) << c.to;
    EXPECT_THAT(Text(sequence.status()), HasSubstr(c.text));
  }
}

TEST(Sequence, ReadsTheFirstAndLastFrameOfEveryRecording) {
  const char* set = std::getenv("CLEARANCE_DATA_DIR");
  const fs::path data = set != nullptr ? set : "../shared/data";
  int read = 0;
  for (const char* name :
       {"kitti_0005", "redkitchen", "street", "orbit", "cubes", "hall", "crossing"}) {
    if (!fs::exists(data / name)) continue;
    const auto sequence = Sequence::Open(data / name);
    ASSERT_TRUE(sequence.ok()) << sequence.status();
    EXPECT_EQ(sequence->Id(), name);
    EXPECT_TRUE(sequence->info().voxel_size_m.has_value());
    for (const uint64_t i : {uint64_t{0}, sequence->size() - 1}) {
      const auto frame = sequence->Read(i);
      ASSERT_TRUE(frame.ok()) << frame.status();
      EXPECT_TRUE(ValidateFrame(*frame).ok()) << ValidateFrame(*frame);
    }
    ++read;
  }
  if (read == 0) GTEST_SKIP() << "no recordings in " << data << "; set CLEARANCE_DATA_DIR";
}

}  // namespace
}  // namespace clearance::client
