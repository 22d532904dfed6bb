#include "client/mirror/view_builder.h"

#include <random>

#include "server/engine/change_log.h"
#include "server/query/point_query.h"
#include "server/service/watch_messages.h"
#include "tests/client/mirror/mirror_fixture.h"

namespace clearance::testing {
namespace {

using client::ViewBuilder;
using ::testing::HasSubstr;

// What a watcher of a scripted map is sent, message by message.
class Told {
 public:
  explicit Told(uint32_t seed, int blocks = 8) : model_(config_, seed, blocks) {
    Step();
    log_ = std::make_unique<ChangeLog>(view_);
  }

  void Step() {
    Frame frame;
    frame.stamp_ns = ++frames_ * 100'000'000;
    EXPECT_TRUE(model_.Integrate(frame).ok());
    auto view = std::make_shared<MapView>(model_.View());
    view->epoch = 77;
    view->published_at = std::chrono::steady_clock::now();
    view_ = std::move(view);
    if (log_) log_->Advance(view_);
  }
  const MapView& view() const { return *view_; }
  uint64_t revision() const { return view_->revision; }

  std::vector<v1::WatchMapResponse> Checkpoint() const {
    std::vector<v1::WatchMapResponse> messages(1);
    v1::WatchHello* hello = messages[0].mutable_hello();
    hello->mutable_info()->mutable_config()->set_voxel_size_m(config_.voxel_size_m);
    hello->mutable_info()->mutable_config()->set_max_distance_m(config_.max_distance_m);
    hello->set_format_version(1);
    messages[0].mutable_stamp()->set_epoch(77);
    Append(WatchMessages::Checkpoint(view_, {}), &messages);
    return messages;
  }
  std::vector<v1::WatchMapResponse> Delta(uint64_t from) const {
    std::vector<v1::WatchMapResponse> messages;
    Append(WatchMessages::Delta(*log_, from, {}), &messages);
    return messages;
  }

 private:
  static void Append(WatchMessages source, std::vector<v1::WatchMapResponse>* messages) {
    v1::WatchMapResponse message;
    while (source.Next(&message)) messages->push_back(message);
  }

