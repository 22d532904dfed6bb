#include "planner_demo/sim/solid.h"

#include <algorithm>
#include <cmath>

#include "planner_demo/sim/triangle.h"

namespace clearance::sim {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr Interval kEverywhere{-kInfinity, kInfinity};

Interval Both(const Interval& a, const Interval& b) {
  return {std::max(a.enter, b.enter), std::min(a.exit, b.exit)};
}

// Stretch of o + t * d in [-half, half].
Interval Slab(double o, double d, double half) {
  if (d == 0.0) return std::abs(o) <= half ? kEverywhere : Interval{};
  const double a = (-half - o) / d;
  const double b = (half - o) / d;
  return {std::min(a, b), std::max(a, b)};
}

// Stretch where a t^2 + 2 b t + c <= 0, with a >= 0.
Interval Quadratic(double a, double b, double c) {
  if (a == 0.0) return c <= 0.0 ? kEverywhere : Interval{};
  const double discriminant = b * b - a * c;
  if (discriminant < 0.0) return {};
  const double root = std::sqrt(discriminant);
  return {(-b - root) / a, (-b + root) / a};
}

Interval InfiniteCylinder(double radius, const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
  return Quadratic(d.x() * d.x() + d.y() * d.y(), o.x() * d.x() + o.y() * d.y(),
                   o.x() * o.x() + o.y() * o.y() - radius * radius);
}

Interval Ball(double z, double radius, Eigen::Vector3d o, const Eigen::Vector3d& d) {
  o.z() -= z;
  return Quadratic(d.squaredNorm(), o.dot(d), o.squaredNorm() - radius * radius);
}

struct Intersector {
  const Eigen::Vector3d& o;
  const Eigen::Vector3d& d;

  Interval operator()(const Box& box) const {
    return Both(
        Both(Slab(o.x(), d.x(), box.half_size_m.x()), Slab(o.y(), d.y(), box.half_size_m.y())),
        Slab(o.z(), d.z(), box.half_size_m.z()));
  }
  Interval operator()(const Cylinder& c) const {
    return Both(InfiniteCylinder(c.radius_m, o, d), Slab(o.z(), d.z(), c.half_height_m));
  }
  Interval operator()(const Capsule& c) const {
    // Convex, so the union of the three parts' stretches is one stretch.
    Interval whole;
    for (const Interval& part :
         {Both(InfiniteCylinder(c.radius_m, o, d), Slab(o.z(), d.z(), c.half_height_m)),
          Ball(c.half_height_m, c.radius_m, o, d), Ball(-c.half_height_m, c.radius_m, o, d)}) {
      if (part.enter > part.exit) continue;
      whole = {std::min(whole.enter, part.enter), std::max(whole.exit, part.exit)};
    }
    return whole;
  }
  Interval operator()(const Polyhedron& p) const {
    Interval inside = kEverywhere;
    for (const Eigen::Vector4d& plane : p.planes) {
      const double speed = plane.head<3>().dot(d);
      const double gap = plane.w() - plane.head<3>().dot(o);
      if (speed == 0.0) {
        if (gap < 0.0) return {};
      } else if (speed > 0.0) {
        inside.exit = std::min(inside.exit, gap / speed);
      } else {
        inside.enter = std::max(inside.enter, gap / speed);
      }
    }
    return inside;
  }
};

struct DistanceTo {
  const Eigen::Vector3d& p;

  double operator()(const Box& box) const {
    const Eigen::Vector3d q = p.cwiseAbs() - box.half_size_m;
    return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
  }
  double operator()(const Cylinder& c) const {
    const Eigen::Vector2d q(std::hypot(p.x(), p.y()) - c.radius_m,
                            std::abs(p.z()) - c.half_height_m);
    return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
  }
  double operator()(const Capsule& c) const {
    const double z = p.z() - std::clamp(p.z(), -c.half_height_m, c.half_height_m);
    return Eigen::Vector3d(p.x(), p.y(), z).norm() - c.radius_m;
  }
  double operator()(const Polyhedron& body) const {
    double deepest = -kInfinity;
    for (const Eigen::Vector4d& plane : body.planes) {
      deepest = std::max(deepest, plane.head<3>().dot(p) - plane.w());
    }
    if (deepest <= 0.0) return deepest;
    double nearest = kInfinity;
    for (const std::vector<int>& face : body.faces) {
      for (size_t i = 2; i < face.size(); ++i) {
        nearest = std::min(nearest,
                           DistanceToTriangle(p, body.vertices[face[0]], body.vertices[face[i - 1]],
                                              body.vertices[face[i]]));
      }
    }
    return nearest;
  }
};

struct BoundsOf {
  const Eigen::Isometry3d& T_B_S;

