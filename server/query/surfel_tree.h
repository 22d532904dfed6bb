// The box tree over one object's surfels, eight lanes wide.
#pragma once

#include <cstdint>
#include <vector>

#include "server/query/eight_way.h"

namespace clearance {

struct SurfelTree {
  // Boxes of up to eight children; empty lanes are kFarAway. A child is a node, or with kLeaf set a
  // leaf.
  static constexpr uint32_t kLeaf = 0x80000000u;
  struct alignas(32) Node {
    float lower[3][kWays], upper[3][kWays];
    uint32_t child[kWays];
  };
  // Up to eight surfels; empty lanes are kFarAway.
  struct alignas(32) Leaf {
    float p[3][kWays], normal[3][kWays];
    uint32_t first;  // of the sites; lane i is site first + i
    uint32_t count;
  };
  std::vector<Node> nodes;  // root first
  std::vector<Leaf> leaves;
};

}  // namespace clearance
