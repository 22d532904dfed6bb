#include "planner_demo/episode/recording.h"

#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "planner_demo/episode/sensor_rig.h"
#include "planner_demo/episode/triangle_set.h"
#include "planner_demo/sim/motion.h"

namespace clearance::demo {
namespace {

constexpr double kGround_m = 0.3;
constexpr double kFar_m = 5.0;     // nobody asks how far exactly beyond
constexpr double kCorner_m = 7.0;  // start and goal, from both axes
constexpr double kRoad_m = 3.7;    // half the carriageways' width

class MeshTruth final : public Truth {
 public:
  struct Object {
    TriangleSet mesh;
    std::vector<Eigen::Isometry3d> T_W_L;  // by frame
  };
  MeshTruth(TriangleSet ground_free, std::map<uint16_t, Object> objects, double frame_s)
      : static_(std::move(ground_free)), objects_(std::move(objects)), frame_s_(frame_s) {}

  double Distance(const Eigen::Vector3d& point_W, double time_s,
                  uint16_t* object_id) const override {
    double nearest_m = static_.Distance(point_W, kFar_m);
    *object_id = 0;
    for (const auto& [id, object] : objects_) {
      const double distance_m =
          object.mesh.Distance(PoseAt(object, time_s).inverse() * point_W, nearest_m);
      if (distance_m < nearest_m) {
        nearest_m = distance_m;
        *object_id = id;
      }
    }
    return nearest_m;
  }

 private:
  // Between frames along a straight line; the last pose holds on.
  Eigen::Isometry3d PoseAt(const Object& object, double time_s) const {
    const double at = std::clamp(time_s / frame_s_, 0.0, object.T_W_L.size() - 1.0);
    const size_t k = std::min(static_cast<size_t>(at), object.T_W_L.size() - 1);
    const Eigen::Isometry3d& a = object.T_W_L[k];
    const Eigen::Isometry3d& b = object.T_W_L[std::min(k + 1, object.T_W_L.size() - 1)];
    const double share = at - static_cast<double>(k);
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::Quaterniond(a.linear())
                        .slerp(share, Eigen::Quaterniond(b.linear()))
                        .toRotationMatrix();
    pose.translation() = a.translation() + share * (b.translation() - a.translation());
    return pose;
  }

