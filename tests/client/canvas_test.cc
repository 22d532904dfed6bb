#include "client/draw/canvas.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <filesystem>
#include <set>

#include "client/draw/font.h"

namespace clearance::client {
namespace {

constexpr Color kWhite{255, 255, 255}, kRed{200, 0, 0};

int Painted(const Canvas& canvas) {
  int n = 0;
  for (int y = 0; y < canvas.height(); ++y) {
    for (int x = 0; x < canvas.width(); ++x) n += canvas.At(x, y) != kWhite;
  }
  return n;
}

TEST(Canvas, AHorizontalLineCoversItsPixels) {
  Canvas canvas(20, 9, kWhite);
  canvas.DrawLine({3, 4.5}, {17, 4.5}, 1, kRed);
  for (int x = 3; x < 17; ++x) EXPECT_EQ(canvas.At(x, 4), kRed) << x;
  EXPECT_EQ(canvas.At(10, 2), kWhite);
  EXPECT_EQ(canvas.At(1, 4), kWhite);
}

TEST(Canvas, DrawingOutsideIsClippedAndNeverFails) {
  Canvas canvas(10, 10, kWhite);
  canvas.DrawLine({-1e300, -1e300}, {1e300, 1e300}, 1, kRed);
  canvas.DrawLine({0.0 / 0.0 * 0, 1}, {2, 3}, 1, kRed);
  canvas.FillRect(-5, -5, 3, 3, kRed);
  canvas.SetPixel(10, 0, kRed);
  canvas.DrawText(-100, 5, "far away", 1, kRed);
  canvas.FillDisc({100, 100}, 5, kRed);
  canvas.Paste(Canvas(4, 4, kRed), 8, 8);
  EXPECT_EQ(canvas.At(9, 9), kRed);
  EXPECT_EQ(canvas.At(9, 0), kWhite);
}

TEST(Canvas, ADiscHasItsArea) {
  Canvas canvas(64, 64, kWhite);
  canvas.FillDisc({32, 32}, 20, kRed);
  double area = 0;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) area += (255.0 - canvas.At(x, y).g) / 255.0;
  }
  EXPECT_NEAR(area, 3.14159 * 400, 25);
}

TEST(Canvas, TextHasTheSizeItSays) {
  Canvas canvas(200, 40, kWhite);
  canvas.DrawText(2, 3, "Clearance 0.5 m", 2, kRed);
  const int width = TextWidth("Clearance 0.5 m", 2);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 200; ++x) {
      const bool inside = x >= 2 && x < 2 + width && y >= 3 && y < 3 + TextHeight(2);
      if (!inside) {
        EXPECT_EQ(canvas.At(x, y), kWhite) << x << " " << y;
      }
    }
  }
  EXPECT_GT(Painted(canvas), 300);
}

TEST(Font, EveryPrintableCharacterHasAGlyphOfItsOwn) {
  std::set<Glyph> seen;
  for (char c = ' '; c <= '~'; ++c) {
    EXPECT_TRUE(seen.insert(GlyphOf(c)).second) << c;
    for (const uint8_t row : GlyphOf(c)) EXPECT_LT(row, 32);
  }
  EXPECT_EQ(GlyphOf('\n'), GlyphOf('?'));
  EXPECT_EQ(GlyphOf('\xe4'), GlyphOf('?'));
}

TEST(Canvas, ItsPngHoldsItsPixels) {
  Canvas canvas(7, 5, kWhite);
  canvas.SetPixel(6, 4, kRed);
  canvas.SetPixel(0, 1, Color{1, 2, 3});
  const auto path = std::filesystem::temp_directory_path() / "clearance_canvas_test.png";
  ASSERT_TRUE(canvas.WritePng(path).ok());
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_file(&image, path.c_str()));
  image.format = PNG_FORMAT_RGB;
  ASSERT_EQ(image.width, 7u);
  ASSERT_EQ(image.height, 5u);
  std::vector<uint8_t> rgb(7 * 5 * 3);
  ASSERT_TRUE(png_image_finish_read(&image, nullptr, rgb.data(), 0, nullptr));
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 7; ++x) {
      const uint8_t* p = &rgb[3 * (y * 7 + x)];
      EXPECT_EQ(canvas.At(x, y), (Color{p[0], p[1], p[2]}));
    }
  }
  std::filesystem::remove(path);
}

TEST(Canvas, AnUnwritablePathIsNamed) {
  const absl::Status status = Canvas(2, 2, kWhite).WritePng("/no/such/folder/a.png");
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("/no/such/folder/a.png"));
}

}  // namespace
}  // namespace clearance::client
