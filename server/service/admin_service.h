// AdminService: versions, limits and statistics.
#pragma once

#include "clearance/v1/admin.grpc.pb.h"
#include "server/service/service_context.h"

namespace clearance {

// Of this build.
const char* ServerVersion();

// Resident memory and threads of this process; zeros where /proc says nothing.
struct ProcessUse {
  uint64_t resident_bytes = 0;
  uint32_t threads = 0;
};
ProcessUse ReadProcessUse();

class AdminServiceImpl final : public v1::AdminService::CallbackService {
 public:
  explicit AdminServiceImpl(ServiceContext* service) : service_(service) {}

  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context,
                                          const v1::GetServerInfoRequest* request,
                                          v1::GetServerInfoResponse* response) override;
  grpc::ServerUnaryReactor* GetStats(grpc::CallbackServerContext* context,
                                     const v1::GetStatsRequest* request,
                                     v1::GetStatsResponse* response) override;
  grpc::ServerUnaryReactor* Drain(grpc::CallbackServerContext* context,
                                  const v1::DrainRequest* request,
                                  v1::DrainResponse* response) override;

 private:
  ServiceContext* const service_;
};

}  // namespace clearance
