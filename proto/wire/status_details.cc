#include "proto/wire/status_details.h"

#include <charconv>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "google/rpc/error_details.pb.h"

namespace clearance::wire {
namespace {

// This release of Abseil has a string_view of its own.
absl::string_view Abseil(std::string_view s) { return {s.data(), s.size()}; }

constexpr absl::string_view kBadRequestUrl = "type.googleapis.com/google.rpc.BadRequest";
constexpr absl::string_view kRetryInfoUrl = "type.googleapis.com/google.rpc.RetryInfo";

template <typename Message>
void Attach(absl::Status& status, absl::string_view url, const Message& message) {
  status.SetPayload(url, absl::Cord(message.SerializeAsString()));
}

template <typename Message>
std::optional<Message> Find(const absl::Status& status, absl::string_view url) {
  const auto payload = status.GetPayload(url);
  Message message;
  if (!payload || !message.ParseFromString(std::string(*payload))) return std::nullopt;
  return message;
}

// The number in the last [..] of a path; a trailing one is cut off the path.
int64_t TakeIndex(std::string& path) {
  const size_t open = path.rfind('[');
  const size_t close = path.find(']', open == std::string::npos ? 0 : open);
  if (open == std::string::npos || close == std::string::npos) return -1;
  int64_t index = -1;
  const char* end = path.data() + close;
  if (std::from_chars(path.data() + open + 1, end, index).ptr != end) return -1;
  if (close + 1 == path.size()) path.resize(open);
  return index;
}

}  // namespace

absl::Status InvalidField(std::string_view field, int64_t index, std::string_view got,
                          std::string_view expected) {
  std::string path(field);
  if (index >= 0) absl::StrAppend(&path, "[", index, "]");
  const std::string description =
      absl::StrCat("got ", Abseil(got), "; expected ", Abseil(expected));
  absl::Status status = absl::InvalidArgumentError(absl::StrCat(path, ": ", description));
  google::rpc::BadRequest details;
  auto* violation = details.add_field_violations();
  violation->set_field(path);
  violation->set_description(description);
  Attach(status, kBadRequestUrl, details);
  return status;
}

std::string Path(std::string_view outer, std::string_view inner) {
  return outer.empty() ? std::string(inner) : absl::StrCat(Abseil(outer), ".", Abseil(inner));
}

std::string PathAt(std::string_view outer, std::string_view inner, size_t index) {
  return absl::StrCat(Path(outer, inner), "[", index, "]");
}

absl::Status WithRetry(absl::Status status, absl::Duration delay) {
  google::rpc::RetryInfo info;
  const int64_t ns = absl::ToInt64Nanoseconds(delay);
  info.mutable_retry_delay()->set_seconds(ns / 1'000'000'000);
  info.mutable_retry_delay()->set_nanos(static_cast<int32_t>(ns % 1'000'000'000));
  Attach(status, kRetryInfoUrl, info);
  return status;
}

std::optional<absl::Duration> RetryDelayOf(const absl::Status& status) {
  const auto info = Find<google::rpc::RetryInfo>(status, kRetryInfoUrl);
  if (!info) return std::nullopt;
  return absl::Seconds(info->retry_delay().seconds()) +
         absl::Nanoseconds(info->retry_delay().nanos());
}

std::vector<Violation> ViolationsOf(const absl::Status& status) {
  if (status.ok()) return {};
  std::vector<Violation> violations;
  if (const auto details = Find<google::rpc::BadRequest>(status, kBadRequestUrl)) {
    for (const auto& v : details->field_violations()) {
      Violation violation;
      violation.field = v.field();
      violation.description = v.description();
      violation.index = TakeIndex(violation.field);
      violations.push_back(std::move(violation));
    }
  }
  if (violations.empty()) {
    violations.emplace_back().description = std::string(status.message());
  }
  return violations;
}

}  // namespace clearance::wire
