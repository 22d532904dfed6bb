#include "client/sequence/object_table.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_cat.h"
#include "client/sequence/text.h"
#include "client/sequence/trajectory.h"

namespace clearance::client {
namespace {

constexpr char kMotionColumns[] = "frame,object_id,tx,ty,tz,qx,qy,qz,qw";

std::string Quoted(std::string_view text) {
  return absl::StrCat("\"", std::string(text.substr(0, 40)), "\"");
}

bool ParseObjectId(std::string_view text, ObjectId* id) {
  int64_t value = 0;
  if (!ParseInteger(text, &value) || value < 1 || value > 65535) return false;
  *id = ObjectId(static_cast<uint16_t>(value));
  return true;
}

bool HasColumns(const Line& line, std::string_view columns) {
  const std::vector<Line> expected = SplitLines(columns, ',');
  return line.cells == expected[0].cells;
}

}  // namespace

absl::StatusOr<MotionTable> ReadObjectMotions(const std::filesystem::path& path) {
  const absl::StatusOr<std::string> text = ReadWholeFile(path);
  if (!text.ok()) return text.status();
  const std::vector<Line> lines = SplitLines(*text, ',');
  if (lines.empty() || !HasColumns(lines[0], kMotionColumns)) {
    return BadLine(path, 1, "other columns", kMotionColumns);
  }
  MotionTable table;
  std::set<std::pair<int64_t, ObjectId>> seen;
  for (size_t i = 1; i < lines.size(); ++i) {
    const Line& line = lines[i];
    if (line.cells.size() != 9) {
      return BadLine(path, line.number, absl::StrCat(line.cells.size(), " cells"), kMotionColumns);
    }
    int64_t frame = 0;
    if (!ParseInteger(line.cells[0], &frame) || frame < 1) {
      return BadLine(path, line.number, Quoted(line.cells[0]), "a frame index from 1");
    }
    ObjectMotion motion;
    if (!ParseObjectId(line.cells[1], &motion.object_id)) {
      return BadLine(path, line.number, Quoted(line.cells[1]), "an object id from 1 to 65535");
    }
    std::string error;
    if (!ParsePose(&line.cells[2], &motion.pose, &error)) {
      return BadLine(path, line.number, error, "finite numbers and a unit quaternion");
    }
    if (!seen.emplace(frame, motion.object_id).second) {
      return BadLine(path, line.number,
                     absl::StrCat("object ", motion.object_id.value(), " again in frame ", frame),
                     "one motion for an object and frame");
    }
    motion.from_frame_id = static_cast<uint64_t>(frame - 1);
    table[static_cast<uint64_t>(frame)].push_back(std::move(motion));
  }
  return table;
}

absl::StatusOr<std::map<ObjectId, std::string>> ReadClassNames(const std::filesystem::path& path) {
  const absl::StatusOr<std::string> text = ReadWholeFile(path);
  if (!text.ok()) return text.status();
  const std::vector<Line> lines = SplitLines(*text, ',');
  const auto column = [&](std::string_view name) {
    if (lines.empty()) return size_t{0};
    const auto& cells = lines[0].cells;
    return static_cast<size_t>(std::find(cells.begin(), cells.end(), name) - cells.begin());
  };
  const size_t id_column = column("object_id"), class_column = column("class");
  if (lines.empty() || std::max(id_column, class_column) >= lines[0].cells.size()) {
    return BadLine(path, 1, "other columns", "the columns object_id and class");
  }
  std::map<ObjectId, std::string> names;
  for (size_t i = 1; i < lines.size(); ++i) {
    const auto& cells = lines[i].cells;
    ObjectId id;
    if (cells.size() <= std::max(id_column, class_column) ||
        !ParseObjectId(cells[id_column], &id)) {
      return BadLine(path, lines[i].number, Quoted(cells[0]),
                     "an object id from 1 to 65535, a class");
    }
    names[id] = std::string(cells[class_column]);
  }
  return names;
}

}  // namespace clearance::client
