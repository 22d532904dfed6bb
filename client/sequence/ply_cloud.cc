#include "client/sequence/ply_cloud.h"

#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/sequence/text.h"

namespace clearance::client {
namespace {

enum class Type { kI8, kU8, kI16, kU16, kI32, kU32, kF32, kF64 };

const std::map<std::string_view, Type>& Types() {
  static const auto* types = new std::map<std::string_view, Type>{
      {"char", Type::kI8},    {"int8", Type::kI8},     {"uchar", Type::kU8},
      {"uint8", Type::kU8},   {"short", Type::kI16},   {"int16", Type::kI16},
      {"ushort", Type::kU16}, {"uint16", Type::kU16},  {"int", Type::kI32},
      {"int32", Type::kI32},  {"uint", Type::kU32},    {"uint32", Type::kU32},
      {"float", Type::kF32},  {"float32", Type::kF32}, {"double", Type::kF64},
      {"float64", Type::kF64}};
  return *types;
}

size_t SizeOf(Type type) {
  constexpr size_t kSizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<int>(type)];
}

template <typename T>
double Load(const char* p) {
  T value;
  std::memcpy(&value, p, sizeof(T));
  return static_cast<double>(value);
}

double ValueAt(const char* p, Type type) {
  switch (type) {
    case Type::kI8:
      return Load<int8_t>(p);
    case Type::kU8:
      return Load<uint8_t>(p);
    case Type::kI16:
      return Load<int16_t>(p);
    case Type::kU16:
      return Load<uint16_t>(p);
    case Type::kI32:
      return Load<int32_t>(p);
    case Type::kU32:
      return Load<uint32_t>(p);
    case Type::kF32:
      return Load<float>(p);
    case Type::kF64:
      return Load<double>(p);
  }
  return 0;
}

struct Property {
  Type type = Type::kF32;
  size_t offset = 0;
};

struct Header {
  int64_t vertices = -1;
  size_t stride = 0;
  std::map<std::string, Property> properties;
  size_t data_begin = 0;
};

// Reads the header; the vertices must be the first element, so that their place is known.
class HeaderParser {
 public:
  HeaderParser(std::string_view bytes, const std::filesystem::path& path)
      : bytes_(bytes), path_(path) {}

  absl::StatusOr<Header> Parse() {
    constexpr size_t kMaxHeaderBytes = 65536;
    const std::string_view text = bytes_.substr(0, kMaxHeaderBytes);
    size_t begin = 0;
    for (size_t number = 1;; ++number) {
      const size_t end = text.find('\n', begin);
      if (end == std::string_view::npos) {
        return BadLine(path_, number, "the end of the file",
                       "a PLY header that ends in end_header");
      }
      const std::vector<Line> split = SplitLines(text.substr(begin, end - begin), ' ');
      begin = end + 1;
      const std::vector<std::string_view> words =
          split.empty() ? std::vector<std::string_view>{} : split[0].cells;
      if (number == 1) {
        if (words.size() != 1 || words[0] != "ply") {
          return BadLine(path_, 1, "another file", "a PLY file (first line \"ply\")");
        }
        continue;
      }
      if (words.size() == 1 && words[0] == "end_header") break;
      if (absl::Status s = ParseLine(words, number); !s.ok()) return s;
    }
    header_.data_begin = begin;
    if (!has_format_) return BadLine(path_, 2, "no format", "format binary_little_endian 1.0");
    for (const char* name : {"x", "y", "z"}) {
      if (header_.properties.contains(name)) continue;
      return BadLine(path_, 1, absl::StrCat("no vertex property ", name), "x, y and z");
    }
    return header_;
  }

 private:
  absl::Status ParseLine(const std::vector<std::string_view>& words, size_t number) {
    if (words.empty() || words[0] == "comment" || words[0] == "obj_info") return absl::OkStatus();
    if (words[0] == "format") {
      has_format_ = words.size() > 1 && words[1] == "binary_little_endian";
      if (!has_format_) return BadLine(path_, number, "another format", "binary_little_endian");
      return absl::OkStatus();
    }
    if (words[0] == "element" && words.size() == 3) return ParseElement(words, number);
    if (words[0] == "property" && words.size() >= 3) return ParseProperty(words, number);
    return BadLine(path_, number, std::string(words[0]), "a PLY header line");
  }

