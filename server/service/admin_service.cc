#include "server/service/admin_service.h"

#include <unistd.h>

#include <cmath>
#include <fstream>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/service/resolve.h"
#include "server/service/unary_call.h"

#ifndef CLEARANCE_VERSION
#define CLEARANCE_VERSION "0"
#endif
#ifndef CLEARANCE_BUILD
#define CLEARANCE_BUILD ""
#endif

namespace clearance {
namespace {

void ToProto(const std::string& stage, const LatencySummary& latency, v1::StageLatency* out) {
  out->set_stage(stage);
  out->mutable_latency()->set_count(latency.count);
  out->mutable_latency()->set_mean_ms(latency.mean_ms);
  out->mutable_latency()->set_p50_ms(latency.p50_ms);
  out->mutable_latency()->set_p95_ms(latency.p95_ms);
  out->mutable_latency()->set_p99_ms(latency.p99_ms);
  out->mutable_latency()->set_max_ms(latency.max_ms);
}

void FillMapStats(const MappingEngine& engine, v1::MapStats* out) {
  const ViewPtr view = engine.Latest();
  const EngineStats stats = engine.Stats();
  out->set_map(engine.id());
  ToProto(StampOf(*view), out->mutable_stamp());
  for (const SourceStatus& source : stats.sources) {
    out->set_frames_integrated(out->frames_integrated() + source.integrated);
    out->set_frames_dropped(out->frames_dropped() + source.dropped);
    out->set_frames_rejected(out->frames_rejected() + source.rejected);
    out->set_frames_duplicate(out->frames_duplicate() + source.duplicate);
  }
  out->set_queue_length(stats.queue_length);
  out->set_queue_capacity(stats.queue_capacity);
  out->set_memory_bytes(stats.sizes.memory_bytes);
  out->set_static_voxels(stats.sizes.static_voxels);
  out->set_field_blocks(stats.sizes.field_blocks);
  uint32_t counts[5] = {};
  for (const ObjectView& object : view->objects) ++counts[static_cast<int>(object.life_state)];
  out->set_tracked_objects(counts[static_cast<int>(LifeState::kTracked)]);
  out->set_coasting_objects(counts[static_cast<int>(LifeState::kCoasting)]);
  out->set_lost_objects(counts[static_cast<int>(LifeState::kLost)]);
  out->set_retired_objects(counts[static_cast<int>(LifeState::kRetired)]);
  for (const auto& [stage, latency] : stats.stages) ToProto(stage, latency, out->add_stages());
  if (stats.log) {
    v1::LogStats* log = out->mutable_log();
    log->set_first_record(stats.log->first_index);
    log->set_last_record(stats.log->last_index);
    log->set_segments(stats.log->segments);
    log->set_bytes(stats.log->bytes);
    log->set_appended(stats.log->appended);
    log->set_failed(stats.log->failed);
    log->set_syncs(stats.log->syncs);
  }
  out->set_evictions(stats.evictions);
  out->set_over_memory(stats.over_memory);
}

uint64_t SettledFrames(const ServiceContext& service) {
  uint64_t frames = 0;
  for (const auto& engine : service.registry->List()) {
    for (const SourceStatus& source : engine->Stats().sources) {
      frames += source.integrated + source.dropped + source.rejected;
    }
  }
  return frames;
}

}  // namespace

const char* ServerVersion() { return CLEARANCE_VERSION; }

ProcessUse ReadProcessUse() {
  ProcessUse use;
  uint64_t pages = 0, resident = 0;
  if (std::ifstream statm("/proc/self/statm"); statm >> pages >> resident) {
    use.resident_bytes = resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  }
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("Threads:")) use.threads = std::strtoul(line.c_str() + 8, nullptr, 10);
  }
  return use;
}

