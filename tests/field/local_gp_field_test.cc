#include "server/field/local_gp_field.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

namespace clearance {
namespace {

using Eigen::Vector3f;

constexpr float kSpacing = 0.1f;
constexpr float kNoise = 0.01f;

Eigen::Matrix3Xf Columns(const std::vector<Vector3f>& points) {
  Eigen::Matrix3Xf out(3, points.size());
  for (size_t i = 0; i < points.size(); ++i) out.col(i) = points[i];
  return out;
}

LocalGpField Train(const std::vector<Vector3f>& points,
                   const Kernel& kernel = {KernelType::kSquaredExponential, kSpacing},
                   float noise = kNoise) {
  const auto field =
      LocalGpField::Train(Columns(points), Eigen::ArrayXf::Constant(points.size(), noise), kernel);
  EXPECT_TRUE(field.has_value());
  return *field;
}

// n x n points in z = 0 around the origin; those for which `keep` is false are left out.
template <typename Keep>
std::vector<Vector3f> Patch(int n, const Keep& keep) {
  std::vector<Vector3f> points;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const Vector3f p((i - 0.5f * (n - 1)) * kSpacing, (j - 0.5f * (n - 1)) * kSpacing, 0);
      if (keep(p)) points.push_back(p);
    }
  }
  return points;
}
std::vector<Vector3f> Patch(int n = 8) {
  return Patch(n, [](const Vector3f&) { return true; });
}

std::vector<Vector3f> Moved(const std::vector<Vector3f>& points, const Eigen::Isometry3f& T) {
  std::vector<Vector3f> out;
  for (const Vector3f& p : points) out.push_back(T * p);
  return out;
}

Eigen::Isometry3f SomePose() {
  return Eigen::Translation3f(0.3f, -0.7f, 0.2f) *
         Eigen::Quaternionf(0.4f, -0.2f, 0.7f, 0.5f).normalized();
}

TEST(LocalGpField, RevertingDistanceToAPlaneHasTheKnownErrors) {
  struct Case {
    KernelType type;
    float l, d, error, tolerance;
  };
  // SE is biased on the surface, where noise keeps the latent below 1, and nowhere else; the exact
  // inverse of Matern falls short farther away; RQ is in between.
  const Case cases[] = {
      {KernelType::kSquaredExponential, 0.1f, 0.0f, 0.020f, 0.006f},
      {KernelType::kSquaredExponential, 0.1f, 0.05f, 0.004f, 0.002f},
      {KernelType::kSquaredExponential, 0.1f, 0.1f, 0.002f, 0.001f},
      {KernelType::kSquaredExponential, 0.1f, 0.2f, 0.001f, 0.001f},
      {KernelType::kMatern32, 0.1f, 0.05f, -0.016f, 0.004f},
      {KernelType::kMatern32, 0.1f, 0.2f, -0.048f, 0.008f},
      {KernelType::kMatern32, 0.1f, 0.5f, -0.082f, 0.012f},
      {KernelType::kRationalQuadratic, 0.3f, 0.2f, -0.001f, 0.003f},
      {KernelType::kRationalQuadratic, 0.3f, 0.5f, -0.005f, 0.005f},
  };
  const Eigen::Isometry3f T = SomePose();
  for (const Case& c : cases) {
    const LocalGpField field = Train(Moved(Patch(), T), Kernel(c.type, c.l));
    const GpSample s = field.Evaluate(T * Vector3f(0, 0, c.d));
    EXPECT_NEAR(s.distance_m - c.d, c.error, c.tolerance) << static_cast<int>(c.type) << " " << c.d;
  }
}

