// Which frames of one source are settled: ids and stamps rise strictly, repeats change nothing.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <unordered_map>
#include <vector>

#include "server/core/bytes.h"
#include "server/engine/frame_ack.h"

namespace clearance {

// Not thread-safe; the engine locks.
class SourceLedger {
 public:
  // Ids older than the newest `window` settled ones are forgotten and count as going back.
  explicit SourceLedger(size_t window = 4096) : window_(window) {}

  struct Judgement {
    enum class Kind { kNew, kPending, kSettled, kRefused };
    Kind kind = Kind::kNew;
    RevisionStamp stamp;  // kSettled: the first settling
    Violation
        violation;  // kRefused: id going back. kNew: a stamp going back, when field is not empty
  };
  // kNew with a violation: the id is new, so that the frame settles, but as REJECTED.
  Judgement Judge(uint64_t frame_id, int64_t stamp_ns) const;

  // A frame that Judge called new waits for its turn. `stamp_ns` absent: it will be rejected.
  void Admit(uint64_t frame_id, std::optional<int64_t> stamp_ns);
  // A repeat of a pending frame is told when that settles.
  void AddRepeat(uint64_t frame_id, FrameCallback done);
  // For snapshots: what is settled, in the order of settling; frames that wait are not in it.
  void Save(ByteWriter* out) const;
  static SourceLedger Load(ByteReader* in, size_t window);

  // Returns the callbacks of repeats.
  std::vector<FrameCallback> Settle(const FrameAck& ack);
  // The frame leaves unsettled; it may come again. Returns the callbacks of repeats.
  std::vector<FrameCallback> Abandon(uint64_t frame_id);

  std::optional<uint64_t> last_settled_id() const { return last_settled_id_; }
  int64_t last_stamp_ns() const { return last_stamp_ns_.value_or(0); }
  uint64_t integrated() const { return integrated_; }
  uint64_t dropped() const { return dropped_; }
  uint64_t rejected() const { return rejected_; }
  uint64_t duplicate() const { return duplicate_; }
  void CountDuplicate() { ++duplicate_; }

 private:
  size_t window_;
  std::optional<uint64_t> last_admitted_id_, last_settled_id_;
  std::optional<int64_t> last_stamp_ns_, last_settled_stamp_ns_;
  std::unordered_map<uint64_t, RevisionStamp> settled_;
  std::deque<uint64_t> settled_order_;
  struct Pending {
    std::optional<int64_t> stamp_ns;
    std::vector<FrameCallback> repeats;
  };
  std::unordered_map<uint64_t, Pending> pending_;
  uint64_t integrated_ = 0, dropped_ = 0, rejected_ = 0, duplicate_ = 0;
};

}  // namespace clearance
