#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "proto/wire/compression.h"

namespace clearance::wire {
namespace {

using ::testing::HasSubstr;

TEST(WireCompression, GivesBackWhatWasPacked) {
  std::mt19937 random(1);
  for (const size_t size : {0u, 10u, 255u, 256u, 5000u, 1'000'000u}) {
    for (const bool repetitive : {true, false}) {
      std::string bytes(size, '\0');
      for (char& c : bytes) c = static_cast<char>(repetitive ? random() % 2 : random());
      const Payload payload = PackPayload(bytes);
      EXPECT_EQ(payload.payload_bytes, size);
      EXPECT_LE(payload.bytes.size(), size);
      if (repetitive && size >= 5000) {
        EXPECT_LT(payload.bytes.size(), size / 2);
      }
      const auto unpacked =
          UnpackPayload(payload.bytes, payload.compression, payload.payload_bytes, "p");
      ASSERT_TRUE(unpacked.ok()) << unpacked.status();
      EXPECT_EQ(*unpacked, bytes);
    }
  }
}

TEST(WireCompression, RefusesDamagedAndBoundlessPayloads) {
  const Payload payload = PackPayload(std::string(5000, 'a'));
  ASSERT_EQ(payload.compression, v1::COMPRESSION_ZSTD);
  const auto error = [](std::string bytes, int compression, uint64_t size) {
    return UnpackPayload(bytes, compression, size, "blocks.payload").status();
  };
  EXPECT_TRUE(absl::IsDataLoss(error(payload.bytes, payload.compression, 4999)));
  EXPECT_TRUE(absl::IsDataLoss(error(payload.bytes, payload.compression, 5001)));
  EXPECT_TRUE(absl::IsDataLoss(error(payload.bytes.substr(1), payload.compression, 5000)));
  EXPECT_TRUE(absl::IsDataLoss(error("abc", v1::COMPRESSION_UNSPECIFIED, 4)));
  EXPECT_TRUE(absl::IsInvalidArgument(error("abc", 7, 3)));
  const absl::Status bomb = error(payload.bytes, payload.compression, kMaxPayloadBytes + 1);
  EXPECT_TRUE(absl::IsDataLoss(bomb));
  EXPECT_THAT(bomb.message(), HasSubstr("blocks.payload"));
}

}  // namespace
}  // namespace clearance::wire
