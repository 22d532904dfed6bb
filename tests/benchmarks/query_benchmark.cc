// In-process look-ups with gradient and state: a street of 50 x 50 x 6 m at 0.1 m, random points
// and points along straight edges, with 0 to 1,000 cars of about 2,700 surfels in it.
#include <benchmark/benchmark.h>

#include <cmath>
#include <map>
#include <random>

#include "server/query/point_query.h"
#include "tests/query/query_fixture.h"

namespace clearance {
namespace {

constexpr double kVoxel = 0.1;
constexpr double kHalfSide = 25;
constexpr double kHeight = 6;

// Ground, two facades and a row of poles, by closed form.
double StreetDistance(const Eigen::Vector3d& p) {
  const double facade = 12 - std::abs(p.y());
  const double along = p.x() - 6 * std::round(p.x() / 6);
  const double pole = std::hypot(along, std::abs(p.y()) - 8) - 0.1;
  return std::min({p.z(), facade, pole});
}

// The site is the foot point itself: timing needs the memory layout, not the sampling.
DistanceField StreetField(double max_distance_m) {
  DistanceField field(kVoxel, max_distance_m);
  const BlockIndex low = BlockOf(VoxelOf({-kHalfSide, -kHalfSide, -0.5}, kVoxel));
  const BlockIndex high = BlockOf(VoxelOf({kHalfSide, kHalfSide, kHeight}, kVoxel));
  for (int x = low.x; x <= high.x; ++x) {
    for (int y = low.y; y <= high.y; ++y) {
      for (int z = low.z; z <= high.z; ++z) {
        auto block = std::make_shared<FieldBlock>();
        for (int i = 0; i < kBlockVoxels; ++i) {
          const Eigen::Vector3d centre = VoxelCentre(VoxelAt({x, y, z}, i), kVoxel);
          const double d = StreetDistance(centre);
          FieldVoxel& voxel = block->voxels[i];
          voxel.attributes = d < 0 ? 2 | 8 : 1;
          if (std::abs(d) > max_distance_m) continue;
          const Eigen::Vector3d normal = testing::NumericalGradient(StreetDistance, centre);
          const Eigen::Vector3d offset = -d * normal / kVoxel / FieldVoxel::kUnit;
          voxel.dx = static_cast<int16_t>(std::lround(offset.x()));
          voxel.dy = static_cast<int16_t>(std::lround(offset.y()));
          voxel.dz = static_cast<int16_t>(std::lround(offset.z()));
          voxel.attributes |= static_cast<uint16_t>(CodeOfNormal(normal.cast<float>()) << 9);
        }
        field.Set({x, y, z}, block);
      }
    }
  }
  return field;
}

const MapView& Street(int max_distance_m, int objects) {
  static std::map<std::pair<int, int>, MapView> views;
  auto [it, inserted] = views.try_emplace({max_distance_m, objects});
  MapView& view = it->second;
  if (!inserted) return view;
  if (objects == 0) {
    view = testing::ViewOf(StreetField(max_distance_m), max_distance_m);
    return view;
  }
  view = Street(max_distance_m, 0);
  const auto shape = testing::CarShape(kVoxel);
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  // Dense traffic: a car on every 60 square metres, beyond the field's borders where there are
  // many.
  const double traffic_half_m = 0.5 * std::sqrt(60.0 * objects);
  for (int i = 0; i < objects; ++i) {
    Pose T_W_L(Eigen::AngleAxisd(unit(rng) * M_PI, Eigen::Vector3d::UnitZ()));
    T_W_L.translation() << traffic_half_m * unit(rng), traffic_half_m * unit(rng), 0;
    ObjectView& object = testing::AddObject(view, static_cast<uint16_t>(1 + i), shape, T_W_L);
    const Eigen::Vector3d velocity = 8 * T_W_L.linear().col(0);
    const Eigen::Vector3d spin(0, 0, 0.3 * unit(rng));
    const Eigen::Vector3d origin_W = T_W_L.translation();
    object.screw_W.head<3>() = velocity - spin.cross(origin_W);
    object.screw_W.tail<3>() = spin;
  }
  view.object_index = BuildObjectIndex(view.objects);
  return view;
}

Eigen::Vector3d RandomPoint(std::mt19937& rng) {
  return testing::RandomIn({Eigen::Vector3d(-24, -24, 0), Eigen::Vector3d(24, 24, 5.5)}, rng);
}

Eigen::Matrix3Xd RandomPoints(int count) {
  std::mt19937 rng(2);
  Eigen::Matrix3Xd points(3, count);
  for (int i = 0; i < count; ++i) points.col(i) = RandomPoint(rng);
  return points;
}

// Straight edges of 100 points, 5 cm apart.
Eigen::Matrix3Xd EdgePoints(int count) {
  std::mt19937 rng(3);
  Eigen::Matrix3Xd points(3, count);
  Eigen::Vector3d from = Eigen::Vector3d::Zero(), direction = from;
  for (int i = 0; i < count; ++i) {
    if (i % 100 == 0) {
      from = RandomPoint(rng);
      direction = (RandomPoint(rng) - from).normalized();
    }
    points.col(i) = from + 0.05 * (i % 100) * direction;
  }
  return points;
}

void Run(benchmark::State& state, const Eigen::Matrix3Xd& points, QueryOptions options) {
  const MapView& view = Street(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  options.parallel = false;
  for (auto _ : state) benchmark::DoNotOptimize(QueryDistances(view, points, options));
  // The console prints seconds with an SI prefix: 103n is 103 ns a point.
  state.counters["s_per_point"] =
      benchmark::Counter(static_cast<double>(state.iterations() * points.cols()),
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

constexpr int kPoints = 100'000;

void Random(benchmark::State& state) { Run(state, RandomPoints(kPoints), {.gradients = true}); }
void RandomDistanceOnly(benchmark::State& state) { Run(state, RandomPoints(kPoints), {}); }
void Coherent(benchmark::State& state) { Run(state, EdgePoints(kPoints), {.gradients = true}); }
void RandomAhead(benchmark::State& state) {
  Run(state, RandomPoints(kPoints), {.horizon_s = 1, .gradients = true});
}
void CoherentAheadPerPoint(benchmark::State& state) {
  QueryOptions options{.gradients = true};
  for (int i = 0; i < kPoints; ++i)
    options.horizons_s.push_back(0.02f * static_cast<float>(i % 100));
  Run(state, EdgePoints(kPoints), options);
}
void UnknownDistances(benchmark::State& state) {
  Run(state, EdgePoints(2000), {.unknown_distances = true});
}

void BuildIndex(benchmark::State& state) {
  const MapView& view = Street(5, static_cast<int>(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(BuildObjectIndex(view.objects));
}

void BuildShape(benchmark::State& state) {
  const auto shape = testing::CarShape(kVoxel);
  for (auto _ : state) benchmark::DoNotOptimize(BuildObjectShape(shape->sites, kVoxel));
}

const std::vector<int64_t> kCrowds = {0, 10, 100, 1000};
BENCHMARK(Random)->ArgsProduct({{2, 5}, kCrowds})->Unit(benchmark::kMillisecond);
BENCHMARK(RandomDistanceOnly)->ArgsProduct({{5}, {0}})->Unit(benchmark::kMillisecond);
BENCHMARK(Coherent)->ArgsProduct({{2, 5}, kCrowds})->Unit(benchmark::kMillisecond);
BENCHMARK(RandomAhead)->ArgsProduct({{5}, kCrowds})->Unit(benchmark::kMillisecond);
BENCHMARK(CoherentAheadPerPoint)->ArgsProduct({{5}, kCrowds})->Unit(benchmark::kMillisecond);
BENCHMARK(UnknownDistances)->ArgsProduct({{5}, {0}})->Unit(benchmark::kMillisecond);
BENCHMARK(BuildIndex)->Arg(10)->Arg(100)->Arg(1000)->Unit(benchmark::kMicrosecond);
BENCHMARK(BuildShape)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace clearance

BENCHMARK_MAIN();
