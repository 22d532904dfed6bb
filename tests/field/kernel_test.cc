#include "server/field/kernel.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace clearance {
namespace {

constexpr KernelType kAll[] = {KernelType::kSquaredExponential, KernelType::kMatern32,
                               KernelType::kRationalQuadratic};

TEST(Kernel, InverseIsExactForEveryKernel) {
  for (KernelType type : kAll) {
    const Kernel k(type, 0.13);
    for (double r : {1e-4, 0.01, 0.05, 0.1, 0.3, 0.7, 1.5}) {
      EXPECT_NEAR(k.Inverse(k.Value(r * r)), r, 1e-9 + 1e-6 * r) << static_cast<int>(type);
    }
    EXPECT_EQ(k.Inverse(1.0), 0.0);
    EXPECT_EQ(k.Inverse(1.01), 0.0);
    EXPECT_EQ(k.Inverse(0.0), std::numeric_limits<double>::infinity());
    EXPECT_EQ(k.Inverse(-0.1), std::numeric_limits<double>::infinity());
  }
}

TEST(Kernel, DerivativesMatchFiniteDifferences) {
  for (KernelType type : kAll) {
    const Kernel k(type, 0.2);
    for (double r : {0.02, 0.1, 0.3, 0.6}) {
      const double e = 1e-6;
      const double slope = (k.Value((r + e) * (r + e)) - k.Value((r - e) * (r - e))) / (2 * e);
      EXPECT_NEAR(k.DerivativeOverR(r * r) * r, slope, 1e-7);
      const double o = k.Value(r * r);
      const double inverse_slope = (k.Inverse(o + 1e-7) - k.Inverse(o - 1e-7)) / 2e-7;
      EXPECT_NEAR(k.InverseDerivative(o) / inverse_slope, 1, 1e-4);
    }
  }
}

TEST(Kernel, PlainLogarithmOfMaternWouldBeBiased) {
  // The formula -ln(o) / lambda, lambda = sqrt(3) / l, that the exact inverse replaces.
  const double l = 0.1, r = 0.5;
  const Kernel k(KernelType::kMatern32, l);
  EXPECT_LT(-std::log(k.Value(r * r)) * l / std::sqrt(3.0), r - 0.1);
  EXPECT_NEAR(k.Inverse(k.Value(r * r)), r, 1e-9);
}

TEST(GpOptions, RefusesValuesThatCannotBeSolved) {
  EXPECT_TRUE(GpOptions{}.Validate().ok());
  GpOptions options;
  options.noise_variance = 0;
  EXPECT_THAT(std::string(options.Validate().message()), ::testing::HasSubstr("noise_variance"));
  options = {};
  options.length_scale_voxels = 9;
  EXPECT_THAT(std::string(options.Validate().message()), ::testing::HasSubstr("9"));
  options = {};
  options.max_latent_variance = std::nan("");
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace clearance
