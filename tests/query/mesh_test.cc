// Meshes: topology, position, incremental upkeep, file formats.
#include "server/query/mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "server/map/surface_map.h"
#include "server/query/block_mesher.h"
#include "server/query/cube_cases.h"
#include "tests/query/query_fixture.h"

namespace clearance {
namespace {

using testing::SignedDistance;

constexpr double kVoxel = 0.1;
// Floats near the block, voxels of 0.1 m.
constexpr double kRounding = 1e-5;

double BoxDistance(const Eigen::Vector3d& p) {
  const Eigen::Vector3d q = p.cwiseAbs() - Eigen::Vector3d(0.83, 0.52, 0.61);
  return q.cwiseMax(0).norm() + std::min(0.0, q.maxCoeff());
}

// Overwrites the voxels of the blocks that touch `box` with the field (full weight each time).
std::vector<BlockIndex> Write(SurfaceMap& map, const SignedDistance& distance,
                              const Eigen::AlignedBox3d& box, double band_m) {
  SurfaceUpdate update;
  const BlockIndex low = BlockOf(VoxelOf(box.min(), kVoxel));
  const BlockIndex high = BlockOf(VoxelOf(box.max(), kVoxel));
  BandObservations& band = update.band;
  for (int x = low.x; x <= high.x; ++x) {
    for (int y = low.y; y <= high.y; ++y) {
      for (int z = low.z; z <= high.z; ++z) {
        const uint32_t begin = static_cast<uint32_t>(band.offset.size());
        for (int i = 0; i < kBlockVoxels; ++i) {
          const double d = distance(VoxelCentre(VoxelAt({x, y, z}, i), kVoxel));
          if (std::abs(d) > band_m) continue;
          band.offset.push_back(static_cast<uint16_t>(i));
          band.distance_m.push_back(static_cast<float>(d));
          band.weight.push_back(1.f);
        }
        const uint32_t end = static_cast<uint32_t>(band.offset.size());
        if (end > begin) band.blocks.push_back({{x, y, z}, begin, end});
      }
    }
  }
  return map.Apply(update, {});
}

using Edge = std::pair<uint32_t, uint32_t>;

// How often each directed edge is used.
std::map<Edge, int> DirectedEdges(const Mesh& mesh) {
  std::map<Edge, int> edges;
  for (const auto& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  }
  return edges;
}

// Closed and oriented: every edge is used once in each direction.
void ExpectWatertight(const Mesh& mesh) {
  const std::map<Edge, int> edges = DirectedEdges(mesh);
  for (const auto& [edge, count] : edges) {
    ASSERT_EQ(count, 1);
    ASSERT_TRUE(edges.contains({edge.second, edge.first}));
  }
}

double Volume(const Mesh& mesh) {
  double volume = 0;
  for (const auto& t : mesh.triangles) {
    volume += mesh.vertices[t[0]].cast<double>().dot(
                  mesh.vertices[t[1]].cast<double>().cross(mesh.vertices[t[2]].cast<double>())) /
              6;
  }
  return volume;
}

Mesh MeshOf(const SurfaceMap& map, const MesherOptions& options = {}) {
  BlockMesher mesher(options);
  mesher.MarkAll(map);
  return mesher.Extract(map);
}

void ExpectSame(const Mesh& a, const Mesh& b) {
  EXPECT_EQ(a.origin_M, b.origin_M);
  EXPECT_EQ(a.vertices, b.vertices);
  EXPECT_EQ(a.normals, b.normals);
  EXPECT_EQ(a.triangles, b.triangles);
}

TEST(CubeCases, EveryCaseUsesExactlyItsCutEdgesAndLooksToThePositiveSide) {
  for (int negative = 0; negative < 256; ++negative) {
    const CubeCase& cube = CaseOf(static_cast<uint8_t>(negative));
    std::set<int> used, cut;
    for (int e = 0; e < 12; ++e) {
      const bool first = (negative >> kCubeEdges[e].first) & 1;
      const bool second = (negative >> kCubeEdges[e].second) & 1;
      if (first != second) cut.insert(e);
    }
    for (int t = 0; t < cube.count; ++t) {
      for (uint8_t e : cube.triangles[t]) used.insert(e);
    }
    EXPECT_EQ(used, cut) << negative;
    EXPECT_LE(cube.count, 6) << negative;
  }
  // Only corner 0 is negative: away from it is (1, 1, 1).
  const CubeCase& corner = CaseOf(1);
  ASSERT_EQ(corner.count, 1);
  Eigen::Vector3d p[3];
  for (int i = 0; i < 3; ++i) {
    p[i] = 0.5 * Eigen::Vector3d::Unit(kCubeEdges[corner.triangles[0][i]].axis);
  }
  EXPECT_GT((p[1] - p[0]).cross(p[2] - p[0]).dot(Eigen::Vector3d::Ones()), 0);
}

TEST(BlockMesher, MakesClosedSurfacesThatLieOnTheCrossing) {
  struct Case {
    SignedDistance distance;
    double volume_m3, tolerance_m;
  };
  // Along a cell edge of length h the distance to a sphere of radius R is not linear: the crossing
  // errs by up to h^2 / 8 R. A box's edges and corners are cut.
  const Case cases[] = {
      {[](const Eigen::Vector3d& p) { return p.norm() - 1.0; }, 4.0 / 3 * M_PI, 0.0014},
      {BoxDistance, 8 * 0.83 * 0.52 * 0.61, 0.025}};
  for (const Case& c : cases) {
    for (const Eigen::Vector3d& centre :
         {Eigen::Vector3d(0.013, -0.027, 0.031), Eigen::Vector3d(-10'000.03, 10'000.04, -50)}) {
      const SignedDistance distance = [&](const Eigen::Vector3d& p) {
        return c.distance(p - centre);
      };
      SurfaceMap map(kVoxel);
      const Eigen::Vector3d reach = Eigen::Vector3d::Constant(1.4);
      Write(map, distance, {centre - reach, centre + reach}, 0.3);
      const Mesh mesh = MeshOf(map);
      ASSERT_GT(mesh.triangles.size(), 1000u);
      ExpectWatertight(mesh);
      double worst = 0, normals = 0;
      for (size_t i = 0; i < mesh.vertices.size(); ++i) {
        const Eigen::Vector3d p = mesh.origin_M + mesh.vertices[i].cast<double>();
        worst = std::max(worst, std::abs(distance(p)));
        normals += mesh.normals[i].cast<double>().dot(testing::NumericalGradient(distance, p));
      }
      EXPECT_LE(worst, c.tolerance_m + kRounding);
      EXPECT_GT(normals / static_cast<double>(mesh.vertices.size()), 0.94);
      EXPECT_NEAR(Volume(mesh) / c.volume_m3, 1, 0.03);
    }
  }
}

TEST(BlockMesher, IsExactOnPlanesInAnyDirection) {
  for (uint32_t seed = 0; seed < 5; ++seed) {
    const Pose T_W_P = testing::RandomPose(seed, 3);
    const SignedDistance plane = [&](const Eigen::Vector3d& p) {
      return (T_W_P.inverse() * p).z();
    };
    SurfaceMap map(kVoxel);
    const Eigen::Vector3d reach = Eigen::Vector3d::Constant(1.2);
    Write(map, plane, {T_W_P.translation() - reach, T_W_P.translation() + reach}, 0.3);
    const Mesh mesh = MeshOf(map);
    ASSERT_GT(mesh.vertices.size(), 300u);
    for (size_t i = 0; i < mesh.vertices.size(); ++i) {
      EXPECT_NEAR(plane(mesh.origin_M + mesh.vertices[i].cast<double>()), 0, 1e-3 * kVoxel);
      EXPECT_GT(mesh.normals[i].cast<double>().dot(T_W_P.linear().col(2)), 0.999);
    }
  }
}

TEST(BlockMesher, HasNoCracksWhereEveryAmbiguousCaseOccurs) {
  // Noise takes on all 256 cases; closed by a shell of positive values.
  std::mt19937 rng(9);
  std::uniform_real_distribution<double> noise(-0.05, 0.05);
  SurfaceMap map(kVoxel);
  const Eigen::AlignedBox3d box(Eigen::Vector3d(-1.55, -1.55, -1.55),
                                Eigen::Vector3d(1.55, 1.55, 1.55));
  Write(
      map,
      [&](const Eigen::Vector3d& p) {
        const double d = noise(rng);
        return p.cwiseAbs().maxCoeff() > 1.5 ? std::abs(d) + 1e-3 : d;
      },
      box, 1);
  const Mesh mesh = MeshOf(map);
  ASSERT_GT(mesh.triangles.size(), 30000u);
  // Where surfaces touch along a diagonal an edge may be used twice, but always as often each way.
  const std::map<Edge, int> edges = DirectedEdges(mesh);
  for (const auto& [edge, count] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    ASSERT_TRUE(back != edges.end());
    ASSERT_EQ(back->second, count);
  }
}

TEST(BlockMesher, KeepsOneVertexForEachCutEdgeAcrossBlocks) {
  SurfaceMap map(kVoxel);
  Write(
      map, [](const Eigen::Vector3d& p) { return p.norm() - 1.0; },
      {Eigen::Vector3d(-1.4, -1.4, -1.4), Eigen::Vector3d(1.4, 1.4, 1.4)}, 0.3);
  const Mesh mesh = MeshOf(map);
  std::set<std::tuple<float, float, float>> positions;
  for (const Eigen::Vector3f& v : mesh.vertices) positions.insert({v.x(), v.y(), v.z()});
  EXPECT_EQ(positions.size(), mesh.vertices.size());
  std::set<uint32_t> used;
  for (const auto& t : mesh.triangles) used.insert(t.begin(), t.end());
  EXPECT_EQ(used.size(), mesh.vertices.size());
}

TEST(BlockMesher, IncrementalEqualsFromScratch) {
  SurfaceMap map(kVoxel);
  BlockMesher mesher;
  std::mt19937 rng(3);
  for (int step = 0; step < 12; ++step) {
    const Eigen::Vector3d centre =
        testing::RandomIn({Eigen::Vector3d(-1, -1, -1), Eigen::Vector3d(1, 1, 1)}, rng);
    const SignedDistance ball = [&](const Eigen::Vector3d& p) { return (p - centre).norm() - 0.5; };
    const Eigen::Vector3d reach = Eigen::Vector3d::Constant(0.8);
    const std::vector<BlockIndex> changed =
        Write(map, ball, {centre - reach, centre + reach}, 0.25);
    ASSERT_FALSE(changed.empty());
    mesher.MarkChanged(changed);
    if (step % 3 == 2) ExpectSame(mesher.Extract(map), MeshOf(map));
  }
  // Nothing marked, nothing changes.
  ExpectSame(mesher.Extract(map), mesher.Extract(map));
}

TEST(BlockMesher, LeavesOutCellsThatJumpAndWhatIsNotTrusted) {
  // Positive and negative voxels that do not belong to one surface: 4 voxels apart.
  SurfaceMap map(kVoxel);
  Write(
      map, [](const Eigen::Vector3d& p) { return p.x() > 0 ? 0.2 : -0.2; },
      {Eigen::Vector3d(-0.5, -0.5, -0.5), Eigen::Vector3d(0.5, 0.5, 0.5)}, 1);
  EXPECT_TRUE(MeshOf(map).triangles.empty());
  EXPECT_TRUE(MeshOf(map).vertices.empty());
  EXPECT_FALSE(MeshOf(map, {.max_jump_voxels = 5}).triangles.empty());
  EXPECT_TRUE(MeshOf(map, {.min_weight = 2, .max_jump_voxels = 5}).triangles.empty());
  EXPECT_TRUE(MeshOf(SurfaceMap(kVoxel)).triangles.empty());
}

TEST(BlockMesher, DropsFloatingFragmentsWhenAsked) {
  SurfaceMap map(kVoxel);
  const auto two_balls = [](const Eigen::Vector3d& p) {
    return std::min(p.norm() - 1.0, (p - Eigen::Vector3d(2, 0, 0)).norm() - 0.12);
  };
  Write(map, two_balls, {Eigen::Vector3d(-1.4, -1.4, -1.4), Eigen::Vector3d(2.4, 1.4, 1.4)}, 0.3);
  const Mesh all = MeshOf(map), large = MeshOf(map, {.min_component_triangles = 100});
  EXPECT_LT(large.triangles.size(), all.triangles.size());
  ExpectWatertight(large);
  for (const Eigen::Vector3f& v : large.vertices) {
    EXPECT_LT((large.origin_M + v.cast<double>()).norm(), 1.1);
  }
}

Mesh SmallMesh(const Eigen::Vector3d& origin) {
  SurfaceMap map(kVoxel);
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(0.6);
  Write(
      map, [&](const Eigen::Vector3d& p) { return (p - origin).norm() - 0.3; },
      {origin - reach, origin + reach}, 0.2);
  return MeshOf(map);
}

template <typename T>
T Read(const std::string& bytes, size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

TEST(MeshFiles, PlyReadsBackToTheMillimetreAnywhere) {
  for (const Eigen::Vector3d& origin : {Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(1e4, -1e4, 7)}) {
    const Mesh mesh = SmallMesh(origin);
    const std::string ply = WritePly(mesh);
    size_t at = ply.find("end_header\n") + 11;
    ASSERT_EQ(ply.rfind("ply\nformat binary_little_endian 1.0\n", 0), 0u);
    ASSERT_NE(ply.find("element vertex " + std::to_string(mesh.vertices.size())),
              std::string::npos);
    const bool doubles = ply.find("property double x") != std::string::npos;
    EXPECT_EQ(doubles, origin.x() > 1000);
    for (size_t i = 0; i < mesh.vertices.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        const double value = doubles ? Read<double>(ply, at) : Read<float>(ply, at);
        at += doubles ? 8 : 4;
        EXPECT_NEAR(value, mesh.origin_M[axis] + mesh.vertices[i][axis], 1e-6);
      }
      EXPECT_EQ(Read<float>(ply, at), mesh.normals[i].x());
      at += 12;
    }
    for (const auto& triangle : mesh.triangles) {
      ASSERT_EQ(Read<uint8_t>(ply, at), 3);
      for (int i = 0; i < 3; ++i) {
        EXPECT_EQ(Read<int32_t>(ply, at + 1 + 4 * i), static_cast<int32_t>(triangle[i]));
      }
      at += 13;
    }
    EXPECT_EQ(at, ply.size());
  }
}

TEST(MeshFiles, GlbIsWellFormedAndTurnsZUpIntoYUp) {
  const Mesh mesh = SmallMesh({1, 2, 3});
  const std::string glb = WriteGlb(mesh);
  ASSERT_EQ(glb.substr(0, 4), "glTF");
  EXPECT_EQ(Read<uint32_t>(glb, 4), 2u);
  EXPECT_EQ(Read<uint32_t>(glb, 8), glb.size());
  const uint32_t json_bytes = Read<uint32_t>(glb, 12);
  EXPECT_EQ(json_bytes % 4, 0u);
  const nlohmann::json scene = nlohmann::json::parse(glb.substr(20, json_bytes));
  const size_t binary = 20 + json_bytes + 8;
  EXPECT_EQ(Read<uint32_t>(glb, binary - 4), 0x004E4942u);
  EXPECT_EQ(scene["buffers"][0]["byteLength"].get<size_t>(), glb.size() - binary);
  EXPECT_EQ(scene["accessors"][0]["count"].get<size_t>(), mesh.vertices.size());
  EXPECT_EQ(scene["accessors"][2]["count"].get<size_t>(), 3 * mesh.triangles.size());
  const auto q = scene["nodes"][0]["rotation"];
  const auto t = scene["nodes"][1]["translation"];
  const Eigen::Quaterniond turn(q[3].get<double>(), q[0].get<double>(), q[1].get<double>(),
                                q[2].get<double>());
  const Eigen::Vector3d shift(t[0].get<double>(), t[1].get<double>(), t[2].get<double>());
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    Eigen::Vector3f v;
    std::memcpy(v.data(), glb.data() + binary + 12 * i, 12);
    const Eigen::Vector3d shown = turn * (shift + v.cast<double>());
    const Eigen::Vector3d p = mesh.origin_M + mesh.vertices[i].cast<double>();
    EXPECT_NEAR((shown - Eigen::Vector3d(p.x(), p.z(), -p.y())).norm(), 0, 1e-6);
  }
  const size_t indices = binary + scene["bufferViews"][2]["byteOffset"].get<size_t>();
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(Read<uint32_t>(glb, indices + 12 * i + 4 * k), mesh.triangles[i][k]);
    }
  }
}

