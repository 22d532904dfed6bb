// The surface sites that the closest-site field is built from, by block.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

#include "absl/status/statusor.h"
#include "server/core/bytes.h"
#include "server/esdf/site_extraction.h"
#include "server/map/distance_field.h"

namespace clearance {

// When the field follows a site. At once, when its position changes by more than 3/8 voxel or its
// normal by more than 60 degrees. Lesser changes (more than 3/32 voxel, 30 degrees, or sigma by
// more than 1.6) wait until something in the block has to be followed anyway, or until many have
// gathered: looking for the voxels that name a block's sites costs the same for one site as for all
// of them. Until then the site stays where the field has it.
struct FollowRule {
  int move_units;
  float normal_cosine;
  int sigma_codes;
};
inline constexpr FollowRule kFollowAtOnce = {96, 0.5f, 32};
inline constexpr FollowRule kFollowInCompany = {24, 0.85f, 3};
inline constexpr int kCompany = 64;

// The sites of one block, as the field knows them.
class SiteBlock {
 public:
  explicit SiteBlock(const BlockIndex& index) : index_(index) {}

  const BlockIndex& index() const { return index_; }
  const BlockMask& mask() const { return mask_; }
  // The site in the voxel at `offset` (from that voxel's centre), nullptr without one.
  const FieldVoxel* Find(int offset) const {
    const uint64_t word = mask_[offset >> 6], bit = uint64_t{1} << (offset & 63);
    if (!(word & bit)) return nullptr;
    return &sites_[first_[offset >> 6] + __builtin_popcountll(word & (bit - 1))];
  }

  // Takes the newest sites, by the rules above. Sets fresh() and gone().
  void Update(const BlockSites& newest);
  // Sites that are new or moved, and sites that moved or vanished, by the last Update().
  const BlockMask& fresh() const { return fresh_; }
  const BlockMask& gone() const { return gone_; }
  bool changed() const { return fresh_ != BlockMask{} || gone_ != BlockMask{}; }
  void Settle() { fresh_ = gone_ = {}; }

  // For snapshots, between two updates: everything.
  void Save(ByteWriter* out) const;
  // DATA_LOSS for bytes that Save did not write.
  static absl::StatusOr<SiteBlock> Load(ByteReader* in);

  // Field blocks whose voxels may name a site of this block; may list more than do.
  std::vector<int32_t> referrers;

 private:
  void CountSites();

  BlockIndex index_;
  BlockMask mask_{}, fresh_{}, gone_{};
  std::array<uint16_t, 8> first_{};  // number of sites before each word of the mask
  std::vector<FieldVoxel> sites_;
};

using SiteTable = std::deque<SiteBlock>;

// Calls fn(offset) for every set bit, rising.
template <typename Fn>
void ForEachSet(const BlockMask& mask, const Fn& fn) {
  for (int word = 0; word < 8; ++word) {
    for (uint64_t bits = mask[word]; bits; bits &= bits - 1) {
      fn(word * 64 + __builtin_ctzll(bits));
    }
  }
}

inline bool Intersects(const BlockMask& a, const BlockMask& b) {
  for (int w = 0; w < 8; ++w) {
    if (a[w] & b[w]) return true;
  }
  return false;
}

}  // namespace clearance
