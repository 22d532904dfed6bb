#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <variant>
#include <vector>

namespace clearance::sim {

// The convex shapes that scenes are made of, each in a frame S of its own (metres).
struct Box {  // centred on the origin
  Eigen::Vector3d half_size_m;
};
struct Cylinder {  // axis z, centred on the origin, flat ends
  double radius_m;
  double half_height_m;
};
struct Capsule {  // all points within radius_m of the segment z in +-half_height_m; 0: a sphere
  double radius_m;
  double half_height_m;
};
struct Polyhedron {  // convex; see MakePrism and MakeFrustum
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::vector<int>> faces;  // counter-clockwise seen from outside, planar
  std::vector<Eigen::Vector4d> planes;  // per face: outward unit normal n and d, n * p <= d
};
using Shape = std::variant<Box, Cylinder, Capsule, Polyhedron>;

// A shape placed in the frame B of the body it belongs to (W for static solids, L for movers).
struct Solid {
  Shape shape;
  Eigen::Isometry3d T_B_S = Eigen::Isometry3d::Identity();
};

// The stretch of a line's parameter that lies inside a shape; empty where enter > exit.
struct Interval {
  double enter = std::numeric_limits<double>::infinity();
  double exit = -std::numeric_limits<double>::infinity();
};

// A profile in the x-z plane (counter-clockwise seen from -y, convex), extruded to |y| <=
// half_width_m and scaled towards y = 0 by `taper` (1: none) at the profile's highest points.
Polyhedron MakePrism(const std::vector<Eigen::Vector2d>& profile_xz_m, double half_width_m,
                     double taper = 1.0);

// Where the line origin_S + t * direction_S runs inside the shape. direction_S need not be unit.
Interval Intersect(const Shape& shape, const Eigen::Vector3d& origin_S,
                   const Eigen::Vector3d& direction_S);

// Exact signed distance in metres to the shape's surface, negative inside.
double SignedDistance(const Shape& shape, const Eigen::Vector3d& point_S);

// Smallest signed distance to any of the solids; exact outside of all, infinity for none.
double SignedDistance(const std::vector<Solid>& solids, const Eigen::Vector3d& point_B);

// The box around a solid, in the frame of its body.
Eigen::AlignedBox3d Bounds(const Solid& solid);

Solid MakeBox(const Eigen::Vector3d& min_B, const Eigen::Vector3d& max_B);
// An upright cylinder or capsule that stands on `foot_B`; height_m is from end to end.
Solid MakeUprightCylinder(const Eigen::Vector3d& foot_B, double radius_m, double height_m);
Solid MakeUprightCapsule(const Eigen::Vector3d& foot_B, double radius_m, double height_m);
Solid MakeSphere(const Eigen::Vector3d& centre_B, double radius_m);

}  // namespace clearance::sim
