#include "client/draw/canvas.h"

#include <algorithm>
#include <cmath>

#include "client/draw/font.h"

namespace clearance::client {
namespace {

double DistanceToSegment(Vec2 p, Vec2 a, Vec2 b) {
  const double dx = b.x - a.x, dy = b.y - a.y;
  const double length2 = dx * dx + dy * dy;
  const double t =
      length2 > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / length2, 0.0, 1.0) : 0.0;
  return std::hypot(p.x - a.x - t * dx, p.y - a.y - t * dy);
}

uint8_t Mixed(uint8_t below, uint8_t above, double coverage) {
  return static_cast<uint8_t>(std::lround(below + (above - below) * coverage));
}

}  // namespace

Canvas::Canvas(int width, int height, Color background)
    : width_(width), height_(height), pixels_(static_cast<size_t>(width) * height, background) {}

void Canvas::SetPixel(int x, int y, Color color) {
  if (x < 0 || y < 0 || x >= width_ || y >= height_) return;
  pixels_[static_cast<size_t>(y) * width_ + x] = color;
}

void Canvas::BlendPixel(int x, int y, Color color, double coverage) {
  if (x < 0 || y < 0 || x >= width_ || y >= height_ || !(coverage > 0)) return;
  Color& pixel = pixels_[static_cast<size_t>(y) * width_ + x];
  const double c = std::min(coverage, 1.0);
  pixel = {Mixed(pixel.r, color.r, c), Mixed(pixel.g, color.g, c), Mixed(pixel.b, color.b, c)};
}

void Canvas::FillRect(int x, int y, int width, int height, Color color) {
  for (int v = std::max(y, 0); v < std::min(y + height, height_); ++v) {
    for (int u = std::max(x, 0); u < std::min(x + width, width_); ++u) SetPixel(u, v, color);
  }
}

void Canvas::Paste(const Canvas& other, int x, int y) {
  for (int v = 0; v < other.height_; ++v) {
    for (int u = 0; u < other.width_; ++u) SetPixel(x + u, y + v, other.At(u, v));
  }
}

void Canvas::DrawLine(Vec2 a, Vec2 b, double width, Color color) {
  if (!std::isfinite(a.x + a.y + b.x + b.y)) return;
  const double reach = width / 2 + 1;
  // Clamped before the conversion: a line may lead far outside.
  const auto first = [&](double v, int limit) {
    return static_cast<int>(std::floor(std::clamp(v - reach, 0.0, static_cast<double>(limit))));
  };
  const auto last = [&](double v, int limit) {
    return static_cast<int>(std::ceil(std::clamp(v + reach, 0.0, static_cast<double>(limit))));
  };
  const int y_end = last(std::max(a.y, b.y), height_), x_end = last(std::max(a.x, b.x), width_);
  for (int y = first(std::min(a.y, b.y), height_); y < y_end; ++y) {
    for (int x = first(std::min(a.x, b.x), width_); x < x_end; ++x) {
      const double d = DistanceToSegment({x + 0.5, y + 0.5}, a, b);
      BlendPixel(x, y, color, width / 2 + 0.5 - d);
    }
  }
}

void Canvas::DrawPolyline(const std::vector<Vec2>& points, double width, Color color, bool closed) {
  for (size_t i = 1; i < points.size(); ++i) DrawLine(points[i - 1], points[i], width, color);
  if (closed && points.size() > 2) DrawLine(points.back(), points.front(), width, color);
}

void Canvas::FillDisc(Vec2 centre, double radius, Color color) {
  DrawLine(centre, centre, 2 * radius, color);
}

void Canvas::DrawArrow(Vec2 a, Vec2 b, double width, Color color) {
  const double length = std::hypot(b.x - a.x, b.y - a.y);
  DrawLine(a, b, width, color);
  if (length < 1e-9) return;
  const double head = std::min(4 * width + 4, length);
  const Vec2 back{(a.x - b.x) / length * head, (a.y - b.y) / length * head};
  constexpr double kCos = 0.866, kSin = 0.5;  // 30 degrees
  DrawLine(b, {b.x + kCos * back.x - kSin * back.y, b.y + kSin * back.x + kCos * back.y}, width,
           color);
  DrawLine(b, {b.x + kCos * back.x + kSin * back.y, b.y - kSin * back.x + kCos * back.y}, width,
           color);
}

void Canvas::DrawText(int x, int y, std::string_view text, int scale, Color color) {
  for (const char c : text) {
    const Glyph& glyph = GlyphOf(c);
    for (int row = 0; row < kGlyphHeight; ++row) {
      for (int column = 0; column < kGlyphWidth; ++column) {
        if ((glyph[row] >> (kGlyphWidth - 1 - column)) & 1) {
          FillRect(x + column * scale, y + row * scale, scale, scale, color);
        }
      }
    }
    x += (kGlyphWidth + 1) * scale;
  }
}

int TextWidth(std::string_view text, int scale) {
  return static_cast<int>(text.size()) * (kGlyphWidth + 1) * scale;
}

int TextHeight(int scale) { return kGlyphHeight * scale; }

}  // namespace clearance::client