TEST(MeshFiles, AnEmptyMeshIsAValidFile) {
  EXPECT_NE(WritePly({}).find("element vertex 0"), std::string::npos);
  const std::string glb = WriteGlb({});
  EXPECT_EQ(Read<uint32_t>(glb, 8), glb.size());
  EXPECT_TRUE(nlohmann::json::parse(glb.substr(20, Read<uint32_t>(glb, 12))).contains("asset"));
}

TEST(MeshFiles, TransformingMovesVerticesAndTurnsNormals) {
  const Mesh mesh = SmallMesh({0.5, 0, 0});
  const Pose T_W_L = testing::RandomPose(2, 10'000);
  const Mesh moved = Transformed(mesh, T_W_L);
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3d expected =
        T_W_L * Eigen::Vector3d(mesh.origin_M + mesh.vertices[i].cast<double>());
    EXPECT_NEAR((moved.origin_M + moved.vertices[i].cast<double>() - expected).norm(), 0, 1e-6);
    EXPECT_NEAR(
        (moved.normals[i].cast<double>() - T_W_L.linear() * mesh.normals[i].cast<double>()).norm(),
        0, 1e-5);
  }
  EXPECT_EQ(moved.triangles, mesh.triangles);
}

}  // namespace
}  // namespace clearance
