// When the surface of an object, as queries see it, follows what was measured.
#pragma once

#include <memory>
#include <vector>

#include "server/map/object_shape.h"

namespace clearance {

// A site stays where the published shape has it while the newest one in its voxel is within 3/32
// voxel, its normal within 30 degrees and its sigma within a factor of 1.6, as in the static field
// (esdf/site_table.h): seeing an object again changes the sites that moved, not all of them by a
// hair. Returns `published` itself where every site stays and none is new or gone; otherwise a
// shape built from the sites that stay and the new ones. Deterministic.
std::shared_ptr<const ObjectShape> FollowSites(std::shared_ptr<const ObjectShape> published,
                                               std::vector<SurfaceSite> newest,
                                               double voxel_size_m);

}  // namespace clearance
