#include "server/service/ingest_sessions.h"

#include "server/service/ingest_stream.h"

namespace clearance {

bool IngestSessions::Open(const std::string& map, const std::string& source,
                          std::shared_ptr<IngestStream> stream) {
  MutexLock lock(&mu_);
  return streams_.emplace(Key(map, source), std::move(stream)).second;
}

void IngestSessions::Remove(const std::string& map, const std::string& source,
                            const IngestStream* stream) {
  std::shared_ptr<IngestStream> removed;  // freed without the lock
  MutexLock lock(&mu_);
  const auto it = streams_.find(Key(map, source));
  if (it == streams_.end() || it->second.get() != stream) return;
  removed = std::move(it->second);
  streams_.erase(it);
  changed_.NotifyAll();
}

void IngestSessions::CloseMap(const std::string& map, v1::IngestClosingReason reason) {
  std::vector<std::shared_ptr<IngestStream>> streams;
  {
    MutexLock lock(&mu_);
    for (const auto& [key, stream] : streams_) {
      if (key.first == map) streams.push_back(stream);
    }
  }
  for (const auto& stream : streams) stream->Close(reason);
}

void IngestSessions::CloseAll(v1::IngestClosingReason reason) {
  std::vector<std::shared_ptr<IngestStream>> streams;
  {
    MutexLock lock(&mu_);
    for (const auto& [key, stream] : streams_) streams.push_back(stream);
  }
  for (const auto& stream : streams) stream->Close(reason);
}

bool IngestSessions::WaitEmpty(std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(&mu_);
  while (!streams_.empty()) {
    if (!changed_.WaitUntil(&mu_, deadline) && std::chrono::steady_clock::now() >= deadline) {
      return streams_.empty();
    }
  }
  return true;
}

}  // namespace clearance
