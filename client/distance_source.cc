#include "client/distance_source.h"

#include <utility>

#include "client/esdf_client.h"

namespace clearance::client {
namespace {

class RemoteDistanceSource final : public DistanceSource {
 public:
  RemoteDistanceSource(const EsdfClient& client, QueryOptions options)
      : client_(client), options_(std::move(options)) {
    options_.gradients = true;
    options_.objects = true;
  }

  absl::StatusOr<DistanceAnswers> Distances(const Eigen::Matrix3Xd& points_W,
                                            double horizon_s) const override {
    QueryOptions options = options_;
    options.horizon_s = horizon_s;
    return client_.QueryPoints(points_W, options);
  }

  absl::StatusOr<DistanceAnswers> Distances(const Eigen::Matrix3Xd& points_W,
                                            const std::vector<float>& horizons_s) const override {
    QueryOptions options = options_;
    options.horizons_s = horizons_s;
    return client_.QueryPoints(points_W, options);
  }

  absl::StatusOr<TrajectoryAnswers> CheckTrajectories(const std::vector<Sphere>& spheres,
                                                      const std::vector<Trajectory>& trajectories,
                                                      const CheckOptions& options) const override {
    return client_.CheckTrajectories(spheres, trajectories, OfMap(options));
  }

  absl::StatusOr<SphereAnswers> CheckSpheres(const std::vector<Sphere>& spheres,
                                             const std::vector<Pose>& T_W_R,
                                             const std::vector<double>& times_s,
                                             const CheckOptions& options) const override {
    return client_.CheckSpheres(spheres, T_W_R, times_s, OfMap(options));
  }

  absl::StatusOr<MapStamp> Stamp() const override {
    auto info = client_.GetMap(options_.map);
    if (!info.ok()) return info.status();
    return info->stamp;
  }

 private:
  CheckOptions OfMap(CheckOptions options) const {
    if (options.map.empty()) options.map = options_.map;
    return options;
  }

  const EsdfClient& client_;
  QueryOptions options_;
};

}  // namespace

std::unique_ptr<DistanceSource> MakeRemoteDistanceSource(const EsdfClient& client,
                                                         QueryOptions options) {
  return std::make_unique<RemoteDistanceSource>(client, std::move(options));
}

}  // namespace clearance::client
