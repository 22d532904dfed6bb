#include "server/map/distance_field.h"

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

// 122 of the 128 directions: six generators under the 48 symmetries of the cube, so that axes, face
// diagonals and space diagonals (floors, walls, edges, corners) are exact. The three free
// generators minimise the largest angle from any direction to its code, 11.63 degrees (128 points
// on a spiral reach 13.6). Components sorted, largest first.
constexpr int kGenerators = 6;
constexpr double kGenerator[kGenerators][3] = {
    {1, 0, 0}, {1, 1, 0}, {1, 1, 1}, {1, 0.2451, 0.2451}, {1, 0.4386, 0}, {1.4440, 1, 0.5511},
};
// Which axis takes the largest, the middle and the smallest component.
constexpr int kPermutation[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                    {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};

struct NormalCodes {
  Eigen::Vector3f generator[kGenerators];
  Eigen::Vector3f direction[128];
  uint8_t code[kGenerators][6][8];  // generator, permutation, sign bits of x, y, z

  NormalCodes() {
    int count = 0;
    for (int g = 0; g < kGenerators; ++g) {
      const Eigen::Vector3d unit = Eigen::Vector3d(kGenerator[g]).normalized();
      generator[g] = unit.cast<float>();
      for (int p = 0; p < 6; ++p) {
        for (int signs = 0; signs < 8; ++signs) {
          Eigen::Vector3f n;
          for (int i = 0; i < 3; ++i) {
            const int axis = kPermutation[p][i];
            const float c = generator[g][i];
            n[axis] = c != 0 && (signs >> axis & 1) ? -c : c;
          }
          int same = 0;
          while (same < count && direction[same] != n) ++same;
          if (same == count) direction[count++] = n;
          code[g][p][signs] = static_cast<uint8_t>(same);
        }
      }
    }
    for (; count < 128; ++count) direction[count] = Eigen::Vector3f::UnitZ();
  }
};

const NormalCodes& Codes() {
  static const NormalCodes codes;
  return codes;
}

// Seven octaves in 31 steps: 1/64 voxel to 2 voxels.
constexpr float kSigmaStepsPerOctave = 31.f / 7.f;
constexpr float kLog2SmallestSigma = -6.f;

struct SigmaCodes {
  float voxels[32];
  SigmaCodes() {
    for (int c = 0; c < 32; ++c) {
      voxels[c] = std::exp2(kLog2SmallestSigma + static_cast<float>(c) / kSigmaStepsPerOctave);
    }
  }
};

BlockIndex RegionOf(const BlockIndex& b) { return {b.x >> 3, b.y >> 3, b.z >> 3}; }

}  // namespace

Eigen::Vector3f NormalOfCode(int code) { return Codes().direction[code & 127]; }

int CodeOfNormal(const Eigen::Vector3f& n) {
  const NormalCodes& codes = Codes();
  // Fold into the wedge x >= y >= z >= 0; there the nearest code is the nearest generator.
  const float a[3] = {std::abs(n.x()), std::abs(n.y()), std::abs(n.z())};
  int permutation = 0;
  if (a[0] >= a[1]) {
    permutation = a[1] >= a[2] ? 0 : (a[0] >= a[2] ? 1 : 4);
  } else {
    permutation = a[0] >= a[2] ? 2 : (a[1] >= a[2] ? 3 : 5);
  }
  const int* axes = kPermutation[permutation];
  const Eigen::Vector3f folded(a[axes[0]], a[axes[1]], a[axes[2]]);
  int best = 0;
  float best_cosine = -1;
  for (int g = 0; g < kGenerators; ++g) {
    const float cosine = folded.dot(codes.generator[g]);
    if (cosine > best_cosine) {
      best_cosine = cosine;
      best = g;
    }
  }
  const int signs = (n.x() < 0 ? 1 : 0) | (n.y() < 0 ? 2 : 0) | (n.z() < 0 ? 4 : 0);
  return codes.code[best][permutation][signs];
}

