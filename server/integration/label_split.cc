#include "server/integration/label_split.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace clearance {
namespace {

constexpr size_t kRowsAtOnce = 16;

// Lists of columns by label; neighbours mostly have the same, so the list of the last is kept.
class LabelLists {
 public:
  void Add(uint16_t label, uint32_t column) {
    if (label != last_label_) {
      last_label_ = label;
      last_ = label == 0 ? &static_points_ : &object_points_[ObjectId(label)];
    }
    last_->push_back(column);
  }
  std::vector<uint32_t>& static_points() { return static_points_; }
  LabelledPoints& object_points() { return object_points_; }

 private:
  std::vector<uint32_t> static_points_;
  LabelledPoints object_points_;
  uint16_t last_label_ = 0;
  std::vector<uint32_t>* last_ = &static_points_;
};

class Bounds {
 public:
  Bounds(const Pose& T_W_X, const std::optional<Aabb>& bounds) : T_W_X_(T_W_X), bounds_(bounds) {}
  bool Contain(const Eigen::Vector3f& p_X) const {
    return !bounds_ || bounds_->contains(T_W_X_ * p_X.cast<double>());
  }

 private:
  const Pose& T_W_X_;
  const std::optional<Aabb>& bounds_;
};

void Split(std::monostate, double, const Bounds&, LabelSplit&) {}

void Split(const PointCloud& cloud, double max_range_m, const Bounds& bounds, LabelSplit& out) {
  const Eigen::Index n = cloud.points_X.cols();
  out.points_X.resize(3, n);
  const float limit = static_cast<float>(max_range_m * max_range_m);
  LabelLists lists;
  uint32_t column = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3f p = cloud.points_X.col(i);
    const float r2 = p.squaredNorm();
    if (r2 == 0 || r2 > limit || !bounds.Contain(p)) continue;  // (0, 0, 0) is no return
    lists.Add(cloud.labels.empty() ? 0 : cloud.labels[i], column);
    out.points_X.col(column++) = p;
  }
  out.points_X.conservativeResize(3, column);
  out.static_points = std::move(lists.static_points());
  out.object_points = std::move(lists.object_points());
}

void SplitRows(const DepthImage& image, uint32_t first, uint32_t last, float limit,
               const std::vector<float>& ray_x, const Bounds& bounds, Eigen::Matrix3Xf& points_X,
               LabelLists& lists) {
  const float scale = static_cast<float>(image.depth_scale_m);
  const uint16_t* labels = image.labels.empty() ? nullptr : image.labels.data();
  for (uint32_t v = first; v < last; ++v) {
    const float ray_y = static_cast<float>((v - image.cy) / image.fy);
    uint32_t i = v * image.width;
    for (uint32_t u = 0; u < image.width; ++u, ++i) {
      const float z = image.depth[i] * scale;
      if (z <= 0 || z > limit) continue;
      const Eigen::Vector3f p(ray_x[u] * z, ray_y * z, z);
      if (!bounds.Contain(p)) continue;
      points_X.col(i) = p;
      lists.Add(labels ? labels[i] : 0, i);
    }
  }
}

void Split(const DepthImage& image, double max_range_m, const Bounds& bounds, LabelSplit& out) {
  out.points_X.resize(3, static_cast<Eigen::Index>(image.width) * image.height);
  std::vector<float> ray_x(image.width);
  for (uint32_t u = 0; u < image.width; ++u) {
    ray_x[u] = static_cast<float>((u - image.cx) / image.fx);
  }
  const float limit = static_cast<float>(max_range_m);
  std::vector<LabelLists> parts((image.height + kRowsAtOnce - 1) / kRowsAtOnce);
  tbb::parallel_for(size_t{0}, parts.size(), [&](size_t part) {
    const uint32_t first = static_cast<uint32_t>(part * kRowsAtOnce);
    parts[part].static_points().reserve(kRowsAtOnce * image.width);
    SplitRows(image, first, std::min<uint32_t>(image.height, first + kRowsAtOnce), limit, ray_x,
              bounds, out.points_X, parts[part]);
  });
  std::vector<size_t> begin(parts.size() + 1, 0);
  for (size_t k = 0; k < parts.size(); ++k) {
    begin[k + 1] = begin[k] + parts[k].static_points().size();
    for (const auto& [id, columns] : parts[k].object_points()) {
      std::vector<uint32_t>& all = out.object_points[id];
      all.insert(all.end(), columns.begin(), columns.end());
    }
  }
  out.static_points.resize(begin.back());
  tbb::parallel_for(size_t{0}, parts.size(), [&](size_t k) {
    std::copy(parts[k].static_points().begin(), parts[k].static_points().end(),
              out.static_points.begin() + begin[k]);
  });
}

}  // namespace

LabelSplit SplitByLabel(const Frame& frame, double max_range_m, const std::optional<Aabb>& bounds) {
  LabelSplit out;
  std::visit([&](const auto& o) { Split(o, max_range_m, Bounds(frame.T_W_X, bounds), out); },
             frame.observation);
  return out;
}

}  // namespace clearance
