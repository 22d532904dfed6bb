// ingest: a recorded sequence streams into a map.
#include <algorithm>
#include <charconv>
#include <iostream>
#include <thread>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/context.h"
#include "client/cli/frame_prefetcher.h"
#include "client/cli/ingest_counts.h"
#include "client/cli/print.h"
#include "client/cli/progress.h"

namespace clearance::cli {
namespace {

struct Arguments {
  std::string folder;
  double voxel_size_m = 0;
  std::string rate = "max";
  uint64_t frames = 0;
  std::string source;
};

// 0 = as fast as acknowledged, otherwise a multiple of the recorded rate.
bool ParseRate(const std::string& text, double* rate) {
  if (text == "max") return *rate = 0, true;
  if (text == "recorded") return *rate = 1, true;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), *rate);
  return result.ec == std::errc() && result.ptr == text.data() + text.size() && *rate > 0 &&
         *rate < 1e6;
}

// The map's info; creates it where it is missing.
absl::StatusOr<client::MapInfo> FindOrCreateMap(const client::EsdfClient& client,
                                                const std::string& map,
                                                const client::Sequence& sequence,
                                                double voxel_size_m) {
  auto info = client.GetMap(map);
  if (info.ok()) {
    const double has = info->settings.voxel_size_m.value_or(0);
    if (voxel_size_m > 0 && std::abs(has - voxel_size_m) > 1e-9) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "map %s exists with voxel_size_m %g, got --voxel-size-m %g; name another with --map or "
          "delete it: clearance map delete %s",
          map, has, voxel_size_m, map));
    }
    return info;
  }
  if (info.status().code() != absl::StatusCode::kNotFound) return info.status();
  const double voxel = voxel_size_m > 0 ? voxel_size_m : sequence.info().voxel_size_m.value_or(0);
  if (voxel <= 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s/sequence.json has no voxel_size_m and map %s does not exist; say --voxel-size-m METRES",
        sequence.folder().string(), map));
  }
  wire::MapSettings settings;
  settings.voxel_size_m = voxel;
  if (sequence.info().max_range_m > 0) settings.max_range_m = sequence.info().max_range_m;
  return client.CreateMap(map, settings);
}

// Asks now and then how many objects are alive, for the progress line alone.
class ObjectCounter {
 public:
  ObjectCounter(const client::EsdfClient& client, std::string map)
      : client_(client), map_(std::move(map)) {}
  int Get() {
    if (absl::Now() - asked_ > absl::Seconds(1)) {
      const auto info = client_.GetMap(map_);
      if (info.ok()) count_ = static_cast<int>(info->live_objects);
      asked_ = absl::Now();
    }
    return count_;
  }

 private:
  const client::EsdfClient& client_;
  const std::string map_;
  absl::Time asked_ = absl::InfinitePast();
  int count_ = -1;
};

class Ingest {
 public:
  Ingest(const Context& context, const Arguments& arguments, double rate,
         const client::Sequence& sequence, const client::EsdfClient& client)
      : context_(context),
        rate_(rate),
        sequence_(sequence),
        client_(client),
        map_(context.map.empty() ? sequence.Id() : context.map),
        source_(arguments.source.empty() ? sequence.Id() : arguments.source),
        end_(arguments.frames == 0 ? sequence.size()
                                   : std::min(sequence.size(), arguments.frames)) {}

  absl::Status Run(double voxel_size_m) {
    const auto info = FindOrCreateMap(client_, map_, sequence_, voxel_size_m);
    if (!info.ok()) return info.status();
    const absl::Time start = absl::Now();
    absl::Status status;
    // A restored or re-created map stands further back: its frames are sent again.
    for (int attempt = 0; attempt < 3; ++attempt) {
      status = Stream();
      if (status.code() != absl::StatusCode::kAborted) break;
      std::cerr << "clearance: " << status.message() << "\n";
    }
    if (!status.ok()) return status;
    Summarise(absl::ToDoubleSeconds(absl::Now() - start));
    return absl::OkStatus();
  }

 private:
  absl::Status Stream() {
    client::IngestOptions options;
    options.map = map_;
    options.source_id = source_;
    options.max_range_m = sequence_.info().max_range_m;
    options.on_ack = [this](const client::FrameAck& ack) { counts_.Add(ack); };
    const auto opened = client_.OpenIngest(options);
    if (!opened.ok()) return opened.status();
    client::IngestStream& stream = **opened;
    const uint64_t first = stream.last_frame_id() ? *stream.last_frame_id() + 1 : 0;
    skipped_ = std::min(first, end_);
    if (skipped_ > 0 && !context_.json) {
      std::cerr << absl::StrFormat("map %s stands at frame %d of %d; continuing behind it\n", map_,
                                   first - 1, sequence_.size());
    }
    const bool show = IsTerminal() && !context_.json;
    Progress progress(end_, skipped_, show);
    ObjectCounter objects(client_, map_);
    const uint64_t settled_before = counts_.settled();
    FramePrefetcher frames(sequence_, skipped_, end_);
    const absl::Time start = absl::Now();
    absl::Status status;
    for (uint64_t i = skipped_; i < end_ && status.ok(); ++i) {
      auto frame = frames.Next();
      if (!frame.ok()) {
        progress.Clear();
        // What came before the damaged file still counts.
        stream.Finish().IgnoreError();
        return frame.status();
      }
      Pace(start, i);
      status = stream.Send(*frame);
      if (show) progress.Show(skipped_ + counts_.settled() - settled_before, objects.Get());
    }
    if (status.ok()) status = stream.Finish();
    reconnects_ += stream.reconnects();
    progress.Clear();
    return status;
  }

