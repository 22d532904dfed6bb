#include "client/sequence/trajectory.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/sequence/text.h"

namespace clearance::client {

bool ParsePose(const std::string_view* cells, Pose* pose, std::string* error) {
  double v[7];
  for (int i = 0; i < 7; ++i) {
    if (ParseNumber(cells[i], &v[i])) continue;
    *error = absl::StrCat("\"", std::string(cells[i].substr(0, 40)), "\"");
    return false;
  }
  const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
  if (!(std::abs(q.norm() - 1.0) < wire::kQuaternionTolerance)) {
    *error = absl::StrFormat("a quaternion of norm %.6g (a unit one is needed)", q.norm());
    return false;
  }
  *pose = Pose::Identity();
  pose->linear() = q.normalized().toRotationMatrix();
  pose->translation() = Eigen::Vector3d(v[0], v[1], v[2]);
  return true;
}

absl::StatusOr<SensorPath> ReadTrajectory(const std::filesystem::path& path) {
  const absl::StatusOr<std::string> text = ReadWholeFile(path);
  if (!text.ok()) return text.status();
  SensorPath trajectory;
  for (const Line& line : SplitLines(*text, ' ')) {
    if (line.cells.size() != 8) {
      return BadLine(path, line.number, absl::StrCat(line.cells.size(), " values"),
                     "timestamp tx ty tz qx qy qz qw");
    }
    int64_t stamp_ns = 0;
    if (!ParseSecondsAsNs(line.cells[0], &stamp_ns)) {
      return BadLine(path, line.number, absl::StrCat("\"", std::string(line.cells[0]), "\""),
                     "a timestamp in decimal seconds");
    }
    if (!trajectory.stamps_ns.empty() && stamp_ns <= trajectory.stamps_ns.back()) {
      return BadLine(path, line.number, std::string(line.cells[0]),
                     "a timestamp above the line before");
    }
    Pose pose;
    std::string error;
    if (!ParsePose(&line.cells[1], &pose, &error)) {
      return BadLine(path, line.number, error, "finite numbers and a unit quaternion");
    }
    trajectory.stamps_ns.push_back(stamp_ns);
    trajectory.T_W_X.push_back(pose);
  }
  return trajectory;
}

}  // namespace clearance::client
