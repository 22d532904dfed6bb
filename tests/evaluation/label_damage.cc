#include "tests/evaluation/label_damage.h"

#include <cmath>
#include <numbers>
#include <set>
#include <vector>

namespace clearance::evaluation {
namespace {

std::vector<uint16_t>* Labels(Frame& frame) {
  if (auto* depth = std::get_if<DepthImage>(&frame.observation)) return &depth->labels;
  if (auto* cloud = std::get_if<PointCloud>(&frame.observation)) return &cloud->labels;
  return nullptr;
}

// Erodes every label of an image; 0xffff (no return) does not erode.
std::vector<uint16_t> Eroded(const std::vector<uint16_t>& labels, int width, int height,
                             int pixels) {
  std::vector<uint16_t> out = labels;
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const uint16_t own = labels[static_cast<size_t>(v) * width + u];
      if (own == 0 || own == 0xffff) continue;
      bool inner = true;
      for (int dv = -pixels; dv <= pixels && inner; ++dv) {
        for (int du = -pixels; du <= pixels && inner; ++du) {
          const int nu = u + du, nv = v + dv;
          if (nu < 0 || nv < 0 || nu >= width || nv >= height) continue;
          const uint16_t other = labels[static_cast<size_t>(nv) * width + nu];
          inner = other == own || other == 0xffff;
        }
      }
      if (!inner) out[static_cast<size_t>(v) * width + u] = 0;
    }
  }
  return out;
}

void ShrinkCloud(int pixels, PointCloud& cloud) {
  constexpr double kDegree = std::numbers::pi / 180, kAzimuth = 0.2, kElevation = 0.4;
  const int width = static_cast<int>(360 / kAzimuth), height = static_cast<int>(180 / kElevation);
  std::vector<uint16_t> image(static_cast<size_t>(width) * height, 0xffff);
  std::vector<size_t> pixel(cloud.labels.size());
  for (size_t i = 0; i < pixel.size(); ++i) {
    const Eigen::Vector3f p = cloud.points_X.col(static_cast<Eigen::Index>(i));
    const int u = static_cast<int>((std::atan2(p.y(), p.x()) / kDegree + 180) / kAzimuth);
    const int v =
        static_cast<int>((std::atan2(p.z(), p.head<2>().norm()) / kDegree + 90) / kElevation);
    pixel[i] = static_cast<size_t>(std::min(v, height - 1)) * width + std::min(u, width - 1);
    uint16_t& at = image[pixel[i]];
    if (at == 0xffff || cloud.labels[i] != 0) at = cloud.labels[i];
  }
  image = Eroded(image, width, height, pixels);
  for (size_t i = 0; i < pixel.size(); ++i) {
    if (image[pixel[i]] == 0) cloud.labels[i] = 0;
  }
}

}  // namespace

void ShrinkLabels(int pixels, Frame& frame) {
  if (auto* depth = std::get_if<DepthImage>(&frame.observation)) {
    if (depth->labels.empty()) return;
    depth->labels = Eroded(depth->labels, static_cast<int>(depth->width),
                           static_cast<int>(depth->height), pixels);
  } else if (auto* cloud = std::get_if<PointCloud>(&frame.observation)) {
    if (!cloud->labels.empty()) ShrinkCloud(pixels, *cloud);
  }
}

void LateLabels::Apply(Frame& frame) {
  std::vector<uint16_t>* labels = Labels(frame);
  if (!labels) return;
  const std::set<uint16_t> present(labels->begin(), labels->end());
  for (const uint16_t id : present) {
    if (id != 0) ++seen_[id];
  }
  for (uint16_t& label : *labels) {
    if (label != 0 && seen_[label] <= frames_) label = 0;
  }
}

}  // namespace clearance::evaluation
