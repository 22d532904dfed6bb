// What an EsdfClient holds. Private to the SDK.
#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>

#include "clearance/v1/admin.grpc.pb.h"
#include "clearance/v1/export.grpc.pb.h"
#include "clearance/v1/map.grpc.pb.h"
#include "clearance/v1/query.grpc.pb.h"
#include "client/esdf_client.h"
#include "grpc/health/v1/health.grpc.pb.h"

namespace clearance::client {

struct EsdfClient::Connection {
  ClientOptions options;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::QueryService::Stub> query;
  std::unique_ptr<v1::MapService::Stub> map;
  std::unique_ptr<v1::AdminService::Stub> admin;
  std::unique_ptr<v1::ExportService::Stub> exporter;
  std::unique_ptr<grpc::health::v1::Health::Stub> health;

  const std::string& MapOr(const std::string& given) const {
    return given.empty() ? options.map : given;
  }
};

}  // namespace clearance::client
