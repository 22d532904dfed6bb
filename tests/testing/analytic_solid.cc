// Closed-form distance, gradient and ray intersection of one solid.
#include <algorithm>
#include <cmath>

#include "tests/testing/analytic_scene.h"

namespace clearance::testing {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Boxes and capped cylinders share this: q holds the distances beyond each pair of faces.
template <int N>
double DistanceBeyond(const Eigen::Matrix<double, N, 1>& q) {
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
}

std::optional<double> CastBox(const Vector3d& half, const Vector3d& o, const Vector3d& d) {
  double enter = -INFINITY, leave = INFINITY;
  for (int k = 0; k < 3; ++k) {
    if (d[k] == 0) {
      if (std::abs(o[k]) > half[k]) return std::nullopt;
      continue;
    }
    const double a = (-half[k] - o[k]) / d[k], b = (half[k] - o[k]) / d[k];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  if (enter > leave || enter <= 0) return std::nullopt;
  return enter;
}

std::optional<double> SmallerRoot(double a, double b, double c) {  // a t^2 + 2 b t + c = 0
  const double discriminant = b * b - a * c;
  if (a == 0 || discriminant < 0) return std::nullopt;
  return (-b - std::sqrt(discriminant)) / a;
}

std::optional<double> CastCylinder(double radius, double half_height, const Vector3d& o,
                                   const Vector3d& d) {
  const Vector2d o2 = o.head<2>(), d2 = d.head<2>();
  if (auto t = SmallerRoot(d2.squaredNorm(), o2.dot(d2), o2.squaredNorm() - radius * radius);
      t && *t > 0 && std::abs(o.z() + *t * d.z()) <= half_height) {
    return t;
  }
  if (d.z() == 0) return std::nullopt;
  const double t = ((d.z() < 0 ? half_height : -half_height) - o.z()) / d.z();
  if (t > 0 && (o2 + t * d2).norm() <= radius) return t;
  return std::nullopt;
}

}  // namespace

double Solid::Distance(const Vector3d& p_W) const {
  const Vector3d p = T_W_P.inverse() * p_W;
  switch (kind) {
    case Kind::kHalfSpace:
      return p.z();
    case Kind::kBox:
      return DistanceBeyond<3>(p.cwiseAbs() - size / 2);
    case Kind::kSphere:
      return p.norm() - size.x();
    case Kind::kCylinder:
      return DistanceBeyond<2>({p.head<2>().norm() - size.x(), std::abs(p.z()) - size.z() / 2});
  }
  return 0;
}

Vector3d Solid::Gradient(const Vector3d& p_W) const {
  const Vector3d p = T_W_P.inverse() * p_W;
  Vector3d g = Vector3d::UnitZ();
  if (kind == Kind::kBox) {
    const Vector3d q = p.cwiseAbs() - size / 2;
    Vector3d outward = q.cwiseMax(0.0);
    if (outward.isZero()) {
      int axis;
      q.maxCoeff(&axis);
      outward = Vector3d::Unit(axis);
    }
    for (int k = 0; k < 3; ++k) g[k] = std::copysign(outward[k], p[k]);
  } else if (kind == Kind::kSphere) {
    g = p;
  } else if (kind == Kind::kCylinder) {
    const double rho = p.head<2>().norm();
    const Vector2d q(rho - size.x(), std::abs(p.z()) - size.z() / 2);
    Vector2d outward = q.cwiseMax(0.0);
    if (outward.isZero()) outward = q.x() > q.y() ? Vector2d::UnitX() : Vector2d::UnitY();
    const Vector2d radial = rho > 0 ? Vector2d(p.head<2>() / rho) : Vector2d::UnitX();
    g << radial * outward.x(), std::copysign(outward.y(), p.z());
  }
  return T_W_P.linear() * (g.isZero() ? Vector3d::UnitZ() : g.normalized());
}

std::optional<double> Solid::Cast(const Vector3d& origin_W, const Vector3d& direction_W) const {
  const Vector3d o = T_W_P.inverse() * origin_W;
  const Vector3d d = T_W_P.linear().transpose() * direction_W;
  switch (kind) {
    case Kind::kHalfSpace:
      if (d.z() >= 0 || o.z() <= 0) return std::nullopt;
      return -o.z() / d.z();
    case Kind::kBox:
      return CastBox(size / 2, o, d);
    case Kind::kSphere: {
      auto t = SmallerRoot(d.squaredNorm(), o.dot(d), o.squaredNorm() - size.x() * size.x());
      return t && *t > 0 ? t : std::nullopt;
    }
    case Kind::kCylinder:
      return CastCylinder(size.x(), size.z() / 2, o, d);
  }
  return std::nullopt;
}

}  // namespace clearance::testing
