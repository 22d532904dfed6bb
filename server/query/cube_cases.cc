#include "server/query/cube_cases.h"

#include <cstddef>
#include <limits>
#include <vector>

namespace clearance {
namespace {

// Corners of the six faces, counter-clockwise seen from outside the cell.
constexpr uint8_t kFaces[6][4] = {
    {0, 1, 3, 2}, {4, 6, 7, 5},  // x = 0, x = 1
    {0, 4, 5, 1}, {2, 3, 7, 6},  // y = 0, y = 1
    {0, 2, 6, 4}, {1, 5, 7, 3},  // z = 0, z = 1
};

constexpr std::array<CubeEdge, 12> MakeEdges() {
  std::array<CubeEdge, 12> edges{};
  int count = 0;
  for (uint8_t axis = 0; axis < 3; ++axis) {
    const uint8_t bit = static_cast<uint8_t>(4 >> axis);
    for (uint8_t corner = 0; corner < 8; ++corner) {
      if (corner & bit) continue;
      edges[count++] = {corner, static_cast<uint8_t>(corner | bit), axis};
    }
  }
  return edges;
}

uint8_t EdgeBetween(uint8_t a, uint8_t b) {
  for (uint8_t e = 0; e < 12; ++e) {
    const CubeEdge& edge = kCubeEdges[e];
    if ((edge.first == a && edge.second == b) || (edge.first == b && edge.second == a)) return e;
  }
  return 0;  // not reached: neighbours on a face share an edge
}

bool OnFace(uint8_t edge, const uint8_t face[4]) {
  int shared = 0;
  for (int i = 0; i < 4; ++i) {
    shared += face[i] == kCubeEdges[edge].first || face[i] == kCubeEdges[edge].second;
  }
  return shared == 2;
}

// A diagonal within a face could coincide with one of the neighbouring cell's.
bool ShareFace(uint8_t a, uint8_t b) {
  for (const auto& face : kFaces) {
    if (OnFace(a, face) && OnFace(b, face)) return true;
  }
  return false;
}

// The surface cuts each face in segments: walking around it, one for every run of negative corners,
// from the edge where the walk enters the run to the one where it leaves. A cut edge is entered on
// one of its two faces and left on the other, so that the segments chain into loops.
std::array<int, 12> NextEdge(uint8_t negative) {
  std::array<int, 12> next;
  next.fill(-1);
  const auto is_negative = [negative](uint8_t corner) { return (negative >> corner) & 1; };
  for (const auto& face : kFaces) {
    for (int i = 0; i < 4; ++i) {
      if (is_negative(face[i]) || !is_negative(face[(i + 1) % 4])) continue;
      int last = i + 1;
      while (is_negative(face[(last + 1) % 4])) ++last;
      next[EdgeBetween(face[i], face[(i + 1) % 4])] =
          EdgeBetween(face[last % 4], face[(last + 1) % 4]);
    }
  }
  return next;
}

// A fan from the vertex whose diagonals lie within the fewest faces.
void Triangulate(const std::vector<uint8_t>& loop, CubeCase& result) {
  const std::size_t n = loop.size();
  std::size_t best = 0;
  int fewest = std::numeric_limits<int>::max();
  for (std::size_t start = 0; start < n; ++start) {
    int within = 0;
    for (std::size_t i = 2; i + 1 < n; ++i) within += ShareFace(loop[start], loop[(start + i) % n]);
    if (within < fewest) fewest = within, best = start;
  }
  for (std::size_t i = 1; i + 1 < n; ++i) {
    result.triangles[result.count++] = {loop[best], loop[(best + i) % n], loop[(best + i + 1) % n]};
  }
}

CubeCase MakeCase(uint8_t negative) {
  CubeCase result;
  std::array<int, 12> next = NextEdge(negative);
  for (int start = 0; start < 12; ++start) {
    std::vector<uint8_t> loop;
    for (int edge = start; next[edge] >= 0;) {
      loop.push_back(static_cast<uint8_t>(edge));
      const int following = next[edge];
      next[edge] = -1;
      edge = following;
    }
    if (!loop.empty()) Triangulate(loop, result);
  }
  return result;
}

}  // namespace

constinit const std::array<CubeEdge, 12> kCubeEdges = MakeEdges();

const CubeCase& CaseOf(uint8_t negative) {
  static const std::array<CubeCase, 256>* const cases = [] {
    auto* all = new std::array<CubeCase, 256>;
    for (int i = 0; i < 256; ++i) (*all)[i] = MakeCase(static_cast<uint8_t>(i));
    return all;
  }();
  return (*cases)[negative];
}

}  // namespace clearance
