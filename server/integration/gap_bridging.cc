#include "server/integration/gap_bridging.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

namespace clearance {
namespace {

// Pixels without a return that a neighbour may lie behind: cells of a sparse cloud are often empty,
// pixels of a depth image only where nothing was measured.
constexpr int kSparseSkip = 5;
constexpr double kNoiseFactor = 8.0;
// Of the gap's width against what the line predicts.
constexpr float kSpacingTolerance = 0.5f;

struct Line {  // of pixels: a row or a column
  int u, v, du, dv, length;
};

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
        deviation_m_(static_cast<float>(options.deviation_voxels * h)),
        skip_(image.is_pinhole() ? 0 : kSparseSkip) {}

  void Along(const Line& line, std::vector<Eigen::Vector3f>& out) const {
    // The last four returns of a run, oldest first; a gap is judged when its far neighbour is
    // known.
    std::array<Eigen::Vector3f, 4> p;
    p.fill(Eigen::Vector3f::Zero());
    int run = 0, empty = 0;
    for (int i = 0; i < line.length; ++i) {
      const int u = line.u + i * line.du, v = line.v + i * line.dv;
      const float measure = image_.measure(u, v);
      const bool usable = image_.has_surface(u, v) && image_.label(u, v) == id_;
      if (!usable) {
        if (measure > 0 || ++empty > skip_) {
          Finish(p, run, out);
          run = 0;
          empty = 0;
        }
        continue;
      }
      empty = 0;
      for (int k = 0; k < 3; ++k) p[k] = p[k + 1];
      p[3] = image_.Point(u, v);
      ++run;
      // The gap between p[1] and p[2], with p[0] before and p[3] behind it.
      if (run >= 4) {
        Judge(&p[0], &p[3], out);
      } else if (run == 3 && Gap(p[1], p[2])) {
        if (Continues(p[3], p[2], p[1])) Fill(p[1], p[2], out);
      }
    }
    Finish(p, run, out);
  }

 private:
  // The last gap of a run, p[2] to p[3].
  void Finish(const std::array<Eigen::Vector3f, 4>& p, int run,
              std::vector<Eigen::Vector3f>& out) const {
    if (run >= 3) {
      Judge(&p[1], nullptr, out);
    } else if (run == 2 && always_ && Gap(p[2], p[3])) {
      Fill(p[2], p[3], out);
    }
  }

  bool Gap(const Eigen::Vector3f& a, const Eigen::Vector3f& b) const {
    const float gap2 = (a - b).squaredNorm();
    return gap2 > narrowest_m_ * narrowest_m_ && gap2 <= widest_m_ * widest_m_;
  }

  // Whether the line from a through b continues to c, on the other side of the gap (b, c): c is
  // near the line, and where its ray meets the line. Any two returns across a depth edge lie nearly
  // on one ray, and so does a surface seen edge-on; only the second condition tells them apart.
  bool Continues(const Eigen::Vector3f& a, const Eigen::Vector3f& b,
                 const Eigen::Vector3f& c) const {
    if (always_) return true;
    const Eigen::Vector3f line = (b - a).normalized(), ray = c.normalized();
    const float along = line.dot(c - b);
    if (along <= 0 || (c - b - along * line).norm() > deviation_m_) return false;
    const float cosine = line.dot(ray);
    const float sine2 = 1.f - cosine * cosine;
    if (sine2 < 1e-6f) return false;
    const float expected = (cosine * ray.dot(b) - line.dot(b)) / sine2;
    return std::abs(expected - along) < kSpacingTolerance * along;
  }

  // before[0], before[1], before[2] are consecutive; the gap is between the latter two.
  void Judge(const Eigen::Vector3f* before, const Eigen::Vector3f* behind,
             std::vector<Eigen::Vector3f>& out) const {
    if (!Gap(before[1], before[2])) return;
    if (Continues(before[0], before[1], before[2]) ||
        (behind && Continues(*behind, before[2], before[1]))) {
      Fill(before[1], before[2], out);
    }
  }

  void Fill(const Eigen::Vector3f& a, const Eigen::Vector3f& b,
            std::vector<Eigen::Vector3f>& out) const {
    const int parts = static_cast<int>(std::ceil((b - a).norm() / step_m_));
    for (int k = 1; k < parts; ++k) {
      out.push_back(a + (b - a) * (static_cast<float>(k) / static_cast<float>(parts)));
    }
  }

  const RangeImage& image_;
  const uint16_t id_;
  const bool always_;
  const float step_m_, narrowest_m_, widest_m_, deviation_m_;
  const int skip_;
};

}  // namespace

Eigen::Matrix3Xf BridgeGaps(const RangeImage& image, ObjectId id, double voxel_size_m,
                            const BridgeOptions& options) {
  const Bridger bridger(image, id, voxel_size_m, options);
  std::vector<Line> lines;
  for (int v = 0; v < image.height(); ++v) lines.push_back({0, v, 1, 0, image.width()});
  for (int u = 0; u < image.width(); ++u) lines.push_back({u, 0, 0, 1, image.height()});
  std::vector<std::vector<Eigen::Vector3f>> parts(lines.size());
  tbb::parallel_for(size_t{0}, lines.size(), [&](size_t i) { bridger.Along(lines[i], parts[i]); });
  size_t n = 0;
  for (const auto& part : parts) n += part.size();
  Eigen::Matrix3Xf out(3, n);
  Eigen::Index column = 0;
  for (const auto& part : parts) {
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
