#include "client/sequence/text.h"

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>

#include "absl/strings/str_format.h"

namespace clearance::client {
namespace {

constexpr size_t kShownBytes = 60;

bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

std::string_view Trimmed(std::string_view text) {
  while (!text.empty() && IsBlank(text.front())) text.remove_prefix(1);
  while (!text.empty() && IsBlank(text.back())) text.remove_suffix(1);
  return text;
}

std::vector<std::string_view> SplitCells(std::string_view line, char separator) {
  std::vector<std::string_view> cells;
  if (separator != ' ') {
    for (size_t begin = 0;;) {
      const size_t end = line.find(separator, begin);
      cells.push_back(Trimmed(line.substr(begin, end - begin)));
      if (end == std::string_view::npos) return cells;
      begin = end + 1;
    }
  }
  for (line = Trimmed(line); !line.empty(); line = Trimmed(line)) {
    size_t end = 0;
    while (end < line.size() && !IsBlank(line[end])) ++end;
    cells.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
  return cells;
}

template <typename T>
bool ParseWhole(std::string_view text, T* value) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  const char* end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, *value);
  return result.ec == std::errc() && result.ptr == end;
}

}  // namespace

absl::StatusOr<std::string> ReadWholeFile(const std::filesystem::path& path) {
  errno = 0;
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  std::error_code error;
  if (!in || std::filesystem::is_directory(path, error)) {
    return absl::DataLossError(
        absl::StrFormat("%s: cannot be opened (%s); expected a readable file", path.string(),
                        errno != 0 ? std::strerror(errno) : "not a file"));
  }
  std::string bytes(static_cast<size_t>(in.tellg()), '\0');
  in.seekg(0);
  if (!in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) {
    return absl::DataLossError(absl::StrFormat("%s: reading ended at byte %d of %d", path.string(),
                                               in.gcount(), bytes.size()));
  }
  return bytes;
}

absl::Status BadLine(const std::filesystem::path& path, size_t line, std::string_view got,
                     std::string_view expected) {
  return absl::DataLossError(absl::StrFormat("%s:%d: got %s, expected %s", path.string(), line,
                                             std::string(got.substr(0, kShownBytes)),
                                             std::string(expected)));
}

std::vector<Line> SplitLines(std::string_view text, char separator) {
  std::vector<Line> lines;
  size_t number = 0;
  while (!text.empty()) {
    const size_t end = text.find('\n');
    const std::string_view line = Trimmed(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    ++number;
    if (!line.empty() && line.front() != '#')
      lines.push_back({number, SplitCells(line, separator)});
  }
  return lines;
}

bool ParseNumber(std::string_view text, double* value) {
  return ParseWhole(text, value) && std::isfinite(*value);
}

bool ParseInteger(std::string_view text, int64_t* value) { return ParseWhole(text, value); }

bool ParseSecondsAsNs(std::string_view text, int64_t* ns) {
  constexpr int64_t kNsPerSecond = 1'000'000'000;
  const bool negative = !text.empty() && text.front() == '-';
  if (negative) text.remove_prefix(1);
  const size_t dot = text.find('.');
  const std::string_view whole = text.substr(0, dot);
  int64_t seconds = 0;
  if (whole.empty() || whole.front() < '0' || whole.front() > '9' ||
      !ParseInteger(whole, &seconds) || seconds > INT64_MAX / kNsPerSecond - 1) {
    return false;
  }
  int64_t fraction = 0;
  if (dot != std::string_view::npos) {
    int64_t scale = kNsPerSecond;
    for (const char c : text.substr(dot + 1)) {
      if (c < '0' || c > '9') return false;
      scale /= 10;
      fraction += (c - '0') * scale;
    }
  }
  *ns = seconds * kNsPerSecond + fraction;
  if (negative) *ns = -*ns;
  return true;
}

}  // namespace clearance::client
