#include "client/convert.h"

namespace clearance::client {
namespace {

Latency FromProto(const v1::StageLatency& stage) {
  const v1::Latency& l = stage.latency();
  return {stage.stage(), l.count(), l.mean_ms(), l.p50_ms(), l.p95_ms(), l.p99_ms(), l.max_ms()};
}

MapStats FromProto(const v1::MapStats& map) {
  MapStats stats;
  stats.map = map.map();
  stats.stamp = client::FromProto(map.stamp());
  stats.frames_integrated = map.frames_integrated();
  stats.frames_dropped = map.frames_dropped();
  stats.frames_rejected = map.frames_rejected();
  stats.frames_duplicate = map.frames_duplicate();
  stats.queue_length = map.queue_length();
  stats.queue_capacity = map.queue_capacity();
  stats.memory_bytes = map.memory_bytes();
  stats.static_voxels = map.static_voxels();
  stats.field_blocks = map.field_blocks();
  stats.tracked_objects = map.tracked_objects();
  stats.coasting_objects = map.coasting_objects();
  stats.lost_objects = map.lost_objects();
  stats.retired_objects = map.retired_objects();
  for (const v1::StageLatency& stage : map.stages()) stats.stages.push_back(FromProto(stage));
  return stats;
}

}  // namespace

ServerStats FromProto(const v1::GetStatsResponse& reply) {
  ServerStats stats;
  for (const v1::MapStats& map : reply.maps()) stats.maps.push_back(FromProto(map));
  stats.resident_bytes = reply.resident_bytes();
  stats.open_streams = reply.open_streams();
  stats.threads = reply.threads();
  stats.uptime_s = reply.uptime_s();
  for (const v1::StageLatency& call : reply.calls()) stats.calls.push_back(FromProto(call));
  return stats;
}

}  // namespace clearance::client
