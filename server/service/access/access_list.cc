#include "server/service/access/access_list.h"

#include <openssl/evp.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <sstream>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_format.h"

namespace clearance {
namespace {

constexpr char kEveryMap[] = "*";

absl::Status At(std::string_view name, const YAML::Node& node, std::string_view text) {
  return absl::InvalidArgumentError(absl::StrFormat("%s:%d: %s", name, node.Mark().line + 1, text));
}

bool IsMapId(std::string_view id) {
  if (id.empty() || id.size() > 63 || !absl::ascii_islower(id[0])) return false;
  return std::all_of(id.begin(), id.end(), [](unsigned char c) {
    return absl::ascii_islower(c) || absl::ascii_isdigit(c) || c == '-' || c == '_';
  });
}

absl::StatusOr<uint8_t> ParseRights(const YAML::Node& node, std::string_view name) {
  if (!node.IsSequence() || node.size() == 0) {
    return At(name, node, "rights: expected a list of read, ingest, admin");
  }
  uint8_t rights = 0;
  for (const YAML::Node& item : node) {
    const std::string text = item.IsScalar() ? item.Scalar() : "";
    bool known = false;
    for (const Right right : {Right::kRead, Right::kIngest, Right::kAdmin}) {
      if (text != NameOf(right)) continue;
      rights |= static_cast<uint8_t>(right);
      known = true;
    }
    if (!known) {
      return At(name, item,
                absl::StrFormat("rights: got '%s', expected read, ingest or admin", text));
    }
  }
  return rights;
}

absl::Status ParseMaps(const YAML::Node& node, std::string_view name, Caller* caller) {
  if (!node.IsMap() || node.size() == 0) {
    return At(name, node, "maps: expected map ids (or \"*\") with their rights");
  }
  for (const auto& entry : node) {
    const std::string map = entry.first.IsScalar() ? entry.first.Scalar() : "";
    if (map != kEveryMap && !IsMapId(map)) {
      return At(name, entry.first,
                absl::StrFormat("maps: got '%s', expected a map id or \"*\"", map));
    }
    const absl::StatusOr<uint8_t> rights = ParseRights(entry.second, name);
    if (!rights.ok()) return rights.status();
    if (!caller->rights.emplace(map, *rights).second) {
      return At(name, entry.first, absl::StrFormat("maps: '%s' is there twice", map));
    }
  }
  return absl::OkStatus();
}

}  // namespace

const char* NameOf(Right right) {
  switch (right) {
    case Right::kRead:
      return "read";
    case Right::kIngest:
      return "ingest";
    case Right::kAdmin:
      return "admin";
  }
  return "";
}

bool Caller::May(Right right, std::string_view map) const {
  if (MayEverywhere(right)) return true;
  const auto it = rights.find(std::string(map));
  return it != rights.end() && (it->second & static_cast<uint8_t>(right)) != 0;
}

bool Caller::MayEverywhere(Right right) const {
  const auto it = rights.find(kEveryMap);
  return it != rights.end() && (it->second & static_cast<uint8_t>(right)) != 0;
}

bool Caller::MaySomewhere(Right right) const {
  return std::any_of(rights.begin(), rights.end(), [right](const auto& entry) {
    return (entry.second & static_cast<uint8_t>(right)) != 0;
  });
}

absl::StatusOr<AccessList> AccessList::Parse(std::string_view yaml, std::string_view name) {
  AccessList list;
  try {
    const YAML::Node root = YAML::Load(std::string(yaml));
    const YAML::Node callers = root.IsMap() ? root["callers"] : YAML::Node();
    if (!root.IsMap() || root.size() != 1 || !callers || !callers.IsSequence()) {
      return At(name, root, "expected one key, callers, with a list");
    }
    for (const YAML::Node& item : callers) {
      if (!item.IsMap()) return At(name, item, "callers: expected name, maps and a credential");
      Caller caller;
      std::string token_hash, certificate;
      for (const auto& entry : item) {
        const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
        const std::string value = entry.second.IsScalar() ? entry.second.Scalar() : "";
        if (key == "maps") {
          if (absl::Status s = ParseMaps(entry.second, name, &caller); !s.ok()) return s;
        } else if (key != "name" && key != "token_sha256" && key != "certificate") {
          return At(name, entry.first,
                    absl::StrFormat("unknown key '%s', expected name, token_sha256, certificate, "
                                    "maps",
                                    key));
        } else if (value.empty()) {
          return At(name, entry.second, absl::StrFormat("%s: expected a text", key));
        } else {
          (key == "name" ? caller.name : key == "certificate" ? certificate : token_hash) = value;
        }
      }
      if (caller.name.empty()) return At(name, item, "a caller without name");
      if (caller.rights.empty()) return At(name, item, "a caller without maps");
      if (token_hash.empty() && certificate.empty()) {
        return At(name, item, "a caller without token_sha256 or certificate");
      }
      const size_t index = list.callers_.size();
      if (!token_hash.empty()) {
        absl::AsciiStrToLower(&token_hash);
        if (token_hash.size() != 64 ||
            !std::all_of(token_hash.begin(), token_hash.end(),
                         [](unsigned char c) { return std::isxdigit(c); })) {
          return At(name, item, "token_sha256: expected 64 hexadecimal digits");
        }
        if (!list.by_token_hash_.emplace(token_hash, index).second) {
          return At(name, item, "token_sha256: two callers with one token");
        }
      }
      if (!certificate.empty() && !list.by_certificate_.emplace(certificate, index).second) {
        return At(name, item, "certificate: two callers with one name");
      }
      list.callers_.push_back(std::move(caller));
    }
  } catch (const YAML::Exception& e) {
    return absl::InvalidArgumentError(absl::StrFormat("%s:%d: %s", name, e.mark.line + 1, e.msg));
  }
  return list;
}

absl::StatusOr<AccessList> AccessList::Load(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in) return absl::NotFoundError(absl::StrFormat("%s: cannot be read", path));
  return Parse(text.str(), path);
}

const Caller* AccessList::ByToken(std::string_view token) const {
  const auto it = by_token_hash_.find(Sha256Hex(token));
  return it == by_token_hash_.end() ? nullptr : &callers_[it->second];
}

const Caller* AccessList::ByCertificate(const std::vector<std::string>& subject_names) const {
  for (const std::string& name : subject_names) {
    const auto it = by_certificate_.find(name);
    if (it != by_certificate_.end()) return &callers_[it->second];
  }
  return nullptr;
}

std::string Sha256Hex(std::string_view bytes) {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  EVP_Digest(bytes.data(), bytes.size(), digest, &size, EVP_sha256(), nullptr);
  return absl::BytesToHexString({reinterpret_cast<const char*>(digest), size});
}

}  // namespace clearance
