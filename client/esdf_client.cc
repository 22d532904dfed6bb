#include "client/esdf_client.h"

#include <grpcpp/client_context.h>

#include <chrono>
#include <utility>

#include "clearance/v1/admin.grpc.pb.h"
#include "clearance/v1/map.grpc.pb.h"
#include "clearance/v1/query.grpc.pb.h"
#include "client/channel.h"
#include "client/connection.h"
#include "client/convert.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "proto/wire/geometry.h"

namespace clearance::client {
namespace {

// One unary call with the client's deadline.
template <typename Stub, typename Request, typename Reply>
absl::Status Call(Stub& stub,
                  grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Reply*),
                  const Request& request, Reply* reply, const ClientOptions& options) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() +
                       absl::ToChronoMicroseconds(options.call_timeout));
  return CallStatus((stub.*method)(&context, request, reply), options.address);
}

}  // namespace

absl::StatusOr<std::unique_ptr<EsdfClient>> EsdfClient::Connect(const ClientOptions& options) {
  auto channel = OpenChannel(options.address, options.credentials, options.connect_timeout);
  if (!channel.ok()) return channel.status();
  auto connection = std::make_unique<Connection>();
  connection->options = options;
  connection->channel = *std::move(channel);
  connection->query = v1::QueryService::NewStub(connection->channel);
  connection->map = v1::MapService::NewStub(connection->channel);
  connection->admin = v1::AdminService::NewStub(connection->channel);
  connection->exporter = v1::ExportService::NewStub(connection->channel);
  connection->health = grpc::health::v1::Health::NewStub(connection->channel);
  return std::unique_ptr<EsdfClient>(new EsdfClient(std::move(connection)));
}

EsdfClient::EsdfClient(std::unique_ptr<Connection> connection)
    : connection_(std::move(connection)) {}
EsdfClient::~EsdfClient() = default;

const ClientOptions& EsdfClient::options() const { return connection_->options; }

absl::StatusOr<DistanceAnswers> EsdfClient::QueryPoints(const Eigen::Matrix3Xd& points_W,
                                                        const QueryOptions& options) const {
  v1::QueryPointsRequest request;
  ToProto(options, &request);
  request.set_map(connection_->MapOr(options.map));
  request.set_positions_f64(wire::EncodePoints(points_W));
  v1::QueryPointsResponse reply;
  absl::Status status = Call(*connection_->query, &v1::QueryService::Stub::QueryPoints, request,
                             &reply, connection_->options);
  if (!status.ok()) return status;
  return FromProto(reply, static_cast<size_t>(points_W.cols()), options);
}

absl::StatusOr<ObjectList> EsdfClient::ListObjects(bool include_history,
                                                   const QueryOptions& options) const {
  v1::ListObjectsRequest request;
  ToProto(options, &request);
  request.set_map(connection_->MapOr(options.map));
  request.set_include_history(include_history);
  v1::ListObjectsResponse reply;
  absl::Status status = Call(*connection_->query, &v1::QueryService::Stub::ListObjects, request,
                             &reply, connection_->options);
  if (!status.ok()) return status;
  ObjectList list;
  list.stamp = FromProto(reply.stamp());
  list.reference_ns = reply.reference_ns();
  for (const auto& object : reply.objects()) {
    auto info = FromProto(object);
    if (!info.ok()) return info.status();
    list.objects.push_back(*std::move(info));
  }
  return list;
}

absl::StatusOr<Slice> EsdfClient::GetSlice(const SliceOptions& options) const {
  v1::GetSliceRequest request;
  ToProto(options, &request);
  request.set_map(connection_->MapOr(options.query.map));
  v1::GetSliceResponse reply;
  absl::Status status = Call(*connection_->query, &v1::QueryService::Stub::GetSlice, request,
                             &reply, connection_->options);
  if (!status.ok()) return status;
  return FromProto(reply);
}

absl::StatusOr<MapInfo> EsdfClient::GetMap(const std::string& map, bool include_trajectory) const {
  v1::GetMapRequest request;
  request.set_map(connection_->MapOr(map));
  request.set_include_trajectory(include_trajectory);
  v1::GetMapResponse reply;
  absl::Status status =
      Call(*connection_->map, &v1::MapService::Stub::GetMap, request, &reply, connection_->options);
  if (!status.ok()) return status;
  return FromProto(reply.info());
}

