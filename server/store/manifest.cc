#include "server/store/manifest.h"

#include <nlohmann/json.hpp>

#include "absl/strings/escaping.h"
#include "absl/strings/str_format.h"
#include "server/core/crc32c.h"

namespace clearance {
namespace {

using Json = nlohmann::ordered_json;

// Deeper than any document of ours: dump() recurses, and a damaged one must not end the process.
constexpr int kMaxDepth = 16;

// Discarded where `text` is no JSON or too deep.
Json ParseShallow(std::string_view text) {
  bool too_deep = false;
  const auto check = [&too_deep](int depth, Json::parse_event_t, Json&) {
    too_deep |= depth > kMaxDepth;
    return !too_deep;
  };
  Json document = Json::parse(text, check, /*allow_exceptions=*/false);
  return too_deep ? Json(Json::value_t::discarded) : document;
}

}  // namespace

uint64_t SnapshotManifest::total_bytes() const {
  uint64_t total = 0;
  for (const FileEntry& file : files) total += file.bytes;
  return total;
}

std::string ToHex(std::string_view bytes) {
  return absl::BytesToHexString(absl::string_view(bytes.data(), bytes.size()));
}

std::string FromHex(std::string_view digits) {
  if (digits.size() % 2 != 0) return "";
  if (digits.find_first_not_of("0123456789abcdef") != std::string_view::npos) return "";
  return absl::HexStringToBytes(absl::string_view(digits.data(), digits.size()));
}

std::string SealJson(std::string_view what, std::string_view content) {
  Json document;
  Json& inner = document[std::string(what)];
  inner = Json::parse(content);
  document["crc32c"] = absl::StrFormat("%08x", Crc32c(inner.dump()));
  return document.dump(2) + "\n";
}

absl::StatusOr<std::string> OpenSealedJson(std::string_view what, std::string_view text,
                                           uint32_t newest_version) {
  const Json document = ParseShallow(text);
  const std::string key(what);
  if (!document.is_object() || !document.contains(key) || !document[key].is_object() ||
      !document.contains("crc32c") || !document["crc32c"].is_string()) {
    return absl::DataLossError(absl::StrFormat("no %s of this format", what));
  }
  const Json& inner = document[key];
  const std::string dumped = inner.dump(-1, ' ', false, Json::error_handler_t::replace);
  const std::string crc = absl::StrFormat("%08x", Crc32c(dumped));
  if (crc != document["crc32c"].get<std::string>()) {
    return absl::DataLossError(absl::StrFormat("the %s has a wrong checksum", what));
  }
  const auto version = inner.find("format_version");
  if (version == inner.end() || !version->is_number_unsigned()) {
    return absl::DataLossError(absl::StrFormat("the %s has no format_version", what));
  }
  if (version->get<uint64_t>() > newest_version) {
    return absl::FailedPreconditionError(
        absl::StrFormat("the %s has format version %d; this server knows up to %d", what,
                        version->get<uint64_t>(), newest_version));
  }
  return dumped;
}

std::string EncodeManifest(const SnapshotManifest& m) {
  Json json = {{"format_version", m.format_version},
               {"map", m.map},
               {"snapshot_id", m.snapshot_id},
               {"comment", m.comment},
               {"automatic", m.automatic},
               {"epoch", m.epoch},
               {"revision", m.revision},
               {"field_revision", m.field_revision},
               {"stamp_ns", m.stamp_ns},
               {"lineage", m.lineage},
               {"log_index", m.log_index},
               {"created_unix_ns", m.created_unix_ns},
               {"config", ToHex(m.config)},
               {"files", Json::array()}};
  for (const auto& file : m.files) {
    json["files"].push_back({{"name", file.name},
                             {"bytes", file.bytes},
                             {"crc32c", absl::StrFormat("%08x", file.crc32c)}});
  }
  return SealJson("snapshot", json.dump(-1, ' ', false, Json::error_handler_t::replace));
}

absl::StatusOr<SnapshotManifest> DecodeManifest(std::string_view text) try {
  const absl::StatusOr<std::string> content =
      OpenSealedJson("snapshot", text, SnapshotManifest::kFormatVersion);
  if (!content.ok()) return content.status();
  const Json json = Json::parse(*content);
  SnapshotManifest m;
  json.at("format_version").get_to(m.format_version);
  json.at("map").get_to(m.map);
  json.at("snapshot_id").get_to(m.snapshot_id);
  json.at("comment").get_to(m.comment);
  json.at("automatic").get_to(m.automatic);
  json.at("epoch").get_to(m.epoch);
  json.at("revision").get_to(m.revision);
  json.at("field_revision").get_to(m.field_revision);
  json.at("stamp_ns").get_to(m.stamp_ns);
  json.at("lineage").get_to(m.lineage);
  json.at("log_index").get_to(m.log_index);
  json.at("created_unix_ns").get_to(m.created_unix_ns);
  m.config = FromHex(json.at("config").get<std::string>());
  for (const Json& file : json.at("files")) {
    SnapshotManifest::FileEntry entry;
    file.at("name").get_to(entry.name);
    file.at("bytes").get_to(entry.bytes);
    entry.crc32c =
        static_cast<uint32_t>(std::stoul(file.at("crc32c").get<std::string>(), nullptr, 16));
    m.files.push_back(std::move(entry));
  }
  return m;
} catch (const std::exception& error) {
  return absl::DataLossError(
      absl::StrFormat("the snapshot's manifest is damaged: %s", error.what()));
}

}  // namespace clearance
