// Which ingest streams are open: one for each source of a map.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "clearance/v1/ingest.pb.h"
#include "server/engine/mutex.h"

namespace clearance {

class IngestStream;

// Thread-safe.
class IngestSessions {
 public:
  // False where another stream of this source is open.
  bool Open(const std::string& map, const std::string& source,
            std::shared_ptr<IngestStream> stream);
  // Does nothing where `stream` is not the open one.
  void Remove(const std::string& map, const std::string& source, const IngestStream* stream);

  // Tells the streams of a map, or all, to end: acks first, then IngestClosing.
  void CloseMap(const std::string& map, v1::IngestClosingReason reason);
  void CloseAll(v1::IngestClosingReason reason);
  // Whether all streams have ended before the deadline.
  bool WaitEmpty(std::chrono::steady_clock::time_point deadline);

 private:
  using Key = std::pair<std::string, std::string>;
  Mutex mu_;
  CondVar changed_;
  std::map<Key, std::shared_ptr<IngestStream>> streams_ ABSL_GUARDED_BY(mu_);
};

}  // namespace clearance
