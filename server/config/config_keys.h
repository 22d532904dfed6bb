// Every key of the configuration and how its value is read: file, environment and flags share it.
#pragma once

#include <yaml-cpp/yaml.h>

#include <functional>
#include <string>
#include <vector>

#include "server/config/server_config.h"

namespace clearance {

struct ConfigKey {
  std::string path;  // "section.key"
  // Returns what was expected; empty when the value was read.
  std::function<std::string(const YAML::Node&, ServerConfig*)> read;
};

const std::vector<ConfigKey>& AllConfigKeys();

}  // namespace clearance
