// Who may do what on which map: the access file, parsed. Knows no transport.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace clearance {

// What a call needs. None includes another.
enum class Right : uint8_t {
  kRead = 1,    // queries, exports, watching
  kIngest = 2,  // frames
  kAdmin = 4,   // creating, editing, restoring and deleting maps; drain
};
const char* NameOf(Right right);

// One holder of a token or a certificate, and its rights.
struct Caller {
  std::string name;                       // for messages and logs
  std::map<std::string, uint8_t> rights;  // by map id, bits of Right; "*" = every map

  bool May(Right right, std::string_view map) const;
  bool MayEverywhere(Right right) const;
  bool MaySomewhere(Right right) const;
};

// Immutable once parsed.
class AccessList {
 public:
  // YAML: a list `callers`, each with `name`, `token_sha256` (64 hexadecimal digits) or
  // `certificate` (a subject's common name or alternative name), and `maps`: map id or "*" to a
  // list of read, ingest, admin. INVALID_ARGUMENT "<name>:<line>: ...". Tokens themselves are never
  // stored, nor named in a message.
  static absl::StatusOr<AccessList> Parse(std::string_view yaml, std::string_view name);
  // NOT_FOUND, or as Parse.
  static absl::StatusOr<AccessList> Load(const std::string& path);

  // nullptr where nobody has it.
  const Caller* ByToken(std::string_view token) const;
  const Caller* ByCertificate(const std::vector<std::string>& subject_names) const;

  size_t size() const { return callers_.size(); }

 private:
  std::vector<Caller> callers_;
  std::map<std::string, size_t, std::less<>> by_token_hash_, by_certificate_;
};

// Lower-case hexadecimal SHA-256.
std::string Sha256Hex(std::string_view bytes);

}  // namespace clearance
