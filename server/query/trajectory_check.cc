#include "server/query/trajectory_check.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <memory>

#include "server/query/object_index.h"
#include "server/query/object_query.h"
#include "server/query/path_walk.h"

namespace clearance {
namespace {

// Below this many paths or states tasks cost more than they give.
constexpr size_t kParallelPaths = 64, kPathsATask = 16;
constexpr size_t kParallelStates = 4096, kPosesATask = 256;

Twist TwistOf(const ObjectView& object, double horizon_s) {
  if (horizon_s == 0) return object.twist;
  const Eigen::Vector3d origin_W = object.PoseAt(horizon_s).translation();
  const Eigen::Vector3d omega = object.screw_W.tail<3>();
  return {object.screw_W.head<3>() + omega.cross(origin_W), omega};
}

// What one task needs to read the view.
struct Reader {
  Reader(const MapView& view, const ObjectIndex& index, const CheckOptions& options)
      : enabled(EnabledEntries(index, options.layers)),
        probe(view, index, enabled, options.layers, options.sigma_margin,
              options.unknown_as_occupied) {}
  const std::vector<uint8_t> enabled;
  ClearanceProbe probe;
};

PathCheck ToCheck(const MapView& view, const ObjectIndex& index, const RobotPath& path,
                  const WalkResult& walked) {
  PathCheck check;
  check.collides = walked.collision_s.has_value();
  if (check.collides) check.first_collision_s = *walked.collision_s;
  if (!check.collides || walked.valid_before) {
    const double last_valid_s = check.collides ? walked.last_valid_s : path.horizons_s.back();
    const auto after =
        std::upper_bound(path.horizons_s.begin(), path.horizons_s.end(), last_valid_s);
    check.last_valid_s = last_valid_s;
    check.last_valid_index =
        static_cast<uint32_t>(std::max<ptrdiff_t>(1, after - path.horizons_s.begin()) - 1);
  }
  check.min_clearance_m = walked.clearance_m;
  check.min_clearance_s = walked.clearance_s;
  check.unknown_decides = walked.at.unknown_m < walked.at.distance_m;
  if (walked.at.entry >= 0 && !check.unknown_decides) {
    check.object = static_cast<int>(index.entries[walked.at.entry].object);
    check.twist = TwistOf(view.objects[check.object], walked.clearance_s);
  }
  return check;
}

std::shared_ptr<const ObjectIndex> IndexOf(const MapView& view) {
  return view.object_index != nullptr ? view.object_index : BuildObjectIndex(view.objects);
}

}  // namespace

std::vector<PathCheck> CheckPaths(const MapView& view, const std::vector<RobotSphere>& spheres,
                                  const std::vector<RobotPath>& paths,
                                  const CheckOptions& options) {
  const std::shared_ptr<const ObjectIndex> index = IndexOf(view);
  std::vector<PathCheck> checks(paths.size());
  const auto check = [&](size_t begin, size_t end) {
    Reader reader(view, *index, options);
    PathWalk walk(view, *index, &reader.probe, options);
    for (size_t i = begin; i < end; ++i) {
      if (options.cancelled && options.cancelled()) return;
      checks[i] = ToCheck(view, *index, paths[i], walk.Run(spheres, paths[i]));
    }
  };
  if (paths.size() < kParallelPaths) {
    check(0, paths.size());
  } else {
    tbb::parallel_for(
        tbb::blocked_range<size_t>(0, paths.size(), kPathsATask),
        [&](const tbb::blocked_range<size_t>& range) { check(range.begin(), range.end()); });
  }
  return checks;
}

PoseChecks CheckPoses(const MapView& view, const std::vector<RobotSphere>& spheres,
                      const std::vector<Pose>& T_W_R, const std::vector<double>& horizons_s,
                      const CheckOptions& options) {
  const std::shared_ptr<const ObjectIndex> index = IndexOf(view);
  PoseChecks checks;
  checks.collides.resize(T_W_R.size());
  checks.clearances_m.resize(T_W_R.size());
  checks.sphere_indices.resize(T_W_R.size());
  checks.objects.assign(T_W_R.size(), -1);
  const auto check = [&](size_t begin, size_t end) {
    Reader reader(view, *index, options);
    for (size_t i = begin; i < end; ++i) {
      if (options.cancelled && options.cancelled()) return;
      const double horizon_s = horizons_s.empty() ? 0 : horizons_s[i];
      for (size_t s = 0; s < spheres.size(); ++s) {
        // Unknown space beyond the worst ball's clearance changes nothing.
        const double limit_m = s == 0 ? std::numeric_limits<double>::infinity()
                                      : std::max<double>(checks.clearances_m[i], options.margin_m) +
                                            spheres[s].radius_m + 1e-3;
        const ProbeAnswer at =
            reader.probe.At(T_W_R[i] * spheres[s].centre_R, horizon_s, true, limit_m);
        const double clearance_m = at.least_m() - spheres[s].radius_m;
        if (clearance_m < options.margin_m) checks.collides[i] = 1;
        const float reported_m = static_cast<float>(clearance_m);
        if (s > 0 && reported_m >= checks.clearances_m[i]) continue;
        checks.clearances_m[i] = reported_m;
        checks.sphere_indices[i] = static_cast<uint32_t>(s);
        const bool object = at.entry >= 0 && at.unknown_m >= at.distance_m;
        checks.objects[i] = object ? static_cast<int>(index->entries[at.entry].object) : -1;
      }
    }
  };
  if (T_W_R.size() * spheres.size() < kParallelStates) {
    check(0, T_W_R.size());
  } else {
    tbb::parallel_for(
        tbb::blocked_range<size_t>(0, T_W_R.size(), kPosesATask),
        [&](const tbb::blocked_range<size_t>& range) { check(range.begin(), range.end()); });
  }
  return checks;
}

}  // namespace clearance
