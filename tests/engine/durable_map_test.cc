// Maps with a folder: what a registry finds again when it opens the same folder.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <future>

#include "absl/strings/str_format.h"
#include "server/engine/map_registry.h"
#include "server/store/log_segment.h"
#include "tests/engine/ack_log.h"
#include "tests/engine/fake_model.h"
#include "tests/engine/gate.h"
#include "tests/store/temp_folder.h"

namespace clearance {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Status = FrameAck::Status;

// Enough of a codec for the fake: source, id, number of points.
std::string Encode(const Frame& frame) {
  ByteWriter out;
  out.PutText(frame.source_id);
  out.Put(frame.frame_id);
  const auto* cloud = std::get_if<PointCloud>(&frame.observation);
  out.Put<int32_t>(cloud ? static_cast<int32_t>(cloud->points_X.cols()) : 0);
  return out.Take();
}
FrameCodec Codec() {
  const auto decode = [](std::string_view bytes) -> absl::StatusOr<Frame> {
    ByteReader in(bytes, "frame");
    const std::string source(in.GetText());
    const uint64_t id = in.Get<uint64_t>();
    const int32_t points = in.Get<int32_t>();
    if (absl::Status s = in.Finish(); !s.ok()) return s;
    return FakeFrame(id, points, source);
  };
  const auto strip = [decode](std::string_view bytes) -> absl::StatusOr<std::string> {
    Frame frame = *decode(bytes);
    frame.observation = std::monostate{};
    return Encode(frame);
  };
  return {decode, strip};
}

class DurableMapTest : public ::testing::Test {
 protected:
  // A server of its own on the folder; the one before is gone, as after a crash.
  absl::Status Start(EngineOptions engine = {}, bool recover_damaged = false) {
    registry_.reset();
    storage_.reset();
    log_ = std::make_shared<FakeLog>();
    notes_.clear();
    StoreOptions store;
    store.path = folder_.path();
    store.sync = SyncPolicy::kOff;
    store.segment_bytes = 400;
    store.recover_damaged = recover_damaged;
    auto storage = DataDirectory::Open(store);
    if (!storage.ok()) return storage.status();
    storage_ = *std::move(storage);
    RegistryOptions options = FakeRegistry(log_, 8);
    options.engine = std::move(engine);
    options.engine.codec = Codec();
    options.storage = storage_.get();
    options.load = [log = log_](const MapConfig& config, const FileSource& files) {
      return FakeModel::Load(config, log, files);
    };
    registry_ = std::make_unique<MapRegistry>(std::move(options));
    return registry_->Recover([this](const std::string& note) { notes_.push_back(note); });
  }
  MapRegistry::EnginePtr Map(const std::string& id = "m") {
    auto engine = registry_->Get(id);
    EXPECT_TRUE(engine.ok()) << engine.status();
    return *engine;
  }
  // The acks of one frame.
  std::vector<FrameAck> Send(const Frame& frame, size_t acks = 2, const std::string& map = "m") {
    AckLog log;
    std::string encoded = Encode(frame);
    EXPECT_EQ(Map(map)->Submit(Frame(frame), log.Callback(), &encoded), Admission::kTaken);
    return log.Wait(acks);
  }
  absl::StatusOr<SnapshotManifest> Snapshot(const std::string& id) {
    std::promise<absl::StatusOr<SnapshotManifest>> done;
    const absl::Status s =
        registry_->CreateSnapshot("m", id, "", [&](auto result) { done.set_value(result); });
    if (!s.ok()) return s;
    return done.get_future().get();
  }
  std::string Segment(size_t k) {
    const auto log = Map()->folder();
    const std::string path = absl::StrFormat("%s/log-%016x", log->path(), log->lineage());
    return path + "/" + ListFolder(path)->at(k);
  }

