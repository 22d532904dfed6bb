// One ball along one path, by conservative advancement.
#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <optional>
#include <vector>

#include "server/query/clearance_probe.h"
#include "server/query/swept_bounds.h"
#include "server/query/trajectory_check.h"

namespace clearance {

// A path's pieces between consecutive poses, ready to be evaluated.
class PathGeometry {
 public:
  explicit PathGeometry(const RobotPath& path);

  size_t pieces() const { return pieces_.size(); }
  double start_s() const { return path_.horizons_s.front(); }
  double end_s() const { return path_.horizons_s.back(); }

  struct Piece {
    double begin_s, end_s;
    Eigen::Vector3d origin_W, step_W;  // of R
    Eigen::Quaterniond from, to;
    double turn_rad;
  };
  const Piece& piece(size_t i) const { return pieces_[i]; }
  // Where a point of R is at share in [0, 1] of the piece.
  static Eigen::Vector3d At(const Piece& piece, const Eigen::Vector3d& p_R, double share);
  // At the start of a path of a single pose.
  Eigen::Vector3d First(const Eigen::Vector3d& p_R) const { return path_.T_W_R.front() * p_R; }
  // All ways of a point of R, summed.
  double Travel(const Eigen::Vector3d& p_R) const;
  // What the balls' centres stay in.
  Eigen::AlignedBox3d Box(double reach_m) const;

 private:
  const RobotPath& path_;
  std::vector<Piece> pieces_;
};

// The state of a check that all balls share.
struct WalkResult {
  std::optional<double> collision_s;  // the first one so far
  double last_valid_s = 0;            // before it
  bool valid_before = false;
  // The least clearance so far.
  double clearance_m = 0, clearance_s = 0;
  ProbeAnswer at;
  bool any = false;

  void Offer(double clearance, double horizon_s, const ProbeAnswer& answer) {
    if (any && clearance >= clearance_m) return;
    clearance_m = clearance, clearance_s = horizon_s, at = answer, any = true;
  }
};

class PathWalk {
 public:
  PathWalk(const MapView& view, const ObjectIndex& index, ClearanceProbe* probe,
           const CheckOptions& options);

  // Checks the balls along the path.
  WalkResult Run(const std::vector<RobotSphere>& spheres, const RobotPath& path);

 private:
  struct Sample {
    double horizon_s = 0, share = 0;
    Eigen::Vector3d p_W;
    ProbeAnswer answer;
  };
  // What an interval's bounds leave open.
  struct Verdict {
    bool of_static = false;     // the static map or unknown space may collide: walk on by length
    bool of_objects = false;    // an object may collide: by length and time
    bool of_clearance = false;  // the least clearance may be missed by more than is stated
  };
  // Bounds of a hub's distances over a whole piece, that let balls around it be skipped.
  void FindHub(const std::vector<RobotSphere>& spheres);
  double HubBound(const PathGeometry::Piece& piece);

  // `limit_m`: unknown space farther away need not be found.
  Sample TakeSample(const PathGeometry::Piece& piece, const Eigen::Vector3d& p_R, double share,
                    double limit_m = std::numeric_limits<double>::infinity());
  void WalkSphere(const RobotSphere& sphere, const PathGeometry& path,
                  const std::vector<double>& hub_bounds, WalkResult* result);
  Sweep SweepOf(const PathGeometry::Piece& piece, const RobotSphere& sphere, const Sample& a,
                const Sample& b) const;
  Verdict Judge(const Sweep& sweep, const Sample& a, const Sample& b, double need_m,
                double wanted_m);
  bool StaticIsFree(const Sweep& sweep, const Sample& a, const Sample& b, double need_m);
  bool Accept(const Verdict& verdict, const Sweep& sweep, const Sample& a, const Sample& b,
              double need_m) const;

  const ObjectIndex& index_;
  ClearanceProbe* const probe_;
  const CheckOptions& options_;
  const std::vector<uint8_t> enabled_;
  const double voxel_m_;
  std::vector<NearObject> near_;
  Eigen::Vector3d hub_R_ = Eigen::Vector3d::Zero();
  bool with_hub_ = false;
};

}  // namespace clearance
