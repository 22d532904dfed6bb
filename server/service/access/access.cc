#include "server/service/access/access.h"

#include <grpcpp/server_context.h>
#include <spdlog/spdlog.h>

#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

namespace clearance {
namespace {

constexpr std::chrono::seconds kLookPeriod{1};
constexpr char kDefaultMap[] = "default";

// Nothing where the call carries no token.
std::string TokenOf(const grpc::ServerContextBase& context) {
  const auto& metadata = context.client_metadata();
  const auto it = metadata.find("authorization");
  if (it == metadata.end()) return "";
  const absl::string_view value(it->second.data(), it->second.size());
  constexpr absl::string_view kBearer = "bearer ";
  if (!absl::StartsWithIgnoreCase(value, kBearer)) return "";
  return std::string(value.substr(kBearer.size()));
}

std::vector<std::string> CertificateNamesOf(const grpc::ServerContextBase& context) {
  std::vector<std::string> names;
  const auto auth = context.auth_context();
  if (!auth || !auth->IsPeerAuthenticated()) return names;
  for (const char* property : {"x509_subject_alternative_name", "x509_common_name"}) {
    for (const grpc::string_ref& value : auth->FindPropertyValues(property)) {
      names.emplace_back(value.data(), value.size());
    }
  }
  return names;
}

std::string Describe(const Scope& scope) {
  switch (scope.kind) {
    case Scope::Kind::kMap:
      return absl::StrFormat("map '%s'", scope.map.empty() ? kDefaultMap : scope.map);
    case Scope::Kind::kEveryMap:
      return "every map";
    case Scope::Kind::kSomeMap:
      return "any map";
  }
  return "";
}

bool May(const Caller& caller, Right right, const Scope& scope) {
  switch (scope.kind) {
    case Scope::Kind::kMap:
      return caller.May(right, scope.map.empty() ? kDefaultMap : scope.map);
    case Scope::Kind::kEveryMap:
      return caller.MayEverywhere(right);
    case Scope::Kind::kSomeMap:
      return caller.MaySomewhere(right);
  }
  return false;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Access>> Access::FromFile(const std::string& path) {
  std::unique_ptr<Access> access(new Access(path));
  std::error_code error;
  const auto written_at = std::filesystem::last_write_time(path, error);
  absl::StatusOr<AccessList> list = AccessList::Load(path);
  if (!list.ok()) return list.status();
  MutexLock lock(&access->mu_);
  access->list_ = std::make_shared<const AccessList>(*std::move(list));
  access->written_at_ = written_at;
  access->looked_at_ = std::chrono::steady_clock::now();
  return access;
}

std::shared_ptr<const AccessList> Access::List() const {
  MutexLock lock(&mu_);
  const auto now = std::chrono::steady_clock::now();
  if (now - looked_at_ < kLookPeriod) return list_;
  looked_at_ = now;
  std::error_code error;
  const auto written_at = std::filesystem::last_write_time(path_, error);
  if (error || written_at == written_at_) return list_;
  written_at_ = written_at;
  absl::StatusOr<AccessList> list = AccessList::Load(path_);
  if (list.ok()) {
    list_ = std::make_shared<const AccessList>(*std::move(list));
    spdlog::info("access file {} read again: {} callers", path_, list_->size());
  } else {
    spdlog::error("access file stays as it was: {}", std::string(list.status().message()));
  }
  return list_;
}

absl::Status Access::Check(const grpc::ServerContextBase& context, Right right,
                           const Scope& scope) const {
  if (path_.empty()) return absl::OkStatus();
  const std::shared_ptr<const AccessList> list = List();
  const std::string token = TokenOf(context);
  const Caller* caller =
      token.empty() ? list->ByCertificate(CertificateNamesOf(context)) : list->ByToken(token);
  if (caller == nullptr) {
    return absl::UnauthenticatedError(
        token.empty() ? "this server asks who calls: send the metadata 'authorization: Bearer "
                        "TOKEN' (clearance: --token-file or CLEARANCE_TOKEN), or a client "
                        "certificate that its access file names"
                      : "the token is not in the server's access file");
  }
  if (May(*caller, right, scope)) return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrFormat("'%s' may not %s on %s; the server's access "
                      "file gives rights",
                      caller->name, NameOf(right), Describe(scope)));
}

}  // namespace clearance
