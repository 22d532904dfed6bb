// A map that was saved and loaded answers, and goes on integrating, byte for byte as one that was
// never disturbed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <map>
#include <random>

#include "server/engine/live_map.h"
#include "server/map/map_config_code.h"
#include "server/map/vdb_export.h"
#include "server/query/point_query.h"
#include "tests/engine/moving_scene.h"

namespace clearance {
namespace {

constexpr int kFrames = 11;

using Files = std::map<std::string, std::string, std::less<>>;

Files FilesOf(MapModel& model) {
  Files files;
  const auto sink = [&files](std::string_view name, std::string bytes) {
    files[std::string(name)] = std::move(bytes);
    return absl::OkStatus();
  };
  EXPECT_TRUE(model.Freeze()->Write(sink).ok());
  return files;
}

FileSource SourceOf(const Files& files) {
  return [&files](std::string_view name) -> absl::StatusOr<std::string> {
    const auto it = files.find(name);
    if (it == files.end()) return absl::DataLossError("missing");
    return it->second;
  };
}

// The files without what differs between two writings of the same grids: OpenVDB gives each .vdb
// file a random id, 36 characters behind magic, versions and a flag.
Files Comparable(Files files) {
  for (auto& [name, bytes] : files) {
    if (name.ends_with(".vdb")) bytes.replace(8 + 4 + 8 + 1, 36, std::string(36, '-'));
  }
  return files;
}

MapConfig Config() {
  MapConfig config;
  config.voxel_size_m = 0.15;
  config.max_distance_m = 2.0;
  config.object_lost_after_s = 0.2;
  return config;
}

void Advance(MapModel& model, int k) {
  ASSERT_TRUE(model.Integrate(MovingSceneFrame(k)).ok());
  if (k == 4) {
    RegionEdit edit;
    edit.action = RegionAction::kMarkOccupied;
    edit.box = Aabb(Eigen::Vector3d(2, 0, 0), Eigen::Vector3d(2.6, 0.7, 0.5));
    ASSERT_TRUE(model.Edit(edit).ok());
  }
}

struct Answers {
  std::vector<std::vector<float>> numbers;
  std::vector<uint8_t> states;
  std::vector<uint32_t> object_ids;
  friend bool operator==(const Answers&, const Answers&) = default;
};

Answers Ask(MapModel& model) {
  std::mt19937 random(17);
  std::uniform_real_distribution<double> x(-5, 5), y(-3, 7), z(-1.5, 3);
  Eigen::Matrix3Xd points(3, 4000);
  for (int i = 0; i < points.cols(); ++i) points.col(i) << x(random), y(random), z(random);
  QueryOptions options;
  options.gradients = options.objects = options.sigmas = options.unknown_distances = true;
  options.horizon_s = 0.3;
  const DistanceBatch batch = QueryDistances(model.View(), points, options);
  Answers answers;
  answers.numbers = {batch.distances_m, batch.sigmas_m, batch.unknown_distances_m};
  answers.numbers.emplace_back(batch.gradients_W.data(),
                               batch.gradients_W.data() + batch.gradients_W.size());
  answers.states = batch.states;
  answers.object_ids = batch.object_ids;
  return answers;
}

TEST(LiveMapSave, GoesOnAsIfNothingHadHappenedFromEveryFrame) {
  LiveMap undisturbed(Config());
  std::vector<Files> saved;
  std::vector<Answers> answers;
  for (int k = 0; k < kFrames; ++k) {
    Advance(undisturbed, k);
    saved.push_back(FilesOf(undisturbed));
    answers.push_back(Ask(undisturbed));
  }
  const Files last = Comparable(saved.back());
  ASSERT_EQ(undisturbed.world().objects().size(), 2u);
  for (int from = 0; from < kFrames; ++from) {
    // Another number of threads must make no difference either.
    tbb::global_control threads(tbb::global_control::max_allowed_parallelism, 1 + from % 3);
    const auto loaded = LiveMap::Load(Config(), SourceOf(saved[from]));
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    EXPECT_EQ(Comparable(FilesOf(**loaded)), Comparable(saved[from])) << from;
    EXPECT_EQ(Ask(**loaded), answers[from]) << from;
    for (int k = from + 1; k < kFrames; ++k) {
      Advance(**loaded, k);
      EXPECT_EQ(Ask(**loaded), answers[k]) << from << " " << k;
    }
    EXPECT_EQ(Comparable(FilesOf(**loaded)), last) << from;
    const MapView view = (*loaded)->View(), expected = undisturbed.View();
    EXPECT_EQ(view.revision, expected.revision);
    EXPECT_EQ(view.stamp_ns, expected.stamp_ns);
    EXPECT_EQ(view.sensor_path->size(), expected.sensor_path->size());
    ASSERT_EQ(view.objects.size(), expected.objects.size());
    for (size_t i = 0; i < view.objects.size(); ++i) {
      const ObjectView &a = view.objects[i], &b = expected.objects[i];
      EXPECT_EQ(a.class_name, b.class_name);
      EXPECT_EQ(a.life_state, b.life_state);
      EXPECT_EQ(a.T_W_L.matrix(), b.T_W_L.matrix());
      EXPECT_EQ(a.screw_W, b.screw_W);
      EXPECT_EQ(a.observations, b.observations);
      EXPECT_EQ(a.history->size(), b.history->size());
      EXPECT_EQ(a.Box().size_m, b.Box().size_m);
    }
    EXPECT_EQ((*loaded)->Sizes().observed_W->max(), undisturbed.Sizes().observed_W->max());
  }
}

TEST(LiveMapSave, AFrozenStateStaysWhileTheMapGoesOn) {
  LiveMap map(Config());
  for (int k = 0; k < 3; ++k) Advance(map, k);
  const Files now = FilesOf(map);
  const std::unique_ptr<FrozenModel> frozen = map.Freeze();
  for (int k = 3; k < 8; ++k) {
    Advance(map, k);
    map.View();
  }
  Files later;
  ASSERT_TRUE(frozen
                  ->Write([&](std::string_view name, std::string bytes) {
                    later[std::string(name)] = std::move(bytes);
                    return absl::OkStatus();
                  })
                  .ok());
  EXPECT_EQ(Comparable(later), Comparable(now));
}

TEST(LiveMapSave, AnEmptyMapIsSavedToo) {
  LiveMap empty(Config());
  const Files files = FilesOf(empty);
  const auto loaded = LiveMap::Load(Config(), SourceOf(files));
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  Advance(empty, 0);
  Advance(**loaded, 0);
  EXPECT_EQ(Comparable(FilesOf(**loaded)), Comparable(FilesOf(empty)));
}

TEST(LiveMapSave, FilesThatAreCutOrMissingAreDataLoss) {
  LiveMap map(Config());
  for (int k = 0; k < 4; ++k) Advance(map, k);
  const Files files = FilesOf(map);
  for (const auto& [name, bytes] : files) {
    for (const size_t size : {size_t{0}, size_t{3}, bytes.size() / 2, bytes.size() - 1}) {
      Files cut = files;
      cut[name].resize(size);
      EXPECT_TRUE(absl::IsDataLoss(LiveMap::Load(Config(), SourceOf(cut)).status()))
          << name << " " << size;
    }
    Files missing = files;
    missing.erase(name);
    EXPECT_TRUE(absl::IsDataLoss(LiveMap::Load(Config(), SourceOf(missing)).status())) << name;
  }
}

TEST(LiveMapSave, GridsOpenInOtherTools) {
  LiveMap map(Config());
  for (int k = 0; k < 4; ++k) Advance(map, k);
  Files files = FilesOf(map);
  const auto grids = ReadVdb(files["static.vdb"]);
  ASSERT_TRUE(grids.ok());
  std::vector<std::string> names;
  for (const auto& grid : *grids) names.push_back(grid->getName());
  EXPECT_THAT(names, ::testing::UnorderedElementsAre("mean_m", "weight", "free_evidence"));
  EXPECT_NEAR(grids->front()->voxelSize().x(), 0.15, 1e-12);
}

TEST(MapConfigCode, ComesBackExactly) {
  MapConfig config = Config();
  config.truncation_m = 0.31;
  config.bounds = Aabb(Eigen::Vector3d(-1e5, 2, 3), Eigen::Vector3d(4, 5.1, 6));
  config.overload = OverloadPolicy::kDropOldestStatic;
  config.memory_cap_bytes = 1ull << 40;
  const std::string bytes = EncodeMapConfig(config);
  const auto decoded = DecodeMapConfig(bytes);
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(EncodeMapConfig(*decoded), bytes);
  EXPECT_EQ(decoded->truncation_m, 0.31);
  EXPECT_EQ(decoded->bounds->max().y(), 5.1);
  EXPECT_TRUE(absl::IsDataLoss(DecodeMapConfig(bytes.substr(1)).status()));
  EXPECT_TRUE(absl::IsDataLoss(DecodeMapConfig(bytes + "x").status()));
}

}  // namespace
}  // namespace clearance
