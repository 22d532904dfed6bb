// Triangle meshes and their file formats.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "server/core/pose.h"

namespace clearance {

// Vertices in some frame M, metres: origin_M + vertices (floats near the surface keep fractions of
// a millimetre anywhere). Triangles wind counter-clockwise seen from free space.
struct Mesh {
  Eigen::Vector3d origin_M = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector3f> normals;  // one a vertex, unit, towards free space
  std::vector<std::array<uint32_t, 3>> triangles;
};

// The mesh in frame A, given T_A_M.
Mesh Transformed(const Mesh& mesh, const Pose& T_A_M);

// Binary little-endian PLY with normals. Coordinates are floats, or doubles where the mesh lies
// more than a kilometre from its frame's origin.
std::string WritePly(const Mesh& mesh);

// glTF 2.0 binary. glTF's y axis is up: the scene's root node turns the z-up vertices and carries
// origin_M. An empty mesh is an empty scene.
std::string WriteGlb(const Mesh& mesh);

}  // namespace clearance
