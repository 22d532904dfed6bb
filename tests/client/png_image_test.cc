#include "client/sequence/png_image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "client/draw/canvas.h"
#include "tests/client/test_files.h"

namespace clearance::client {
namespace {

using ::testing::HasSubstr;

std::vector<uint16_t> RandomPixels(size_t n) {
  std::mt19937 rng(5);
  std::vector<uint16_t> pixels(n);
  for (uint16_t& p : pixels) p = static_cast<uint16_t>(rng());
  return pixels;
}

TEST(PngImage, ReadsEveryValueExactly) {
  std::vector<uint16_t> pixels = RandomPixels(31 * 17);
  pixels[0] = 0;
  pixels[1] = 65535;
  pixels[2] = 1;
  pixels[3] = 256;
  const auto image = ParseGray16Png(Gray16Png(31, 17, pixels), "a.png");
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_EQ(image->width, 31u);
  EXPECT_EQ(image->height, 17u);
  EXPECT_EQ(image->pixels, pixels);
}

TEST(PngImage, EveryTruncationNamesFileAndByte) {
  const std::string whole = Gray16Png(16, 8, RandomPixels(16 * 8));
  for (size_t size = 0; size < whole.size(); ++size) {
    const auto image = ParseGray16Png(whole.substr(0, size), "depth/000004.png");
    ASSERT_EQ(image.status().code(), absl::StatusCode::kDataLoss) << size;
    EXPECT_THAT(std::string(image.status().message()), HasSubstr("depth/000004.png: "));
    EXPECT_THAT(std::string(image.status().message()),
                HasSubstr(" of " + std::to_string(size) + "; expected a complete"));
  }
}

TEST(PngImage, ADamagedByteIsFoundByTheChecksum) {
  const std::string whole = Gray16Png(16, 8, RandomPixels(16 * 8));
  std::string bytes = whole;
  bytes[whole.size() / 2] = static_cast<char>(bytes[whole.size() / 2] ^ 0x40);
  EXPECT_EQ(ParseGray16Png(bytes, "a.png").status().code(), absl::StatusCode::kDataLoss);
}

TEST(PngImage, FlippedBytesNeverCrash) {
  const std::string whole = Gray16Png(16, 8, RandomPixels(16 * 8));
  std::mt19937 rng(9);
  for (int i = 0; i < 2000; ++i) {
    std::string bytes = whole;
    for (int k = 0; k < 2; ++k) bytes[rng() % bytes.size()] = static_cast<char>(rng());
    const auto image = ParseGray16Png(bytes, "a.png");
    if (image.ok()) {
      EXPECT_EQ(image->pixels.size(), size_t{image->width} * image->height);
    }
  }
}

TEST(PngImage, ColourImagesAreRefused) {
  TestFolder folder;
  const auto path = folder.path() / "rgb.png";
  ASSERT_TRUE(Canvas(4, 4, Color{1, 2, 3}).WritePng(path).ok());
  EXPECT_THAT(std::string(ReadGray16Png(path).status().message()), HasSubstr("grey"));
}

}  // namespace
}  // namespace clearance::client
