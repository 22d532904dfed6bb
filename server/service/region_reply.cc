#include "server/service/region_reply.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/status_details.h"
#include "server/query/point_query.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

// Side of a block: with every array a reply stays below 700 kB.
constexpr uint64_t kSide = 32;

}  // namespace

absl::StatusOr<Region> Region::Make(ViewPtr view, const wire::RegionQuery& query,
                                    uint64_t max_cells) {
  Region region;
  absl::StatusOr<QueryOptions> options = ResolveOptions(*view, query.settings);
  if (!options.ok()) return options.status();
  region.options_ = *std::move(options);
  region.options_.gradients = query.gradients;
  region.options_.objects = query.objects;
  if (absl::Status s = ValidateQuery(*view, 1, region.options_); !s.ok()) return s;
  region.reference_ns_ = ReferenceNs(*view, query.settings.time);
  region.resolution_m_ = query.resolution_m > 0 ? query.resolution_m : view->config.voxel_size_m;
  double total = 1;
  for (int axis = 0; axis < 3; ++axis) {
    // An extent of a whole number of cells must not grow one by rounding.
    const double cells =
        std::max(1.0, std::ceil(query.bounds.sizes()[axis] / region.resolution_m_ - 1e-6));
    total *= cells;
    // Also where the product is not finite.
    if (!(total <= static_cast<double>(max_cells))) {
      return wire::InvalidField(
          "bounds", -1,
          absl::StrFormat("a box of %g x %g x %g m in cells of %g m", query.bounds.sizes().x(),
                          query.bounds.sizes().y(), query.bounds.sizes().z(), region.resolution_m_),
          absl::StrFormat("at most %d cells", max_cells));
    }
    region.cells_[axis] = static_cast<uint64_t>(cells);
    region.blocks_[axis] = (region.cells_[axis] + kSide - 1) / kSide;
  }
  region.query_ = query;
  region.view_ = std::move(view);
  return region;
}

std::optional<v1::GetRegionResponse> Region::Block(uint64_t index) const {
  const uint64_t at[3] = {index / (blocks_[1] * blocks_[2]), index / blocks_[2] % blocks_[1],
                          index % blocks_[2]};
  Eigen::Vector3d first_W;
  uint64_t size[3];
  for (int axis = 0; axis < 3; ++axis) {
    size[axis] = std::min(kSide, cells_[axis] - at[axis] * kSide);
    first_W[axis] =
        query_.bounds.min()[axis] + (static_cast<double>(at[axis] * kSide) + 0.5) * resolution_m_;
  }
  Eigen::Matrix3Xd points_W(3, size[0] * size[1] * size[2]);
  Eigen::Index i = 0;
  for (uint64_t z = 0; z < size[2]; ++z) {
    for (uint64_t y = 0; y < size[1]; ++y) {
      for (uint64_t x = 0; x < size[0]; ++x) {
        points_W.col(i++) = first_W + resolution_m_ * Eigen::Vector3d(x, y, z);
      }
    }
  }
  const DistanceBatch batch = QueryDistances(*view_, points_W, options_);
  if (query_.known_only) {
    const bool known = std::any_of(batch.states.begin(), batch.states.end(), [](uint8_t state) {
      return (state & state_byte::kStateMask) != static_cast<uint8_t>(VoxelState::kUnknown);
    });
    if (!known) return std::nullopt;
  }
  v1::GetRegionResponse response;
  ToProto(StampOf(*view_), response.mutable_stamp());
  response.set_reference_ns(reference_ns_);
  wire::ToProto(first_W, response.mutable_origin());
  response.set_resolution_m(resolution_m_);
  response.set_size_x(size[0]);
  response.set_size_y(size[1]);
  response.set_size_z(size[2]);
  response.set_distances_f32(wire::EncodeArray(batch.distances_m));
  response.set_states_u8(wire::EncodeArray(batch.states));
  if (query_.gradients) response.set_gradients_f32(wire::EncodePoints(batch.gradients_W));
  if (query_.objects) response.set_object_ids_u32(wire::EncodeArray(batch.object_ids));
  return response;
}

}  // namespace clearance
