// The strict reader: sections of keys, each known, each once.
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <numeric>
#include <set>
#include <sstream>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "server/config/config_keys.h"
#include "server/config/server_config.h"

namespace clearance {
namespace {

size_t EditDistance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      const size_t substituted = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({row[j + 1] + 1, row[j] + 1, substituted});
    }
  }
  return row[b.size()];
}

// " did you mean 'x'?" for the nearest of `known`, or nothing.
std::string Suggestion(std::string_view got, const std::set<std::string>& known) {
  std::string best;
  size_t best_distance = std::max<size_t>(2, got.size() / 3) + 1;
  for (const std::string& name : known) {
    const size_t distance = EditDistance(got, name);
    if (distance < best_distance) {
      best = name;
      best_distance = distance;
    }
  }
  return best.empty() ? "" : absl::StrFormat("; did you mean '%s'?", best);
}

absl::Status At(std::string_view name, const YAML::Mark& mark, std::string_view text) {
  return absl::InvalidArgumentError(absl::StrFormat("%s:%d: %s", name, mark.line + 1, text));
}

const ConfigKey* FindKey(std::string_view path) {
  for (const ConfigKey& key : AllConfigKeys()) {
    if (key.path == path) return &key;
  }
  return nullptr;
}

std::set<std::string> Sections() {
  std::set<std::string> sections;
  for (const ConfigKey& key : AllConfigKeys()) {
    sections.insert(key.path.substr(0, key.path.find('.')));
  }
  return sections;
}

std::set<std::string> KeysOf(std::string_view section) {
  std::set<std::string> keys;
  for (const ConfigKey& key : AllConfigKeys()) {
    const size_t dot = key.path.find('.');
    if (std::string_view(key.path).substr(0, dot) == section) keys.insert(key.path.substr(dot + 1));
  }
  return keys;
}

std::string Shown(const YAML::Node& node) {
  std::ostringstream out;
  out << node;
  return out.str().substr(0, 60);
}

absl::Status ReadSection(const YAML::Node& section, const std::string& name, std::string_view file,
                         ServerConfig* config) {
  if (section.IsNull()) return absl::OkStatus();
  if (!section.IsMap()) return At(file, section.Mark(), "'" + name + "' must hold keys and values");
  std::set<std::string> seen;
  for (const auto& entry : section) {
    const std::string key = Shown(entry.first);
    const ConfigKey* known = FindKey(name + "." + key);
    if (known == nullptr) {
      return At(
          file, entry.first.Mark(),
          absl::StrFormat("unknown key '%s' in '%s'%s", key, name, Suggestion(key, KeysOf(name))));
    }
    if (!seen.insert(key).second) {
      return At(file, entry.first.Mark(), absl::StrFormat("key '%s.%s' repeats", name, key));
    }
    if (const std::string expected = known->read(entry.second, config); !expected.empty()) {
      return At(
          file, entry.second.Mark(),
          absl::StrFormat("%s: got '%s', expected %s", known->path, Shown(entry.second), expected));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ApplyYaml(std::string_view text, std::string_view name, ServerConfig* config) try {
  const YAML::Node root = YAML::Load(std::string(text));
  if (root.IsNull()) return absl::OkStatus();
  if (!root.IsMap()) return At(name, root.Mark(), "expected sections with keys and values");
  std::set<std::string> seen;
  for (const auto& entry : root) {
    const std::string section = Shown(entry.first);
    if (!Sections().contains(section)) {
      return At(
          name, entry.first.Mark(),
          absl::StrFormat("unknown section '%s'%s", section, Suggestion(section, Sections())));
    }
    if (!seen.insert(section).second) {
      return At(name, entry.first.Mark(), absl::StrFormat("section '%s' repeats", section));
    }
    if (absl::Status status = ReadSection(entry.second, section, name, config); !status.ok()) {
      return status;
    }
  }
  return absl::OkStatus();
} catch (const YAML::Exception& error) {
  return At(name, error.mark, error.msg);
}

absl::Status ApplyFile(const std::string& path, ServerConfig* config) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (!file || !(text << file.rdbuf())) {
    return absl::NotFoundError(absl::StrFormat("%s: cannot read the configuration file", path));
  }
  return ApplyYaml(text.str(), path, config);
}

absl::Status ApplySetting(std::string_view key, const std::string& value, std::string_view origin,
                          ServerConfig* config) try {
  const ConfigKey* known = FindKey(key);
  if (known == nullptr) {
    const std::vector<std::string> keys = ConfigKeys();
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: unknown key '%s'%s", origin, key,
                        Suggestion(key, std::set<std::string>(keys.begin(), keys.end()))));
  }
  if (const std::string expected = known->read(YAML::Load(value), config); !expected.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: got '%s', expected %s", origin, value.substr(0, 60), expected));
  }
  return absl::OkStatus();
} catch (const YAML::Exception& error) {
  return absl::InvalidArgumentError(absl::StrFormat("%s: %s", origin, error.msg));
}

absl::Status ApplyEnvironment(ServerConfig* config) {
  for (const std::string& key : ConfigKeys()) {
    const std::string upper = absl::AsciiStrToUpper(absl::StrReplaceAll(key, {{".", "_"}}));
    std::vector<std::string> names = {"CLEARANCE_" + upper};
    if (key == "server.listen" || key == "server.socket" || key == "server.http") {
      names.push_back("CLEARANCE_" + upper.substr(upper.find('_') + 1));
    }
    for (const std::string& name : names) {
      const char* value = std::getenv(name.c_str());
      if (value == nullptr) continue;
      // "a, b" is a list of addresses as well as "[a, b]".
      std::string text = value;
      if (key == "server.listen" && text.find('[') == std::string::npos) text = "[" + text + "]";
      if (absl::Status status = ApplySetting(key, text, name, config); !status.ok()) return status;
    }
  }
  return absl::OkStatus();
}

std::vector<std::string> ConfigKeys() {
  std::vector<std::string> keys;
  for (const ConfigKey& key : AllConfigKeys()) keys.push_back(key.path);
  return keys;
}

}  // namespace clearance
