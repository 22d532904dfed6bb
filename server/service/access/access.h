// Who makes a call, and whether it is allowed to.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/engine/mutex.h"
#include "server/service/access/access_list.h"

namespace grpc {
class ServerContextBase;
}

namespace clearance {

// Where a right is needed.
struct Scope {
  enum class Kind { kMap, kEveryMap, kSomeMap };
  Kind kind = Kind::kMap;
  std::string map;  // of kMap; empty = default
};
inline Scope OnMap(std::string_view map) { return {Scope::Kind::kMap, std::string(map)}; }
inline Scope OnEveryMap() { return {Scope::Kind::kEveryMap, {}}; }
inline Scope OnSomeMap() { return {Scope::Kind::kSomeMap, {}}; }

// Thread-safe. Without an access file everybody who can connect may do everything.
class Access {
 public:
  // Everybody may do everything.
  Access() = default;
  // Reads the file now, and again when it changes (looked at once a second at most); a file that
  // turns bad is refused and the last good one stays in force. NOT_FOUND, INVALID_ARGUMENT.
  static absl::StatusOr<std::unique_ptr<Access>> FromFile(const std::string& path);

  // By `authorization: Bearer TOKEN`, else by the verified client certificate's names.
  // UNAUTHENTICATED without a known one; PERMISSION_DENIED naming caller, right and map.
  absl::Status Check(const grpc::ServerContextBase& context, Right right, const Scope& scope) const;

 private:
  std::shared_ptr<const AccessList> List() const;

  const std::string path_;
  mutable Mutex mu_;
  mutable std::shared_ptr<const AccessList> list_ ABSL_GUARDED_BY(mu_);
  mutable std::filesystem::file_time_type written_at_ ABSL_GUARDED_BY(mu_);
  mutable std::chrono::steady_clock::time_point looked_at_ ABSL_GUARDED_BY(mu_);

  explicit Access(std::string path) : path_(std::move(path)) {}
};

}  // namespace clearance
