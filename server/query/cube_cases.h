// The cases of marching cubes, made by rule instead of by table.
#pragma once

#include <array>
#include <cstdint>

namespace clearance {

// Corner k of a cell lies at (k >> 2, (k >> 1) & 1, k & 1). Edge 4 a + i runs along axis a from its
// lower corner kCubeEdges[4 a + i].first, i rising with that corner's number.
struct CubeEdge {
  uint8_t first, second;  // corners
  uint8_t axis;
};
extern const std::array<CubeEdge, 12> kCubeEdges;

inline constexpr int kMaxCubeTriangles = 10;  // 12 cut edges in one loop

// Triangles (three cut edges each) that separate the negative corners from the others; their
// normals point to the positive side. Where a face is ambiguous (two negative corners on a
// diagonal) the negative corners are kept apart; the rule looks at that face alone, so that
// neighbouring cells agree and the surface has no cracks.
struct CubeCase {
  uint8_t count = 0;
  std::array<std::array<uint8_t, 3>, kMaxCubeTriangles> triangles{};
};

// `negative`: bit k set where corner k is negative.
const CubeCase& CaseOf(uint8_t negative);

}  // namespace clearance
