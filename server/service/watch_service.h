// WatchService: maps to follow.
#pragma once

#include "clearance/v1/watch.grpc.pb.h"
#include "server/service/watch_hub.h"

namespace clearance {

class WatchServiceImpl final : public v1::WatchService::CallbackService {
 public:
  explicit WatchServiceImpl(ServiceContext* service) : hub_(service) {}

  grpc::ServerWriteReactor<v1::WatchMapResponse>* WatchMap(
      grpc::CallbackServerContext*, const v1::WatchMapRequest* request) override {
    return hub_.Start(*request);
  }

 private:
  WatchHub hub_;
};

}  // namespace clearance
