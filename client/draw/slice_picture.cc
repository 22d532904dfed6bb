#include "client/draw/slice_picture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "absl/strings/str_format.h"

namespace clearance::client {
namespace {

constexpr Color kPaper{255, 255, 255}, kInk{20, 20, 24}, kFaint{120, 120, 126};
constexpr Color kOccupied{38, 34, 48}, kUnknown{214, 214, 216}, kHatch{188, 188, 192};
constexpr Color kSensor{0, 0, 0}, kOutline{255, 255, 255};
constexpr int kMargin = 16, kTitleHeight = 34, kLegendHeight = 64, kMinWidth = 940;

// One colour for each object, far apart from its neighbours' and readable on the heat map.
Color ObjectColor(uint32_t id) {
  constexpr std::array<Color, 8> kColors = {{{214, 39, 160},
                                             {0, 120, 60},
                                             {120, 50, 200},
                                             {180, 40, 30},
                                             {0, 90, 160},
                                             {130, 90, 0},
                                             {90, 90, 90},
                                             {0, 130, 130}}};
  return kColors[id % kColors.size()];
}

// From the world to pixels.
struct Projection {
  double left_m, top_m, pixels_per_m;

  Vec2 operator()(const Eigen::Vector3d& p_W) const {
    return {(p_W.x() - left_m) * pixels_per_m, (top_m - p_W.y()) * pixels_per_m};
  }
};

// The footprint of a box in the plane, counter-clockwise.
std::vector<Vec2> Footprint(const OrientedBox& box, const Projection& project) {
  std::vector<Vec2> points;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d p_B((corner & 1 ? 0.5 : -0.5) * box.size_m.x(),
                              (corner & 2 ? 0.5 : -0.5) * box.size_m.y(),
                              (corner & 4 ? 0.5 : -0.5) * box.size_m.z());
    points.push_back(project(box.world_from_box * p_B));
  }
  // Convex hull by the monotone chain.
  std::sort(points.begin(), points.end(),
            [](Vec2 a, Vec2 b) { return a.x != b.x ? a.x < b.x : a.y < b.y; });
  const auto turn = [](Vec2 o, Vec2 a, Vec2 b) {
    return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x);
  };
  std::vector<Vec2> hull;
  for (int pass = 0; pass < 2; ++pass) {
    const size_t base = hull.size();
    for (const Vec2& p : points) {
      while (hull.size() >= base + 2 && turn(hull[hull.size() - 2], hull.back(), p) <= 0) {
        hull.pop_back();
      }
      hull.push_back(p);
    }
    hull.pop_back();
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

// Half way to the colour of the unknown.
Color Paler(Color c) {
  return {static_cast<uint8_t>((c.r + kUnknown.r) / 2),
          static_cast<uint8_t>((c.g + kUnknown.g) / 2),
          static_cast<uint8_t>((c.b + kUnknown.b) / 2)};
}

Color CellColor(const Slice& slice, size_t cell, double max_distance_m, int x, int y) {
  const uint8_t state = slice.states[cell];
  switch (StateOf(state)) {
    case SpaceState::kOccupied:
      return kOccupied;
    case SpaceState::kFree: {
      const Color c = HeatColor(slice.distances_m[cell], max_distance_m);
      return state & kFlagLowConfidence ? Paler(c) : c;
    }
    case SpaceState::kUnknown:
      break;
  }
  return (x + y) % 8 < 2 ? kHatch : kUnknown;
}

void DrawCells(const Slice& slice, const SlicePicture& picture, Canvas& canvas) {
  for (int y = 0; y < canvas.height(); ++y) {
    const size_t row = slice.rows - 1 - size_t(y) * slice.rows / canvas.height();
    for (int x = 0; x < canvas.width(); ++x) {
      const size_t column = size_t(x) * slice.columns / canvas.width();
      canvas.SetPixel(x, y,
                      CellColor(slice, row * slice.columns + column, picture.max_distance_m, x, y));
    }
  }
}

void DrawPath(const std::vector<StampedPose>& path, const Projection& project, double width,
              Color color, Canvas& canvas) {
  std::vector<Vec2> points;
  for (const StampedPose& pose : path) points.push_back(project(pose.pose.translation()));
  canvas.DrawPolyline(points, width, color);
}

void DrawObject(const ObjectInfo& object, const Projection& project, Canvas& canvas) {
  const Color color = ObjectColor(object.brief.object_id);
  DrawPath(object.history, project, 1.6, color, canvas);
  if (object.box.size_m.norm() > 0) {
    const std::vector<Vec2> outline = Footprint(object.box, project);
    canvas.DrawPolyline(outline, 4, kOutline, /*closed=*/true);
    canvas.DrawPolyline(outline, 2, color, /*closed=*/true);
  }
  const bool has_box = object.box.size_m.norm() > 0;
  const Eigen::Vector3d centre = has_box ? Eigen::Vector3d(object.box.world_from_box.translation())
                                         : Eigen::Vector3d(object.brief.T_W_L.translation());
  const Eigen::Vector3d& v = object.brief.twist.linear_mps;
  const Vec2 from = project(centre);
  if (v.head<2>().norm() > 0.2) canvas.DrawArrow(from, project(centre + v), 2, color);
  const std::string label =
      absl::StrFormat("%d%s%s", object.brief.object_id, object.brief.class_name.empty() ? "" : " ",
                      object.brief.class_name);
  const int x = static_cast<int>(from.x) + 8, y = static_cast<int>(from.y) + 8;
  for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
    canvas.DrawText(x + dx, y + dy, label, 1, kOutline);
  }
  canvas.DrawText(x, y, label, 1, color);
}

// A round length that takes at most a fifth of the width.
double ScaleBarLength(double width_m) {
  double length = std::pow(10.0, std::floor(std::log10(std::max(width_m / 5, 1e-3))));
  if (length * 5 <= width_m / 5) return length * 5;
  return length * 2 <= width_m / 5 ? length * 2 : length;
}

void DrawLegend(const SlicePicture& picture, double width_m, double pixels_per_m, int y,
                Canvas& canvas) {
  const int x0 = kMargin;
  constexpr int kBar = 200, kBarHeight = 12;
  for (int i = 0; i < kBar; ++i) {
    canvas.FillRect(x0 + i, y, 1, kBarHeight,
                    HeatColor(picture.max_distance_m * i / kBar, picture.max_distance_m));
  }
  const int text_y = y + kBarHeight + 5;
  canvas.DrawText(x0, text_y, "0", 1, kInk);
  const std::string end = absl::StrFormat("%.3g m", picture.max_distance_m);
  canvas.DrawText(x0 + kBar - TextWidth(end, 1), text_y, end, 1, kInk);
  canvas.DrawText(x0 + kBar / 2 - TextWidth("clearance", 1) / 2, text_y, "clearance", 1, kInk);

  int x = x0 + kBar + 24;
  const auto swatch = [&](const char* name, auto fill) {
    fill(x, y);
    canvas.DrawText(x + 26, y + 3, name, 1, kInk);
    x += 26 + TextWidth(name, 1) + 14;
  };
  swatch("occupied", [&](int u, int v) { canvas.FillRect(u, v, 20, 12, kOccupied); });
  swatch("paler: free, not yet sure", [&](int u, int v) {
    for (int i = 0; i < 20; ++i) {
      canvas.FillRect(u + i, v, 1, 12,
                      Paler(HeatColor(picture.max_distance_m * i / 20, picture.max_distance_m)));
    }
  });
  swatch("unknown", [&](int u, int v) {
    for (int j = 0; j < 12; ++j) {
      for (int i = 0; i < 20; ++i)
        canvas.SetPixel(u + i, v + j, (i + j) % 8 < 2 ? kHatch : kUnknown);
    }
  });
  swatch("object, velocity (1 s), path", [&](int u, int v) {
    canvas.DrawArrow({u + 1.0, v + 6.0}, {u + 19.0, v + 6.0}, 2, ObjectColor(0));
  });
  swatch("sensor path", [&](int u, int v) {
    canvas.DrawLine({u + 0.0, v + 6.0}, {u + 14.0, v + 6.0}, 1.5, kSensor);
    canvas.FillDisc({u + 15.0, v + 6.0}, 4, kSensor);
  });

  const double length_m = ScaleBarLength(width_m);
  const double bar = length_m * pixels_per_m;
  const std::string text = absl::StrFormat("%g m", length_m);
  const double right = x0 + kBar + 24 + bar;
  canvas.DrawLine({right - bar, y + 34.0}, {right, y + 34.0}, 3, kInk);
  for (const double end_x : {right - bar, right}) {
    canvas.DrawLine({end_x, y + 29.0}, {end_x, y + 39.0}, 2, kInk);
  }
  canvas.DrawText(static_cast<int>(right) + 8, y + 31, text, 1, kInk);
}

// The map alone, so that what leads out of it is cut at its border.
Canvas DrawMap(const Slice& slice, const SlicePicture& picture, int width, int height,
               double pixels_per_m) {
  Canvas canvas(width, height, kPaper);
  DrawCells(slice, picture, canvas);
  const Projection project{slice.origin_W.x() - slice.resolution_m / 2,
                           slice.origin_W.y() + (slice.rows - 0.5) * slice.resolution_m,
                           pixels_per_m};
  DrawPath(picture.sensor_path, project, 1.5, kSensor, canvas);
  if (!picture.sensor_path.empty()) {
    const Vec2 now = project(picture.sensor_path.back().pose.translation());
    canvas.FillDisc(now, 5, kOutline);
    canvas.FillDisc(now, 4, kSensor);
  }
  for (const ObjectInfo& object : picture.objects) {
    if (object.brief.life != ObjectLife::kRetired) DrawObject(object, project, canvas);
  }
  return canvas;
}

}  // namespace