float SigmaVoxelsOfCode(int code) {
  static const SigmaCodes codes;
  return codes.voxels[code & 31];
}

int CodeOfSigmaVoxels(float sigma_voxels) {
  if (!(sigma_voxels > 0)) return 0;
  const float code = (std::log2(sigma_voxels) - kLog2SmallestSigma) * kSigmaStepsPerOctave;
  return static_cast<int>(std::clamp(std::round(code), 0.f, 31.f));
}

FieldVoxel DistanceField::At(const VoxelIndex& v) const {
  const BlockIndex block = BlockOf(v);
  const Region* region = FindRegion(RegionOf(block));
  if (!region) return {};
  const int slot = RegionOffset(block);
  if (const FieldBlock* data = region->blocks[slot].get()) return data->voxels[OffsetOf(v)];
  FieldVoxel voxel;
  if (region->tiles[slot] != kNoTile) voxel.attributes = region->tiles[slot] & 7;
  return voxel;
}

void DistanceField::Set(const BlockIndex& block, std::shared_ptr<const FieldBlock> data,
                        uint8_t tile) {
  const bool removes = data == nullptr && tile == kNoTile;
  auto it = regions_.find(RegionOf(block));
  if (it == regions_.end()) {
    if (removes) return;
    it = regions_.emplace(RegionOf(block), std::make_shared<Region>()).first;
  } else if (it->second.use_count() > 1) {  // copies of this field read it: leave theirs alone
    it->second = std::make_shared<Region>(*it->second);
  } else {
    // The last reader may just have let go in another thread. Its release is ordered before our
    // writes by an acquiring operation on the same count, which use_count() is not.
    std::shared_ptr<const Region>(it->second).reset();
  }
  // Made as non-const above and owned by this field alone.
  Region& region = const_cast<Region&>(*it->second);
  const int slot = RegionOffset(block);
  region.blocks[slot] = std::move(data);
  region.tiles[slot] = region.blocks[slot] ? kNoTile : tile;
  if (!removes) return;
  const auto holds_nothing = [&region](int s) {
    return region.blocks[s] == nullptr && region.tiles[s] == kNoTile;
  };
  for (int s = 0; s < kBlockVoxels; ++s) {
    if (!holds_nothing(s)) return;
  }
  regions_.erase(it);
}

void DistanceField::ForEach(
    const std::function<void(const BlockIndex&, const std::shared_ptr<const FieldBlock>&,
                             uint8_t tile)>& fn) const {
  struct Entry {
    BlockIndex block;
    const std::shared_ptr<const FieldBlock>* data;
    uint8_t tile;
  };
  std::vector<Entry> entries;
  for (const auto& [index, region] : regions_) {
    for (int slot = 0; slot < kBlockVoxels; ++slot) {
      if (!region->blocks[slot] && region->tiles[slot] == kNoTile) continue;
      const BlockIndex block{index.x * 8 + (slot >> 6), index.y * 8 + ((slot >> 3) & 7),
                             index.z * 8 + (slot & 7)};
      entries.push_back({block, &region->blocks[slot], region->tiles[slot]});
    }
  }
  std::sort(entries.begin(), entries.end(),
            [](const Entry& a, const Entry& b) { return a.block < b.block; });
  for (const Entry& e : entries) fn(e.block, *e.data, e.tile);
}

size_t DistanceField::BlockCount() const {
  size_t count = 0;
  for (const auto& [index, region] : regions_) {
    for (const auto& block : region->blocks) count += block != nullptr;
  }
  return count;
}

uint64_t DistanceField::MemoryBytes() const {
  return BlockCount() * (sizeof(FieldBlock) + 16) +
         regions_.size() * (sizeof(Region) + sizeof(BlockIndex) + sizeof(void*) * 2);
}

}  // namespace clearance
