// WatchService: declared, not offered yet.
#pragma once

#include "clearance/v1/watch.grpc.pb.h"
#include "server/service/unimplemented.h"

namespace clearance {

class WatchServiceImpl final : public v1::WatchService::CallbackService {
 public:
  grpc::ServerWriteReactor<v1::WatchMapResponse>* WatchMap(grpc::CallbackServerContext*,
                                                           const v1::WatchMapRequest*) override {
    return WritesNotOffered<v1::WatchMapResponse>("WatchMap");
  }
};

}  // namespace clearance
