// The exact closest-site transform: the oracle that the incremental field is measured against.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "server/map/voxel.h"

namespace clearance {

// Nearest-site search without approximation: sites in cells of 8^3 voxels, searched in shells of
// growing distance until no unvisited cell can hold a nearer one.
class ExactTransform {
 public:
  struct Nearest {
    int32_t site = -1;  // index into the constructor's sites, -1 where none is within the limit
    double distance_m = 0;
  };

  // `sites`: positions in metres. `max_distance_m`: nothing beyond is reported.
  ExactTransform(absl::Span<const Eigen::Vector3d> sites, double voxel_size_m,
                 double max_distance_m);

  // The nearest site of a point; the one with the lower index where two are equally near.
  Nearest Find(const Eigen::Vector3d& point) const;

  size_t size() const { return positions_.size(); }

 private:
  struct Cell {
    BlockIndex index;
    uint32_t begin, end;  // range in order_
  };
  const Cell* FindCell(const BlockIndex& index) const;

  double voxel_size_m_, max_distance_m_;
  std::vector<Eigen::Vector3d> positions_;
  std::vector<uint32_t> order_;  // site indices by cell
  std::vector<Cell> cells_;      // sorted
};

}  // namespace clearance
