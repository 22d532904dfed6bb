// GetSlice: a horizontal cut, answered as a batch of points at the centres of its cells.
#include <algorithm>
#include <cmath>
#include <optional>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/status_details.h"
#include "server/query/point_query.h"
#include "server/service/query_replies.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

// With gradients a cell takes 21 bytes instead of 9, and replies stay below 4 MiB.
constexpr double kGradientShare = 170'000.0 / 400'000.0;

// x and y of all blocks that hold something known.
std::optional<Aabb> ObservedBounds(const DistanceField& field) {
  std::optional<Aabb> bounds;
  const double side_m = kBlockSide * field.voxel_size_m();
  field.ForEach([&](const BlockIndex& index, const std::shared_ptr<const FieldBlock>& block,
                    uint8_t tile) {
    bool known = !block && tile != DistanceField::kNoTile && (tile & 3) != 0;
    if (block) {
      known = std::any_of(block->voxels.begin(), block->voxels.end(), [](const FieldVoxel& voxel) {
        return voxel.state() != VoxelState::kUnknown;
      });
    }
    if (!known) return;
    const Eigen::Vector3d origin = BlockOrigin(index, field.voxel_size_m());
    const Aabb box(origin, origin + Eigen::Vector3d::Constant(side_m));
    bounds = bounds ? bounds->merged(box) : box;
  });
  return bounds;
}

struct Layout {
  Eigen::Vector2d first = Eigen::Vector2d::Zero();  // centre of cell (0, 0)
  double resolution_m = 0;
  int64_t columns = 0, rows = 0;
};

absl::StatusOr<Layout> LayOut(const MapView& view, const wire::SliceQuery& query,
                              double max_cells) {
  std::optional<Aabb> bounds = query.bounds;
  if (!bounds) bounds = ObservedBounds(view.field);
  Layout layout;
  layout.resolution_m = query.resolution_m > 0 ? query.resolution_m : view.config.voxel_size_m;
  if (!bounds) return layout;  // nothing observed: no cells
  const Eigen::Vector2d size = (bounds->max() - bounds->min()).head<2>();
  const auto cells = [&](int axis) {
    // An extent of a whole number of cells must not grow one by rounding.
    return std::max(1.0, std::ceil(size[axis] / layout.resolution_m - 1e-6));
  };
  if (query.resolution_m <= 0) {
    while (cells(0) * cells(1) > max_cells) layout.resolution_m *= 2;
  } else if (cells(0) * cells(1) > max_cells) {
    return wire::InvalidField("resolution_m", -1,
                              absl::StrFormat("%g, which makes %.0f x %.0f cells",
                                              query.resolution_m, cells(0), cells(1)),
                              absl::StrFormat("at most %.0f cells", max_cells));
  }
  layout.columns = static_cast<int64_t>(cells(0));
  layout.rows = static_cast<int64_t>(cells(1));
  layout.first = bounds->min().head<2>().array() + layout.resolution_m / 2;
  return layout;
}

}  // namespace

absl::StatusOr<v1::GetSliceResponse> AnswerSlice(const MapView& view, const wire::SliceQuery& query,
                                                 uint64_t max_cells) {
  absl::StatusOr<QueryOptions> options = ResolveOptions(view, query.settings);
  if (!options.ok()) return options.status();
  options->gradients = query.gradients;
  options->objects = true;
  const absl::StatusOr<Layout> layout =
      LayOut(view, query, std::floor(max_cells * (query.gradients ? kGradientShare : 1.0)));
  if (!layout.ok()) return layout.status();

  Eigen::Matrix3Xd points_W(3, layout->columns * layout->rows);
  for (int64_t row = 0, i = 0; row < layout->rows; ++row) {
    for (int64_t column = 0; column < layout->columns; ++column, ++i) {
      points_W.col(i) << layout->first.x() + column * layout->resolution_m,
          layout->first.y() + row * layout->resolution_m, query.z_m;
    }
  }
  v1::GetSliceResponse response;
  ToProto(StampOf(view), response.mutable_stamp());
  response.set_reference_ns(ReferenceNs(view, query.settings.time));
  response.set_resolution_m(layout->resolution_m);
  response.set_columns(layout->columns);
  response.set_rows(layout->rows);
  for (const ObjectView& object : view.objects) {
    if (object.life_state == LifeState::kRetired) continue;
    ToProto(object, options->horizon_s, response.add_objects());
  }
  if (points_W.cols() == 0) return response;
  wire::ToProto(Eigen::Vector3d(points_W.col(0)), response.mutable_origin());
  if (absl::Status s = ValidateQuery(view, points_W.cols(), *options); !s.ok()) return s;
  const DistanceBatch batch = QueryDistances(view, points_W, *options);
  response.set_distances_f32(wire::EncodeArray(batch.distances_m));
  response.set_states_u8(wire::EncodeArray(batch.states));
  response.set_object_ids_u32(wire::EncodeArray(batch.object_ids));
  if (query.gradients) response.set_gradients_f32(wire::EncodePoints(batch.gradients_W));
  return response;
}

}  // namespace clearance