TEST(LocalGpField, FootOnAPlaneIsExactWhateverTheNoiseTerm) {
  const Eigen::Isometry3f T = SomePose();
  const Vector3f normal = T.linear().col(2);
  std::mt19937 rng(5);
  std::uniform_real_distribution<float> u(-0.25f, 0.25f);
  for (KernelType type :
       {KernelType::kSquaredExponential, KernelType::kMatern32, KernelType::kRationalQuadratic}) {
    for (float noise : {1e-3f, 1e-2f, 1e-1f}) {
      const LocalGpField field = Train(Moved(Patch(), T), Kernel(type, 0.1), noise);
      for (int i = 0; i < 20; ++i) {
        const Vector3f p(u(rng), u(rng), u(rng));
        const Vector3f x = T * p;
        EXPECT_NEAR(normal.dot(x - field.Evaluate(x).foot), p.z(), 2e-5f);
      }
    }
  }
}

TEST(LocalGpField, VarianceTellsHowFarTheNearestSampleIs) {
  const LocalGpField field = Train(Patch());
  EXPECT_NEAR(field.Evaluate({0, 0, kSpacing}).variance, 0.64f, 0.02f);
  EXPECT_NEAR(field.Evaluate({0, 0, 2 * kSpacing}).variance, 0.98f, 0.01f);
  EXPECT_LT(field.Evaluate({0, 0, 0}).variance, 0.1f);
}

TEST(LocalGpField, VarianceFlagsGaps) {
  float last = 0.05f;
  for (int half : {1, 2, 3}) {
    const LocalGpField field = Train(Patch(9, [half](const Vector3f& p) {
      const float out = p.cwiseAbs().maxCoeff() / kSpacing;
      return out > half - 0.5f && out < half + 1.5f;
    }));
    const float v = field.Evaluate(Vector3f::Zero()).variance;
    EXPECT_GT(v, last) << half;
    last = v;
  }
  EXPECT_GT(last, 0.95f);
}

TEST(LocalGpField, GradientsMatchFiniteDifferencesOfTheDistance) {
  std::mt19937 rng(2);
  std::normal_distribution<float> g;
  std::vector<Vector3f> points = Patch(5);
  for (Vector3f& p : points) p.z() = 0.3f * p.x() * p.x() + 0.1f * p.y() + 0.01f * g(rng);
  for (KernelType type :
       {KernelType::kSquaredExponential, KernelType::kMatern32, KernelType::kRationalQuadratic}) {
    const LocalGpField field = Train(points, Kernel(type, 0.1));
    int compared = 0;
    for (int i = 0; i < 50; ++i) {
      const Vector3f x(0.1f * g(rng), 0.1f * g(rng), 0.15f * g(rng));
      const GpSample s = field.Evaluate(x);
      if (!(s.distance_m > 0.05f && s.distance_m < 0.25f)) continue;
      Vector3f difference;
      for (int k = 0; k < 3; ++k) {
        const Vector3f e = 2e-3f * Vector3f::Unit(k);
        difference[k] = field.Evaluate(x + e).distance_m - field.Evaluate(x - e).distance_m;
      }
      if (difference.norm() < 1e-4f) continue;
      EXPECT_GT(difference.normalized().dot(s.gradient), 0.999f);
      ++compared;
    }
    EXPECT_GT(compared, 10);
  }
}

// Directions spread over a cap around +z.
std::vector<Vector3f> SphereCap(float radius, float spacing) {
  std::vector<Vector3f> points;
  for (float x = -3 * spacing; x <= 3.01f * spacing; x += spacing) {
    for (float y = -3 * spacing; y <= 3.01f * spacing; y += spacing) {
      const float z2 = radius * radius - x * x - y * y;
      if (z2 > 0) points.emplace_back(x, y, std::sqrt(z2));
    }
  }
  return points;
}

TEST(LocalGpField, SphereIsReadFromBothSidesWithinATenthOfTheSpacing) {
  const float radius = 1.f;
  const LocalGpField field = Train(SphereCap(radius, kSpacing));
  for (float d : {-0.1f, -0.05f, 0.05f, 0.1f}) {
    const Vector3f x(0, 0, radius + d);
    const float signed_d = (x - field.Evaluate(x).foot).z();
    // The weighted mean lies towards the centre by about l^2 / R: less than 1.5 cm here.
    EXPECT_NEAR(signed_d, d + kSpacing * kSpacing / radius, 0.006f) << d;
  }
}

