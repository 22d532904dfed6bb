// A small raster canvas: lines, polygons and text on RGB pixels, written as PNG.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <vector>

#include "absl/status/status.h"

namespace clearance::client {

struct Color {
  uint8_t r = 0, g = 0, b = 0;
  friend bool operator==(const Color&, const Color&) = default;
};

struct Vec2 {
  double x = 0, y = 0;
};

// Pixel (x, y) covers [x, x + 1) x [y, y + 1); x right, y down. Drawing outside is clipped.
class Canvas {
 public:
  Canvas(int width, int height, Color background);

  int width() const { return width_; }
  int height() const { return height_; }
  Color At(int x, int y) const { return pixels_[static_cast<size_t>(y) * width_ + x]; }

  void SetPixel(int x, int y, Color color);
  // `coverage` 0..1 of `color` over what is there.
  void BlendPixel(int x, int y, Color color, double coverage);
  void FillRect(int x, int y, int width, int height, Color color);
  // Copies `other` with its top left corner at (x, y).
  void Paste(const Canvas& other, int x, int y);
  // Anti-aliased, with round ends.
  void DrawLine(Vec2 a, Vec2 b, double width, Color color);
  void DrawPolyline(const std::vector<Vec2>& points, double width, Color color,
                    bool closed = false);
  void FillDisc(Vec2 centre, double radius, Color color);
  // A line from a to b with a head at b.
  void DrawArrow(Vec2 a, Vec2 b, double width, Color color);
  // (x, y) is the top left corner; `scale` pixels a dot of the 5x7 font. Characters without a glyph
  // become '?'.
  void DrawText(int x, int y, std::string_view text, int scale, Color color);

  // NOT_FOUND naming the path where it cannot be written.
  absl::Status WritePng(const std::filesystem::path& path) const;

 private:
  int width_, height_;
  std::vector<Color> pixels_;
};

// Of DrawText, in pixels.
int TextWidth(std::string_view text, int scale);
int TextHeight(int scale);

}  // namespace clearance::client
