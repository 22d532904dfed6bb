// Covariance kernels of the Gaussian-process distance field and their inverses.
#pragma once

#include "server/field/gp_options.h"

namespace clearance {

// A stationary kernel k(r) with k(0) = 1, falling monotonically, and the reverting function
// r = k^-1(o) that turns a latent value into a distance (VDB-GPDF, Sec. III; Le Gentil et al.
// 2023). Values and distances in double: the latent of SE underflows float beyond 13 l.
class Kernel {
 public:
  Kernel(KernelType type, double length_m) : type_(type), length_m_(length_m) {}

  KernelType type() const { return type_; }
  double length_m() const { return length_m_; }

  // k at a squared distance, m^2.
  double Value(double squared_m2) const;
  // k'(r) / r at a squared distance, 1 / m^2; finite at 0. The gradient of k(|x - y|) by x is
  // (x - y) times this.
  double DerivativeOverR(double squared_m2) const;
  // The distance, m, at which the kernel takes the value `latent`: 0 for latent >= 1, infinity for
  // latent <= 0 (an underflown or negative latent says "far", nothing more). The exact inverse for
  // every kernel: the plain logarithm, often used for Matern, is biased by -0.2 m at 0.5 m.
  double Inverse(double latent) const;
  // d k^-1 / d o at a latent in (0, 1), m. Grows without bound towards 1.
  double InverseDerivative(double latent) const;

 private:
  KernelType type_;
  double length_m_;
};

}  // namespace clearance