  // At the recorded rate: frame i leaves when its stamp says so.
  void Pace(absl::Time start, uint64_t i) const {
    if (rate_ <= 0) return;
    const int64_t offset_ns = sequence_.stamp_ns(i) - sequence_.stamp_ns(skipped_);
    absl::SleepFor(start + absl::Nanoseconds(offset_ns) / rate_ - absl::Now());
  }

  void Summarise(double seconds) const {
    const IngestSummary s = counts_.Get();
    const double frames_per_s = seconds > 0 ? static_cast<double>(s.settled()) / seconds : 0;
    const auto info = client_.GetMap(map_);
    const uint32_t objects = info.ok() ? info->live_objects : 0;
    if (context_.json) {
      PrintJson({{"map", map_},
                 {"source_id", source_},
                 {"frames", end_},
                 {"resumed_behind", skipped_},
                 {"integrated", s.integrated},
                 {"duplicate", s.duplicate},
                 {"dropped", s.dropped},
                 {"rejected", s.rejected},
                 {"violations", s.violations},
                 {"first_violations", s.first_violations},
                 {"reconnects", reconnects_},
                 {"seconds", seconds},
                 {"frames_per_s", frames_per_s},
                 {"integrate_ms_p50", Percentile(s.integrate_ms, 0.5)},
                 {"integrate_ms_p95", Percentile(s.integrate_ms, 0.95)},
                 {"queue_ms_p95", Percentile(s.queue_ms, 0.95)},
                 {"objects_alive", objects},
                 {"stamp", ToJson(info.ok() ? info->stamp : s.stamp)}});
      return;
    }
    std::cout << absl::StrFormat(
        "%s: %d frames integrated in %.1f s (%.1f frames/s), integration %.1f ms (p95 %.1f), "
        "%d objects alive, revision %d\n",
        map_, s.integrated, seconds, frames_per_s, Percentile(s.integrate_ms, 0.5),
        Percentile(s.integrate_ms, 0.95), objects,
        info.ok() ? info->stamp.revision : s.stamp.revision);
    if (s.settled() == 0) std::cout << "nothing to send: the map has all frames\n";
    if (s.duplicate + s.dropped + s.rejected > 0) {
      std::cout << absl::StrFormat("%d duplicate, %d dropped, %d rejected\n", s.duplicate,
                                   s.dropped, s.rejected);
    }
    if (s.violations > 0) {
      std::cout << absl::StrFormat("%d violations, the first:\n", s.violations);
      for (const std::string& v : s.first_violations) std::cout << "  " << v << "\n";
    }
  }

  const Context& context_;
  const double rate_;
  const client::Sequence& sequence_;
  const client::EsdfClient& client_;
  const std::string map_, source_;
  const uint64_t end_;
  uint64_t skipped_ = 0;
  uint64_t reconnects_ = 0;
  IngestCounts counts_;
};

absl::Status RunIngest(const Context& context, const Arguments& arguments) {
  double rate = 0;
  ParseRate(arguments.rate, &rate);
  const auto sequence = client::Sequence::Open(arguments.folder);
  if (!sequence.ok()) return sequence.status();
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  return Ingest(context, arguments, rate, *sequence, **client).Run(arguments.voxel_size_m);
}

}  // namespace

void AddIngest(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      AddCommand(app, context, "ingest", "stream a recorded sequence folder into a map",
                 [&context, arguments] { return RunIngest(context, *arguments); });
  command->add_option("folder", arguments->folder, "with sequence.json")->required();
  command->add_option("--voxel-size-m", arguments->voxel_size_m, "of a map that is created")
      ->check(CLI::PositiveNumber);
  command
      ->add_option("--rate", arguments->rate,
                   "max (as fast as acknowledged), recorded, or a multiple of the recorded rate")
      ->check([](const std::string& text) {
        double rate = 0;
        return ParseRate(text, &rate)
                   ? std::string()
                   : "got " + text + ", expected max, recorded or a number above 0";
      })
      ->capture_default_str();
  command->add_option("--frames", arguments->frames, "only the first so many frames")
      ->check(CLI::PositiveNumber);
  command->add_option("--source", arguments->source,
                      "the source's id (default: the folder's name)");
}

}  // namespace clearance::cli
