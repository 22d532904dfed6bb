// Files and the numbers in them, with errors that name file, line and what was expected.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace clearance::client {

// The whole file. DATA_LOSS where it is missing or cannot be read: the folder that should have it
// is damaged.
absl::StatusOr<std::string> ReadWholeFile(const std::filesystem::path& path);

// DATA_LOSS "path:line: got ..., expected ...".
absl::Status BadLine(const std::filesystem::path& path, size_t line, std::string_view got,
                     std::string_view expected);

struct Line {
  size_t number = 0;  // from 1
  std::vector<std::string_view> cells;
};

// Lines split at `separator` (' ' also stands for tabs and repeated blanks), cells trimmed. Empty
// lines and lines that begin with '#' are left out. The views point into `text`.
std::vector<Line> SplitLines(std::string_view text, char separator);

bool ParseNumber(std::string_view text, double* value);
bool ParseInteger(std::string_view text, int64_t* value);

// A decimal number of seconds as nanoseconds, exactly (a double of seconds since 1970 cannot hold
// them). Digits beyond the ninth are cut off.
bool ParseSecondsAsNs(std::string_view text, int64_t* ns);

}  // namespace clearance::client