Color HeatColor(double distance_m, double max_distance_m) {
  // From warm (close) over yellow to a cool blue (far), perceptually about even.
  constexpr std::array<Color, 6> kStops = {{{165, 0, 38},
                                            {244, 109, 67},
                                            {254, 224, 139},
                                            {171, 221, 164},
                                            {74, 160, 200},
                                            {49, 84, 160}}};
  const double t = std::clamp(distance_m / max_distance_m, 0.0, 1.0) * (kStops.size() - 1);
  const size_t i = std::min<size_t>(static_cast<size_t>(t), kStops.size() - 2);
  const double f = t - static_cast<double>(i);
  const auto mix = [f](uint8_t a, uint8_t b) {
    return static_cast<uint8_t>(std::lround(a + (b - a) * f));
  };
  const Color a = kStops[i], b = kStops[i + 1];
  return {mix(a.r, b.r), mix(a.g, b.g), mix(a.b, b.b)};
}

Canvas DrawSlice(const Slice& slice, const SlicePicture& picture) {
  const int columns = std::max<int>(1, static_cast<int>(slice.columns));
  const int rows = std::max<int>(1, static_cast<int>(slice.rows));
  // Whole pixels a cell where cells are large, so that they stay square and sharp.
  double scale = static_cast<double>(picture.target_width) / std::max(columns, rows);
  if (scale > 1) scale = std::floor(scale);
  const int width = std::max(1, static_cast<int>(std::lround(columns * scale)));
  const int height = std::max(1, static_cast<int>(std::lround(rows * scale)));
  Canvas canvas(std::max(width, kMinWidth) + 2 * kMargin,
                kTitleHeight + height + 2 * kMargin + kLegendHeight, kPaper);
  canvas.DrawText(kMargin, 12, picture.title, 2, kInk);
  const int x0 = kMargin, y0 = kTitleHeight + kMargin;
  const double pixels_per_m = slice.resolution_m > 0 ? scale / slice.resolution_m : 1.0;
  if (slice.columns > 0 && slice.rows > 0) {
    canvas.Paste(DrawMap(slice, picture, width, height, pixels_per_m), x0, y0);
  } else {
    canvas.DrawText(x0, y0, "nothing observed yet", 2, kFaint);
  }
  DrawLegend(picture, width / pixels_per_m, pixels_per_m, y0 + height + kMargin, canvas);
  return canvas;
}

}  // namespace clearance::client
