// ExportService: meshes and grids as files in chunks.
#pragma once

#include "clearance/v1/export.grpc.pb.h"
#include "server/service/service_context.h"

namespace clearance {

class ExportServiceImpl final : public v1::ExportService::CallbackService {
 public:
  explicit ExportServiceImpl(ServiceContext* service) : service_(service) {}

  grpc::ServerWriteReactor<v1::ExportMeshResponse>* ExportMesh(
      grpc::CallbackServerContext* context, const v1::ExportMeshRequest* request) override;
  grpc::ServerWriteReactor<v1::ExportGridResponse>* ExportGrid(
      grpc::CallbackServerContext* context, const v1::ExportGridRequest* request) override;

 private:
  ServiceContext* const service_;
};

}  // namespace clearance