  TriangleSet static_;
  std::map<uint16_t, Object> objects_;
  double frame_s_;
};

// frame,object_id,tx,ty,tz,qx,qy,qz,qw, frames 0, 1, .. of every object.
absl::StatusOr<std::map<uint16_t, std::vector<Eigen::Isometry3d>>> ReadPoses(
    const std::string& path) {
  std::ifstream file(path);
  if (!file) return absl::NotFoundError(absl::StrCat("cannot read ", path));
  std::map<uint16_t, std::vector<Eigen::Isometry3d>> poses;
  std::string line;
  std::getline(file, line);
  for (int number = 2; std::getline(file, line); ++number) {
    for (char& c : line) c = c == ',' ? ' ' : c;
    std::istringstream words(line);
    size_t frame = 0;
    uint16_t id = 0;
    double t[3], q[4];
    words >> frame >> id >> t[0] >> t[1] >> t[2] >> q[0] >> q[1] >> q[2] >> q[3];
    if (!words || frame != poses[id].size()) {
      return absl::DataLossError(absl::StrCat(path, " line ", number,
                                              ": expected frame,object_id,tx,ty,tz,qx,qy,qz,qw "
                                              "with the frames of an object in order"));
    }
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized().toRotationMatrix();
    pose.translation() = Eigen::Vector3d(t[0], t[1], t[2]);
    poses[id].push_back(pose);
  }
  return poses;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Truth>> ReadTruth(const std::string& folder, double frame_s) {
  auto triangles = ReadTriangles(folder + "/gt/static.ply");
  if (!triangles.ok()) return triangles.status();
  std::erase_if(*triangles, [](const Triangle& t) {
    return t[0].z() < kGround_m && t[1].z() < kGround_m && t[2].z() < kGround_m;
  });
  auto poses = ReadPoses(folder + "/gt/object_poses.csv");
  if (!poses.ok()) return poses.status();
  std::map<uint16_t, MeshTruth::Object> objects;
  for (auto& [id, track] : *poses) {
    auto mesh = ReadTriangles(absl::StrCat(folder, "/gt/objects/", id, ".ply"));
    if (!mesh.ok()) return mesh.status();
    objects.emplace(id, MeshTruth::Object{TriangleSet(*std::move(mesh)), std::move(track)});
  }
  return std::make_unique<MeshTruth>(TriangleSet(*std::move(triangles)), std::move(objects),
                                     frame_s);
}

absl::StatusOr<std::unique_ptr<Recording>> Recording::Open(const std::string& folder) {
  auto sequence = client::Sequence::Open(folder);
  if (!sequence.ok()) return sequence.status();
  if (sequence->size() < 2) {
    return absl::DataLossError(absl::StrCat(folder, " has fewer than two frames"));
  }
  const double frame_s = 1e-9 * static_cast<double>(sequence->stamp_ns(1) - sequence->stamp_ns(0));
  auto truth = ReadTruth(folder, frame_s);
  if (!truth.ok()) return truth.status();
  return std::unique_ptr<Recording>(new Recording(*std::move(sequence), *std::move(truth)));
}

Stage Recording::StageFor(uint64_t index) const {
  Stage stage;
  stage.name = "recorded";
  stage.seed = index;
  stage.robot = DeliveryRobot();
  const Eigen::AngleAxisd turn(0.5 * M_PI * static_cast<double>(index % 4),
                               Eigen::Vector3d::UnitZ());
  Mission& mission = stage.mission;
  mission.start.position_W = turn * Eigen::Vector3d(-kCorner_m, -kCorner_m, 0.15);
  mission.goal_W = turn * Eigen::Vector3d(-kCorner_m, kCorner_m, 0.15);
  mission.min_W = {-8.5, -8.5, 0.15};
  mission.max_W = {8.5, 8.5, 0.15};
  mission.no_standing = {{Eigen::Vector2d(-60.0, -kRoad_m), Eigen::Vector2d(60.0, kRoad_m)},
                         {Eigen::Vector2d(-kRoad_m, -60.0), Eigen::Vector2d(kRoad_m, 60.0)}};
  stage.frame_s = 1e-9 * static_cast<double>(sequence_.stamp_ns(1) - sequence_.stamp_ns(0));
  stage.start_s = 0.6 + 0.4 * static_cast<double>(index / 4);
  const Trajectory straight = StraightAhead(stage.robot, mission, 0.0);
  stage.unobstructed_s = straight.ends_s();
  mission.start.heading_rad = straight.states().front().heading_rad;
  stage.ends_s = stage.start_s + 2.0 * stage.unobstructed_s;
  Surround(stage);
  stage.max_range_m = sequence_.info().max_range_m;
  stage.truth = truth_.get();
  stage.see = [this, near_W = stage.static_bounds](
                  uint64_t frame, const RobotState&,
                  bool labelled) -> absl::StatusOr<std::optional<Frame>> {
    if (frame >= sequence_.size()) return std::nullopt;
    auto read = sequence_.Read(frame);
    if (!read.ok()) return read.status();
    read->stamp_ns -= sequence_.stamp_ns(0);
    if (!labelled) {
      read->motions.clear();
      if (auto* cloud = std::get_if<PointCloud>(&read->observation)) cloud->labels.clear();
      if (auto* depth = std::get_if<DepthImage>(&read->observation)) depth->labels.clear();
    }
    LeaveOutFarStatic(near_W, *read);
    return std::optional<Frame>(*std::move(read));
  };
  return stage;
}

}  // namespace clearance::demo