  Eigen::AlignedBox3d Around(const Eigen::Vector3d& half) const {
    const Eigen::Vector3d reach = T_B_S.linear().cwiseAbs() * half;
    return {T_B_S.translation() - reach, T_B_S.translation() + reach};
  }
  Eigen::AlignedBox3d operator()(const Box& box) const { return Around(box.half_size_m); }
  Eigen::AlignedBox3d operator()(const Cylinder& c) const {
    return Around({c.radius_m, c.radius_m, c.half_height_m});
  }
  Eigen::AlignedBox3d operator()(const Capsule& c) const {
    const Eigen::Vector3d reach =
        T_B_S.linear().col(2).cwiseAbs() * c.half_height_m + Eigen::Vector3d::Constant(c.radius_m);
    return {T_B_S.translation() - reach, T_B_S.translation() + reach};
  }
  Eigen::AlignedBox3d operator()(const Polyhedron& p) const {
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& v : p.vertices) box.extend(T_B_S * v);
    return box;
  }
};

Solid Upright(Shape shape, const Eigen::Vector3d& centre_B) {
  Solid solid{std::move(shape), Eigen::Isometry3d::Identity()};
  solid.T_B_S.translation() = centre_B;
  return solid;
}

}  // namespace

Polyhedron MakePrism(const std::vector<Eigen::Vector2d>& profile_xz_m, double half_width_m,
                     double taper) {
  Polyhedron body;
  const int n = static_cast<int>(profile_xz_m.size());
  double low = kInfinity;
  double high = -kInfinity;
  for (const Eigen::Vector2d& p : profile_xz_m) {
    low = std::min(low, p.y());
    high = std::max(high, p.y());
  }
  for (const double side : {-1.0, 1.0}) {
    for (const Eigen::Vector2d& p : profile_xz_m) {
      // Linear in z, so that the side faces stay planar.
      const double scale = 1.0 + (taper - 1.0) * (p.y() - low) / (high - low);
      body.vertices.emplace_back(p.x(), side * half_width_m * scale, p.y());
    }
  }
  std::vector<int> right(n);
  std::vector<int> left(n);
  for (int i = 0; i < n; ++i) {
    right[i] = i;
    left[i] = 2 * n - 1 - i;
    const int next = (i + 1) % n;
    body.faces.push_back({i, n + i, n + next, next});
  }
  body.faces.push_back(right);
  body.faces.push_back(left);
  for (const std::vector<int>& face : body.faces) {
    const Eigen::Vector3d& a = body.vertices[face[0]];
    const Eigen::Vector3d normal =
        (body.vertices[face[1]] - a).cross(body.vertices[face[2]] - a).normalized();
    body.planes.emplace_back(normal.x(), normal.y(), normal.z(), normal.dot(a));
  }
  return body;
}

Interval Intersect(const Shape& shape, const Eigen::Vector3d& origin_S,
                   const Eigen::Vector3d& direction_S) {
  return std::visit(Intersector{origin_S, direction_S}, shape);
}

double SignedDistance(const Shape& shape, const Eigen::Vector3d& point_S) {
  return std::visit(DistanceTo{point_S}, shape);
}

double SignedDistance(const std::vector<Solid>& solids, const Eigen::Vector3d& point_B) {
  double nearest = kInfinity;
  for (const Solid& solid : solids) {
    nearest = std::min(nearest, SignedDistance(solid.shape, solid.T_B_S.inverse() * point_B));
  }
  return nearest;
}

Eigen::AlignedBox3d Bounds(const Solid& solid) {
  return std::visit(BoundsOf{solid.T_B_S}, solid.shape);
}

Solid MakeBox(const Eigen::Vector3d& min_B, const Eigen::Vector3d& max_B) {
  return Upright(Box{(max_B - min_B) / 2.0}, (min_B + max_B) / 2.0);
}

Solid MakeUprightCylinder(const Eigen::Vector3d& foot_B, double radius_m, double height_m) {
  return Upright(Cylinder{radius_m, height_m / 2.0},
                 foot_B + Eigen::Vector3d(0.0, 0.0, height_m / 2.0));
}

Solid MakeUprightCapsule(const Eigen::Vector3d& foot_B, double radius_m, double height_m) {
  return Upright(Capsule{radius_m, height_m / 2.0 - radius_m},
                 foot_B + Eigen::Vector3d(0.0, 0.0, height_m / 2.0));
}

Solid MakeSphere(const Eigen::Vector3d& centre_B, double radius_m) {
  return Upright(Capsule{radius_m, 0.0}, centre_B);
}

}  // namespace clearance::sim
