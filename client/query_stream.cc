#include "client/query_stream.h"

#include <grpcpp/client_context.h>

#include <map>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "client/channel.h"
#include "client/connection.h"
#include "client/convert.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/status_details.h"

namespace clearance::client {
namespace {

absl::Status FromProto(const v1::Error& error) {
  absl::Status status(static_cast<absl::StatusCode>(error.code()), error.message());
  if (error.retry_after_s() > 0) {
    status = wire::WithRetry(std::move(status), absl::Seconds(error.retry_after_s()));
  }
  if (!status.ok()) return status;
  return absl::DataLossError("the server's reply: an error without a code");
}

absl::Status AnotherKind() {
  return absl::DataLossError(
      "the server's reply: an answer of another kind than its request; do client and server "
      "match?");
}

class GrpcQueryStream final : public QueryStream {
 public:
  GrpcQueryStream(v1::QueryService::Stub& stub, ClientOptions options)
      : options_(std::move(options)), stream_(stub.QueryStream(&context_)) {
    reader_ = std::thread([this] { Read(); });
  }

  ~GrpcQueryStream() override {
    {
      absl::MutexLock lock(&mutex_);
      if (!finishing_) context_.TryCancel();
    }
    (void)Finish();
  }

  void QueryPoints(const Eigen::Matrix3Xd& points_W, const QueryOptions& options,
                   std::function<void(absl::StatusOr<DistanceAnswers>)> done) override {
    v1::QueryStreamRequest request;
    v1::QueryPointsRequest& query = *request.mutable_query_points();
    ToProto(options, &query);
    SetMap(options.map, &query);
    query.set_positions_f64(wire::EncodePoints(points_W));
    Send(std::move(request), [n = static_cast<size_t>(points_W.cols()), options,
                              done = std::move(done)](absl::StatusOr<const Answer*> answer) {
      if (!answer.ok()) return done(answer.status());
      if (!(*answer)->has_query_points()) return done(AnotherKind());
      done(client::FromProto((*answer)->query_points(), n, options));
    });
  }

  void CheckTrajectories(const std::vector<Sphere>& spheres,
                         const std::vector<Trajectory>& trajectories, const CheckOptions& options,
                         std::function<void(absl::StatusOr<TrajectoryAnswers>)> done) override {
    v1::QueryStreamRequest request;
    v1::CheckTrajectoriesRequest& check = *request.mutable_check_trajectories();
    ToProto(options, spheres, &check);
    SetMap(options.map, &check);
    for (const Trajectory& trajectory : trajectories) {
      ToProto(trajectory, check.add_trajectories());
    }
    Send(std::move(request),
         [n = trajectories.size(), done = std::move(done)](absl::StatusOr<const Answer*> answer) {
           if (!answer.ok()) return done(answer.status());
           if (!(*answer)->has_check_trajectories()) return done(AnotherKind());
           done(client::FromProto((*answer)->check_trajectories(), n));
         });
  }

  void CheckSpheres(const std::vector<Sphere>& spheres, const std::vector<Pose>& T_W_R,
                    const std::vector<double>& times_s, const CheckOptions& options,
                    std::function<void(absl::StatusOr<SphereAnswers>)> done) override {
    v1::QueryStreamRequest request;
    v1::CheckSpheresRequest& check = *request.mutable_check_spheres();
    ToProto(options, spheres, &check);
    SetMap(options.map, &check);
    for (const Pose& pose : T_W_R) wire::AppendPose(pose, check.mutable_poses_f64());
    check.set_times_f64(wire::EncodeArray(times_s));
    Send(std::move(request),
         [n = T_W_R.size(), done = std::move(done)](absl::StatusOr<const Answer*> answer) {
           if (!answer.ok()) return done(answer.status());
           if (!(*answer)->has_check_spheres()) return done(AnotherKind());
           done(client::FromProto((*answer)->check_spheres(), n));
         });
  }

  absl::Status Finish() override {
    absl::MutexLock finish(&finish_mutex_);
    if (!reader_.joinable()) return outcome_;
    {
      absl::MutexLock writing(&write_mutex_);
      absl::MutexLock lock(&mutex_);
      finishing_ = true;
    }
    {
      absl::MutexLock writing(&write_mutex_);
      stream_->WritesDone();
    }
    reader_.join();
    return outcome_;
  }

 private:
  using Answer = v1::QueryStreamResponse;
  using Done = std::function<void(absl::StatusOr<const Answer*>)>;

  template <typename Request>
  void SetMap(const std::string& map, Request* request) {
    request->set_map(map.empty() ? options_.map : map);
  }

  void Send(v1::QueryStreamRequest request, Done done) {
    absl::MutexLock writing(&write_mutex_);
    absl::Status refused;
    {
      absl::MutexLock lock(&mutex_);
      if (ended_) {
        refused = absl::UnavailableError("the query stream has ended; open another");
      } else if (finishing_) {
        refused = absl::FailedPreconditionError("the query stream is finished; open another");
      } else {
        request.set_tag(++last_tag_);
        waiting_.emplace(last_tag_, std::move(done));
      }
    }
    if (!refused.ok()) return done(refused);
    // Where writing fails the stream is over, and its reader answers what waits.
    (void)stream_->Write(request);
  }

  void Read() {
    for (Answer answer; stream_->Read(&answer);) {
      Done done;
      {
        absl::MutexLock lock(&mutex_);
        const auto it = waiting_.find(answer.tag());
        if (it == waiting_.end()) continue;
        done = std::move(it->second);
        waiting_.erase(it);
      }
      if (answer.has_error()) {
        done(FromProto(answer.error()));
      } else {
        done(&answer);
      }
    }
    outcome_ = CallStatus(stream_->Finish(), options_.address);
    std::map<uint64_t, Done> left;
    {
      absl::MutexLock lock(&mutex_);
      ended_ = true;
      left.swap(waiting_);
    }
    const absl::Status status =
        outcome_.ok() ? absl::DataLossError("the server ended the query stream without an answer")
                      : outcome_;
    for (auto& [tag, done] : left) done(status);
  }

  const ClientOptions options_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::QueryStreamRequest, Answer>> stream_;
  absl::Mutex finish_mutex_;
  absl::Mutex write_mutex_ ABSL_ACQUIRED_BEFORE(mutex_);
  absl::Mutex mutex_;
  bool finishing_ ABSL_GUARDED_BY(mutex_) = false;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  uint64_t last_tag_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<uint64_t, Done> waiting_ ABSL_GUARDED_BY(mutex_);
  absl::Status outcome_;  // written by the reader before it ends
  std::thread reader_;
};

}  // namespace

std::unique_ptr<QueryStream> EsdfClient::OpenQueryStream() const {
  return std::make_unique<GrpcQueryStream>(*connection_->query, connection_->options);
}

}  // namespace clearance::client
