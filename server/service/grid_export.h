// What an ExportGrid asks for, copied on the mapping thread, written elsewhere.
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "clearance/v1/export.pb.h"
#include "server/engine/map_model.h"
#include "server/engine/map_store.h"

namespace clearance {

struct GridSelection {
  ObjectId object;  // 0 = the static map
  uint32_t generation = 0;
  bool mean = false, weight = false, free_space = false, distance = false;
};

// INVALID_ARGUMENT for an unknown or repeated kind, or for kinds that objects do not have.
absl::StatusOr<GridSelection> GridSelectionFromProto(const v1::ExportGridRequest& request);

// Grids that belong to the map are deep copies; those of the view are made while writing.
class GridCopy {
 public:
  // On the mapping thread. NOT_FOUND for an unknown object.
  static absl::StatusOr<std::shared_ptr<GridCopy>> Take(const GridSelection& selection,
                                                        MapModel* model, ViewPtr view);
  ~GridCopy();
  absl::StatusOr<std::string> Write() const;
  const MapView& view() const { return *view_; }

 private:
  struct Grids;
  GridCopy();

  GridSelection selection_;
  ViewPtr view_;
  std::unique_ptr<Grids> grids_;
};

}  // namespace clearance