grpc::ServerUnaryReactor* AdminServiceImpl::GetServerInfo(grpc::CallbackServerContext*,
                                                          const v1::GetServerInfoRequest*,
                                                          v1::GetServerInfoResponse* response) {
  auto call = UnaryCall<v1::GetServerInfoResponse>::Start(service_, "GetServerInfo", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  v1::GetServerInfoResponse info;
  info.set_version(ServerVersion());
  info.set_api_version("v1");
  info.set_build(CLEARANCE_BUILD);
  const ServiceLimits& limits = service_->limits;
  v1::ServerLimits* out = info.mutable_limits();
  out->set_max_message_bytes(limits.max_message_bytes);
  out->set_max_query_points(limits.max_query_points);
  out->set_max_frame_points(limits.max_frame_points);
  out->set_max_motions(limits.max_motions);
  out->set_max_slice_cells(limits.max_slice_cells);
  out->set_max_maps(limits.max_maps);
  out->set_max_wait_s(limits.max_wait_s);
  info.set_uptime_s(service_->uptime_s());
  info.set_draining(service_->draining);
  for (const auto& engine : service_->registry->List()) info.add_maps(engine->id());
  call->Finish(std::move(info));
  return reactor;
}

grpc::ServerUnaryReactor* AdminServiceImpl::GetStats(grpc::CallbackServerContext*,
                                                     const v1::GetStatsRequest* request,
                                                     v1::GetStatsResponse* response) {
  auto call = UnaryCall<v1::GetStatsResponse>::Start(service_, "GetStats", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  v1::GetStatsResponse stats;
  if (request->map().empty()) {
    for (const auto& engine : service_->registry->List()) FillMapStats(*engine, stats.add_maps());
  } else {
    const absl::StatusOr<MapRegistry::EnginePtr> engine = service_->registry->Get(request->map());
    if (!engine.ok()) {
      call->Finish(engine.status());
      return reactor;
    }
    FillMapStats(**engine, stats.add_maps());
  }
  if (service_->registry->durable()) {
    const SnapshotterStats snapshots = service_->registry->snapshot_stats();
    stats.mutable_snapshots()->set_written(snapshots.written);
    stats.mutable_snapshots()->set_failed(snapshots.failed);
    stats.mutable_snapshots()->set_last_ms(snapshots.last_ms);
    stats.mutable_snapshots()->set_last_error(snapshots.last_error);
  }
  const ProcessUse use = ReadProcessUse();
  stats.set_resident_bytes(use.resident_bytes);
  stats.set_threads(use.threads);
  stats.set_open_streams(service_->open_streams);
  stats.set_uptime_s(service_->uptime_s());
  for (const auto& [method, latency] : service_->calls.Latencies()) {
    ToProto(method, latency.Summary(), stats.add_calls());
  }
  call->Finish(std::move(stats));
  return reactor;
}

grpc::ServerUnaryReactor* AdminServiceImpl::Drain(grpc::CallbackServerContext*,
                                                  const v1::DrainRequest* request,
                                                  v1::DrainResponse* response) {
  auto call = UnaryCall<v1::DrainResponse>::Start(service_, "Drain", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  constexpr double kMaxTimeoutS = 3600;
  const double timeout_s = request->timeout_s();
  if (!(timeout_s >= 0 && timeout_s <= kMaxTimeoutS)) {
    call->Finish(absl::InvalidArgumentError(
        absl::StrFormat("timeout_s: got %g, expected 0 to %g", timeout_s, kMaxTimeoutS)));
    return reactor;
  }
  const auto limit = std::chrono::milliseconds(static_cast<int64_t>(std::ceil(timeout_s * 1e3)));
  const absl::Status posted = service_->pool->Post([service = service_, call, limit] {
    const uint64_t before = SettledFrames(*service);
    if (!service->settle(limit)) {
      return call->Finish(absl::DeadlineExceededError(
          "frames are still waiting; they settle unless the server is stopped. Ask again"));
    }
    v1::DrainResponse drained;
    drained.set_settled_frames(SettledFrames(*service) - before);
    call->Finish(std::move(drained));
  });
  if (!posted.ok()) call->Finish(posted);
  return reactor;
}

}  // namespace clearance
