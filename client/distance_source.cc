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

 private:
  const EsdfClient& client_;
  QueryOptions options_;
};

}  // namespace

std::unique_ptr<DistanceSource> MakeRemoteDistanceSource(const EsdfClient& client,
                                                         QueryOptions options) {
  return std::make_unique<RemoteDistanceSource>(client, std::move(options));
}

}  // namespace clearance::client
