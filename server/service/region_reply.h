// A box of the map cut into dense blocks of cells.
#pragma once

#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "clearance/v1/query.pb.h"
#include "proto/wire/check.h"
#include "server/engine/map_store.h"
#include "server/query/query_options.h"

namespace clearance {

// Immutable; each block is computed when it is asked for, all from one view.
class Region {
 public:
  // INVALID_ARGUMENT for more than `max_cells`; times and layers as of QueryPoints.
  static absl::StatusOr<Region> Make(ViewPtr view, const wire::RegionQuery& query,
                                     uint64_t max_cells);

  uint64_t blocks() const { return blocks_[0] * blocks_[1] * blocks_[2]; }
  // The block, by ascending origin. Absent where it is left out for being unknown everywhere.
  std::optional<v1::GetRegionResponse> Block(uint64_t index) const;

 private:
  Region() = default;

  ViewPtr view_;
  wire::RegionQuery query_;
  QueryOptions options_;
  int64_t reference_ns_ = 0;
  double resolution_m_ = 0;
  uint64_t cells_[3] = {}, blocks_[3] = {};
};

}  // namespace clearance
