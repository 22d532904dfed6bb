#include "planner_demo/sim/mesh.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace clearance::sim {
namespace {

// Segments of a circle whose chords stay within the tolerance.
int Segments(double radius_m, double tolerance_m) {
  const double half_angle = std::acos(1.0 - std::min(tolerance_m / radius_m, 1.0));
  return std::max(12, static_cast<int>(std::ceil(std::numbers::pi / half_angle)));
}

struct Ring {
  double radius_m;
  double z_m;
};

// A surface of revolution about z through the rings, which run from the lowest to the highest; a
// ring of radius 0 is a pole.
TriangleMesh Revolve(const std::vector<Ring>& rings, int segments) {
  TriangleMesh mesh;
  std::vector<int> first;
  for (const Ring& ring : rings) {
    first.push_back(static_cast<int>(mesh.vertices.size()));
    const int count = ring.radius_m > 0.0 ? segments : 1;
    for (int i = 0; i < count; ++i) {
      const double angle = 2.0 * std::numbers::pi * i / segments;
      mesh.vertices.emplace_back(ring.radius_m * std::cos(angle), ring.radius_m * std::sin(angle),
                                 ring.z_m);
    }
  }
  for (size_t r = 0; r + 1 < rings.size(); ++r) {
    const auto lower = [&](int i) {
      return first[r] + (rings[r].radius_m > 0.0 ? i % segments : 0);
    };
    const auto upper = [&](int i) {
      return first[r + 1] + (rings[r + 1].radius_m > 0.0 ? i % segments : 0);
    };
    for (int i = 0; i < segments; ++i) {
      if (rings[r].radius_m > 0.0) mesh.faces.push_back({lower(i), lower(i + 1), upper(i)});
      if (rings[r + 1].radius_m > 0.0) {
        mesh.faces.push_back({lower(i + 1), upper(i + 1), upper(i)});
      }
    }
  }
  return mesh;
}

TriangleMesh Fan(const Polyhedron& body) {
  TriangleMesh mesh{body.vertices, {}};
  for (const std::vector<int>& face : body.faces) {
    for (size_t i = 2; i < face.size(); ++i) mesh.faces.push_back({face[0], face[i - 1], face[i]});
  }
  return mesh;
}

struct Triangulator {
  double tolerance_m;

  TriangleMesh operator()(const Box& box) const {
    const double x = box.half_size_m.x();
    const double z = box.half_size_m.z();
    return Fan(MakePrism({{-x, -z}, {x, -z}, {x, z}, {-x, z}}, box.half_size_m.y()));
  }
  TriangleMesh operator()(const Cylinder& c) const {
    return Revolve({{0.0, -c.half_height_m},
                    {c.radius_m, -c.half_height_m},
                    {c.radius_m, c.half_height_m},
                    {0.0, c.half_height_m}},
                   Segments(c.radius_m, tolerance_m));
  }
  TriangleMesh operator()(const Capsule& c) const {
    // Half the tolerance for each of the two directions of curvature.
    const int segments = Segments(c.radius_m, tolerance_m / 2.0);
    const int steps = (segments + 3) / 4;
    std::vector<Ring> rings;
    for (const double side : {-1.0, 1.0}) {
      for (int i = 0; i <= steps; ++i) {
        const double angle = std::numbers::pi / 2.0 * (side < 0.0 ? steps - i : i) / steps;
        const bool pole = side < 0.0 ? i == 0 : i == steps;
        // A sphere has one equator, not two.
        if (side > 0.0 && i == 0 && c.half_height_m == 0.0) continue;
        rings.push_back({pole ? 0.0 : c.radius_m * std::cos(angle),
                         side * (c.half_height_m + c.radius_m * std::sin(angle))});
      }
    }
    return Revolve(rings, segments);
  }
  TriangleMesh operator()(const Polyhedron& body) const { return Fan(body); }
};

}  // namespace

TriangleMesh Triangulate(const std::vector<Solid>& solids, double tolerance_m) {
  TriangleMesh all;
  for (const Solid& solid : solids) {
    const TriangleMesh part = std::visit(Triangulator{tolerance_m}, solid.shape);
    const int offset = static_cast<int>(all.vertices.size());
    for (const Eigen::Vector3d& v : part.vertices) all.vertices.push_back(solid.T_B_S * v);
    for (const auto& f : part.faces) {
      all.faces.push_back({f[0] + offset, f[1] + offset, f[2] + offset});
    }
  }
  return all;
}

}  // namespace clearance::sim
