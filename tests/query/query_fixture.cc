#include "tests/query/query_fixture.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace clearance::testing {
namespace {

struct Sample {
  Eigen::Vector3d p, normal;
};

std::vector<Sample> SampleSurface(const SignedDistance& distance, const Eigen::AlignedBox3d& box,
                                  double h) {
  std::vector<Sample> samples;
  const VoxelIndex low = VoxelOf(box.min(), h), high = VoxelOf(box.max(), h);
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        const Eigen::Vector3d centre = VoxelCentre({x, y, z}, h);
        const double d = distance(centre);
        if (std::abs(d) > h) continue;
        const Eigen::Vector3d normal = NumericalGradient(distance, centre);
        const Eigen::Vector3d site = centre - d * normal;
        if ((site - centre).cwiseAbs().maxCoeff() <= 0.5 * h) samples.push_back({site, normal});
      }
    }
  }
  return samples;
}

}  // namespace

Eigen::Vector3d NumericalGradient(const SignedDistance& distance, const Eigen::Vector3d& p,
                                  double step) {
  Eigen::Vector3d gradient;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d offset = step * Eigen::Vector3d::Unit(axis);
    gradient[axis] = distance(p + offset) - distance(p - offset);
  }
  return gradient.normalized();
}

std::vector<SurfaceSite> SampleSites(const SignedDistance& distance, const Eigen::AlignedBox3d& box,
                                     double voxel_size_m) {
  std::vector<SurfaceSite> sites;
  for (const Sample& sample : SampleSurface(distance, box, voxel_size_m)) {
    sites.push_back({sample.p.cast<float>(), sample.normal.cast<float>(), 0.01f});
  }
  return sites;
}

std::vector<Eigen::Vector3d> SamplePositions(const SignedDistance& distance,
                                             const Eigen::AlignedBox3d& box, double voxel_size_m) {
  std::vector<Eigen::Vector3d> positions;
  for (const Sample& sample : SampleSurface(distance, box, voxel_size_m)) {
    positions.push_back(sample.p);
  }
  return positions;
}

DistanceField ExactField(const SignedDistance& distance, const Eigen::AlignedBox3d& box,
                         double voxel_size_m, double max_distance_m) {
  const std::vector<Sample> samples = SampleSurface(distance, box, voxel_size_m);
  std::vector<uint16_t> codes;
  for (const Sample& sample : samples) {
    codes.push_back(static_cast<uint16_t>(CodeOfNormal(sample.normal.cast<float>()) << 9 |
                                          CodeOfSigmaVoxels(0.1f) << 4));
  }
  const BlockIndex low = BlockOf(VoxelOf(box.min(), voxel_size_m));
  const BlockIndex high = BlockOf(VoxelOf(box.max(), voxel_size_m));
  std::vector<BlockIndex> blocks;
  for (int x = low.x; x <= high.x; ++x) {
    for (int y = low.y; y <= high.y; ++y) {
      for (int z = low.z; z <= high.z; ++z) blocks.push_back({x, y, z});
    }
  }
  std::vector<std::shared_ptr<FieldBlock>> data(blocks.size());
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
    data[b] = std::make_shared<FieldBlock>();
    const Eigen::Vector3d origin = BlockOrigin(blocks[b], voxel_size_m);
    std::vector<Eigen::Vector3f> near;
    for (const Sample& sample : samples) near.push_back((sample.p - origin).cast<float>());
    for (int i = 0; i < kBlockVoxels; ++i) {
      const Eigen::Vector3d centre_W = VoxelCentre(VoxelAt(blocks[b], i), voxel_size_m);
      const Eigen::Vector3f centre = (centre_W - origin).cast<float>();
      float best = std::numeric_limits<float>::max();
      size_t nearest = 0;
      for (size_t s = 0; s < near.size(); ++s) {
        const float squared = (near[s] - centre).squaredNorm();
        if (squared < best) best = squared, nearest = s;
      }
      FieldVoxel& voxel = data[b]->voxels[i];
      const bool inside = distance(centre_W) < 0;
      VoxelState state = inside ? VoxelState::kOccupied : VoxelState::kFree;
      if (std::sqrt(best) <= max_distance_m) {
        const Eigen::Vector3d offset =
            (samples[nearest].p - centre_W) / voxel_size_m / FieldVoxel::kUnit;
        voxel.dx = static_cast<int16_t>(std::lround(offset.x()));
        voxel.dy = static_cast<int16_t>(std::lround(offset.y()));
        voxel.dz = static_cast<int16_t>(std::lround(offset.z()));
        voxel.attributes = codes[nearest];
        if (offset.cwiseAbs().maxCoeff() <= 128) state = VoxelState::kOccupied;
      }
      voxel.attributes |= static_cast<uint16_t>(state) | (inside ? 8 : 0);
    }
  });
  DistanceField field(voxel_size_m, max_distance_m);
  for (size_t b = 0; b < blocks.size(); ++b) field.Set(blocks[b], data[b]);
  return field;
}

MapView ViewOf(DistanceField field, double max_distance_m) {
  MapView view;
  view.config.voxel_size_m = field.voxel_size_m();
  view.config.max_distance_m = max_distance_m;
  view.field = std::move(field);
  view.published_at = std::chrono::steady_clock::now();
  return view;
}

ObjectView& AddObject(MapView& view, uint16_t id, std::shared_ptr<const ObjectShape> shape,
                      const Pose& T_W_L) {
  ObjectView object;
  object.id = ObjectId(id);
  object.shape = std::move(shape);
  object.T_W_L = T_W_L;
  object.screw_W.setZero();
  view.objects.push_back(object);
  return view.objects.back();
}

double CarDistance(const Eigen::Vector3d& p_L) {
  const auto box = [&p_L](const Eigen::Vector3d& centre, const Eigen::Vector3d& half) {
    const Eigen::Vector3d q = (p_L - centre).cwiseAbs() - half;
    return q.cwiseMax(0).norm() + std::min(0.0, q.maxCoeff());
  };
  return std::min(box({0, 0, 0.57}, {2.23, 0.87, 0.36}), box({-0.33, 0, 0.86}, {1.2, 0.77, 0.57}));
}

std::shared_ptr<const ObjectShape> CarShape(double voxel_size_m) {
  std::vector<SurfaceSite> sites = SampleSites(
      CarDistance, {Eigen::Vector3d(-3, -2, -0.5), Eigen::Vector3d(3, 2, 2)}, voxel_size_m);
  std::erase_if(sites, [](const SurfaceSite& site) { return site.normal_L.z() < -0.7f; });
  return BuildObjectShape(std::move(sites), voxel_size_m);
}

Eigen::Vector3d RandomIn(const Eigen::AlignedBox3d& box, std::mt19937& rng) {
  std::uniform_real_distribution<double> unit(0, 1);
  const Eigen::Vector3d r(unit(rng), unit(rng), unit(rng));
  return box.min() + r.cwiseProduct(box.sizes());
}

ErrorSummary Summarize(std::vector<double> errors) {
  ErrorSummary summary;
  if (errors.empty()) return summary;
  for (double& error : errors) error = std::abs(error);
  std::sort(errors.begin(), errors.end());
  for (double error : errors) summary.mean += error / static_cast<double>(errors.size());
  summary.p99 = errors[errors.size() * 99 / 100];
  summary.max = errors.back();
  return summary;
}

}  // namespace clearance::testing
