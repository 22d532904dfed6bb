#include "server/field/kernel.h"

#include <cmath>
#include <limits>

namespace clearance {
namespace {

// Shape of the rational quadratic; large, so that it is close to SE near zero but does not
// underflow.
constexpr double kBeta = 50.0;

// s >= 0 with (1 + s) exp(-s) = latent, by Newton's method on ln(1 + s) - s - ln(latent), which is
// concave and falling: starting left of the root it converges monotonically after one step.
double Matern32Inverse(double latent) {
  const double target = std::log(latent);
  double s = std::sqrt(-2.0 * target);
  for (int i = 0; i < 60; ++i) {
    const double step = (std::log1p(s) - s - target) * (1.0 + s) / s;
    s += step;
    if (std::abs(step) <= 1e-14 * s) break;
  }
  return s;
}

}  // namespace

double Kernel::Value(double squared_m2) const {
  const double l = length_m_;
  switch (type_) {
    case KernelType::kSquaredExponential:
      return std::exp(-squared_m2 / (2 * l * l));
    case KernelType::kMatern32: {
      const double s = std::sqrt(3 * squared_m2) / l;
      return (1 + s) * std::exp(-s);
    }
    case KernelType::kRationalQuadratic:
      return std::pow(1 + squared_m2 / (2 * kBeta * l * l), -kBeta);
  }
  return 0;
}

double Kernel::DerivativeOverR(double squared_m2) const {
  const double l = length_m_;
  switch (type_) {
    case KernelType::kSquaredExponential:
      return -std::exp(-squared_m2 / (2 * l * l)) / (l * l);
    case KernelType::kMatern32:
      return -3 / (l * l) * std::exp(-std::sqrt(3 * squared_m2) / l);
    case KernelType::kRationalQuadratic:
      return -std::pow(1 + squared_m2 / (2 * kBeta * l * l), -kBeta - 1) / (l * l);
  }
  return 0;
}

double Kernel::Inverse(double latent) const {
  if (!(latent > 0)) return std::numeric_limits<double>::infinity();
  if (latent >= 1) return 0;
  const double l = length_m_;
  switch (type_) {
    case KernelType::kSquaredExponential:
      return l * std::sqrt(-2 * std::log(latent));
    case KernelType::kMatern32:
      return l * Matern32Inverse(latent) / std::sqrt(3.0);
    case KernelType::kRationalQuadratic:
      return l * std::sqrt(2 * kBeta * (std::pow(latent, -1 / kBeta) - 1));
  }
  return 0;
}

double Kernel::InverseDerivative(double latent) const {
  const double r = Inverse(latent);
  return 1 / (DerivativeOverR(r * r) * r);
}

}  // namespace clearance
