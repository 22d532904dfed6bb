// What a local Gaussian-process distance field is good for, on one view of each analytic scene:
//   local_field_study [--seeds N]
// 1. In the surface band: error by kernel, length scale and neighbourhood, and what training costs.
// 2. Throughout the view: the direct estimate (the field of the nearest training point, the
// reverting
//    distance in double precision) against the distance to the nearest of the same training points.
// Prints JSON. Errors in voxels, of points whose true nearest surface was seen.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "server/esdf/exact_transform.h"
#include "server/field/local_gp_field.h"
#include "server/integration/local_voxels.h"
#include "server/integration/range_image.h"
#include "tests/testing/analytic_scene.h"

namespace clearance::evaluation {
namespace {

using Eigen::Vector3d;

constexpr double kH = 0.1;
constexpr double kNoiseVariance = 0.01;

// Centroids of the surface voxels of one view, and the scene.
struct View {
  testing::AnalyticScene scene;
  Vector3d eye;
  std::vector<Vector3d> returns;
  std::vector<Vector3d> centroids;

  bool Observed(const Vector3d& p) const {
    const auto near = nearest->Find(scene.NearestSurface(p));
    return near.site >= 0 && near.distance_m < kH;
  }
  std::shared_ptr<const ExactTransform> nearest;  // of the centroids

