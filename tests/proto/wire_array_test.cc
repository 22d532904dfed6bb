#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "proto/wire/array.h"

namespace clearance::wire {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(WireArray, RoundTripsEveryElementType) {
  EXPECT_THAT(*DecodeArray<float>(EncodeArray<float>({1.5f, -2.25f}), 1, "a"),
              ElementsAre(1.5f, -2.25f));
  EXPECT_THAT(*DecodeArray<uint16_t>(EncodeArray<uint16_t>({0, 65535}), 1, "a"),
              ElementsAre(0, 65535));
  EXPECT_THAT(*DecodeArray<int64_t>(EncodeArray<int64_t>({-1, 1'317'042'272'349'000'000}), 1, "a"),
              ElementsAre(-1, 1'317'042'272'349'000'000));
}

TEST(WireArray, IsLittleEndianOnTheWire) {
  EXPECT_EQ(EncodeArray<uint32_t>({0x01020304u}), std::string("\x04\x03\x02\x01", 4));
}

TEST(WireArray, NamesFieldAndBytesWhenTheLengthIsNotAMultiple) {
  for (const size_t bytes : {1u, 4u, 11u, 13u}) {
    const auto values = DecodeArray<float>(std::string(bytes, '\0'), 3, "points_f32");
    ASSERT_EQ(values.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(
        std::string(values.status().message()),
        HasSubstr("points_f32: got " + std::to_string(bytes) + " bytes; expected a multiple"));
  }
}

TEST(WireArray, NamesTheFirstElementThatIsNotFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  const auto values =
      DecodeArray<float>(EncodeArray<float>({0, 1, 2, 3, -inf, 5, nan, 7, 8}), 3, "points_f32");
  ASSERT_EQ(values.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(values.status().message()), HasSubstr("points_f32[1]: got (3, -inf, 5)"));
}

TEST(WireArray, AnEmptyArrayIsNoError) {
  EXPECT_TRUE(DecodeArray<double>("", 7, "poses_f64")->empty());
}

}  // namespace
}  // namespace clearance::wire
