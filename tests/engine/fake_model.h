// A map model that computes nothing: every frame is a revision and one object for each motion. What
// the engine and the services do around the computation can so be tested alone.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "server/core/bytes.h"
#include "server/engine/map_model.h"
#include "server/engine/map_registry.h"

namespace clearance {

// What the fakes of one registry have seen; shared with the test.
struct FakeLog {
  std::mutex mu;
  std::vector<uint64_t> integrated;         // frame ids, in order
  std::vector<uint64_t> integrated_points;  // of the same frames
  std::atomic<int> edits = 0, evictions = 0;
  std::atomic<uint64_t> memory_bytes = 1000;  // what maps say they take
};

class FakeModel final : public MapModel {
 public:
  FakeModel(const MapConfig& config, std::shared_ptr<FakeLog> log)
      : config_(config), log_(std::move(log)), surface_(config.voxel_size_m) {}

  absl::StatusOr<Integrated> Integrate(const Frame& frame) override {
    if (absl::Status s = ValidateFrame(frame); !s.ok()) return s;
    uint64_t points = 0;
    if (const auto* cloud = std::get_if<PointCloud>(&frame.observation)) {
      points = cloud->points_X.cols();
    }
    std::lock_guard lock(log_->mu);
    log_->integrated.push_back(frame.frame_id);
    log_->integrated_points.push_back(points);
    ++revision_;
    stamp_ns_ = std::max(stamp_ns_, frame.stamp_ns);
    Integrated result;
    result.stages.emplace_back("fake", 0.0);
    for (const ObjectMotion& motion : frame.motions) {
      if (motion.kind == ObjectMotion::Kind::kWorldFromObject) continue;
      result.violations.push_back({"frame.motions", 0, "the fake knows no object"});
    }
    return result;
  }
  absl::StatusOr<Edited> Edit(const RegionEdit&) override {
    ++log_->edits;
    ++revision_;
    return Edited{7};
  }
  MapView View() override {
    MapView view;
    view.config = config_;
    view.revision = view.field_revision = revision_;
    view.stamp_ns = stamp_ns_;
    view.field = DistanceField(config_.voxel_size_m, config_.max_distance_m);
    return view;
  }
  uint64_t revision() const override { return revision_; }
  std::optional<Eviction> ChooseEviction(double) override { return Eviction{}; }
  void Evict(const Eviction&) override {
    ++log_->evictions;
    ++revision_;
  }
  std::unique_ptr<FrozenModel> Freeze() override {
    ByteWriter out;
    out.Put(revision_);
    out.Put(stamp_ns_);
    return std::make_unique<Frozen>(out.Take());
  }
  static absl::StatusOr<std::unique_ptr<MapModel>> Load(const MapConfig& config,
                                                        std::shared_ptr<FakeLog> log,
                                                        const FileSource& files) {
    auto model = std::make_unique<FakeModel>(config, std::move(log));
    const absl::StatusOr<std::string> state = files("fake.bin");
    if (!state.ok()) return state.status();
    ByteReader in(*state, "fake.bin");
    model->revision_ = in.Get<uint64_t>();
    model->stamp_ns_ = in.Get<int64_t>();
    if (absl::Status s = in.Finish(); !s.ok()) return s;
    return model;
  }
  MapSizes Sizes() override { return {log_->memory_bytes, 10, 1, std::nullopt}; }
  absl::StatusOr<Surface> FindSurface(ObjectId id, uint32_t) override {
    if (!id.is_static()) return absl::NotFoundError("object does not exist. Objects: none");
    return Surface{&surface_, Pose::Identity(), id, 0};
  }
  absl::StatusOr<Mesh> ExtractMesh(ObjectId id, uint32_t) override {
    if (!id.is_static()) return absl::NotFoundError("object does not exist. Objects: none");
    Mesh mesh;
    mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    mesh.normals = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
    mesh.triangles = {{0, 1, 2}};
    return mesh;
  }

 private:
  class Frozen final : public FrozenModel {
   public:
    explicit Frozen(std::string state) : state_(std::move(state)) {}
    absl::Status Write(const FileSink& sink) const override { return sink("fake.bin", state_); }

   private:
    const std::string state_;
  };

  const MapConfig config_;
  const std::shared_ptr<FakeLog> log_;
  SurfaceMap surface_;
  uint64_t revision_ = 0;
  int64_t stamp_ns_ = 0;
};

inline MapModelFactory FakeModelFactory(std::shared_ptr<FakeLog> log) {
  return [log](const MapConfig& config) { return std::make_unique<FakeModel>(config, log); };
}

inline RegistryOptions FakeRegistry(std::shared_ptr<FakeLog> log, size_t max_maps) {
  RegistryOptions options;
  options.model = FakeModelFactory(std::move(log));
  options.max_maps = max_maps;
  return options;
}

inline Frame FakeFrame(uint64_t id, int points = 1, const std::string& source = "default") {
  Frame frame;
  frame.frame_id = id;
  frame.stamp_ns = static_cast<int64_t>(id) * 100'000'000;
  frame.source_id = source;
  if (points > 0) {
    PointCloud cloud;
    cloud.points_X = Eigen::Matrix3Xf::Constant(3, points, 1.0f);
    frame.observation = std::move(cloud);
  }
  return frame;
}

}  // namespace clearance
