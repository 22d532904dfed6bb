#include "server/integration/smallest_axis.h"

#include <Eigen/Eigenvalues>

namespace clearance {

Eigen::Vector3f SmallestAxis(const Eigen::Vector3f* points, const float* noise_variance, int count,
                             const Eigen::Vector3f& fallback) {
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  float total = 0;
  for (int i = 0; i < count; ++i) {
    sum += points[i] / noise_variance[i];
    total += 1.f / noise_variance[i];
  }
  const Eigen::Vector3f mean = sum / total;
  Eigen::Matrix3f spread = Eigen::Matrix3f::Zero();
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3f d = points[i] - mean;
    spread += d * d.transpose() / (noise_variance[i] * total);
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
  solver.computeDirect(spread);
  const Eigen::Vector3f& values = solver.eigenvalues();  // rising
  if (!(values[2] > 0) || count < 2) return fallback;
  if (values[1] < 0.02f * values[2] || count < 3) {
    const Eigen::Vector3f line = solver.eigenvectors().col(2);
    const Eigen::Vector3f normal = fallback - line * line.dot(fallback);
    return normal.norm() > 1e-3f ? normal.normalized() : fallback;
  }
  return solver.eigenvectors().col(0).normalized();
}

}  // namespace clearance