absl::StatusOr<std::vector<MapInfo>> EsdfClient::ListMaps() const {
  v1::ListMapsResponse reply;
  absl::Status status = Call(*connection_->map, &v1::MapService::Stub::ListMaps,
                             v1::ListMapsRequest(), &reply, connection_->options);
  if (!status.ok()) return status;
  std::vector<MapInfo> maps;
  for (const auto& map : reply.maps()) {
    auto info = FromProto(map);
    if (!info.ok()) return info.status();
    maps.push_back(*std::move(info));
  }
  return maps;
}

absl::StatusOr<MapInfo> EsdfClient::CreateMap(const std::string& map,
                                              const wire::MapSettings& settings) const {
  v1::CreateMapRequest request;
  request.set_map(connection_->MapOr(map));
  wire::ToProto(settings, request.mutable_config());
  v1::CreateMapResponse reply;
  absl::Status status = Call(*connection_->map, &v1::MapService::Stub::CreateMap, request, &reply,
                             connection_->options);
  if (!status.ok()) return status;
  return FromProto(reply.info());
}

absl::Status EsdfClient::DeleteMap(const std::string& map) const {
  v1::DeleteMapRequest request;
  request.set_map(connection_->MapOr(map));
  v1::DeleteMapResponse reply;
  return Call(*connection_->map, &v1::MapService::Stub::DeleteMap, request, &reply,
              connection_->options);
}

absl::StatusOr<MapStamp> EsdfClient::EditRegion(const std::string& map,
                                                const wire::EditRegion& edit) const {
  v1::EditRegionRequest request;
  request.set_map(connection_->MapOr(map));
  request.set_action(edit.action);
  if (edit.box) wire::ToProto(*edit.box, request.mutable_box());
  if (edit.sphere) {
    wire::ToProto(edit.sphere->center_W, request.mutable_sphere()->mutable_center());
    request.mutable_sphere()->set_radius_m(edit.sphere->radius_m);
  }
  v1::EditRegionResponse reply;
  absl::Status status = Call(*connection_->map, &v1::MapService::Stub::EditRegion, request, &reply,
                             connection_->options);
  if (!status.ok()) return status;
  return FromProto(reply.stamp());
}

absl::StatusOr<bool> EsdfClient::IsServing(const std::string& service) const {
  using grpc::health::v1::Health;
  using grpc::health::v1::HealthCheckResponse;
  grpc::health::v1::HealthCheckRequest request;
  request.set_service(service);
  HealthCheckResponse reply;
  absl::Status status =
      Call(*connection_->health, &Health::Stub::Check, request, &reply, connection_->options);
  if (!status.ok()) return status;
  return reply.status() == HealthCheckResponse::SERVING;
}

absl::StatusOr<ServerInfo> EsdfClient::GetServerInfo() const {
  v1::GetServerInfoResponse reply;
  absl::Status status = Call(*connection_->admin, &v1::AdminService::Stub::GetServerInfo,
                             v1::GetServerInfoRequest(), &reply, connection_->options);
  if (!status.ok()) return status;
  ServerInfo info;
  info.version = reply.version();
  info.api_version = reply.api_version();
  info.build = reply.build();
  info.uptime_s = reply.uptime_s();
  info.maps.assign(reply.maps().begin(), reply.maps().end());
  info.draining = reply.draining();
  info.max_message_bytes = reply.limits().max_message_bytes();
  info.max_query_points = reply.limits().max_query_points();
  info.max_frame_points = reply.limits().max_frame_points();
  info.max_slice_cells = reply.limits().max_slice_cells();
  return info;
}

absl::StatusOr<ServerStats> EsdfClient::GetStats(const std::string& map) const {
  v1::GetStatsRequest request;
  request.set_map(map);
  v1::GetStatsResponse reply;
  absl::Status status = Call(*connection_->admin, &v1::AdminService::Stub::GetStats, request,
                             &reply, connection_->options);
  if (!status.ok()) return status;
  return FromProto(reply);
}

absl::StatusOr<uint64_t> EsdfClient::Drain(double timeout_s) const {
  v1::DrainRequest request;
  request.set_timeout_s(timeout_s);
  v1::DrainResponse reply;
  absl::Status status = Call(*connection_->admin, &v1::AdminService::Stub::Drain, request, &reply,
                             connection_->options);
  if (!status.ok()) return status;
  return reply.settled_frames();
}

}  // namespace clearance::client
