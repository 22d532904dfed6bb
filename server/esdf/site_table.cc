#include "server/esdf/site_table.h"

#include <cstdlib>

namespace clearance {
namespace {

bool Exceeds(const FollowRule& rule, const FieldVoxel& from, const FieldVoxel& to) {
  const int x = to.dx - from.dx, y = to.dy - from.dy, z = to.dz - from.dz;
  if (x * x + y * y + z * z > rule.move_units * rule.move_units) return true;
  if (std::abs(to.sigma_code() - from.sigma_code()) > rule.sigma_codes) return true;
  return to.normal_code() != from.normal_code() &&
         NormalOfCode(to.normal_code()).dot(NormalOfCode(from.normal_code())) < rule.normal_cosine;
}

}  // namespace

void SiteBlock::Update(const BlockSites& newest) {
  Settle();
  BlockMask moved{}, company{};
  int waiting = 0;
  ForEachSet(newest.mask, [&](int o) {
    const FieldVoxel* known = Find(o);
    if (!known || *known == newest.site[o]) return;
    if (Exceeds(kFollowAtOnce, *known, newest.site[o])) {
      Set(moved, o);
    } else if (Exceeds(kFollowInCompany, *known, newest.site[o])) {
      Set(company, o);
      ++waiting;
    }
  });
  bool follow = waiting >= kCompany || moved != BlockMask{};
  for (int w = 0; w < 8; ++w) follow |= (mask_[w] & ~newest.mask[w]) != 0;
  for (int w = 0; w < 8; ++w) {
    if (follow) moved[w] |= company[w];
    gone_[w] = moved[w] | (mask_[w] & ~newest.mask[w]);
    fresh_[w] = moved[w] | (newest.mask[w] & ~mask_[w]);
  }
  if (!changed()) return;
  std::vector<FieldVoxel> sites;
  ForEachSet(newest.mask,
             [&](int o) { sites.push_back(Test(fresh_, o) ? newest.site[o] : *Find(o)); });
  sites_ = std::move(sites);
  mask_ = newest.mask;
  CountSites();
}

void SiteBlock::Save(ByteWriter* out) const {
  out->Put(index_);
  out->Put(mask_);
  out->PutVector(sites_);
  out->PutVector(referrers);
}

absl::StatusOr<SiteBlock> SiteBlock::Load(ByteReader* in) {
  SiteBlock block(in->Get<BlockIndex>());
  block.mask_ = in->Get<BlockMask>();
  block.CountSites();
  block.sites_ = in->GetVector<FieldVoxel>();
  block.referrers = in->GetVector<int32_t>();
  if (!in->ok()) return in->Finish();
  size_t expected = 0;
  ForEachSet(block.mask_, [&expected](int) { ++expected; });
  if (block.sites_.size() != expected) return in->Error("a block's sites do not match its mask");
  return block;
}

void SiteBlock::CountSites() {
  uint16_t count = 0;
  for (int w = 0; w < 8; ++w) {
    first_[w] = count;
    count += static_cast<uint16_t>(__builtin_popcountll(mask_[w]));
  }
}

}  // namespace clearance