TEST(LocalGpField, ConcaveCornerIsUnderestimatedOnItsBisector) {
  std::vector<Vector3f> points;
  for (int i = 0; i < 5; ++i) {
    for (int j = -2; j <= 2; ++j) {
      points.emplace_back((i + 0.5f) * kSpacing, j * kSpacing, 0.f);
      points.emplace_back(0.f, j * kSpacing, (i + 0.5f) * kSpacing);
    }
  }
  const LocalGpField field = Train(points);
  for (float d : {0.1f, 0.15f, 0.2f}) {  // both walls add
    const float error = field.Evaluate({d, 0, d}).distance_m - d;
    EXPECT_LT(error, 0.f) << d;
    EXPECT_GT(error, -0.07f) << d;
  }
}

TEST(LocalGpField, ThinWallKeepsItsFacesApartOnlyWithAShortLengthScale) {
  std::vector<Vector3f> points;
  for (const Vector3f& p : Patch(5)) {
    points.push_back(p + Vector3f(0, 0, 0.1f));
    points.push_back(p - Vector3f(0, 0, 0.1f));
  }
  const Vector3f x(0, 0, 0.2f);  // 0.1 before one face, 0.3 before the other
  const float near = Train(points).Evaluate(x).distance_m;
  const float far =
      Train(points, Kernel(KernelType::kSquaredExponential, 3 * kSpacing)).Evaluate(x).distance_m;
  EXPECT_NEAR(near, 0.1f, 0.015f);
  EXPECT_GT(std::abs(far - 0.1f), std::abs(near - 0.1f));
}

TEST(LocalGpField, ThinPoleSeenFromOneSideIsReadWithinAQuarterOfTheSpacing) {
  // Half of an 8 cm pole is seen: one centroid a voxel, 2.5 cm before the axis.
  std::vector<Vector3f> points;
  for (int i = -3; i <= 3; ++i) points.emplace_back(0.025f, 0.f, i * kSpacing);
  const LocalGpField field = Train(points);
  for (float d : {0.05f, 0.1f, 0.15f}) {
    EXPECT_NEAR(field.Evaluate({0.04f + d, 0, 0.02f}).distance_m, d, 0.25f * kSpacing) << d;
  }
}

TEST(LocalGpField, ManyPointsAtOnceGiveTheSameAsOneByOne) {
  const LocalGpField field = Train(Patch());
  Eigen::Matrix3Xf x(3, 17);
  std::mt19937 rng(1);
  std::normal_distribution<float> g(0, 0.1f);
  for (float& c : x.reshaped()) c = g(rng);
  const LocalGpField::Samples many = field.EvaluateMany(x);
  for (int i = 0; i < x.cols(); ++i) {
    const GpSample one = field.Evaluate(x.col(i));
    EXPECT_NEAR(many.latent[i], one.latent, 1e-6f);
    EXPECT_NEAR(many.variance[i], one.variance, 1e-6f);
    EXPECT_NEAR((many.foot.col(i) - one.foot).norm(), 0, 1e-6f);
  }
}

TEST(LocalGpField, RefusesWhatItCannotSolve) {
  const Kernel kernel(KernelType::kSquaredExponential, 0.1);
  EXPECT_FALSE(LocalGpField::Train(Eigen::Matrix3Xf(3, 0), Eigen::ArrayXf(0), kernel));
  EXPECT_FALSE(
      LocalGpField::Train(Eigen::Matrix3Xf::Random(3, 65), Eigen::ArrayXf::Ones(65), kernel));
  EXPECT_FALSE(
      LocalGpField::Train(Eigen::Matrix3Xf::Random(3, 4), Eigen::ArrayXf::Ones(3), kernel));
}

}  // namespace
}  // namespace clearance