  TempFolder folder_;
  std::shared_ptr<FakeLog> log_;
  std::vector<std::string> notes_;
  std::unique_ptr<DataDirectory> storage_;
  std::unique_ptr<MapRegistry> registry_;
};

TEST_F(DurableMapTest, FindsMapsFramesEditsAndSettledIdsAgain) {
  ASSERT_TRUE(Start().ok());
  MapConfig config;
  config.voxel_size_m = 0.25;
  ASSERT_TRUE(registry_->Create("m", config).ok());
  ASSERT_TRUE(registry_->Create("gone", config).ok());
  ASSERT_TRUE(registry_->Delete("gone").ok());
  const auto acks = Send(FakeFrame(3));
  EXPECT_EQ(acks[0].status, Status::kAccepted);
  EXPECT_EQ(acks[1].status, Status::kIntegrated);
  Send(FakeFrame(4, 2));
  Send(FakeFrame(1, 1, "other"));
  std::promise<RevisionStamp> edited;
  RegionEdit edit;
  edit.sphere_centre = Eigen::Vector3d(1, 2, 3);
  edit.sphere_radius_m = 0.5;
  ASSERT_TRUE(
      Map()->EditRegion(edit, [&](auto, const RevisionStamp& s) { edited.set_value(s); }).ok());
  EXPECT_EQ(edited.get_future().get().revision, 4u);
  AckLog rejected;
  Map()->SubmitRejected("default", 6, {{"frame", -1, "bad"}}, rejected.Callback());
  rejected.Wait(1);
  const uint64_t epoch = Map()->epoch();

  ASSERT_TRUE(Start().ok());
  EXPECT_EQ(registry_->List().size(), 1u);
  EXPECT_THAT(notes_, ElementsAre());
  EXPECT_THAT(log_->integrated, ElementsAre(3, 4, 1));
  EXPECT_THAT(log_->integrated_points, ElementsAre(1, 2, 1));
  EXPECT_EQ(log_->edits, 1);
  EXPECT_EQ(Map()->Latest()->revision, 4u);
  EXPECT_EQ(Map()->config().voxel_size_m, 0.25);
  EXPECT_NE(Map()->epoch(), epoch);
  EXPECT_EQ(Map()->LastSettledId("default"), 6u);
  EXPECT_EQ(Map()->LastSettledId("other"), 1u);
  // Nothing is applied twice, and the chain goes on.
  const auto again = Send(FakeFrame(4, 2), 1);
  EXPECT_EQ(again[0].status, Status::kDuplicate);
  EXPECT_EQ(again[0].stamp.revision, 2u);
  EXPECT_EQ(Send(FakeFrame(5), 1)[0].status, Status::kRejected);
  EXPECT_EQ(Send(FakeFrame(7))[1].stamp.revision, 5u);
}

TEST_F(DurableMapTest, FramesThatLostTheirPointsComeBackWithoutThem) {
  Gate gate;
  EngineOptions engine;
  engine.queue_frames = 1;
  engine.before_integrate = [&gate](const Frame&) { gate.Pass(); };
  ASSERT_TRUE(Start(engine).ok());
  MapConfig config;
  config.overload = OverloadPolicy::kDropOldestStatic;
  ASSERT_TRUE(registry_->Create("m", config).ok());
  AckLog acks;
  for (uint64_t id = 1; id <= 4; ++id) {
    std::string encoded = Encode(FakeFrame(id));
    ASSERT_EQ(Map()->Submit(FakeFrame(id), acks.Callback(), &encoded), Admission::kTaken);
    if (id == 1) gate.WaitForArrival();
  }
  gate.Open();
  // 1 and 4 are accepted and integrated, 2 and 3 dropped without a word of durability.
  std::vector<std::pair<uint64_t, Status>> seen;
  for (const FrameAck& ack : acks.Wait(6)) seen.emplace_back(ack.frame_id, ack.status);
  EXPECT_THAT(seen,
              ElementsAre(std::pair(1, Status::kAccepted), std::pair(1, Status::kIntegrated),
                          std::pair(2, Status::kDropped), std::pair(3, Status::kDropped),
                          std::pair(4, Status::kAccepted), std::pair(4, Status::kIntegrated)));
  ASSERT_TRUE(Start().ok());
  EXPECT_THAT(log_->integrated, ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(log_->integrated_points, ElementsAre(1, 0, 0, 1));
  EXPECT_EQ(Map()->Stats().sources[0].dropped, 2u);
}

TEST_F(DurableMapTest, StartsFromTheNewestGoodSnapshot) {
  ASSERT_TRUE(Start().ok());
  ASSERT_TRUE(registry_->Create("m", {}).ok());
  for (uint64_t id = 1; id <= 5; ++id) Send(FakeFrame(id));
  ASSERT_TRUE(Snapshot("five").ok());
  for (uint64_t id = 6; id <= 8; ++id) Send(FakeFrame(id));
  const auto eight = Snapshot("eight");
  ASSERT_TRUE(eight.ok()) << eight.status();
  EXPECT_EQ(eight->revision, 8u);
  EXPECT_EQ(eight->log_index, 8u);
  Send(FakeFrame(9));
  EXPECT_TRUE(absl::IsAlreadyExists(Snapshot("eight").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Snapshot("Eight").status()));
  const std::string file = Map()->folder()->SnapshotFolder("eight") + "/fake.bin";

  ASSERT_TRUE(Start().ok());
  EXPECT_THAT(log_->integrated, ElementsAre(9));
  EXPECT_EQ(Map()->Latest()->revision, 9u);
  EXPECT_EQ(Map()->LastSettledId("default"), 9u);
  EXPECT_EQ(Send(FakeFrame(2), 1)[0].status, Status::kDuplicate);

  // The newest one is damaged: the one before, and more of the log.
  std::ofstream(file, std::ios::binary | std::ios::app) << "x";
  ASSERT_TRUE(Start().ok());
  EXPECT_THAT(log_->integrated, ElementsAre(6, 7, 8, 9));
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("eight is passed over")));
  EXPECT_EQ(Map()->Latest()->revision, 9u);
}

