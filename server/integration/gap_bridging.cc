#include "server/integration/gap_bridging.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "server/field/lanes.h"

namespace clearance {
namespace {

// Cells of a sparse cloud without a return that a neighbour may lie behind.
constexpr int kSparseSkip = 5;
constexpr double kNoiseFactor = 8.0;
// Of the gap's width against what the line predicts.
constexpr float kSpacingTolerance = 0.5f;

using Points = std::vector<Eigen::Vector3f>;

// Decides about one gap and fills it.
class Bridger {
 public:
  Bridger(const RangeImage& image, ObjectId id, double h, const BridgeOptions& options)
      : image_(image),
        id_(id.value()),
        always_(image.is_pinhole() && !id.is_static()),
        step_m_(static_cast<float>(0.5 * h)),
        narrowest_m_(static_cast<float>(std::max(h, kNoiseFactor * options.noise_m))),
        widest_m_(static_cast<float>(
            always_ ? std::min(options.widest_object_gap_voxels * h, options.widest_object_gap_m)
                    : options.widest_gap_voxels * h)),
        deviation_m_(static_cast<float>(options.deviation_voxels * h)) {}

  // A gap outside these is not bridged.
  float narrowest_m() const { return narrowest_m_; }
  float widest_m() const { return widest_m_; }

  bool Usable(int u, int v) const {
    return u >= 0 && v >= 0 && u < image_.width() && v < image_.height() &&
           image_.label(u, v) == id_ && image_.has_surface(u, v);
  }

  // The gap between b and c; `before` b and `behind` c are their neighbours on the same line, null
  // where there is none.
  void Bridge(const Eigen::Vector3f* before, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
              const Eigen::Vector3f* behind, Points& out) const {
    const float gap = (c - b).norm();
    if (gap <= narrowest_m_ || gap > widest_m_) return;
    if (!always_ && !(before && Continues(*before, b, c)) &&
        !(behind && Continues(*behind, c, b))) {
      return;
    }
    const int parts = static_cast<int>(std::ceil(gap / step_m_));
    for (int k = 1; k < parts; ++k) {
      out.push_back(b + (c - b) * (static_cast<float>(k) / static_cast<float>(parts)));
    }
  }

 private:
  // Whether the line from a through b continues to c, on the other side of the gap (b, c): c is
  // near the line, and where its ray meets the line. Any two returns across a depth edge lie nearly
  // on one ray, and so does a surface seen edge-on; only the second condition tells them apart.
  bool Continues(const Eigen::Vector3f& a, const Eigen::Vector3f& b,
                 const Eigen::Vector3f& c) const {
    const Eigen::Vector3f line = (b - a).normalized();
    const float along = line.dot(c - b);
    if (along <= 0 || (c - b - along * line).norm() > deviation_m_) return false;
    const Eigen::Vector3f ray = c.normalized();
    const float cosine = line.dot(ray);
    const float sine2 = 1.f - cosine * cosine;
    if (sine2 < 1e-6f) return false;
    const float expected = (cosine * ray.dot(b) - line.dot(b)) / sine2;
    return std::abs(expected - along) < kSpacingTolerance * along;
  }

