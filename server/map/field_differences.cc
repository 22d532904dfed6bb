#include "server/map/field_differences.h"

#include <algorithm>

namespace clearance {
namespace {

// The regions of two fields at one place; the last is kept, since neighbours follow one another.
class Regions {
 public:
  Regions(const DistanceField& a, const DistanceField& b) : a_(a), b_(b) {}

  void MoveTo(const BlockIndex& block) {
    const BlockIndex region{block.x >> 3, block.y >> 3, block.z >> 3};
    if (valid_ && region == at_) return;
    valid_ = true;
    at_ = region;
    a = a_.FindRegion(region);
    b = b_.FindRegion(region);
  }

  const DistanceField::Region* a = nullptr;
  const DistanceField::Region* b = nullptr;

 private:
  const DistanceField &a_, &b_;
  BlockIndex at_;
  bool valid_ = false;
};

}  // namespace

std::vector<FieldDifference> DifferencesBetween(const DistanceField& before,
                                                const DistanceField& after) {
  std::vector<FieldDifference> differences;
  Regions regions(before, after);
  after.ForEach([&](const BlockIndex& index, const auto& data, uint8_t tile) {
    regions.MoveTo(index);
    if (regions.a == regions.b) return;
    FieldDifference d{index, nullptr, data, DistanceField::kNoTile, tile};
    if (regions.a) {
      const int slot = DistanceField::RegionOffset(index);
      d.before = regions.a->blocks[slot];
      d.tile_before = regions.a->tiles[slot];
    }
    if (d.before != d.after || d.tile_before != d.tile_after) differences.push_back(std::move(d));
  });
  const size_t common = differences.size();
  before.ForEach([&](const BlockIndex& index, const auto& data, uint8_t tile) {
    regions.MoveTo(index);
    if (regions.a == regions.b) return;
    const int slot = DistanceField::RegionOffset(index);
    const bool gone = regions.b == nullptr || (regions.b->blocks[slot] == nullptr &&
                                               regions.b->tiles[slot] == DistanceField::kNoTile);
    if (gone) differences.push_back({index, data, nullptr, tile, DistanceField::kNoTile});
  });
  std::inplace_merge(differences.begin(), differences.begin() + static_cast<std::ptrdiff_t>(common),
                     differences.end(), [](const FieldDifference& a, const FieldDifference& b) {
                       return a.index < b.index;
                     });
  return differences;
}

}  // namespace clearance
