#include <chrono>
#include <set>
#include <thread>

#include "server/service/watch_hub.h"
#include "tests/engine/scripted_model.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;

// One watch, read by the test's thread.
class Watcher {
 public:
  Watcher(const std::shared_ptr<grpc::Channel>& channel, const v1::WatchMapRequest& request)
      : stream_(v1::WatchService::NewStub(channel)->WatchMap(&context_, request)) {}

  // False at the end.
  bool Read() { return stream_->Read(&message); }
  // Reads on until revision `r` is told completely; counts what comes.
  bool ReadTo(uint64_t r) {
    while (revision < r) {
      if (!Read()) return false;
      Note();
    }
    return true;
  }
  void Note() {
    bytes += message.ByteSizeLong();
    if (message.has_hello()) {
      ++hellos;
      resumed = message.hello().resumes();
      epoch = message.stamp().epoch();
    } else if (message.has_checkpoint()) {
      if (!message.checkpoint().last_part()) return;
      ++checkpoints;
      revision = message.stamp().revision();
    } else {
      EXPECT_EQ(message.delta().prev_revision(), revision) << "a gap";
      EXPECT_EQ(message.stamp().revision(), message.delta().revision());
      for (const auto& blocks : message.delta().blocks()) {
        changed += blocks.indices_i32().size() / 12;
      }
      if (!message.delta().last_part()) return;
      ++deltas;
      revision = message.delta().revision();
    }
  }
  grpc::Status Finish() {
    while (Read()) Note();
    return stream_->Finish();
  }
  void Cancel() { context_.TryCancel(); }

  v1::WatchMapResponse message;
  uint64_t revision = 0, epoch = 0;
  int hellos = 0, checkpoints = 0, deltas = 0;
  size_t changed = 0, bytes = 0;
  bool resumed = false;

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<v1::WatchMapResponse>> stream_;
};

class WatchServiceTest : public ServiceFixture {
 protected:
  void StartScripted(int blocks_a_frame, ServerOptions options = {}) {
    RegistryOptions registry;
    registry.model = [blocks_a_frame](const MapConfig& config) {
      return std::make_unique<testing::ScriptedModel>(config, 1, blocks_a_frame);
    };
    options.socket = SocketPath();
    StartServer(std::move(registry), options);
  }
  uint64_t Step(const std::string& map = "") {
    const uint64_t revision = Ingest(ProtoFrame(++frames_, 1), map).stamp().revision();
    EXPECT_GT(revision, 0u);
    return revision;
  }
  grpc::Status StatusOf(const v1::WatchMapRequest& request) {
    return Watcher(channel_, request).Finish();
  }

  uint64_t frames_ = 0;
};

TEST_F(WatchServiceTest, SaysHelloThenEverythingThenWhatChanges) {
  StartScripted(10);
  Step();
  Watcher watcher(channel_, {});
  ASSERT_TRUE(watcher.Read());
  ASSERT_TRUE(watcher.message.has_hello());
  EXPECT_FALSE(watcher.message.hello().resumes());
  EXPECT_EQ(watcher.message.hello().info().map(), "default");
  EXPECT_GT(watcher.message.hello().info().config().voxel_size_m(), 0);
  EXPECT_EQ(watcher.message.hello().format_version(), 1u);
  EXPECT_GT(watcher.message.hello().stale_after_s(), 0);
  ASSERT_TRUE(watcher.ReadTo(1));
  EXPECT_EQ(watcher.checkpoints, 1);
  for (int i = 0; i < 20; ++i) ASSERT_TRUE(watcher.ReadTo(Step()));
  EXPECT_EQ(watcher.deltas, 20);
  EXPECT_EQ(watcher.checkpoints, 1);
}

TEST_F(WatchServiceTest, ResumesBehindAnyRevisionOfTheEpoch) {
  StartScripted(10);
  const uint64_t first = Step();
  v1::WatchMapRequest request;
  {
    Watcher watcher(channel_, {});
    ASSERT_TRUE(watcher.ReadTo(first));
    request.set_epoch(watcher.epoch);
    watcher.Cancel();
    watcher.Finish();
  }
  for (int i = 0; i < 50; ++i) Step();  // far more than the map keeps views of
  request.set_revision(first);
  Watcher watcher(channel_, request);
  watcher.revision = first;
  ASSERT_TRUE(watcher.ReadTo(first + 50));
  EXPECT_TRUE(watcher.resumed);
  EXPECT_EQ(watcher.deltas, 1) << "coalesced";
  EXPECT_EQ(watcher.checkpoints, 0);

  request.set_revision(first + 50);
  Watcher idle(channel_, request);
  idle.revision = first + 50;
  ASSERT_TRUE(idle.ReadTo(Step()));
  EXPECT_TRUE(idle.resumed);

  for (const auto& [epoch, revision] : std::vector<std::pair<uint64_t, uint64_t>>{
           {request.epoch() + 1, first}, {request.epoch(), 1'000'000}}) {
    request.set_epoch(epoch);
    request.set_revision(revision);
    Watcher other(channel_, request);
    ASSERT_TRUE(other.ReadTo(first + 51));
    EXPECT_FALSE(other.resumed);
    EXPECT_EQ(other.checkpoints, 1);
  }
}

