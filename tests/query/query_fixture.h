// Fields, shapes and views with known truth, made without the mapping side.
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "server/map/map_view.h"
#include "server/query/object_index.h"
#include "server/query/object_tree.h"
#include "tests/testing/analytic_scene.h"

namespace clearance::testing {

using SignedDistance = std::function<double(const Eigen::Vector3d& p)>;

Eigen::Vector3d NumericalGradient(const SignedDistance& distance, const Eigen::Vector3d& p,
                                  double step = 1e-5);

// Surface samples as a mapper would make them: one site in each voxel of `box` that holds the foot
// point of its own centre.
std::vector<SurfaceSite> SampleSites(const SignedDistance& distance, const Eigen::AlignedBox3d& box,
                                     double voxel_size_m);
std::vector<Eigen::Vector3d> SamplePositions(const SignedDistance& distance,
                                             const Eigen::AlignedBox3d& box, double voxel_size_m);

// The closest-site field of those sites by brute force, over the blocks that touch `box`; the side
// of each voxel's centre is the true one; FREE outside, OCCUPIED inside and where a site is.
DistanceField ExactField(const SignedDistance& distance, const Eigen::AlignedBox3d& box,
                         double voxel_size_m, double max_distance_m);

// A view with this field and no objects.
MapView ViewOf(DistanceField field, double max_distance_m);

// Gives the view an object (its index is not built).
ObjectView& AddObject(MapView& view, uint16_t id, std::shared_ptr<const ObjectShape> shape,
                      const Pose& T_W_L);

// A car-like shape: a body and a cabin, seen from everywhere but below.
std::shared_ptr<const ObjectShape> CarShape(double voxel_size_m);
double CarDistance(const Eigen::Vector3d& p_L);

Eigen::Vector3d RandomIn(const Eigen::AlignedBox3d& box, std::mt19937& rng);

// Mean, 99th percentile and largest of absolute values.
struct ErrorSummary {
  double mean = 0, p99 = 0, max = 0;
};
ErrorSummary Summarize(std::vector<double> errors);

}  // namespace clearance::testing
