// One episode's map on the server: frames go in, one at a time, and look-ups come out of a mirror.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/esdf_client.h"
#include "client/mirror/mirror.h"
#include "planner_demo/plan/clearance_probe.h"

namespace clearance::demo {

// Where look-ups are answered: in this process, or by a call to the server.
enum class Source { kMirror, kRemote };

class MapLink {
 public:
  // Makes the map anew. `client` must outlive the link.
  static absl::StatusOr<std::unique_ptr<MapLink>> Open(const client::EsdfClient& client,
                                                       const std::string& map,
                                                       const wire::MapSettings& settings,
                                                       double max_range_m, Source source);
  ~MapLink();  // the map goes, too

  // Sends the frame and waits until it is integrated and look-ups see it, for at most `patience`:
  // DEADLINE_EXCEEDED where that is not so by then. Errors as of the stream; FAILED_PRECONDITION
  // for a frame that was refused.
  absl::Status Integrate(const Frame& frame, absl::Duration patience = absl::Seconds(20));

  // The newest frame that look-ups see, and how long its integration took on the server.
  double map_time_s() const;
  double integrate_ms() const;

  // For ClearanceProbe. The link must outlive it.
  Lookup lookup() const;
  const client::EsdfClient& client() const { return client_; }
  const std::string& map() const { return map_; }

 private:
  MapLink(const client::EsdfClient& client, std::string map)
      : client_(client), map_(std::move(map)) {}

  const client::EsdfClient& client_;
  const std::string map_;
  mutable std::mutex mutex_;
  std::condition_variable acked_;
  client::FrameAck newest_;                         // guarded by mutex_
  std::unique_ptr<client::Mirror> mirror_;          // where that is the source
  std::unique_ptr<client::DistanceSource> remote_;  // else
  std::unique_ptr<client::IngestStream> stream_;
};

}  // namespace clearance::demo