TEST_F(WatchServiceTest, ASlowReaderIsToldLessOftenAndCostsNoQueue) {
  StartScripted(300);
  Step();
  grpc::ChannelArguments apart;  // a connection of its own, so that it holds up nobody else
  apart.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  const auto own =
      grpc::CreateCustomChannel("unix:" + SocketPath(), grpc::InsecureChannelCredentials(), apart);
  Watcher prompt(channel_, {}), slow(own, {});
  ASSERT_TRUE(prompt.ReadTo(1));
  ASSERT_TRUE(slow.ReadTo(1));
  uint64_t last = 1;
  for (int i = 0; i < 60; ++i) {
    last = Step();
    ASSERT_TRUE(prompt.ReadTo(last));
  }
  EXPECT_EQ(prompt.deltas, 60);
  ASSERT_TRUE(slow.ReadTo(last));
  // What fits into the transport's buffers, and then one delta for all the rest.
  EXPECT_LT(slow.deltas, 55);
  EXPECT_LT(slow.bytes, prompt.bytes);
  EXPECT_LT(slow.changed, prompt.changed);
}

TEST_F(WatchServiceTest, MaxRateSpacesTheDeltas) {
  StartScripted(5);
  Step();
  v1::WatchMapRequest request;
  request.set_max_rate_hz(0.001);
  Watcher watcher(channel_, request);
  ASSERT_TRUE(watcher.ReadTo(1));
  const uint64_t second = Step();
  ASSERT_TRUE(watcher.ReadTo(second)) << "the first delta comes at once";
  for (int i = 0; i < 20; ++i) Step();
  request.set_max_rate_hz(100);
  Watcher other(channel_, request);
  ASSERT_TRUE(other.ReadTo(second + 20));
  const auto started = std::chrono::steady_clock::now();
  const int before = other.deltas;
  uint64_t last = 0;
  for (int i = 0; i < 50; ++i) last = Step();
  ASSERT_TRUE(other.ReadTo(last));
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - started;
  EXPECT_LE(other.deltas - before, elapsed.count() * 100 + 2);
  watcher.Cancel();
  watcher.Finish();
  EXPECT_EQ(watcher.deltas, 1) << "the next one is due in a quarter of an hour";
}

TEST_F(WatchServiceTest, RefusesBadRequestsNamingTheField) {
  StartScripted(1);
  v1::WatchMapRequest request;
  request.set_map("No Map");
  EXPECT_EQ(StatusOf(request).error_code(), Code::INVALID_ARGUMENT);
  request.set_map("nowhere");
  EXPECT_EQ(StatusOf(request).error_code(), Code::NOT_FOUND);
  EXPECT_THAT(StatusOf(request).error_message(), HasSubstr("Maps: default"));
  request.set_map("");
  for (const double rate : {-1.0, std::nan(""), HUGE_VAL}) {
    request.set_max_rate_hz(rate);
    EXPECT_EQ(StatusOf(request).error_code(), Code::INVALID_ARGUMENT);
    EXPECT_THAT(StatusOf(request).error_message(), HasSubstr("max_rate_hz"));
  }
  request.set_max_rate_hz(0);
  request.mutable_bounds()->mutable_min()->set_x_m(2);
  request.mutable_bounds()->mutable_max()->set_x_m(1);
  EXPECT_THAT(StatusOf(request).error_message(), HasSubstr("bounds"));
  EXPECT_EQ(Step(), 1u) << "the map is as it was";
}

TEST_F(WatchServiceTest, ADeletedMapEndsTheStreamAndSaysSo) {
  StartScripted(3);
  Step();
  Watcher watcher(channel_, {});
  ASSERT_TRUE(watcher.ReadTo(1));
  grpc::ClientContext context;
  v1::DeleteMapResponse deleted;
  ASSERT_TRUE(map_->DeleteMap(&context, {}, &deleted).ok());
  const grpc::Status status = watcher.Finish();
  EXPECT_EQ(status.error_code(), Code::NOT_FOUND);
  EXPECT_THAT(status.error_message(), HasSubstr("'default'"));
}

TEST_F(WatchServiceTest, TheDrainTellsTheLastRevisionAndEndsTheStream) {
  StartScripted(3);
  Step();
  Watcher watcher(channel_, {});
  ASSERT_TRUE(watcher.ReadTo(1));
  const uint64_t last = Step();
  std::thread drain([&] { EXPECT_TRUE(server_->Drain()); });
  const grpc::Status status = watcher.Finish();
  drain.join();
  EXPECT_EQ(watcher.revision, last);
  EXPECT_EQ(status.error_code(), Code::UNAVAILABLE);
  EXPECT_FALSE(status.error_details().empty()) << "RetryInfo";
}

TEST_F(WatchServiceTest, WatchersThatGoAwayAreForgotten) {
  StartScripted(20);
  Step();
  for (int i = 0; i < 100; ++i) {
    Watcher watcher(channel_, {});
    if (i % 3 == 0) watcher.Read();
    if (i % 5 == 0) Step();
    watcher.Cancel();
    watcher.Finish();
  }
  while (server_->context().open_streams > 0) std::this_thread::yield();
  Watcher watcher(channel_, {});
  ASSERT_TRUE(watcher.ReadTo(frames_));
}

TEST_F(WatchServiceTest, HoldsNoMoreWatchersThanItsLimit) {
  StartScripted(1);
  Step();
  std::vector<std::unique_ptr<Watcher>> watchers;
  for (size_t i = 0; i < kMaxWatchers; ++i) {
    watchers.push_back(std::make_unique<Watcher>(channel_, v1::WatchMapRequest()));
  }
  for (const auto& watcher : watchers) ASSERT_TRUE(watcher->ReadTo(1));
  EXPECT_EQ(StatusOf({}).error_code(), Code::RESOURCE_EXHAUSTED);
  watchers.back()->Cancel();
  watchers.back()->Finish();
  while (server_->context().open_streams >= static_cast<int64_t>(kMaxWatchers)) {
    std::this_thread::yield();
  }
  Watcher another(channel_, {});
  EXPECT_TRUE(another.ReadTo(1));
}

}  // namespace
}  // namespace clearance
