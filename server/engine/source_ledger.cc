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
  pending_[frame_id].stamp_ns = stamp_ns;
}

void SourceLedger::AddRepeat(uint64_t frame_id, FrameCallback done) {
  pending_[frame_id].repeats.push_back(std::move(done));
}

void SourceLedger::Save(ByteWriter* out) const {
  out->Put<uint8_t>(last_settled_stamp_ns_.has_value());
  out->Put(last_settled_stamp_ns_.value_or(0));
  for (uint64_t count : {integrated_, dropped_, rejected_, duplicate_}) out->Put(count);
  out->Put<uint64_t>(settled_order_.size());
  for (uint64_t frame_id : settled_order_) {
    const RevisionStamp& stamp = settled_.at(frame_id);
    out->Put(frame_id);
    out->Put(stamp.revision);
    out->Put(stamp.field_revision);
    out->Put(stamp.epoch);
    out->Put(stamp.stamp_ns);
  }
}

SourceLedger SourceLedger::Load(ByteReader* in, size_t window) {
  SourceLedger ledger(window);
  const bool stamped = in->Get<uint8_t>() != 0;
  const int64_t stamp_ns = in->Get<int64_t>();
  if (stamped) ledger.last_stamp_ns_ = ledger.last_settled_stamp_ns_ = stamp_ns;
  for (uint64_t* count :
       {&ledger.integrated_, &ledger.dropped_, &ledger.rejected_, &ledger.duplicate_}) {
    *count = in->Get<uint64_t>();
  }
  for (size_t left = in->GetCount(5 * sizeof(uint64_t)); left > 0; --left) {
    const uint64_t frame_id = in->Get<uint64_t>();
    RevisionStamp stamp;
    stamp.revision = in->Get<uint64_t>();
    stamp.field_revision = in->Get<uint64_t>();
    stamp.epoch = in->Get<uint64_t>();
    stamp.stamp_ns = in->Get<int64_t>();
    ledger.settled_.emplace(frame_id, stamp);
    ledger.settled_order_.push_back(frame_id);
    ledger.last_admitted_id_ = ledger.last_settled_id_ = frame_id;
  }
  return ledger;
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
  if (const auto it = pending_.find(ack.frame_id); it != pending_.end() && it->second.stamp_ns) {
    last_settled_stamp_ns_ = it->second.stamp_ns;
  }
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
  std::vector<FrameCallback> repeats = std::move(it->second.repeats);
  pending_.erase(it);
  return repeats;
}

}  // namespace clearance
