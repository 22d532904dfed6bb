// A Gaussian-process distance field trained on a few surface points: VDB-GPDF, Sec. III.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "server/field/kernel.h"

namespace clearance {

// The field at one point.
struct GpSample {
  // Latent mean o = k(x)^T alpha: 1 on the surface, falling to 0 away from it.
  float latent = 0;
  // Reverting distance k^-1(o), unsigned, m. Biased near the surface, where noise keeps o below 1
  // (about +0.2 spacings on it); infinite where o <= 0.
  float distance_m = 0;
  // The nearest surface point as the field sees it, in the frame of the training points. With
  // w_i = -alpha_i k'(r_i) / r_i it is sum(w_i x_i) / sum(w_i), so that x - foot is the gradient of
  // the latent, scaled. For SE, where d^2 = -2 l^2 ln(o), it is exactly distance times gradient of
  // the reverting field, d * grad d = -l^2 grad(o) / o, but free of the bias of its value: on
  // points of a plane (x - foot) . n is the true signed distance, whatever the noise term.
  Eigen::Vector3f foot = Eigen::Vector3f::Zero();
  // Unit gradient of the unsigned distance, away from the surface; zero on the surface itself.
  Eigen::Vector3f gradient = Eigen::Vector3f::Zero();
  // Latent variance v = 1 - |L^-1 k(x)|^2 in [0, 1]: 0.64 one spacing from a plane, 0.98 at two.
  float variance = 1;
};

// Points are metres from a local origin near them (a few metres: floats keep micrometres). The
// field is meant to about 3 length scales; beyond, the latent underflows.
// Computes in double: it is the oracle of GpBatch, which evaluates eight neighbourhoods at once.
class LocalGpField {
 public:
  static constexpr int kMaxPoints = 64;

  // points: 3 x n, 1 <= n <= kMaxPoints; noise_variance: n entries added to the kernel matrix'
  // diagonal. Absent where the counts are out of range or the matrix is not positive definite.
  static std::optional<LocalGpField> Train(const Eigen::Ref<const Eigen::Matrix3Xf>& points,
                                           const Eigen::Ref<const Eigen::ArrayXf>& noise_variance,
                                           const Kernel& kernel);

  GpSample Evaluate(const Eigen::Vector3f& x) const;

  // At many points (3 x m) by matrix products: K = k(points, x), o = K^T alpha, v = 1 - |L^-1 K|^2.
  struct Samples {
    Eigen::ArrayXf latent, distance_m, variance;  // m
    Eigen::Matrix3Xf foot, gradient;              // 3 x m
  };
  Samples EvaluateMany(const Eigen::Ref<const Eigen::Matrix3Xf>& x) const;

  const Eigen::VectorXd& alpha() const { return alpha_; }

  // Moves the training points' positions in the foot's mean (and nowhere else) by `shift` (3 x n):
  // see RemoveCurvatureBias in server/field/gp_batch.h.
  void ShiftPoints(const Eigen::Ref<const Eigen::Matrix3Xf>& shift);

 private:
  LocalGpField(const Kernel& kernel) : kernel_(kernel) {}

  Kernel kernel_;
  Eigen::Matrix3Xd points_, shifted_;
  Eigen::MatrixXd L_;
  Eigen::VectorXd alpha_;
};

}  // namespace clearance
