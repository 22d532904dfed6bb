// MapService: create, look at, edit and delete maps.
#pragma once

#include <functional>
#include <string>

#include "clearance/v1/map.grpc.pb.h"
#include "server/service/ingest_sessions.h"
#include "server/service/service_context.h"

namespace clearance {

class MapServiceImpl final : public v1::MapService::CallbackService {
 public:
  // `serving_changed(map, serving)` keeps the health of `maps/<id>`.
  MapServiceImpl(ServiceContext* service, IngestSessions* sessions,
                 std::function<void(const std::string&, bool)> serving_changed)
      : service_(service), sessions_(sessions), serving_changed_(std::move(serving_changed)) {}

  grpc::ServerUnaryReactor* CreateMap(grpc::CallbackServerContext* context,
                                      const v1::CreateMapRequest* request,
                                      v1::CreateMapResponse* response) override;
  grpc::ServerUnaryReactor* GetMap(grpc::CallbackServerContext* context,
                                   const v1::GetMapRequest* request,
                                   v1::GetMapResponse* response) override;
  grpc::ServerUnaryReactor* ListMaps(grpc::CallbackServerContext* context,
                                     const v1::ListMapsRequest* request,
                                     v1::ListMapsResponse* response) override;
  grpc::ServerUnaryReactor* DeleteMap(grpc::CallbackServerContext* context,
                                      const v1::DeleteMapRequest* request,
                                      v1::DeleteMapResponse* response) override;
  grpc::ServerUnaryReactor* EditRegion(grpc::CallbackServerContext* context,
                                       const v1::EditRegionRequest* request,
                                       v1::EditRegionResponse* response) override;
  grpc::ServerUnaryReactor* RepositionSubmaps(grpc::CallbackServerContext* context,
                                              const v1::RepositionSubmapsRequest* request,
                                              v1::RepositionSubmapsResponse* response) override;

 private:
  ServiceContext* const service_;
  IngestSessions* const sessions_;
  const std::function<void(const std::string&, bool)> serving_changed_;
};

}  // namespace clearance
