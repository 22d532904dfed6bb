#include "server/store/segment_log.h"

#include <gmock/gmock.h>
#include <signal.h>
#include <sys/resource.h>

#include <random>
#include <thread>

#include "server/store/log_segment.h"
#include "tests/store/temp_folder.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
constexpr uint64_t kLineage = 0x1234;

std::string RecordOf(uint64_t index) {
  std::mt19937 random(static_cast<uint32_t>(index));
  std::string record(1 + random() % 300, 0);
  for (char& c : record) c = static_cast<char>(1 + random() % 255);
  return record;
}

class SegmentLogTest : public ::testing::Test {
 protected:
  LogOptions Options(SyncPolicy sync = SyncPolicy::kOff) {
    LogOptions options;
    options.sync = sync;
    options.segment_bytes = 1500;
    return options;
  }
  std::unique_ptr<SegmentLog> Create() {
    auto log = SegmentLog::Create(path_, kLineage, 1, Options());
    EXPECT_TRUE(log.ok()) << log.status();
    return *std::move(log);
  }
  std::unique_ptr<SegmentLog> Reopen() {
    auto log = SegmentLog::Open(path_, kLineage, Options());
    EXPECT_TRUE(log.ok()) << log.status();
    return *std::move(log);
  }
  void Fill(SegmentLog& log, uint64_t from, uint64_t to) {
    for (uint64_t i = from; i <= to; ++i) {
      const std::string record = RecordOf(i);
      const size_t cut = record.size() / 3;
      const auto index = log.Append(record.substr(0, cut), record.substr(cut));
      ASSERT_TRUE(index.ok()) << index.status();
      ASSERT_EQ(*index, i);
    }
  }
  // How far the records are right.
  static absl::StatusOr<uint64_t> Read(SegmentLog& log, uint64_t after = 0) {
    uint64_t last = after;
    const absl::Status status = log.Replay(after, [&](uint64_t index, std::string_view record) {
      EXPECT_EQ(index, last + 1);
      EXPECT_EQ(record, RecordOf(index));
      last = index;
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
    return last;
  }
  std::vector<std::string> Segments() {
    std::vector<std::string> paths;
    const auto names = ListFolder(path_);
    for (const std::string& name : *names) {
      if (name.ends_with(".log")) paths.push_back(path_ + "/" + name);
    }
    return paths;
  }

  TempFolder folder_;
  const std::string path_ = folder_ / "log";
};

TEST_F(SegmentLogTest, GivesBackWhatItTookAcrossSegmentsAndRestarts) {
  {
    auto log = Create();
    Fill(*log, 1, 60);
    EXPECT_EQ(*Read(*log), 60u);
    EXPECT_EQ(*Read(*log, 41), 60u);
    EXPECT_GT(log->Stats().segments, 4u);
    EXPECT_EQ(log->Stats().last_index, 60u);
  }
  auto log = Reopen();
  EXPECT_TRUE(log->repaired().empty());
  EXPECT_EQ(*Read(*log), 60u);
  Fill(*log, 61, 80);
  EXPECT_EQ(*Read(*log), 80u);
  EXPECT_EQ(*Read(*log, 80), 80u);
}

TEST_F(SegmentLogTest, EveryCutOfTheLastSegmentLosesTheCutRecordsAlone) {
  Fill(*Create(), 1, 12);
  const std::string last = Segments().back();
  const std::string whole = *ReadFile(last);
  uint64_t least = 0;
  for (size_t size = kSegmentHeaderBytes; size <= whole.size(); ++size) {
    ASSERT_TRUE(WriteFileSynced(last, whole.substr(0, size)).ok());
    auto log = Reopen();
    const auto read = Read(*log);
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_GE(*read, least);
    least = *read;
    // And it goes on behind them.
    Fill(*log, *read + 1, *read + 2);
    EXPECT_EQ(*Read(*log), *read + 2);
    for (const std::string& segment : Segments()) {
      if (segment > last) {
        ASSERT_TRUE(RemoveAll(segment).ok());
      }
    }
  }
  EXPECT_EQ(least, 12u);
}

TEST_F(SegmentLogTest, ZerosBehindTheEndAreWhatAStopOfTheMachineLeaves) {
  Fill(*Create(), 1, 3);
  const std::string last = Segments().back();
  ASSERT_TRUE(WriteFileSynced(last, *ReadFile(last) + std::string(5000, 0)).ok());
  auto log = Reopen();
  EXPECT_THAT(log->repaired(), HasSubstr("5000 bytes were cut off"));
  EXPECT_EQ(*Read(*log), 3u);
}

TEST_F(SegmentLogTest, EveryFlippedBitIsDataLossNeverAnotherRecord) {
  Fill(*Create(), 1, 25);
  std::mt19937 random(3);
  for (const std::string& path : Segments()) {
    const std::string whole = *ReadFile(path);
    for (int trial = 0; trial < 40; ++trial) {
      std::string flipped = whole;
      const size_t at = random() % whole.size();
      flipped[at] = static_cast<char>(flipped[at] ^ (1 << random() % 8));
      ASSERT_TRUE(WriteFileSynced(path, flipped).ok());
      const auto log = SegmentLog::Open(path_, kLineage, Options());
      const absl::Status status = log.ok() ? Read(**log).status() : log.status();
      // A version that says "newer" is refused as well, in its own words.
      EXPECT_TRUE(absl::IsDataLoss(status) || absl::IsFailedPrecondition(status))
          << path << " byte " << at << ": " << status;
      EXPECT_THAT(std::string(status.message()), HasSubstr(path));
      ASSERT_TRUE(WriteFileSynced(path, whole).ok());
    }
  }
  EXPECT_EQ(*Read(*Reopen()), 25u);
}

TEST_F(SegmentLogTest, RecoversUpToTheDamageWhereToldToAndKeepsTheRestAside) {
  Fill(*Create(), 1, 40);
  const std::string second = Segments()[1];
  std::string bytes = *ReadFile(second);
  bytes[bytes.size() / 2] ^= 4;
  ASSERT_TRUE(WriteFileSynced(second, bytes).ok());
  LogOptions options = Options();
  options.recover_damaged = true;
  uint64_t last = 0;
  {
    auto log = SegmentLog::Open(path_, kLineage, options);
    ASSERT_TRUE(log.ok()) << log.status();
    last = *Read(**log);
    EXPECT_GT(last, 1u);
    EXPECT_LT(last, 40u);
    EXPECT_THAT((*log)->repaired(), HasSubstr(second));
    Fill(**log, last + 1, last + 10);
    EXPECT_EQ(*Read(**log), last + 10);
  }
  EXPECT_EQ(*Read(*Reopen()), last + 10);
  EXPECT_EQ(*ReadFile(second + ".damaged"), bytes);
}

TEST_F(SegmentLogTest, AMissingSegmentIsDataLoss) {
  Fill(*Create(), 1, 40);
  ASSERT_TRUE(RemoveAll(Segments()[2]).ok());
  auto log = Reopen();
  EXPECT_TRUE(absl::IsDataLoss(Read(*log).status()));
  // What is behind the gap can be read where a snapshot covers the gap.
  const uint64_t behind = std::stoull(std::filesystem::path(Segments()[2]).stem());
  EXPECT_EQ(*Read(*log, behind - 1), 40u);
  for (const std::string& path : Segments()) ASSERT_TRUE(RemoveAll(path).ok());
  EXPECT_TRUE(absl::IsDataLoss(SegmentLog::Open(path_, kLineage, Options()).status()));
}

TEST_F(SegmentLogTest, ForgetsWholeSegmentsOnly) {
  auto log = Create();
  Fill(*log, 1, 40);
  log->Forget(0);
  EXPECT_EQ(log->Stats().first_index, 1u);
  log->Forget(20);
  const uint64_t first = log->Stats().first_index;
  EXPECT_GT(first, 1u);
  EXPECT_LE(first, 21u);
  EXPECT_EQ(*Read(*log, 20), 40u);
  log->Forget(1000);
  EXPECT_EQ(log->Stats().segments, 1u);
  Fill(*log, 41, 42);
  EXPECT_EQ(*Read(*Reopen(), 40), 42u);
}

TEST_F(SegmentLogTest, AnotherLogsSegmentIsNotRead) {
  Fill(*Create(), 1, 2);
  EXPECT_TRUE(absl::IsDataLoss(SegmentLog::Open(path_, kLineage + 1, Options()).status()));
}

TEST_F(SegmentLogTest, SkipsWhatOnlyASnapshotHolds) {
  auto log = Create();
  Fill(*log, 1, 3);
  ASSERT_TRUE(log->SkipTo(10).ok());
  Fill(*log, 10, 12);
  EXPECT_EQ(*Read(*Reopen(), 9), 12u);
  EXPECT_TRUE(absl::IsDataLoss(Read(*log).status()));
}

// A file size limit stands for a full disk: a write fails in the middle of a record.
TEST_F(SegmentLogTest, WithoutRoomNothingIsHalfWrittenAndItGoesOnWhenThereIsSome) {
  signal(SIGXFSZ, SIG_IGN);
  LogOptions options = Options();
  options.segment_bytes = 1u << 20;
  auto created = SegmentLog::Create(path_, kLineage, 1, options);
  ASSERT_TRUE(created.ok());
  SegmentLog& log = **created;
  Fill(log, 1, 20);
  rlimit before;
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  rlimit full = before;
  full.rlim_cur = log.Stats().bytes + 100;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &full), 0);
  const auto refused = log.Append("x", std::string(5000, 'y'));
  const auto again = log.Append("x", std::string(5000, 'y'));
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_TRUE(absl::IsResourceExhausted(refused.status())) << refused.status();
  EXPECT_TRUE(absl::IsResourceExhausted(again.status())) << again.status();
  EXPECT_EQ(log.Stats().failed, 2u);
  EXPECT_EQ(*Read(log), 20u);
  Fill(log, 21, 25);
  auto reopened = Reopen();
  EXPECT_TRUE(reopened->repaired().empty()) << reopened->repaired();
  EXPECT_EQ(*Read(*reopened), 25u);
}

TEST_F(SegmentLogTest, EveryPolicyKeepsTheRecords) {
  Flusher flusher(std::chrono::milliseconds(2));
  for (const SyncPolicy sync : {SyncPolicy::kEach, SyncPolicy::kInterval, SyncPolicy::kOff}) {
    LogOptions options = Options(sync);
    options.flusher = &flusher;
    const std::string path = folder_ / std::to_string(static_cast<int>(sync));
    {
      auto log = SegmentLog::Create(path, kLineage, 1, options);
      ASSERT_TRUE(log.ok()) << log.status();
      // Appends while the flusher and others sync and look.
      std::thread other([&] {
        for (int i = 0; i < 20; ++i) {
          EXPECT_TRUE((*log)->Sync().ok());
          EXPECT_GE((*log)->Stats().segments, 1u);
        }
      });
      Fill(**log, 1, 30);
      other.join();
      if (sync == SyncPolicy::kEach) {
        EXPECT_GE((*log)->Stats().syncs, 30u);
      }
    }
    auto log = SegmentLog::Open(path, kLineage, options);
    ASSERT_TRUE(log.ok());
    EXPECT_EQ(*Read(**log), 30u);
  }
}

}  // namespace
}  // namespace clearance
