#include "client/sequence/object_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/client/test_files.h"

namespace clearance::client {
namespace {

using ::testing::HasSubstr;

constexpr char kHeader[] = "frame,object_id,tx,ty,tz,qx,qy,qz,qw\n";

TEST(ObjectMotions, AreWorldMotionsFromTheFrameBefore) {
  TestFolder folder;
  const auto table = ReadObjectMotions(folder.Write(
      "m.csv",
      std::string(kHeader) + "1,3,1,2,3,0,0,0,1\n5,65535,0,0,0,0,0,1,0\n5,1,0,0,0,0,0,0,1\n"));
  ASSERT_TRUE(table.ok()) << table.status();
  ASSERT_EQ(table->at(1).size(), 1u);
  EXPECT_EQ(table->at(1)[0].from_frame_id, 0u);
  EXPECT_EQ(table->at(1)[0].kind, ObjectMotion::Kind::kWorldMotion);
  EXPECT_TRUE(table->at(1)[0].pose.translation() == Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(table->at(5).size(), 2u);
  EXPECT_EQ(table->at(5)[0].object_id.value(), 65535);
}

TEST(ObjectMotions, NameTheLineThatIsWrong) {
  const struct {
    const char* lines;
    const char* text;
  } cases[] = {{"1,3,1,2,3,0,0,0\n", ":2: got 8 cells"},
               {"0,3,0,0,0,0,0,0,1\n", ":2: got \"0\", expected a frame index from 1"},
               {"1,0,0,0,0,0,0,0,1\n", ":2: got \"0\", expected an object id from 1"},
               {"1,-4,0,0,0,0,0,0,1\n", ":2: got \"-4\", expected an object id"},
               {"1,65536,0,0,0,0,0,0,1\n", ":2: got \"65536\""},
               {"1,3,0,0,0,0,0,0,0\n", ":2: got a quaternion of norm 0"},
               {"1,3,0,x,0,0,0,0,1\n", ":2: got \"x\""},
               {"1,3,0,0,0,0,0,0,1\n1,3,0,0,0,0,0,0,1\n", ":3: got object 3 again in frame 1"}};
  for (const auto& c : cases) {
    TestFolder folder;
    const auto table = ReadObjectMotions(folder.Write("m.csv", std::string(kHeader) + c.lines));
    EXPECT_EQ(table.status().code(), absl::StatusCode::kDataLoss) << c.lines;
    EXPECT_THAT(std::string(table.status().message()), HasSubstr(c.text));
  }
  TestFolder folder;
  EXPECT_THAT(std::string(ReadObjectMotions(folder.Write("m.csv", "a,b\n")).status().message()),
              HasSubstr(":1: got other columns"));
}

TEST(ClassNames, ComeFromTheirColumnsWhereverTheyAre) {
  TestFolder folder;
  const auto names =
      ReadClassNames(folder.Write("objects.csv", "first,class,object_id\n0,Van,1\n4,Cyclist,13\n"));
  ASSERT_TRUE(names.ok()) << names.status();
  EXPECT_EQ(names->at(ObjectId(1)), "Van");
  EXPECT_EQ(names->at(ObjectId(13)), "Cyclist");
  EXPECT_FALSE(ReadClassNames(folder.Write("o2.csv", "id,kind\n1,Van\n")).ok());
  EXPECT_FALSE(ReadClassNames(folder.Write("o3.csv", "object_id,class\n-1,Van\n")).ok());
}

}  // namespace
}  // namespace clearance::client
