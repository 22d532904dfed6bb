#include "client/watch.h"

#include <grpcpp/client_context.h>

#include "clearance/v1/watch.grpc.pb.h"
#include "client/channel.h"
#include "client/convert.h"
#include "proto/wire/geometry.h"

namespace clearance::client {
namespace {

constexpr size_t kIndexBytes = 12;

template <typename Part>
void Count(const Part& part, WatchEvent* event) {
  for (const v1::FieldBlocks& blocks : part.blocks()) {
    event->blocks += blocks.indices_i32().size() / kIndexBytes;
    event->removed_blocks += blocks.removed_i32().size() / kIndexBytes;
    event->block_bytes += blocks.ByteSizeLong();
  }
  for (const v1::ObjectState& object : part.objects()) {
    event->object_bytes += object.ByteSizeLong();
    // A large surface repeats its object in the parts that follow.
    if (object.surface().first_site() == 0) event->objects.push_back(FromProto(object.brief()));
  }
}

}  // namespace

absl::Status WatchMap(const ClientOptions& client, const WatchOptions& options,
                      const WatchCallback& callback) {
  const auto channel = OpenChannel(client.address, client.credentials, client.connect_timeout);
  if (!channel.ok()) return channel.status();
  v1::WatchMapRequest request;
  request.set_map(options.map.empty() ? client.map : options.map);
  if (options.bounds) wire::ToProto(*options.bounds, request.mutable_bounds());
  request.set_max_rate_hz(options.max_rate_hz);
  request.set_poses_only(options.poses_only);
  grpc::ClientContext context;
  if (options.until != absl::InfiniteFuture()) {
    context.set_deadline(absl::ToChronoTime(options.until));
  }
  const auto stub = v1::WatchService::NewStub(*channel);
  const auto reader = stub->WatchMap(&context, request);
  v1::WatchMapResponse message;
  WatchEvent event;
  while (reader->Read(&message)) {
    event.bytes += message.ByteSizeLong();
    event.stamp = FromProto(message.stamp());
    bool complete = false;
    if (message.has_checkpoint()) {
      event.checkpoint = true;
      Count(message.checkpoint(), &event);
      complete = message.checkpoint().last_part();
    } else if (message.has_delta()) {
      event.prev_revision = message.delta().prev_revision();
      event.evicted_objects += message.delta().evicted_objects_size();
      Count(message.delta(), &event);
      complete = message.delta().last_part();
    }
    if (!complete) continue;
    if (!callback(event)) {
      context.TryCancel();
      while (reader->Read(&message)) continue;
      reader->Finish();
      return absl::OkStatus();
    }
    event = {};
  }
  const grpc::Status status = reader->Finish();
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED && absl::Now() >= options.until) {
    return absl::OkStatus();
  }
  return CallStatus(status, client.address);
}

}  // namespace clearance::client
