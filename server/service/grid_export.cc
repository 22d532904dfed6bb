#include "server/service/grid_export.h"

#include <set>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"
#include "server/map/vdb_export.h"

namespace clearance {

absl::StatusOr<GridSelection> GridSelectionFromProto(const v1::ExportGridRequest& request) {
  GridSelection selection;
  if (request.has_object_id()) {
    const absl::StatusOr<ObjectId> id = wire::ObjectIdFromProto(request.object_id(), "object_id");
    if (!id.ok()) return id.status();
    selection.object = *id;
  }
  selection.generation = request.generation();
  std::set<int> seen;
  for (int i = 0; i < request.kinds_size(); ++i) {
    const int kind = request.kinds(i);
    if (kind <= v1::GRID_KIND_UNSPECIFIED || !v1::GridKind_IsValid(kind)) {
      return wire::InvalidField("kinds", i, absl::StrFormat("%d", kind),
                                "MEAN, WEIGHT, FREE_SPACE or DISTANCE");
    }
    if (!seen.insert(kind).second) {
      return wire::InvalidField("kinds", i, v1::GridKind_Name(request.kinds(i)), "each kind once");
    }
  }
  selection.mean = seen.empty() || seen.contains(v1::GRID_KIND_MEAN);
  selection.weight = seen.empty() || seen.contains(v1::GRID_KIND_WEIGHT);
  selection.free_space = seen.contains(v1::GRID_KIND_FREE_SPACE);
  selection.distance = seen.contains(v1::GRID_KIND_DISTANCE);
  if (!selection.object.is_static() && (selection.free_space || selection.distance)) {
    return wire::InvalidField("kinds", -1, "FREE_SPACE or DISTANCE of an object",
                              "MEAN or WEIGHT: only the static map has the others");
  }
  return selection;
}

struct GridCopy::Grids {
  openvdb::GridCPtrVec all;
};

GridCopy::GridCopy() : grids_(std::make_unique<Grids>()) {}
GridCopy::~GridCopy() = default;

absl::StatusOr<std::shared_ptr<GridCopy>> GridCopy::Take(const GridSelection& selection,
                                                         MapModel* model, ViewPtr view) {
  const absl::StatusOr<MapModel::Surface> surface =
      model->FindSurface(selection.object, selection.generation);
  if (!surface.ok()) return surface.status();
  std::shared_ptr<GridCopy> copy(new GridCopy);
  copy->selection_ = selection;
  copy->view_ = std::move(view);
  if (selection.mean) copy->grids_->all.push_back(CopyMean(*surface->map));
  if (selection.weight) copy->grids_->all.push_back(CopyWeight(*surface->map));
  return copy;
}

absl::StatusOr<std::string> GridCopy::Write() const {
  openvdb::GridCPtrVec grids = grids_->all;
  if (selection_.free_space) grids.push_back(FreeSpaceGrid(view_->field));
  if (selection_.distance) grids.push_back(DistanceGrid(view_->field));
  return WriteVdb(grids);
}

}  // namespace clearance
