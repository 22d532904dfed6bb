// Which sites the voxels of a block name, and what to do when some of those are gone.
#pragma once

#include <cstdint>

#include "absl/container/inlined_vector.h"
#include "server/esdf/site_table.h"
#include "server/map/distance_field.h"

namespace clearance {

// Most blocks name sites of a handful of others.
using ReferencedBlockList = absl::InlinedVector<BlockIndex, 16>;
using ChangedSites = absl::InlinedVector<const SiteBlock*, 16>;

// Blocks of the sites that `block`'s voxels name, without repetition, in order of first appearance.
ReferencedBlockList ReferencedBlocks(const BlockIndex& index, const FieldBlock& block);

// Voxels that name a site in gone() of one of `changed`: follow it where it moved to, or forget it
// where it vanished or went beyond the limit. Nothing else would find them: a flood from the
// vanished site stops where it meets voxels that name other sites. True if any voxel changed; false
// leaves the block untouched, so `block` may then be a published one.
bool NamesGoneSite(const BlockIndex& index, const FieldBlock& block, const ChangedSites& changed);
void FollowSites(const BlockIndex& index, const ChangedSites& changed, int32_t squared_limit,
                 FieldBlock* block);

}  // namespace clearance