TEST_F(DurableMapTest, ADamagedLogIsNeverASmallerMapInSilence) {
  ASSERT_TRUE(Start().ok());
  ASSERT_TRUE(registry_->Create("m", {}).ok());
  for (uint64_t id = 1; id <= 30; ++id) Send(FakeFrame(id));
  const std::string path = Segment(1);
  std::string bytes = *ReadFile(path);
  bytes[bytes.size() / 2] ^= 1;
  ASSERT_TRUE(WriteFileSynced(path, bytes).ok());
  const absl::Status status = Start();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(path));
  EXPECT_TRUE(absl::IsUnavailable(registry_->Get("m").status()));
  ASSERT_TRUE(Start({}, true).ok());
  EXPECT_THAT(notes_, ElementsAre(HasSubstr(path)));
  const uint64_t kept = Map()->Latest()->revision;
  EXPECT_GT(kept, 0u);
  EXPECT_LT(kept, 30u);
  EXPECT_EQ(Map()->LastSettledId("default"), kept);
  Send(FakeFrame(kept + 1));
  ASSERT_TRUE(Start().ok());
  EXPECT_EQ(Map()->Latest()->revision, kept + 1);
}

TEST_F(DurableMapTest, ARestoreIsANewEpochThatForgetsWhatCameAfter) {
  ASSERT_TRUE(Start().ok());
  ASSERT_TRUE(registry_->Create("m", {}).ok());
  for (uint64_t id = 1; id <= 3; ++id) Send(FakeFrame(id));
  ASSERT_TRUE(Snapshot("three").ok());
  for (uint64_t id = 4; id <= 6; ++id) Send(FakeFrame(id));
  ASSERT_TRUE(Snapshot("six").ok());
  const MapRegistry::EnginePtr old = Map();
  int swaps = 0;
  EXPECT_TRUE(absl::IsNotFound(registry_->RestoreSnapshot("m", "four", [&] { ++swaps; }).status()));
  const auto restored = registry_->RestoreSnapshot("m", "three", [&] {
    ++swaps;
    EXPECT_TRUE(absl::IsUnavailable(registry_->Get("m").status()));
  });
  ASSERT_TRUE(restored.ok()) << restored.status();
  EXPECT_EQ(swaps, 1);
  EXPECT_EQ(Map(), *restored);
  EXPECT_NE(Map()->epoch(), old->epoch());
  EXPECT_EQ(Map()->Latest()->revision, 3u);
  EXPECT_EQ(Map()->LastSettledId("default"), 3u);
  std::string encoded = Encode(FakeFrame(7));
  EXPECT_EQ(old->Submit(
                FakeFrame(7), [](const FrameAck&) {}, &encoded),
            Admission::kStopped);
  Send(FakeFrame(5));

  // Also after a crash: three, then 5; never what was there before the restore.
  ASSERT_TRUE(Start().ok());
  EXPECT_THAT(log_->integrated, ElementsAre(5));
  EXPECT_EQ(Map()->Latest()->revision, 4u);
  EXPECT_EQ(Map()->folder()->Snapshots().size(), 2u);

  // A damaged snapshot changes nothing.
  const std::string file = Map()->folder()->SnapshotFolder("six") + "/fake.bin";
  ASSERT_TRUE(WriteFileSynced(file, "short").ok());
  EXPECT_TRUE(absl::IsDataLoss(registry_->RestoreSnapshot("m", "six", [&] { ++swaps; }).status()));
  EXPECT_EQ(swaps, 1);
  EXPECT_EQ(Map()->Latest()->revision, 4u);
  EXPECT_EQ(Send(FakeFrame(6))[1].status, Status::kIntegrated);

  // Nor does one of a newer server.
  const std::string manifest = Map()->folder()->SnapshotFolder("six") + "/manifest.json";
  ASSERT_TRUE(WriteFileSynced(manifest, SealJson("snapshot", R"({"format_version": 9})")).ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(
      registry_->RestoreSnapshot("m", "six", [&] { ++swaps; }).status()));
  EXPECT_EQ(swaps, 1);
}

