#include "server/integration/label_split.h"

#include <algorithm>

namespace clearance {
namespace {

// Collects points one by one; pixels of one label come in runs, so the list of the last label is
// kept.
class Splitter {
 public:
  Splitter(LabelSplit& out, const Pose& T_W_X, const std::optional<Aabb>& bounds)
      : out_(out), T_W_X_(T_W_X), bounds_(bounds), last_list_(&out.static_points) {}

  void Add(const Eigen::Vector3f& p_X, uint16_t label) {
    if (bounds_ && !bounds_->contains(T_W_X_ * p_X.cast<double>())) return;
    if (label != last_label_) {
      last_label_ = label;
      last_list_ = label == 0 ? &out_.static_points : &out_.object_points[ObjectId(label)];
    }
    last_list_->push_back(count_);
    out_.points_X.col(count_++) = p_X;
  }

  void Finish() { out_.points_X.conservativeResize(3, count_); }

 private:
  LabelSplit& out_;
  const Pose& T_W_X_;
  const std::optional<Aabb>& bounds_;
  uint16_t last_label_ = 0;
  std::vector<uint32_t>* last_list_;
  uint32_t count_ = 0;
};

void Split(std::monostate, double, LabelSplit&, Splitter&) {}

void Split(const PointCloud& cloud, double max_range_m, LabelSplit& out, Splitter& splitter) {
  const Eigen::Index n = cloud.points_X.cols();
  out.points_X.resize(3, n);
  out.static_points.reserve(n);
  const float limit = static_cast<float>(max_range_m * max_range_m);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3f p = cloud.points_X.col(i);
    const float r2 = p.squaredNorm();
    if (r2 == 0 || r2 > limit) continue;  // (0, 0, 0) is no return
    splitter.Add(p, cloud.labels.empty() ? 0 : cloud.labels[i]);
  }
}

void Split(const DepthImage& image, double max_range_m, LabelSplit& out, Splitter& splitter) {
  const size_t n = size_t{image.width} * image.height;
  out.points_X.resize(3, n);
  out.static_points.reserve(n);
  std::vector<float> ray_x(image.width);
  for (uint32_t u = 0; u < image.width; ++u) {
    ray_x[u] = static_cast<float>((u - image.cx) / image.fx);
  }
  const float scale = static_cast<float>(image.depth_scale_m);
  const float limit = static_cast<float>(max_range_m);
  size_t i = 0;
  for (uint32_t v = 0; v < image.height; ++v) {
    const float ray_y = static_cast<float>((v - image.cy) / image.fy);
    for (uint32_t u = 0; u < image.width; ++u, ++i) {
      const float z = image.depth[i] * scale;
      if (z <= 0 || z > limit) continue;
      splitter.Add({ray_x[u] * z, ray_y * z, z}, image.labels.empty() ? 0 : image.labels[i]);
    }
  }
}

}  // namespace

LabelSplit SplitByLabel(const Frame& frame, double max_range_m, const std::optional<Aabb>& bounds) {
  LabelSplit out;
  Splitter splitter(out, frame.T_W_X, bounds);
  std::visit([&](const auto& o) { Split(o, max_range_m, out, splitter); }, frame.observation);
  splitter.Finish();
  return out;
}

}  // namespace clearance