  struct Leaf {
    Vector3d middle = Vector3d::Zero();  // of its centroids
    std::vector<Vector3d> centroids;
  };
  std::vector<Leaf> leaves;
};

View MakeView(const testing::ViewedScene& placed, size_t which) {
  View view;
  view.scene = placed.scene;
  const Pose& T_W_X = placed.views[which % placed.views.size()];
  view.eye = T_W_X.translation();
  const auto depth = placed.scene.RenderDepth(T_W_X, testing::Intrinsics::Large());
  const RangeImage image = RangeImage::FromDepth(depth, 12.0);
  Eigen::Matrix3Xf points_X(3, depth.width * depth.height);
  std::vector<uint32_t> indices;
  for (uint32_t i = 0; i < depth.width * depth.height; ++i) {
    const int u = static_cast<int>(i % depth.width), v = static_cast<int>(i / depth.width);
    if (!image.has_surface(u, v)) continue;
    points_X.col(i) = image.Point(u, v);
    indices.push_back(i);
    view.returns.push_back(T_W_X * points_X.col(i).cast<double>());
  }
  const LocalVoxels voxels = GatherVoxels(points_X, indices, T_W_X, kH);
  for (const LocalVoxels::Block& b : voxels.blocks) {
    View::Leaf& leaf = view.leaves.emplace_back();
    for (uint32_t i = b.begin; i < b.end; ++i) {
      view.centroids.push_back(BlockOrigin(b.block, kH) + voxels.centroid[i].cast<double>());
      leaf.centroids.push_back(view.centroids.back());
      leaf.middle += view.centroids.back() / (b.end - b.begin);
    }
  }
  view.nearest = std::make_shared<ExactTransform>(view.centroids, kH, 8.0);
  return view;
}

std::optional<LocalGpField> FieldOf(std::vector<std::pair<double, Vector3d>> near,
                                    const Kernel& kernel) {
  std::sort(near.begin(), near.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  near.resize(std::min<size_t>(near.size(), LocalGpField::kMaxPoints));
  Eigen::Matrix3Xf points(3, near.size());
  for (size_t i = 0; i < near.size(); ++i) points.col(i) = near[i].second.cast<float>();
  return LocalGpField::Train(points, Eigen::ArrayXf::Constant(near.size(), kNoiseVariance), kernel);
}

// The field of the leaf whose middle is nearest, of up to 64 of its points, those nearest to p.
std::optional<LocalGpField> FieldOfLeaf(const View& view, const Vector3d& p, const Kernel& kernel,
                                        Vector3d* origin) {
  const auto leaf = std::min_element(
      view.leaves.begin(), view.leaves.end(), [&](const View::Leaf& a, const View::Leaf& b) {
        return (a.middle - p).squaredNorm() < (b.middle - p).squaredNorm();
      });
  *origin = leaf->middle;
  std::vector<std::pair<double, Vector3d>> near;
  for (const Vector3d& c : leaf->centroids) near.emplace_back((c - p).squaredNorm(), c - *origin);
  return FieldOf(std::move(near), kernel);
}

// The field around a centroid: up to 64 of those whose voxels lie within `reach` voxels of its own.
std::optional<LocalGpField> FieldAround(const View& view, int32_t centroid, int reach,
                                        const Kernel& kernel, Vector3d* origin) {
  const VoxelIndex own = VoxelOf(view.centroids[centroid], kH);
  *origin = VoxelCentre(own, kH);
  std::vector<std::pair<double, Vector3d>> near;
  for (const Vector3d& c : view.centroids) {
    if ((c - *origin).cwiseAbs().maxCoeff() > (reach + 0.5) * kH) continue;
    near.emplace_back((c - view.centroids[centroid]).squaredNorm(), c - *origin);
  }
  return FieldOf(std::move(near), kernel);
}

nlohmann::json Summary(std::vector<double> errors) {
  if (errors.empty()) return {{"points", 0}};
  double sum = 0, absolute = 0;
  for (double e : errors) {
    sum += e;
    absolute += std::abs(e);
  }
  std::sort(errors.begin(), errors.end(),
            [](double a, double b) { return std::abs(a) < std::abs(b); });
  const double n = static_cast<double>(errors.size());
  return {{"points", errors.size()},
          {"bias", sum / n},
          {"mean", absolute / n},
          {"p95", std::abs(errors[errors.size() * 95 / 100])}};
}

struct Choice {
  const char* kernel;
  KernelType type;
  double length_voxels;
  int reach;
};

// Points within two voxels of seen surface, in front of it.
std::vector<Vector3d> BandPoints(const View& view, size_t count, std::mt19937& rng) {
  std::uniform_real_distribution<double> u(-2 * kH, 2 * kH);
  std::vector<Vector3d> points;
  for (int tries = 0; points.size() < count && tries < 100000; ++tries) {
    const Vector3d p =
        view.centroids[rng() % view.centroids.size()] + Vector3d(u(rng), u(rng), u(rng));
    const double d = view.scene.Distance(p);
    if (d > 0 && d < 2 * kH && view.Observed(p)) points.push_back(p);
  }
  return points;
}

nlohmann::json BandStudy(const std::vector<View>& views, size_t count) {
  std::vector<Choice> choices;
  for (const double l : {0.5, 1.0, 1.5, 2.0, 3.0}) {
    choices.push_back({"SE", KernelType::kSquaredExponential, l, 1});
    choices.push_back({"Matern 3/2", KernelType::kMatern32, l, 1});
    choices.push_back({"RQ", KernelType::kRationalQuadratic, l, 1});
  }
  for (const int reach : {0, 2, 3})
    choices.push_back({"SE", KernelType::kSquaredExponential, 1.0, reach});
  nlohmann::json rows = nlohmann::json::array();
  for (const Choice& choice : choices) {
    const Kernel kernel(choice.type, choice.length_voxels * kH);
    std::vector<double> to_foot, reverting;
    for (const View& view : views) {
      std::mt19937 rng(7);
      for (const Vector3d& p : BandPoints(view, count, rng)) {
        Vector3d origin;
        const auto field =
            FieldAround(view, view.nearest->Find(p).site, choice.reach, kernel, &origin);
        if (!field) continue;
        const GpSample s = field->Evaluate((p - origin).cast<float>());
        const double d = view.scene.Distance(p);
        to_foot.push_back(((p - origin).cast<float>() - s.foot).norm() / kH - d / kH);
        if (std::isfinite(s.distance_m)) reverting.push_back((s.distance_m - d) / kH);
      }
    }
    rows.push_back({{"kernel", choice.kernel},
                    {"length_voxels", choice.length_voxels},
                    {"neighbourhood", 2 * choice.reach + 1},
                    {"foot", Summary(to_foot)},
                    {"reverting", Summary(reverting)}});
  }
  return rows;
}

// Time of training alone, on the neighbourhoods of a few voxels.
nlohmann::json TrainingTimes(const View& view) {
  nlohmann::json rows = nlohmann::json::array();
  const Kernel kernel(KernelType::kSquaredExponential, kH);
  for (const int n : {9, 27, 64}) {
    std::vector<double> us;
    for (size_t c = 0; c < 200; ++c) {
      const size_t first = c * (view.centroids.size() / 200);
      std::vector<Vector3d> near(view.centroids.begin(), view.centroids.end());
      const Vector3d origin = view.centroids[first];
      std::nth_element(near.begin(), near.begin() + n, near.end(),
                       [&](const Vector3d& a, const Vector3d& b) {
                         return (a - origin).squaredNorm() < (b - origin).squaredNorm();
                       });
      Eigen::Matrix3Xf points(3, n);
      for (int i = 0; i < n; ++i) points.col(i) = (near[i] - origin).cast<float>();
      const auto start = std::chrono::steady_clock::now();
      const auto field =
          LocalGpField::Train(points, Eigen::ArrayXf::Constant(n, kNoiseVariance), kernel);
      us.push_back(
          std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
              .count());
      if (!field) us.pop_back();
    }
    std::nth_element(us.begin(), us.begin() + us.size() / 2, us.end());
    rows.push_back({{"points", n}, {"median_us", us[us.size() / 2]}});
  }
  return rows;
}

nlohmann::json FrustumStudy(const std::vector<View>& views, size_t count) {
  constexpr double kBins_m[] = {0.0, 0.2, 0.5, 1.0, 2.0, 5.0};
  nlohmann::json rows = nlohmann::json::array();
  for (const double length_voxels : {1.0, 3.0}) {
    const Kernel kernel(KernelType::kSquaredExponential, length_voxels * kH);
    std::vector<double> direct[5], leaf[5], closest[5];
    size_t asked[5] = {}, infinite[5] = {}, underflown[5] = {};
    for (const View& view : views) {
      std::mt19937 rng(11);
      std::uniform_real_distribution<double> u(0, 1);
      for (size_t k = 0; k < count; ++k) {
        const Vector3d p =
            view.eye + u(rng) * (view.returns[rng() % view.returns.size()] - view.eye);
        const double d = view.scene.Distance(p);
        if (d <= 0 || d >= kBins_m[5] || !view.Observed(p)) continue;
        const int bin = static_cast<int>(std::upper_bound(kBins_m, kBins_m + 6, d) - kBins_m) - 1;
        const auto near = view.nearest->Find(p);
        Vector3d origin, leaf_origin;
        const auto field = FieldAround(view, near.site, 3, kernel, &origin);
        ++asked[bin];
        closest[bin].push_back((near.distance_m - d) / kH);
        const auto of_leaf = FieldOfLeaf(view, p, kernel, &leaf_origin);
        if (!field || !of_leaf) continue;
        const GpSample s = field->Evaluate((p - origin).cast<float>());
        underflown[bin] += s.latent < std::numeric_limits<float>::min();
        if (std::isfinite(s.distance_m)) {
          direct[bin].push_back((s.distance_m - d) / kH);
        } else {
          ++infinite[bin];
        }
        const GpSample l = of_leaf->Evaluate((p - leaf_origin).cast<float>());
        if (std::isfinite(l.distance_m)) leaf[bin].push_back((l.distance_m - d) / kH);
      }
    }
    for (int b = 0; b < 5; ++b) {
      if (asked[b] == 0) continue;
      rows.push_back({{"length_voxels", length_voxels},
                      {"from_m", kBins_m[b]},
                      {"to_m", kBins_m[b + 1]},
                      {"no_answer", static_cast<double>(infinite[b]) / asked[b]},
                      {"no_answer_in_floats", static_cast<double>(underflown[b]) / asked[b]},
                      {"direct", Summary(direct[b])},
                      {"leaf", Summary(leaf[b])},
                      {"closest_site", Summary(closest[b])}});
    }
  }
  return rows;
}

int Main(int argc, char** argv) {
  CLI::App app{"Local Gaussian-process distance fields on analytic scenes"};
  uint32_t seeds = 2;
  app.add_option("--seeds", seeds, "views of each scene")->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  std::vector<View> views;
  for (const testing::ViewedScene& scene : testing::StandardScenes()) {
    for (uint32_t seed = 0; seed < seeds; ++seed) {
      views.push_back(MakeView(scene.Moved(testing::RandomPose(100 + seed, 20.0)), 3 * seed));
    }
  }
  const nlohmann::json out = {{"band", BandStudy(views, 150)},
                              {"training", TrainingTimes(views.front())},
                              {"frustum", FrustumStudy(views, 400)}};
  std::printf("%s\n", out.dump().c_str());
  return 0;
}

}  // namespace
}  // namespace clearance::evaluation

int main(int argc, char** argv) { return clearance::evaluation::Main(argc, argv); }