  const RangeImage& image_;
  const uint16_t id_;
  const bool always_;
  const float step_m_, narrowest_m_, widest_m_, deviation_m_;
};

// Depth images: pixel (u, v) against its left and its upper neighbour.
void BridgeRow(const RangeImage& image, const Bridger& bridger, const RangeImage::PixelBox& box,
               int v, Points& out) {
  const auto bridge = [&](int u, int du, int dv) {
    if (!bridger.Usable(u, v) || !bridger.Usable(u - du, v - dv)) return;
    Eigen::Vector3f before, behind;
    const bool has_before = bridger.Usable(u - 2 * du, v - 2 * dv);
    const bool has_behind = bridger.Usable(u + du, v + dv);
    if (has_before) before = image.Point(u - 2 * du, v - 2 * dv);
    if (has_behind) behind = image.Point(u + du, v + dv);
    bridger.Bridge(has_before ? &before : nullptr, image.Point(u - du, v - dv), image.Point(u, v),
                   has_behind ? &behind : nullptr, out);
  };
  const float* row = image.measures().data() + static_cast<size_t>(v) * image.width();
  const float* above = v > 0 ? row - image.width() : row;
  const float inverse_fx = 1.f / image.fx();
  const float y = (static_cast<float>(v) - image.cy()) / image.fy();
  const float y_step = 1.f / image.fy();
  const float farthest_m = static_cast<float>(image.max_range_m());
  // Bridge() decides with other roundings.
  const float least2 = 0.99f * bridger.narrowest_m() * bridger.narrowest_m();
  const float most2 = 1.01f * bridger.widest_m() * bridger.widest_m();
  // Left and upper gaps of eight pixels, one bit each.
  const auto find = [&](int u, Lanes m, Lanes left, Lanes up) {
    constexpr Lanes kSteps = {0, 1, 2, 3, 4, 5, 6, 7};
    const Lanes x = (kSteps + (static_cast<float>(u) - image.cx())) * inverse_fx;
    const Lanes to_left = m - left, to_up = m - up;
    const Lanes left_x = x * to_left + inverse_fx * left, up_y = y * to_up + y_step * up;
    const Lanes left2 = to_left * to_left * (1.f + y * y) + left_x * left_x;
    const Lanes up2 = to_up * to_up * (1.f + x * x) + up_y * up_y;
    const LanesInt usable = (m > 0.f) & (m <= farthest_m);
    return std::pair(Bits(usable & (left > 0.f) & (left2 > least2) & (left2 < most2)),
                     Bits(usable & (up > 0.f) & (up2 > least2) & (up2 < most2)));
  };
  const int end = box.u1 + 1;
  for (int u = box.u0; u < end; u += kLanes) {
    std::pair<uint32_t, uint32_t> gaps;
    uint32_t in = 0xff;
    if (u > 0 && u + kLanes <= image.width()) {
      gaps = find(u, Load(row + u), Load(row + u - 1), Load(above + u));
    } else {
      Lanes m{}, left{}, up{};
      for (int k = 0; k < kLanes && u + k < image.width(); ++k) {
        m[k] = row[u + k];
        left[k] = u + k > 0 ? row[u + k - 1] : 0.f;
        up[k] = above[u + k];
      }
      gaps = find(u, m, left, up);
    }
    if (u + kLanes > end) in >>= u + kLanes - end;
    for (uint32_t bits = (gaps.first | gaps.second) & in; bits; bits &= bits - 1) {
      const int k = __builtin_ctz(bits);
      if (gaps.first >> k & 1) bridge(u + k, 1, 0);
      if (gaps.second >> k & 1) bridge(u + k, 0, 1);
    }
  }
}

// Sparse clouds: the returns along a row or column of cells.
struct Line {
  int u, v, du, dv, length;
};

void BridgeLine(const RangeImage& image, const Bridger& bridger, const Line& line, Points& out) {
  // The last returns of a run, newest last; a gap is judged when its far neighbour is known.
  std::array<Eigen::Vector3f, 4> p;
  p.fill(Eigen::Vector3f::Zero());
  int run = 0, empty = 0;
  const auto finish = [&] {
    if (run >= 2) bridger.Bridge(run >= 3 ? &p[1] : nullptr, p[2], p[3], nullptr, out);
    run = empty = 0;
  };
  for (int i = 0; i < line.length; ++i) {
    const int u = line.u + i * line.du, v = line.v + i * line.dv;
    if (!bridger.Usable(u, v)) {
      if (image.measure(u, v) > 0 || ++empty > kSparseSkip) finish();
      continue;
    }
    empty = 0;
    for (int k = 0; k < 3; ++k) p[k] = p[k + 1];
    p[3] = image.Point(u, v);
    if (++run >= 3) bridger.Bridge(run >= 4 ? &p[0] : nullptr, p[1], p[2], &p[3], out);
  }
  finish();
}

}  // namespace

Eigen::Matrix3Xf BridgeGaps(const RangeImage& image, ObjectId id, double voxel_size_m,
                            const BridgeOptions& options) {
  const Bridger bridger(image, id, voxel_size_m, options);
  const RangeImage::PixelBox box = image.BoxOf(id.value());
  const int width = box.u1 + 1 - box.u0, height = box.v1 + 1 - box.v0;
  if (width <= 0 || height <= 0) return {};
  std::vector<Points> parts;
  if (image.is_pinhole()) {
    parts.resize(height);
    tbb::parallel_for(0, height,
                      [&](int k) { BridgeRow(image, bridger, box, box.v0 + k, parts[k]); });
  } else {
    std::vector<Line> lines;
    for (int v = box.v0; v <= box.v1; ++v) lines.push_back({box.u0, v, 1, 0, width});
    for (int u = box.u0; u <= box.u1; ++u) lines.push_back({u, box.v0, 0, 1, height});
    parts.resize(lines.size());
    tbb::parallel_for(size_t{0}, lines.size(),
                      [&](size_t i) { BridgeLine(image, bridger, lines[i], parts[i]); });
  }
  size_t n = 0;
  for (const Points& part : parts) n += part.size();
  Eigen::Matrix3Xf out(3, n);
  Eigen::Index column = 0;
  for (const Points& part : parts) {
    for (const Eigen::Vector3f& p : part) out.col(column++) = p;
  }
  return out;
}

LocalVoxels WithBridges(const LocalVoxels& voxels, const RangeImage& image, const Pose& T_M_X,
                        ObjectId id, double noise_m) {
  BridgeOptions options;
  options.noise_m = noise_m;
  const Eigen::Matrix3Xf bridges_X = BridgeGaps(image, id, voxels.voxel_size_m, options);
  std::vector<uint32_t> all(bridges_X.cols());
  std::iota(all.begin(), all.end(), 0);
  LocalVoxels bridges = GatherVoxels(bridges_X, all, T_M_X, voxels.voxel_size_m);
  std::fill(bridges.count.begin(), bridges.count.end(), 1);  // many lines cross; none is a return
  return Union(voxels, bridges);
}

}  // namespace clearance
