// Decision 9: movers that park. Their labels and motions end, and their returns turn static.
#pragma once

#include <vector>

#include "server/integration/object_motion.h"
#include "server/integration/range_image.h"
#include "server/map/world_map.h"

namespace clearance {

// Objects without points and motion in this frame coast; those whose surface returns static rays
// right where it was last, and no better where it would have coasted to, stand there instead.
void LetStanding(const RangeImage& image, const Pose& T_W_X, const WorldMap& map,
                 std::vector<ObjectTask>& tasks);

}  // namespace clearance
