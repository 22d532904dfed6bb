#include "server/engine/log_record.h"

#include "server/core/bytes.h"

namespace clearance {

std::string EncodeHead(const LogRecord& record) {
  ByteWriter out;
  out.Put(record.kind);
  switch (record.kind) {
    case LogRecord::Kind::kFrame:
    case LogRecord::Kind::kStripped:
      break;
    case LogRecord::Kind::kRejected:
      out.PutText(record.source_id);
      out.Put(record.frame_id);
      break;
    case LogRecord::Kind::kEdit: {
      const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
      out.Put(record.edit.action);
      out.Put<uint8_t>(record.edit.box.has_value());
      out.PutMatrix(record.edit.box ? record.edit.box->min() : zero);
      out.PutMatrix(record.edit.box ? record.edit.box->max() : zero);
      out.PutMatrix(record.edit.sphere_centre.value_or(zero));
      out.Put(record.edit.sphere_radius_m);
      break;
    }
    case LogRecord::Kind::kEviction:
      out.PutMatrix(record.eviction.centre_W);
      out.Put(record.eviction.radius_m);
      break;
  }
  return out.Take();
}

absl::StatusOr<LogRecord> DecodeRecord(std::string_view bytes) {
  ByteReader in(bytes, "log record");
  LogRecord record;
  record.kind = in.Get<LogRecord::Kind>();
  switch (record.kind) {
    case LogRecord::Kind::kFrame:
    case LogRecord::Kind::kStripped:
      record.frame = in.rest();
      return record;
    case LogRecord::Kind::kRejected:
      record.source_id = std::string(in.GetText());
      record.frame_id = in.Get<uint64_t>();
      break;
    case LogRecord::Kind::kEdit: {
      record.edit.action = in.Get<RegionAction>();
      const bool is_box = in.Get<uint8_t>() != 0;
      Eigen::Vector3d low, high, centre;
      in.GetMatrix(low);
      in.GetMatrix(high);
      in.GetMatrix(centre);
      if (is_box) {
        record.edit.box = Aabb(low, high);
      } else {
        record.edit.sphere_centre = centre;
      }
      record.edit.sphere_radius_m = in.Get<double>();
      break;
    }
    case LogRecord::Kind::kEviction:
      in.GetMatrix(record.eviction.centre_W);
      record.eviction.radius_m = in.Get<double>();
      break;
    default:
      return in.Error("of an unknown kind");
  }
  if (absl::Status s = in.Finish(); !s.ok()) return s;
  return record;
}

}  // namespace clearance