TEST_F(DurableMapTest, AMapWhoseBaseIsGoneIsDataLossNotEmpty) {
  ASSERT_TRUE(Start().ok());
  ASSERT_TRUE(registry_->Create("m", {}).ok());
  Send(FakeFrame(1));
  ASSERT_TRUE(Snapshot("one").ok());
  ASSERT_TRUE(registry_->RestoreSnapshot("m", "one", [] {}).ok());
  const std::string base = Map()->folder()->SnapshotFolder("one");
  ASSERT_TRUE(RemoveAll(base).ok());
  const absl::Status status = Start();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("'one'"));
}

TEST_F(DurableMapTest, AFrameThatCannotBeLoggedIsRejectedAndTheMapUntouched) {
  ASSERT_TRUE(Start().ok());
  ASSERT_TRUE(registry_->Create("m", {}).ok());
  Send(FakeFrame(1));
  AckLog acks;
  Map()->Submit(FakeFrame(2), acks.Callback());  // without its encoding
  const auto ack = acks.Wait(1)[0];
  EXPECT_EQ(ack.status, Status::kRejected);
  EXPECT_THAT(ack.violations.at(0).field, "log");
  EXPECT_EQ(Map()->Latest()->revision, 1u);
  EXPECT_EQ(Send(FakeFrame(3))[1].stamp.revision, 2u);
  ASSERT_TRUE(Start().ok());
  EXPECT_THAT(log_->integrated, ElementsAre(1, 3));
}

TEST_F(DurableMapTest, AboveTheMemoryLimitFramesAreNotTakenUntilThereIsRoom) {
  EngineOptions engine;
  engine.sizes_period = std::chrono::milliseconds(0);
  ASSERT_TRUE(Start(engine).ok());
  MapConfig config;
  config.memory_cap_bytes = 5000;
  ASSERT_TRUE(registry_->Create("m", config).ok());
  log_->memory_bytes = 6000;
  Send(FakeFrame(1));
  while (Map()->Stats().over_memory.empty()) std::this_thread::yield();
  std::string encoded = Encode(FakeFrame(2));
  const auto never = [](const FrameAck&) { ADD_FAILURE(); };
  EXPECT_EQ(Map()->Submit(FakeFrame(2), never, &encoded), Admission::kOverMemory);
  EXPECT_THAT(Map()->Stats().over_memory, HasSubstr("6000 bytes, limit 5000"));
  EXPECT_EQ(Map()->LastSettledId("default"), 1u);
  log_->memory_bytes = 4000;
  // Trying looks again.
  AckLog acks;
  while (Map()->Submit(FakeFrame(2), acks.Callback(), &encoded) == Admission::kOverMemory) {
    std::this_thread::yield();
  }
  EXPECT_EQ(acks.Wait(2)[1].status, Status::kIntegrated);
}

TEST_F(DurableMapTest, EvictionIsLoggedAndReplayed) {
  EngineOptions engine;
  engine.sizes_period = std::chrono::milliseconds(0);
  engine.evict_over_cap = true;
  engine.process_memory_cap_bytes = 100;
  std::atomic<uint64_t> used = 50;
  engine.process_memory_bytes = [&used] { return used.load(); };
  ASSERT_TRUE(Start(engine).ok());
  ASSERT_TRUE(registry_->Create("m", {}).ok());
  Send(FakeFrame(1));
  used = 200;
  Send(FakeFrame(2));
  while (Map()->Stats().evictions == 0) std::this_thread::yield();
  used = 50;
  const uint64_t revision = Map()->Latest()->revision;
  EXPECT_GE(revision, 3u);
  engine.process_memory_cap_bytes = 0;
  ASSERT_TRUE(Start(engine).ok());
  EXPECT_EQ(log_->evictions, static_cast<int>(revision) - 2);
  EXPECT_EQ(Map()->Latest()->revision, revision);
}

TEST_F(DurableMapTest, WithoutAFolderThereAreNoSnapshots) {
  MapRegistry registry(FakeRegistry(std::make_shared<FakeLog>(), 2));
  ASSERT_TRUE(registry.Create("m", {}).ok());
  const auto done = [](const absl::StatusOr<SnapshotManifest>&) { ADD_FAILURE(); };
  const absl::Status status = registry.CreateSnapshot("m", "s", "", done);
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("store.dir"));
}

}  // namespace
}  // namespace clearance
