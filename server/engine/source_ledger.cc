#include "server/engine/source_ledger.h"

#include <utility>

#include "absl/strings/str_format.h"

namespace clearance {

SourceLedger::Judgement SourceLedger::Judge(uint64_t frame_id, int64_t stamp_ns) const {
  Judgement result;
  if (pending_.contains(frame_id)) {
    result.kind = Judgement::Kind::kPending;
    return result;
  }
  if (const auto it = settled_.find(frame_id); it != settled_.end()) {
    result.kind = Judgement::Kind::kSettled;
    result.stamp = it->second;
    return result;
  }
  if (last_admitted_id_ && frame_id <= *last_admitted_id_) {
    result.kind = Judgement::Kind::kRefused;
    result.violation = {"frame.frame_id", -1,
                        absl::StrFormat("got %d, must rise strictly per source: the newest is %d",
                                        frame_id, *last_admitted_id_)};
    return result;
  }
  if (last_stamp_ns_ && stamp_ns <= *last_stamp_ns_) {
    result.violation = {"frame.stamp_ns", -1,
                        absl::StrFormat("got %d, must rise strictly per source: the newest is %d",
                                        stamp_ns, *last_stamp_ns_)};
  }
  return result;
}

void SourceLedger::Admit(uint64_t frame_id, std::optional<int64_t> stamp_ns) {
  last_admitted_id_ = frame_id;
  if (stamp_ns) last_stamp_ns_ = stamp_ns;
  pending_[frame_id];
}

void SourceLedger::AddRepeat(uint64_t frame_id, FrameCallback done) {
  pending_[frame_id].push_back(std::move(done));
}

std::vector<FrameCallback> SourceLedger::Settle(const FrameAck& ack) {
  switch (ack.status) {
    case FrameAck::Status::kIntegrated:
      ++integrated_;
      break;
    case FrameAck::Status::kDropped:
      ++dropped_;
      break;
    default:
      ++rejected_;
  }
  last_settled_id_ = ack.frame_id;
  settled_.emplace(ack.frame_id, ack.stamp);
  settled_order_.push_back(ack.frame_id);
  if (settled_order_.size() > window_) {
    settled_.erase(settled_order_.front());
    settled_order_.pop_front();
  }
  return Abandon(ack.frame_id);
}

std::vector<FrameCallback> SourceLedger::Abandon(uint64_t frame_id) {
  const auto it = pending_.find(frame_id);
  if (it == pending_.end()) return {};
  std::vector<FrameCallback> repeats = std::move(it->second);
  pending_.erase(it);
  return repeats;
}

}  // namespace clearance
