#include "server/field/local_gp_field.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace clearance {

std::optional<LocalGpField> LocalGpField::Train(
    const Eigen::Ref<const Eigen::Matrix3Xf>& points,
    const Eigen::Ref<const Eigen::ArrayXf>& noise_variance, const Kernel& kernel) {
  const Eigen::Index n = points.cols();
  if (n < 1 || n > kMaxPoints || noise_variance.size() != n) return std::nullopt;
  LocalGpField field(kernel);
  field.points_ = points.cast<double>();
  field.shifted_ = field.points_;
  Eigen::MatrixXd K(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      K(i, j) = K(j, i) = kernel.Value((field.points_.col(i) - field.points_.col(j)).squaredNorm());
    }
    K(i, i) = 1.0 + noise_variance[i];
  }
  const Eigen::LLT<Eigen::MatrixXd> llt(K);
  if (llt.info() != Eigen::Success) return std::nullopt;
  field.L_ = llt.matrixL();
  field.alpha_ =
      llt.solve(Eigen::VectorXd::Ones(n));  // targets are 1: the points are on the surface
  return field;
}

GpSample LocalGpField::Evaluate(const Eigen::Vector3f& x) const {
  const Samples s = EvaluateMany(Eigen::Matrix3Xf(x));
  return {s.latent[0], s.distance_m[0], s.foot.col(0), s.gradient.col(0), s.variance[0]};
}

LocalGpField::Samples LocalGpField::EvaluateMany(
    const Eigen::Ref<const Eigen::Matrix3Xf>& x) const {
  const Eigen::Index n = points_.cols(), m = x.cols();
  Eigen::MatrixXd K(n, m), W(n, m);
  for (Eigen::Index j = 0; j < m; ++j) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double r2 = (x.col(j).cast<double>() - points_.col(i)).squaredNorm();
      K(i, j) = kernel_.Value(r2);
      W(i, j) = -alpha_[i] * kernel_.DerivativeOverR(r2);
    }
  }
  const Eigen::RowVectorXd latent = alpha_.transpose() * K;
  const Eigen::RowVectorXd weight = W.colwise().sum();
  const Eigen::Matrix3Xd foot = (shifted_ * W).array().rowwise() / weight.array();
  const Eigen::MatrixXd z = L_.triangularView<Eigen::Lower>().solve(K);

  Samples out;
  out.latent = latent.transpose().cast<float>();
  out.variance =
      (1.0 - z.colwise().squaredNorm().array()).max(0.0).min(1.0).transpose().cast<float>();
  out.foot = foot.cast<float>();
  out.distance_m.resize(m);
  out.gradient.resize(3, m);
  for (Eigen::Index j = 0; j < m; ++j) {
    out.distance_m[j] = static_cast<float>(kernel_.Inverse(latent[j]));
    const Eigen::Vector3d away = x.col(j).cast<double>() * weight[j] - points_ * W.col(j);
    out.gradient.col(j) = away.normalized().cast<float>();
    if (out.distance_m[j] == 0) out.gradient.col(j).setZero();
  }
  return out;
}

void LocalGpField::ShiftPoints(const Eigen::Ref<const Eigen::Matrix3Xf>& shift) {
  shifted_ = points_ + shift.cast<double>();
}

}  // namespace clearance
