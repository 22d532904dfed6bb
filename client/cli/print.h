// Tables for people, JSON for programs.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "client/cli/context.h"
#include "client/types.h"

namespace clearance::cli {

// Columns padded to their widest cell; cells that look like numbers are right-aligned.
class Table {
 public:
  explicit Table(std::vector<std::string> header) : rows_{std::move(header)} {}
  void Add(std::vector<std::string> row) { rows_.push_back(std::move(row)); }
  std::string Text() const;

 private:
  std::vector<std::vector<std::string>> rows_;
};

std::string Number(double value, int decimals);
std::string Bytes(uint64_t bytes);

// "free", "occupied", "unknown"; the flags' names, comma separated.
std::string_view StateName(uint8_t state_byte);
std::vector<std::string> FlagNames(uint8_t state_byte);

Json ToJson(const client::MapStamp& stamp);
Json ToJson(const Pose& pose);
Json ToJson(const Eigen::Vector3d& v);
Json ToJson(const client::ObjectBrief& brief);
Json ToJson(const client::ObjectInfo& info);
Json ToJson(const client::MapInfo& info);
Json ToJson(const std::vector<client::StampedPose>& path);

// One JSON document, or the table's text.
void PrintJson(const Json& json);

}  // namespace clearance::cli
