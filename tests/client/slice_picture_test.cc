#include "client/draw/slice_picture.h"

#include <gtest/gtest.h>

#include <map>

namespace clearance::client {
namespace {

// 40 x 30 cells of 0.5 m: left unknown, right free, one occupied column between.
Slice MakeSlice() {
  Slice slice;
  slice.columns = 40;
  slice.rows = 30;
  slice.resolution_m = 0.5;
  slice.origin_W = {-10, 100, 0.5};
  for (uint32_t row = 0; row < 30; ++row) {
    for (uint32_t column = 0; column < 40; ++column) {
      slice.states.push_back(column < 10 ? 0 : column == 10 ? 2 : 1);
      slice.distances_m.push_back(column < 10 ? 0.f : 0.5f * static_cast<float>(column - 10));
    }
  }
  return slice;
}

// What was drawn on top of the bare slice.
int Difference(const Canvas& a, const Canvas& b) {
  int n = 0;
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) n += a.At(x, y) != b.At(x, y);
  }
  return n;
}

std::map<std::array<uint8_t, 3>, int> Histogram(const Canvas& canvas) {
  std::map<std::array<uint8_t, 3>, int> counts;
  for (int y = 0; y < canvas.height(); ++y) {
    for (int x = 0; x < canvas.width(); ++x) {
      const Color c = canvas.At(x, y);
      ++counts[{c.r, c.g, c.b}];
    }
  }
  return counts;
}

TEST(SlicePicture, ShowsFreeOccupiedAndUnknownInTheirShares) {
  SlicePicture picture;
  picture.title = "test";
  picture.target_width = 800;  // 20 pixels a cell
  const Canvas canvas = DrawSlice(MakeSlice(), picture);
  const auto counts = Histogram(canvas);
  EXPECT_GE(counts.at({38, 34, 48}), 1 * 30 * 400);                                   // occupied
  EXPECT_GE(counts.at({214, 214, 216}) + counts.at({188, 188, 192}), 10 * 30 * 400);  // unknown
  const Color far = HeatColor(5, 5);
  EXPECT_GE(counts.at({far.r, far.g, far.b}), 19 * 30 * 400);  // free, at the scale's end
}

TEST(SlicePicture, DrawsOutlineArrowAndPathsWhereTheyAre) {
  const Slice slice = MakeSlice();
  SlicePicture picture;
  picture.target_width = 800;
  const Canvas bare = DrawSlice(slice, picture);
  ObjectInfo object;
  object.brief.object_id = 1;
  object.brief.life = ObjectLife::kTracked;
  object.brief.twist.linear_mps = {2, 0, 0};
  object.box.world_from_box.translation() = Eigen::Vector3d(0, 107, 0.5);
  object.box.size_m = {4, 2, 1.5};
  picture.objects = {object};
  const Canvas with_object = DrawSlice(slice, picture);
  EXPECT_GT(Difference(bare, with_object), 500);
  // The outline passes through the middle of the box's upper edge: x = 0 m, y = 108 m.
  const int x = 16 + static_cast<int>((0 + 10.25) * 40);
  const int y = 34 + 16 + static_cast<int>((114.75 - 108) * 40);
  EXPECT_NE(with_object.At(x, y), bare.At(x, y));
  picture.objects[0].brief.life = ObjectLife::kRetired;
  EXPECT_EQ(Difference(bare, DrawSlice(slice, picture)), 0);
  picture.objects.clear();
  StampedPose a, b;
  a.pose.translation() = Eigen::Vector3d(-5, 101, 0);
  b.pose.translation() = Eigen::Vector3d(1e9, 101, 0);  // leads out of the picture
  picture.sensor_path = {a, b};
  EXPECT_GT(Difference(bare, DrawSlice(slice, picture)), 100);
}

TEST(SlicePicture, AnEmptySliceIsAPictureToo) {
  EXPECT_GT(DrawSlice(Slice(), SlicePicture()).height(), 0);
}

TEST(SlicePicture, ColoursRunFromWarmToCool) {
  EXPECT_GT(HeatColor(0, 5).r, HeatColor(0, 5).b);
  EXPECT_LT(HeatColor(5, 5).r, HeatColor(5, 5).b);
  EXPECT_EQ(HeatColor(-1, 5), HeatColor(0, 5));
  EXPECT_EQ(HeatColor(9, 5), HeatColor(5, 5));
}

}  // namespace
}  // namespace clearance::client
