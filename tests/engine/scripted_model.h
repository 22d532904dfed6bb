// A map that changes at random with every frame: blocks, tiles, holes, objects that come, move,
// change their surface and go. Made by seed; computes nothing.
#pragma once

#include <map>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "server/engine/map_model.h"
#include "server/map/screw_twist.h"
#include "server/query/object_index.h"
#include "server/query/object_tree.h"

namespace clearance::testing {

class ScriptedModel final : public MapModel {
 public:
  ScriptedModel(const MapConfig& config, uint32_t seed, int blocks_a_frame)
      : config_(config),
        random_(seed),
        blocks_a_frame_(blocks_a_frame),
        field_(config.voxel_size_m, config.max_distance_m),
        surface_(config.voxel_size_m) {}

  absl::StatusOr<Integrated> Integrate(const Frame& frame) override {
    stamp_ns_ = frame.stamp_ns;
    Change();
    return Integrated{};
  }
  absl::StatusOr<Edited> Edit(const RegionEdit&) override {
    Change();
    return Edited{1};
  }
  MapView View() override {
    MapView view;
    view.config = config_;
    view.revision = view.field_revision = revision_;
    view.stamp_ns = stamp_ns_;
    view.field = field_;
    for (const auto& [key, object] : objects_) view.objects.push_back(object);
    view.object_index = BuildObjectIndex(view.objects);
    return view;
  }
  MapSizes Sizes() override { return {}; }
  absl::StatusOr<Surface> FindSurface(ObjectId, uint32_t) override {
    return absl::NotFoundError("no surfaces");
  }
  absl::StatusOr<Mesh> ExtractMesh(ObjectId, uint32_t) override {
    return absl::NotFoundError("no meshes");
  }
  uint64_t revision() const override { return revision_; }
  std::optional<Eviction> ChooseEviction(double) override { return std::nullopt; }
  void Evict(const Eviction&) override {}
  std::unique_ptr<FrozenModel> Freeze() override {
    class Nothing final : public FrozenModel {
      absl::Status Write(const FileSink&) const override {
        return absl::UnimplementedError("a scripted model is not kept");
      }
    };
    return std::make_unique<Nothing>();
  }

 private:
  int Random(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double Real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  void Change() {
    ++revision_;
    for (int i = Random(0, blocks_a_frame_); i > 0; --i) ChangeBlock();
    if (Random(0, 3) == 0 && objects_.size() < 6) AddObject();
    if (Random(0, 7) == 0 && !objects_.empty()) {
      objects_.erase(std::next(objects_.begin(), Random(0, static_cast<int>(objects_.size()) - 1)));
    }
    for (auto& [key, object] : objects_) {
      if (object.life_state == LifeState::kRetired) continue;  // stands still
      object.T_W_L = Orthonormalized(object.PoseAt(0.1));
      object.last_seen_ns = stamp_ns_;
      ++object.observations;
      if (Random(0, 4) == 0) object.shape = RandomShape();
      if (Random(0, 9) == 0) object.life_state = static_cast<LifeState>(Random(1, 4));
    }
  }

  void ChangeBlock() {
    const BlockIndex index{Random(-9, 9), Random(-9, 9), Random(-2, 2)};
    const int what = Random(0, 9);
    if (what == 0) return field_.Set(index, nullptr);
    if (what == 1) return field_.Set(index, nullptr, static_cast<uint8_t>(Random(0, 2)));
    const FieldBlock* before = field_.FindBlock(index);
    auto block = before ? std::make_shared<FieldBlock>(*before) : std::make_shared<FieldBlock>();
    const int voxels = what < 6 ? Random(0, 20) : kBlockVoxels;
    for (int i = 0; i < voxels; ++i) {
      FieldVoxel& voxel = block->voxels[voxels == kBlockVoxels ? i : Random(0, kBlockVoxels - 1)];
      voxel.attributes = static_cast<uint16_t>(Random(0, 0x3fff) << 2 | Random(0, 2));
      voxel.dx =
          Random(0, 5) == 0 ? FieldVoxel::kNoSite : static_cast<int16_t>(Random(-30720, 30720));
      voxel.dy = static_cast<int16_t>(Random(-30720, 30720));
      voxel.dz = static_cast<int16_t>(Random(-30720, 30720));
    }
    field_.Set(index, std::move(block));
  }

  void AddObject() {
    const auto id = static_cast<uint16_t>(Random(1, 20));
    const uint32_t generation = ++generations_[id];
    ObjectView object;
    object.id = ObjectId(id);
    object.generation = generation;
    object.class_name = Random(0, 1) ? "car" : "";
    object.source_id = "default";
    object.T_W_L = Pose(Eigen::AngleAxisd(Real(-3, 3), Eigen::Vector3d::Random().normalized()));
    object.T_W_L.translation() = Eigen::Vector3d(Real(-5, 5), Real(-5, 5), Real(-1, 1));
    for (int i = 0; i < 6; ++i) object.screw_W[i] = Real(-2, 2);
    object.twist = TwistOfScrew(object.screw_W, object.T_W_L);
    object.position_sigma_m = Real(0, 0.2);
    object.velocity_sigma_mps = Real(0, 0.5);
    object.first_seen_ns = stamp_ns_;
    if (Random(0, 3) != 0) object.shape = RandomShape();
    objects_.emplace(std::pair(object.id, generation), std::move(object));
  }

  // Coordinates on a coarse grid: ties, which a tree must break alike everywhere.
  std::shared_ptr<const ObjectShape> RandomShape() {
    std::vector<SurfaceSite> sites(static_cast<size_t>(Random(0, 300)));
    for (SurfaceSite& site : sites) {
      for (int axis = 0; axis < 3; ++axis)
        site.p_L[axis] = 0.1f * static_cast<float>(Random(-9, 9));
      site.normal_L =
          Eigen::Vector3f(static_cast<float>(Real(-1, 1)), static_cast<float>(Real(-1, 1)), 0.5f)
              .normalized();
      site.sigma_m = 0.01f * static_cast<float>(Random(1, 4));
    }
    return BuildObjectShape(std::move(sites), config_.voxel_size_m);
  }

  const MapConfig config_;
  std::mt19937 random_;
  const int blocks_a_frame_;
  DistanceField field_;
  SurfaceMap surface_;
  uint64_t revision_ = 0;
  int64_t stamp_ns_ = 0;
  std::map<std::pair<ObjectId, uint32_t>, ObjectView> objects_;
  std::map<uint16_t, uint32_t> generations_;
};

}  // namespace clearance::testing