  const MapConfig config_;
  ScriptedModel model_;
  int64_t frames_ = 0;
  ViewPtr view_;
  std::unique_ptr<ChangeLog> log_;
};

absl::StatusOr<ViewBuilder::ViewPtr> TakeAll(ViewBuilder& builder,
                                             const std::vector<v1::WatchMapResponse>& messages) {
  absl::StatusOr<ViewBuilder::ViewPtr> last = ViewBuilder::ViewPtr();
  for (const auto& message : messages) {
    last = builder.Take(message);
    if (!last.ok()) return last;
  }
  return last;
}

TEST(ViewBuilder, RebuildsWhatWasTold) {
  for (uint32_t seed = 1; seed <= 5; ++seed) {
    Told told(seed);
    ViewBuilder builder;
    ASSERT_TRUE(TakeAll(builder, told.Checkpoint()).ok());
    ExpectSameView(told.view(), *builder.current());
    std::mt19937 random(seed);
    for (int i = 0; i < 60; ++i) {
      const uint64_t from = told.revision();
      for (int steps = 1 + static_cast<int>(random() % 4); steps > 0; --steps) told.Step();
      const auto view = TakeAll(builder, told.Delta(from));
      ASSERT_TRUE(view.ok()) << view.status();
      ASSERT_NE(*view, nullptr);
      ExpectSameView(told.view(), **view);
    }
  }
}

TEST(ViewBuilder, LargeMapsComeInPartsBelowTheMessageLimit) {
  Told told(1, 3000);
  for (int i = 0; i < 3; ++i) told.Step();
  const auto messages = told.Checkpoint();
  EXPECT_GT(messages.size(), 3u);
  for (const auto& message : messages) EXPECT_LT(message.ByteSizeLong(), 2u << 20);
  ViewBuilder builder;
  ASSERT_TRUE(TakeAll(builder, messages).ok());
  ExpectSameView(told.view(), *builder.current());
}

TEST(ViewBuilder, AnEarlierViewStaysAsItWas) {
  Told told(2);
  ViewBuilder builder;
  ASSERT_TRUE(TakeAll(builder, told.Checkpoint()).ok());
  const MapView server = told.view();
  const ViewBuilder::ViewPtr held = builder.current();
  for (int i = 0; i < 20; ++i) {
    const uint64_t from = told.revision();
    told.Step();
    ASSERT_TRUE(TakeAll(builder, told.Delta(from)).ok());
  }
  ExpectSameView(server, *held);
}

TEST(ViewBuilder, RefusesAGapAMissingPartAndAnotherFormat) {
  Told told(3, 3000);
  for (int i = 0; i < 3; ++i) told.Step();
  const auto checkpoint = told.Checkpoint();
  const uint64_t first = told.revision();
  told.Step();
  const uint64_t second = told.revision();
  told.Step();
  const auto gap = told.Delta(second);
  {
    ViewBuilder builder;
    EXPECT_TRUE(absl::IsFailedPrecondition(TakeAll(builder, told.Delta(first)).status()));
    ASSERT_TRUE(TakeAll(builder, checkpoint).ok());
    const auto view = TakeAll(builder, gap);
    EXPECT_TRUE(absl::IsFailedPrecondition(view.status()));
    EXPECT_THAT(view.status().message(), HasSubstr("watch again"));
    EXPECT_EQ(builder.current()->revision, first) << "the last complete view stays";
  }
  {
    ASSERT_GT(checkpoint.size(), 3u);
    auto missing = checkpoint;
    missing.erase(missing.begin() + 2);
    ViewBuilder builder;
    EXPECT_TRUE(absl::IsFailedPrecondition(TakeAll(builder, missing).status()));
    EXPECT_EQ(builder.current(), nullptr);
    ASSERT_TRUE(TakeAll(builder, checkpoint).ok()) << "a new hello starts over";
  }
  {
    auto other = checkpoint;
    other[0].mutable_hello()->set_format_version(2);
    ViewBuilder builder;
    const auto view = TakeAll(builder, other);
    EXPECT_TRUE(absl::IsFailedPrecondition(view.status()));
    EXPECT_THAT(view.status().message(), HasSubstr("format 2"));
  }
}

TEST(ViewBuilder, NamesWhatIsWrongWithDamagedContent) {
  Told told(4, 4);
  for (int i = 0; i < 30; ++i) told.Step();
  const auto checkpoint = told.Checkpoint();
  ASSERT_EQ(checkpoint.size(), 2u);
  ASSERT_GT(checkpoint[1].checkpoint().objects_size(), 0);
  const auto error_of = [&](auto damage) {
    auto messages = checkpoint;
    damage(messages[1].mutable_checkpoint());
    ViewBuilder builder;
    const absl::Status status = TakeAll(builder, messages).status();
    EXPECT_FALSE(status.ok());
    EXPECT_EQ(builder.current(), nullptr);
    return std::string(status.message());
  };
  EXPECT_THAT(error_of([](auto* c) { c->mutable_blocks(0)->mutable_payload()->pop_back(); }),
              HasSubstr("blocks.payload"));
  EXPECT_THAT(error_of([](auto* c) { c->mutable_blocks(0)->mutable_indices_i32()->pop_back(); }),
              HasSubstr("blocks.indices_i32"));
  EXPECT_THAT(error_of([](auto* c) { c->mutable_blocks(0)->set_payload_bytes(1ull << 40); }),
              HasSubstr("limit"));
  EXPECT_THAT(
      error_of([](auto* c) { c->mutable_blocks(0)->mutable_indices_i32()->append(12, '\0'); }),
      HasSubstr("field block"));
  EXPECT_THAT(error_of([](auto* c) {
                c->mutable_blocks(0)->mutable_indices_i32()->replace(0, 4, "\xff\xff\xff\x7f");
              }),
              HasSubstr("too far"));
  EXPECT_THAT(error_of([](auto* c) {
                c->mutable_blocks(0)->set_compression(static_cast<v1::Compression>(9));
              }),
              HasSubstr("compression"));
  EXPECT_THAT(error_of([](auto* c) { c->mutable_objects(0)->mutable_brief()->set_object_id(0); }),
              HasSubstr("object_id"));
  EXPECT_THAT(error_of([](auto* c) { c->mutable_objects(0)->mutable_screw_f64()->resize(40); }),
              HasSubstr("screw_f64"));
  EXPECT_THAT(error_of([](auto* c) {
                c->mutable_objects(0)->mutable_world_from_object_f64()->assign(96, '\0');
              }),
              HasSubstr("rotation"));
  EXPECT_THAT(error_of([](auto* c) {
                c->mutable_objects(0)->mutable_surface()->set_site_count(1ull << 30);
              }),
              HasSubstr("sites"));
}

TEST(ViewBuilder, SurvivesRandomDamage) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> coordinate(-6, 6);
  int refused = 0, taken = 0;
  for (int round = 0; round < 400; ++round) {
    Told told(static_cast<uint32_t>(round % 20 + 1), 4);
    for (int i = 0; i < 6; ++i) told.Step();
    auto messages = told.Checkpoint();
    const uint64_t from = told.revision();
    told.Step();
    for (auto& message : told.Delta(from)) messages.push_back(std::move(message));
    ViewBuilder builder(client::ViewLimits{64u << 20, 1000});
    for (const auto& message : messages) {
      std::string bytes = message.SerializeAsString();
      if (!bytes.empty() && random() % 2 == 0) {
        for (uint64_t hits = 1 + random() % 3; hits > 0; --hits) {
          bytes[random() % bytes.size()] = static_cast<char>(random());
        }
        if (random() % 8 == 0) bytes.resize(random() % bytes.size());
      }
      v1::WatchMapResponse damaged;
      if (!damaged.ParseFromString(bytes)) continue;
      const auto view = builder.Take(damaged);
      ++(view.ok() ? taken : refused);
      if (!view.ok() || *view == nullptr) continue;
      Eigen::Matrix3Xd points(3, 50);
      for (double& c : points.reshaped()) c = coordinate(random);
      const DistanceBatch batch =
          QueryDistances(**view, points, {.horizon_s = 0.5, .gradients = true, .objects = true});
      ASSERT_EQ(batch.distances_m.size(), 50u);
    }
    // And it still works.
    ASSERT_TRUE(TakeAll(builder, told.Checkpoint()).ok());
    ExpectSameView(told.view(), *builder.current());
  }
  EXPECT_GT(refused, 50);
  EXPECT_GT(taken, 50);
}

}  // namespace
}  // namespace clearance::testing
