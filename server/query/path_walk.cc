#include "server/query/path_walk.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "server/query/object_query.h"

namespace clearance {
namespace {

// Intervals that bounds cannot clear are walked in these steps.
constexpr double kStep_m = 1e-3, kStep_s = 1e-3;
// And in these where both ends are nearly in collision.
constexpr double kFineStep_m = 1e-4, kFineStep_s = 1e-4;
constexpr double kNearlyCollides_m = 2e-3;
// The least clearance is followed down to these.
constexpr double kClearanceStep_m = 1e-2, kClearanceStep_s = 5e-3;
constexpr double kClearanceTolerance_m = 2e-3, kClearanceTolerance = 0.01;
// The reported distance to static surfaces is that to the field's sites give or take less than a
// voxel: it errs between voxel centres and changes by steps where one cell of centres passes into
// the next. Beyond 2.5 voxels it is never less than the distance to the sites.
constexpr double kFieldError_voxels = 1.0;
constexpr double kSitesOnly_voxels = 2.5;
// Nearer than this it is a blend of the corners' signed distances, steady across the surface.
constexpr double kBlendOnly_voxels = 1.0;
// Largest sigma that the field stores.
constexpr double kLargestSigma_voxels = 2.0;
// Inside one cell of voxel centres the reported distance changes by at most this per metre.
constexpr double kCellSlope = 2.0;
// The cells that touch a voxel on the inner side of a surface reach this far around its cube.
constexpr double kCellReach_voxels = 1.7320508;

// How far beyond the least clearance unknown space is searched for: it bounds the steps.
constexpr double kUnknownReach = 1.5, kUnknownReach_m = 0.3;

// Fewer balls are walked one by one.
constexpr size_t kHubSpheres = 4;

}  // namespace

PathGeometry::PathGeometry(const RobotPath& path) : path_(path) {
  for (size_t i = 0; i + 1 < path.T_W_R.size(); ++i) {
    Piece piece;
    piece.begin_s = path.horizons_s[i];
    piece.end_s = path.horizons_s[i + 1];
    piece.origin_W = path.T_W_R[i].translation();
    piece.step_W = path.T_W_R[i + 1].translation() - piece.origin_W;
    piece.from = Eigen::Quaterniond(path.T_W_R[i].linear());
    piece.to = Eigen::Quaterniond(path.T_W_R[i + 1].linear());
    piece.turn_rad = piece.from.angularDistance(piece.to);
    pieces_.push_back(piece);
  }
}

Eigen::Vector3d PathGeometry::At(const Piece& piece, const Eigen::Vector3d& p_R, double share) {
  const Eigen::Vector3d origin_W = piece.origin_W + share * piece.step_W;
  if (p_R.isZero(0)) return origin_W;
  if (piece.turn_rad == 0) return origin_W + piece.from * p_R;
  return origin_W + piece.from.slerp(share, piece.to) * p_R;
}

double PathGeometry::Travel(const Eigen::Vector3d& p_R) const {
  double travel_m = 0;
  for (const Piece& piece : pieces_) travel_m += piece.step_W.norm() + piece.turn_rad * p_R.norm();
  return travel_m;
}

Eigen::AlignedBox3d PathGeometry::Box(double reach_m) const {
  Eigen::AlignedBox3d box;
  for (const Pose& T_W_R : path_.T_W_R) box.extend(T_W_R.translation());
  box.min().array() -= reach_m;
  box.max().array() += reach_m;
  return box;
}

PathWalk::PathWalk(const MapView& view, const ObjectIndex& index, ClearanceProbe* probe,
                   const CheckOptions& options)
    : index_(index),
      probe_(probe),
      options_(options),
      enabled_(EnabledEntries(index, options.layers)),
      voxel_m_(view.field.voxel_size_m()) {}

WalkResult PathWalk::Run(const std::vector<RobotSphere>& spheres, const RobotPath& path) {
  const PathGeometry geometry(path);
  near_.clear();
  if (probe_->with_objects()) {
    double reach_m = 0;
    for (const RobotSphere& sphere : spheres) reach_m = std::max(reach_m, sphere.centre_R.norm());
    CollectNearObjects(index_, enabled_, geometry.Box(reach_m), geometry.start_s(),
                       geometry.end_s(), options_.sigma_margin, probe_->max_distance_m(), &near_);
  }
  WalkResult result;
  if (geometry.pieces() == 0) {
    for (const RobotSphere& sphere : spheres) {
      const ProbeAnswer answer =
          probe_->At(geometry.First(sphere.centre_R), geometry.start_s(), !near_.empty());
      const double clearance_m = answer.least_m() - sphere.radius_m;
      result.Offer(clearance_m, geometry.start_s(), answer);
      if (clearance_m < options_.margin_m) result.collision_s = geometry.start_s();
    }
    return result;
  }
  std::vector<double> hub_bounds;
  FindHub(spheres);
  if (with_hub_) {
    for (size_t i = 0; i < geometry.pieces(); ++i) {
      hub_bounds.push_back(HubBound(geometry.piece(i)));
    }
  }
  for (const RobotSphere& sphere : spheres) {
    if (options_.cancelled && options_.cancelled()) return result;
    WalkSphere(sphere, geometry, hub_bounds, &result);
  }
  if (!result.collision_s) return result;
  // What came before the collision was clear of it: there the clearance is least.
  const double collision_s = *result.collision_s;
  result.any = false;
  for (size_t i = 0; i < geometry.pieces(); ++i) {
    const PathGeometry::Piece& piece = geometry.piece(i);
    if (collision_s > piece.end_s) continue;
    const double share =
        std::clamp((collision_s - piece.begin_s) / (piece.end_s - piece.begin_s), 0.0, 1.0);
    for (const RobotSphere& sphere : spheres) {
      const Sample sample = TakeSample(piece, sphere.centre_R, share);
      result.Offer(sample.answer.least_m() - sphere.radius_m, collision_s, sample.answer);
    }
    break;
  }
  return result;
}

void PathWalk::FindHub(const std::vector<RobotSphere>& spheres) {
  with_hub_ = spheres.size() >= kHubSpheres;
  if (!with_hub_) return;
  Eigen::AlignedBox3d box;
  for (const RobotSphere& sphere : spheres) box.extend(sphere.centre_R);
  hub_R_ = box.center();
}

double PathWalk::HubBound(const PathGeometry::Piece& piece) {
  const Sample a = TakeSample(piece, hub_R_, 0), b = TakeSample(piece, hub_R_, 1);
  const Sweep sweep = SweepOf(piece, {hub_R_, 0}, a, b);
  // Balls beside the hub see other surfaces and other sides of them: nothing but distances to whole
  // sets counts here.
  if (!options_.unknown_as_occupied) return 0;
  const double field_m = kFieldError_voxels * voxel_m_;
  double bound_m = std::min(
      LeastBetween(a.answer.unknown_m, b.answer.unknown_m, sweep.travel_m),
      LeastBetween(a.answer.distance_m - field_m, b.answer.distance_m - field_m, sweep.travel_m) -
          field_m - options_.sigma_margin * kLargestSigma_voxels * voxel_m_);
  for (const NearObject& object : near_) {
    bound_m = std::min(bound_m, BoxBound(index_, object, sweep, options_.sigma_margin));
  }
  return bound_m - sweep.deviation_m;
}

PathWalk::Sample PathWalk::TakeSample(const PathGeometry::Piece& piece, const Eigen::Vector3d& p_R,
                                      double share, double limit_m) {
  Sample sample;
  sample.share = share;
  sample.horizon_s =
      share >= 1 ? piece.end_s : piece.begin_s + share * (piece.end_s - piece.begin_s);
  sample.p_W = PathGeometry::At(piece, p_R, share);
  sample.answer = probe_->At(sample.p_W, sample.horizon_s, !near_.empty(), limit_m);
  return sample;
}

Sweep PathWalk::SweepOf(const PathGeometry::Piece& piece, const RobotSphere& sphere,
                        const Sample& a, const Sample& b) const {
  Sweep sweep;
  sweep.p0_W = a.p_W;
  sweep.p1_W = b.p_W;
  sweep.horizon0_s = a.horizon_s;
  sweep.horizon1_s = b.horizon_s;
  const double share = b.share - a.share;
  const double arm_m = sphere.centre_R.norm(), turn = piece.turn_rad * share;
  sweep.travel_m = share * piece.step_W.norm() + turn * arm_m;
  sweep.deviation_m = turn * turn * arm_m / 8;
  return sweep;
}

void PathWalk::WalkSphere(const RobotSphere& sphere, const PathGeometry& path,
                          const std::vector<double>& hub_bounds, WalkResult* result) {
  const double need_m = sphere.radius_m + options_.margin_m;
  const double from_hub_m = with_hub_ ? (sphere.centre_R - hub_R_).norm() : 0;
  // Unknown space well beyond the least clearance neither changes it nor collides.
  const auto limit_m = [&] {
    if (!result->any) return std::numeric_limits<double>::infinity();
    return kUnknownReach * (result->clearance_m + sphere.radius_m) + kUnknownReach_m;
  };
  std::vector<Sample> ends;
  Sample a;
  bool have_a = false;
  for (size_t i = 0; i < path.pieces(); ++i) {
    const PathGeometry::Piece& piece = path.piece(i);
    if (result->collision_s && piece.begin_s >= *result->collision_s) return;
    if (with_hub_ && result->any) {
      const double bound_m = hub_bounds[i] - from_hub_m;
      // The least clearance need not be better than the field.
      const double likely_m = bound_m + 2 * kFieldError_voxels * voxel_m_;
      if (bound_m >= need_m && likely_m - sphere.radius_m >= result->clearance_m) {
        have_a = false;
        continue;
      }
    }
    if (have_a) {
      a.share = 0;
    } else {
      a = TakeSample(piece, sphere.centre_R, 0, limit_m());
    }
    if (i == 0 || !have_a) {
      result->Offer(a.answer.least_m() - sphere.radius_m, a.horizon_s, a.answer);
      if (a.answer.least_m() < need_m) {
        result->collision_s = a.horizon_s;
        result->valid_before = i > 0;
        result->last_valid_s = a.horizon_s;
        return;
      }
    }
    have_a = true;
    ends.assign(1, TakeSample(piece, sphere.centre_R, 1, limit_m()));
    while (!ends.empty()) {
      if (result->collision_s && a.horizon_s >= *result->collision_s) return;
      const Sample& b = ends.back();
      const Sweep sweep = SweepOf(piece, sphere, a, b);
      const double best_m = std::min({result->clearance_m + sphere.radius_m,
                                      double{a.answer.least_m()}, double{b.answer.least_m()}});
      const double wanted_m =
          best_m - kClearanceTolerance_m - kClearanceTolerance * std::abs(best_m);
      const Verdict verdict = Judge(sweep, a, b, need_m, wanted_m);
      if (!Accept(verdict, sweep, a, b, need_m)) {
        const double middle = 0.5 * (a.share + b.share);
        // Where numbers end, so does halving.
        if (middle > a.share && middle < b.share) {
          ends.push_back(TakeSample(piece, sphere.centre_R, middle, limit_m()));
          continue;
        }
      }
      if (b.answer.least_m() < need_m) {
        if (!result->collision_s || b.horizon_s < *result->collision_s) {
          result->collision_s = b.horizon_s;
          result->last_valid_s = a.horizon_s;
          result->valid_before = true;
        }
        return;
      }
      result->Offer(b.answer.least_m() - sphere.radius_m, b.horizon_s, b.answer);
      a = b;
      ends.pop_back();
      if (options_.cancelled && options_.cancelled()) return;
    }
  }
}

bool PathWalk::StaticIsFree(const Sweep& sweep, const Sample& a, const Sample& b, double need_m) {
  if (!probe_->with_static()) return true;
  const double length_m = (b.p_W - a.p_W).norm();
  const double sigma_m = options_.sigma_margin * kLargestSigma_voxels * voxel_m_;
  const double field_m = kFieldError_voxels * voxel_m_;
  double bound_m =
      LeastBetween(a.answer.distance_m - field_m, b.answer.distance_m - field_m, length_m) -
      sweep.deviation_m;
  if (bound_m < kSitesOnly_voxels * voxel_m_) bound_m -= field_m;
  bool sided = true;  // the way stays away from cells in which the sign may jump
  if (!options_.unknown_as_occupied) {
    sided = LeastBetween(a.answer.inner_m, b.answer.inner_m, length_m) - sweep.deviation_m >
            kCellReach_voxels * voxel_m_;
  }
  if (sided && bound_m - sigma_m >= need_m) return true;

  // Near collisions, cell by cell: at most one face of a cell lies between the ends.
  const VoxelIndex cell_a = VoxelOf(a.p_W.array() - 0.5 * voxel_m_, voxel_m_);
  const VoxelIndex cell_b = VoxelOf(b.p_W.array() - 0.5 * voxel_m_, voxel_m_);
  if ((cell_a - cell_b).lpNorm<1>() > 1) return false;
  const double lesser_m = std::min(a.answer.distance_m, b.answer.distance_m);
  const double slope = lesser_m > (kSitesOnly_voxels + 0.5) * voxel_m_ ? 1.0 : kCellSlope;
  if (lesser_m - slope * (length_m + sweep.deviation_m) - sigma_m < need_m) return false;
  // At a surface the distance passes through zero; farther away a change of side is a step.
  if (lesser_m < kBlendOnly_voxels * voxel_m_) return true;
  return !probe_->OnBothSides(a.p_W) && !probe_->OnBothSides(b.p_W);
}

PathWalk::Verdict PathWalk::Judge(const Sweep& sweep, const Sample& a, const Sample& b,
                                  double need_m, double wanted_m) {
  Verdict verdict;
  const double length_m = (b.p_W - a.p_W).norm();
  const double unknown_m =
      LeastBetween(a.answer.unknown_m, b.answer.unknown_m, length_m) - sweep.deviation_m;
  const double least_m =
      LeastBetween(a.answer.distance_m, b.answer.distance_m, length_m) - sweep.deviation_m;
  verdict.of_static =
      (options_.unknown_as_occupied && unknown_m < need_m) || !StaticIsFree(sweep, a, b, need_m);
  verdict.of_clearance = unknown_m < wanted_m || least_m < wanted_m;
  for (const NearObject& object : near_) {
    if (verdict.of_objects && verdict.of_clearance) break;
    double bound_m = BoxBound(index_, object, sweep, options_.sigma_margin);
    const double both_m = std::max(need_m, wanted_m);
    if (bound_m < both_m) {
      bound_m = std::max(bound_m, SurfaceBound(index_, object, sweep, a.answer.distance_m,
                                               b.answer.distance_m, options_.sigma_margin));
    }
    verdict.of_objects |= bound_m < need_m;
    // The sites' own sigmas differ a little: bounds below the ends' values by that much say no
    // more, and are not followed.
    const double sigmas_m = options_.sigma_margin * index_.entries[object.entry].max_site_sigma_m;
    verdict.of_clearance |= bound_m < wanted_m - sigmas_m;
  }
  return verdict;
}

bool PathWalk::Accept(const Verdict& verdict, const Sweep& sweep, const Sample& a, const Sample& b,
                      double need_m) const {
  const double duration_s = sweep.horizon1_s - sweep.horizon0_s;
  const double lesser_m = std::min(a.answer.least_m(), b.answer.least_m());
  const bool fine = lesser_m < need_m + kNearlyCollides_m;
  const double step_m = fine ? kFineStep_m : kStep_m, step_s = fine ? kFineStep_s : kStep_s;
  if (verdict.of_static && sweep.travel_m > step_m) return false;
  if (verdict.of_objects && (sweep.travel_m > step_m || duration_s > step_s)) return false;
  return !verdict.of_clearance ||
         (sweep.travel_m <= kClearanceStep_m && duration_s <= kClearanceStep_s);
}

}  // namespace clearance
