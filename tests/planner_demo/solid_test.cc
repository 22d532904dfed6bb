#include "planner_demo/sim/solid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/mesh.h"
#include "planner_demo/sim/random.h"
#include "planner_demo/sim/triangle.h"

namespace clearance::sim {
namespace {

Eigen::Vector3d Draw(Random& random, double reach) {
  const double x = random.Uniform(-reach, reach);
  const double y = random.Uniform(-reach, reach);
  return {x, y, random.Uniform(-reach, reach)};
}

std::vector<Shape> Shapes() {
  return {Box{{0.6, 0.3, 0.9}}, Cylinder{0.5, 0.7}, Capsule{0.4, 0.6}, Capsule{0.8, 0.0},
          MakePrism({{-0.8, -0.5}, {0.7, -0.5}, {1.0, 0.1}, {0.2, 0.6}, {-0.6, 0.5}}, 0.5, 0.7)};
}

TEST(Intersect, EntersAndLeavesWhereTheSignedDistanceIsZero) {
  Random random(1);
  int hits = 0;
  for (const Shape& shape : Shapes()) {
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3d origin = Draw(random, 3.0);
      const Eigen::Vector3d direction = Draw(random, 2.0);
      const Interval inside = Intersect(shape, origin, direction);
      if (inside.enter > inside.exit) continue;
      ++hits;
      EXPECT_NEAR(SignedDistance(shape, origin + inside.enter * direction), 0.0, 1e-9);
      EXPECT_NEAR(SignedDistance(shape, origin + inside.exit * direction), 0.0, 1e-9);
      EXPECT_LE(SignedDistance(shape, origin + 0.5 * (inside.enter + inside.exit) * direction),
                1e-9);
    }
  }
  EXPECT_GT(hits, 500);
}

TEST(Intersect, MissesOnlyWhereEveryPointOfTheLineIsOutside) {
  Random random(2);
  for (const Shape& shape : Shapes()) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d origin = Draw(random, 2.0);
      const Eigen::Vector3d direction = Draw(random, 1.0).normalized();
      const Interval inside = Intersect(shape, origin, direction);
      for (double t = -6.0; t < 6.0; t += 0.01) {
        const bool in = SignedDistance(shape, origin + t * direction) < -1e-9;
        if (in) {
          EXPECT_TRUE(inside.enter < t && t < inside.exit);
        }
      }
    }
  }
}

TEST(Intersect, KnowsRaysAlongAxesAndWithinFaces) {
  const Shape box = Box{{1.0, 2.0, 3.0}};
  const Interval through = Intersect(box, {-5.0, 0.0, 0.0}, {2.0, 0.0, 0.0});
  EXPECT_DOUBLE_EQ(through.enter, 2.0);
  EXPECT_DOUBLE_EQ(through.exit, 3.0);
  const Interval beside = Intersect(box, {-5.0, 2.5, 0.0}, {1.0, 0.0, 0.0});
  EXPECT_GT(beside.enter, beside.exit);
  const Interval face = Intersect(box, {-5.0, 2.0, 0.0}, {1.0, 0.0, 0.0});
  EXPECT_DOUBLE_EQ(face.enter, 4.0);
  const Interval along_axis = Intersect(Cylinder{0.5, 2.0}, {0.1, 0.1, 9.0}, {0.0, 0.0, -1.0});
  EXPECT_DOUBLE_EQ(along_axis.enter, 7.0);
  EXPECT_DOUBLE_EQ(along_axis.exit, 11.0);
}

TEST(SignedDistance, EqualsTheNearestPointOfAFineMesh) {
  Random random(3);
  for (const Shape& shape : Shapes()) {
    const TriangleMesh mesh = Triangulate({Solid{shape, Eigen::Isometry3d::Identity()}});
    for (int i = 0; i < 10; ++i) {
      const Eigen::Vector3d point = Draw(random, 2.0);
      double nearest = 1e9;
      for (const auto& f : mesh.faces) {
        nearest = std::min(nearest, DistanceToTriangle(point, mesh.vertices[f[0]],
                                                       mesh.vertices[f[1]], mesh.vertices[f[2]]));
      }
      EXPECT_NEAR(std::abs(SignedDistance(shape, point)), nearest, 3e-4);
    }
  }
}

