#include "server/service/http/metrics.h"

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <sstream>
#include <utility>
#include <vector>

#include "server/service/admin_service.h"

namespace clearance {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<std::pair<std::string, std::string>>;

class Families {
 public:
  void Gauge(const char* name, const char* help, double value, const Labels& labels = {}) {
    Add(name, help, MetricType::Gauge, labels).gauge.value = value;
  }
  void Counter(const char* name, const char* help, double value, const Labels& labels = {}) {
    Add(name, help, MetricType::Counter, labels).counter.value = value;
  }
  void Histogram(const char* name, const char* help, const LatencyHistogram& histogram,
                 const Labels& labels) {
    static constexpr double kBoundsMs[] = {0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 10000};
    ClientMetric& metric = Add(name, help, MetricType::Histogram, labels);
    metric.histogram.sample_count = histogram.count();
    metric.histogram.sample_sum = histogram.sum_ms() * 1e-3;
    for (const double ms : kBoundsMs) {
      metric.histogram.bucket.push_back({histogram.CountUpTo(ms), ms * 1e-3});
    }
  }
  std::string Text() const {
    std::ostringstream out;
    prometheus::TextSerializer().Serialize(out, families_);
    return out.str();
  }

 private:
  ClientMetric& Add(const char* name, const char* help, MetricType type, const Labels& labels) {
    MetricFamily* family = nullptr;
    for (MetricFamily& known : families_) {
      if (known.name == name) family = &known;
    }
    if (family == nullptr) family = &families_.emplace_back(MetricFamily{name, help, type, {}});
    ClientMetric& metric = family->metric.emplace_back();
    for (const auto& [label, value] : labels) metric.label.push_back({label, value});
    return metric;
  }

  std::vector<MetricFamily> families_;
};

void AddMap(const MappingEngine& engine, Families* out) {
  const ViewPtr view = engine.Latest();
  const EngineStats stats = engine.Stats();
  const Labels map = {{"map", engine.id()}};
  const auto with = [&](const char* label, const std::string& value) {
    Labels labels = map;
    labels.emplace_back(label, value);
    return labels;
  };
  out->Gauge("clearance_map_revision", "Newest revision", view->revision, map);
  out->Gauge("clearance_map_field_revision", "Newest revision in the distance field",
             view->field_revision, map);
  out->Gauge(
      "clearance_map_staleness_seconds", "Since the newest frame was published",
      std::chrono::duration<double>(std::chrono::steady_clock::now() - view->published_at).count(),
      map);
  out->Gauge("clearance_map_memory_bytes", "Memory of the map", stats.sizes.memory_bytes, map);
  out->Gauge("clearance_queue_frames", "Frames that wait", stats.queue_length, map);
  const char* kFrames = "clearance_frames_total";
  const char* kFramesHelp = "Settled frames by outcome";
  double integrated = 0, dropped = 0, rejected = 0, duplicate = 0;
  for (const SourceStatus& source : stats.sources) {
    integrated += source.integrated;
    dropped += source.dropped;
    rejected += source.rejected;
    duplicate += source.duplicate;
  }
  out->Counter(kFrames, kFramesHelp, integrated, with("status", "integrated"));
  out->Counter(kFrames, kFramesHelp, dropped, with("status", "dropped"));
  out->Counter(kFrames, kFramesHelp, rejected, with("status", "rejected"));
  out->Counter(kFrames, kFramesHelp, duplicate, with("status", "duplicate"));
  uint64_t counts[5] = {};
  for (const ObjectView& object : view->objects) ++counts[static_cast<int>(object.life_state)];
  static constexpr const char* kStates[] = {"", "tracked", "coasting", "lost", "retired"};
  for (int s = 1; s < 5; ++s) {
    out->Gauge("clearance_objects", "Objects by life state", counts[s], with("state", kStates[s]));
  }
  if (stats.log) {
    out->Counter("clearance_log_records_total", "Records appended to the frame log",
                 stats.log->appended, map);
    out->Counter("clearance_log_failures_total", "Records that the frame log could not take",
                 stats.log->failed, map);
    out->Gauge("clearance_log_bytes", "Size of the frame log", stats.log->bytes, map);
    out->Gauge("clearance_log_segments", "Files of the frame log", stats.log->segments, map);
  }
  out->Counter("clearance_evictions_total", "Times the map forgot what is far", stats.evictions,
               map);
  out->Gauge("clearance_over_memory", "1 while a memory limit refuses frames",
             stats.over_memory.empty() ? 0 : 1, map);
  for (const auto& [stage, latency] : stats.stages) {
    out->Gauge("clearance_stage_p95_seconds", "95th percentile of a stage of integration",
               latency.p95_ms * 1e-3, with("stage", stage));
  }
}

}  // namespace

std::string MetricsText(const ServiceContext& service) {
  Families out;
  const ProcessUse use = ReadProcessUse();
  out.Gauge("clearance_uptime_seconds", "Since the server started", service.uptime_s());
  out.Gauge("clearance_draining", "1 while the server drains", service.draining ? 1 : 0);
  out.Gauge("clearance_resident_bytes", "Resident memory", use.resident_bytes);
  out.Gauge("clearance_threads", "Threads", use.threads);
  out.Gauge("clearance_open_streams", "Open streams", service.open_streams);
  if (service.registry->durable()) {
    const SnapshotterStats snapshots = service.registry->snapshot_stats();
    const char* kName = "clearance_snapshots_total";
    const char* kHelp = "Snapshots by outcome";
    out.Counter(kName, kHelp, snapshots.written, {{"outcome", "written"}});
    out.Counter(kName, kHelp, snapshots.failed, {{"outcome", "failed"}});
    out.Gauge("clearance_snapshot_seconds", "Duration of the newest snapshot",
              snapshots.last_ms * 1e-3);
  }
  out.Gauge("clearance_loading", "1 while maps are recovered", service.registry->loading() ? 1 : 0);
  for (const auto& engine : service.registry->List()) AddMap(*engine, &out);
  for (const CallStats::Entry& entry : service.calls.Counts()) {
    out.Counter("clearance_calls_total", "Finished calls by method and code", entry.count,
                {{"method", entry.method}, {"code", absl::StatusCodeToString(entry.code)}});
  }
  for (const auto& [method, latency] : service.calls.Latencies()) {
    out.Histogram("clearance_call_seconds", "Latency of calls", latency, {{"method", method}});
  }
  return out.Text();
}

}  // namespace clearance