  absl::Status ParseElement(const std::vector<std::string_view>& words, size_t number) {
    in_vertex_ = words[1] == "vertex";
    if (!in_vertex_) {
      if (header_.vertices >= 0) return absl::OkStatus();
      return BadLine(path_, number, std::string(words[1]), "the vertices as the first element");
    }
    if (header_.vertices >= 0 || !ParseInteger(words[2], &header_.vertices) ||
        header_.vertices < 0) {
      header_.vertices = -1;
      return BadLine(path_, number, std::string(words[2]), "one vertex element with a count");
    }
    return absl::OkStatus();
  }

  absl::Status ParseProperty(const std::vector<std::string_view>& words, size_t number) {
    if (!in_vertex_) return absl::OkStatus();
    const auto type = Types().find(words[1]);
    if (type == Types().end()) {
      return BadLine(path_, number, std::string(words[1]), "a scalar type of a vertex property");
    }
    header_.properties[std::string(words[2])] = {type->second, header_.stride};
    header_.stride += SizeOf(type->second);
    return absl::OkStatus();
  }

  std::string_view bytes_;
  const std::filesystem::path& path_;
  Header header_;
  bool has_format_ = false;
  bool in_vertex_ = false;
};

absl::Status BadVertex(const std::filesystem::path& path, int64_t vertex, std::string_view got,
                       std::string_view expected) {
  return absl::DataLossError(absl::StrFormat("%s: vertex %d: got %s, expected %s", path.string(),
                                             vertex, std::string(got), std::string(expected)));
}

}  // namespace

absl::StatusOr<PointCloud> ReadPlyCloud(const std::filesystem::path& path) {
  const absl::StatusOr<std::string> bytes = ReadWholeFile(path);
  if (!bytes.ok()) return bytes.status();
  return ParsePlyCloud(*bytes, path);
}

absl::StatusOr<PointCloud> ParsePlyCloud(std::string_view bytes,
                                         const std::filesystem::path& path) {
  const absl::StatusOr<Header> header = HeaderParser(bytes, path).Parse();
  if (!header.ok()) return header.status();
  const size_t available = bytes.size() - header->data_begin;
  // Division, not multiplication: a huge count must not wrap around.
  if (static_cast<uint64_t>(header->vertices) > available / header->stride) {
    return absl::DataLossError(absl::StrFormat(
        "%s: ends at byte %d, expected %d vertices of %d bytes from byte %d on", path.string(),
        bytes.size(), header->vertices, header->stride, header->data_begin));
  }
  const Property x = header->properties.at("x"), y = header->properties.at("y"),
                 z = header->properties.at("z");
  const auto label = header->properties.find("label");
  const bool labelled = label != header->properties.end();
  PointCloud cloud;
  cloud.points_X.resize(3, header->vertices);
  if (labelled) cloud.labels.resize(header->vertices);
  const char* p = bytes.data() + header->data_begin;
  for (int64_t i = 0; i < header->vertices; ++i, p += header->stride) {
    const Eigen::Vector3d point(ValueAt(p + x.offset, x.type), ValueAt(p + y.offset, y.type),
                                ValueAt(p + z.offset, z.type));
    if (!point.allFinite()) {
      return BadVertex(path, i, absl::StrFormat("(%g, %g, %g)", point.x(), point.y(), point.z()),
                       "finite numbers");
    }
    cloud.points_X.col(i) = point.cast<float>();
    if (!labelled) continue;
    const double value = ValueAt(p + label->second.offset, label->second.type);
    if (!(value >= 0 && value <= 65535)) {
      return BadVertex(path, i, absl::StrCat("label ", value), "a label from 0 to 65535");
    }
    cloud.labels[i] = static_cast<uint16_t>(value);
  }
  return cloud;
}

}  // namespace clearance::client