TEST(Triangulate, MakesClosedOutwardSurfacesWithinItsTolerance) {
  for (const Shape& shape : Shapes()) {
    const TriangleMesh mesh = Triangulate({Solid{shape, Eigen::Isometry3d::Identity()}}, 1e-3);
    std::map<std::pair<int, int>, int> edges;
    double volume = 0.0;
    for (const auto& f : mesh.faces) {
      for (int i = 0; i < 3; ++i) ++edges[{f[i], f[(i + 1) % 3]}];
      const Eigen::Vector3d& a = mesh.vertices[f[0]];
      const Eigen::Vector3d& b = mesh.vertices[f[1]];
      const Eigen::Vector3d& c = mesh.vertices[f[2]];
      volume += a.dot(b.cross(c)) / 6.0;
      EXPECT_NEAR(SignedDistance(shape, (a + b + c) / 3.0), 0.0, 1e-3);
    }
    EXPECT_GT(volume, 0.0);
    for (const auto& [edge, count] : edges) {
      EXPECT_EQ(count, 1);
      EXPECT_EQ(edges.count({edge.second, edge.first}), 1u);
    }
  }
  const TriangleMesh ball =
      Triangulate({Solid{Capsule{0.8, 0.0}, Eigen::Isometry3d::Identity()}}, 1e-4);
  double volume = 0.0;
  for (const auto& f : ball.faces) {
    volume += ball.vertices[f[0]].dot(ball.vertices[f[1]].cross(ball.vertices[f[2]])) / 6.0;
  }
  EXPECT_NEAR(volume, 4.0 / 3.0 * std::numbers::pi * 0.512, 1e-3);
}

TEST(Bounds, ContainsEveryVertexOfAPlacedSolid) {
  Random random(4);
  for (const Shape& shape : Shapes()) {
    for (int i = 0; i < 10; ++i) {
      Solid solid{shape, Eigen::Isometry3d::Identity()};
      solid.T_B_S.linear() =
          Eigen::Quaterniond(Eigen::Vector4d(random.Normal(1.0), random.Normal(1.0),
                                             random.Normal(1.0), random.Normal(1.0)))
              .normalized()
              .toRotationMatrix();
      solid.T_B_S.translation() = Draw(random, 1e4);
      const Eigen::AlignedBox3d box = Bounds(solid);
      for (const Eigen::Vector3d& v : Triangulate({solid}, 1e-2).vertices) {
        EXPECT_LE(box.exteriorDistance(v), 1e-8);
      }
    }
  }
}

TEST(Bodies, AreMadeOfConvexSolidsWithinTheirFootprint) {
  for (uint64_t seed = 0; seed < 30; ++seed) {
    Random random(seed);
    for (const Body& body : {MakeCar(random), MakeVan(random), MakeTruck(random),
                             MakeCyclist(random), MakePedestrian(random)}) {
      for (const Solid& solid : body.solids) {
        if (const auto* p = std::get_if<Polyhedron>(&solid.shape)) {
          for (const Eigen::Vector4d& plane : p->planes) {
            for (const Eigen::Vector3d& v : p->vertices) {
              EXPECT_LE(plane.head<3>().dot(v) - plane.w(), 1e-9) << body.class_name;
            }
          }
        }
        const Eigen::AlignedBox3d box = Bounds(solid);
        EXPECT_GE(box.min().z(), -1e-9) << body.class_name;
        EXPECT_LE(box.max().x(), body.half_length_m + 1e-9) << body.class_name;
        EXPECT_GE(box.min().x(), -body.half_length_m - 1e-9) << body.class_name;
        EXPECT_LE(box.max().y(), body.half_width_m + 1e-9) << body.class_name;
        EXPECT_GE(box.min().y(), -body.half_width_m - 1e-9) << body.class_name;
      }
    }
  }
}

}  // namespace
}  // namespace clearance::sim
