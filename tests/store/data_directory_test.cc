#include "server/store/data_directory.h"

#include <gmock/gmock.h>

#include "tests/store/temp_folder.h"

namespace clearance {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class DataDirectoryTest : public ::testing::Test {
 protected:
  std::unique_ptr<DataDirectory> Open() {
    StoreOptions options;
    options.path = folder_.path();
    options.sync = SyncPolicy::kOff;
    auto directory = DataDirectory::Open(options);
    EXPECT_TRUE(directory.ok()) << directory.status();
    return *std::move(directory);
  }
  static SnapshotManifest Snapshot(MapFolder& folder, const std::string& id, uint64_t log_index,
                                   bool automatic = false) {
    static int64_t clock = 0;
    auto writer = folder.BeginSnapshot(id);
    EXPECT_TRUE(writer.ok()) << writer.status();
    EXPECT_TRUE(writer->Add("state", "state of " + id).ok());
    SnapshotManifest manifest;
    manifest.map = folder.map();
    manifest.snapshot_id = id;
    manifest.automatic = automatic;
    manifest.lineage = folder.lineage();
    manifest.log_index = log_index;
    manifest.config = folder.config();
    manifest.created_unix_ns = ++clock;
    EXPECT_TRUE(writer->Commit(&manifest).ok());
    return manifest;
  }
  static std::vector<std::string> Ids(const std::vector<SnapshotManifest>& snapshots) {
    std::vector<std::string> ids;
    for (const SnapshotManifest& m : snapshots) ids.push_back(m.snapshot_id);
    return ids;
  }
  static void Append(MapFolder& folder, int count) {
    for (int i = 0; i < count; ++i) {
      ASSERT_TRUE(folder.log()->Append("record", std::string(100, 'x')).ok());
    }
  }

  TempFolder folder_;
};

TEST_F(DataDirectoryTest, ASecondServerIsRefusedUntilTheFirstLetsGo) {
  auto first = Open();
  StoreOptions options;
  options.path = folder_.path();
  const absl::Status status = DataDirectory::Open(options).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr(std::to_string(getpid())));
  first.reset();
  EXPECT_TRUE(DataDirectory::Open(options).ok());
}

TEST_F(DataDirectoryTest, KeepsMapsAcrossRestartsUntilTheyAreDeleted) {
  {
    auto directory = Open();
    ASSERT_TRUE(directory->CreateMap("a", "config a", 5).ok());
    ASSERT_TRUE(directory->CreateMap("b", "config b", 6).ok());
    EXPECT_TRUE(absl::IsAlreadyExists(directory->CreateMap("a", "", 7).status()));
  }
  auto directory = Open();
  EXPECT_THAT(*directory->Maps(), ElementsAre("a", "b"));
  {
    const auto b = directory->OpenMap("b");
    ASSERT_TRUE(b.ok()) << b.status();
    EXPECT_EQ((*b)->config(), "config b");
    EXPECT_EQ((*b)->lineage(), 6u);
  }
  ASSERT_TRUE(directory->DeleteMap("b").ok());
  EXPECT_THAT(*directory->Maps(), ElementsAre("a"));
  EXPECT_TRUE(absl::IsDataLoss(directory->OpenMap("b").status()));
}

TEST_F(DataDirectoryTest, WhatACrashLeftHalfIsCleanedUp) {
  Open()->CreateMap("a", "config", 5).status().IgnoreError();
  const std::string maps = folder_ / "maps/";
  ASSERT_TRUE(MakeFolder(maps + ".new-c/log-1").ok());
  ASSERT_TRUE(MakeFolder(maps + ".deleted-d").ok());
  ASSERT_TRUE(MakeFolder(maps + "a/snapshots/.writing-s").ok());
  ASSERT_TRUE(MakeFolder(maps + "a/log-0000000000000009").ok());
  auto directory = Open();
  EXPECT_THAT(*directory->Maps(), ElementsAre("a"));
  ASSERT_TRUE(directory->OpenMap("a").ok());
  EXPECT_FALSE(std::filesystem::exists(maps + ".new-c"));
  EXPECT_FALSE(std::filesystem::exists(maps + ".deleted-d"));
  EXPECT_FALSE(std::filesystem::exists(maps + "a/snapshots/.writing-s"));
  EXPECT_FALSE(std::filesystem::exists(maps + "a/log-0000000000000009"));
}

TEST_F(DataDirectoryTest, ADamagedMapFileIsDataLoss) {
  Open()->CreateMap("a", "config", 5).status().IgnoreError();
  const std::string path = folder_ / "maps/a/map.json";
  std::string text = *ReadFile(path);
  text[text.find("lineage") + 11] ^= 1;
  ASSERT_TRUE(WriteFileSynced(path, text).ok());
  EXPECT_TRUE(absl::IsDataLoss(Open()->OpenMap("a").status()));
  ASSERT_TRUE(RemoveAll(path).ok());
  EXPECT_TRUE(absl::IsDataLoss(Open()->OpenMap("a").status()));
}

TEST_F(DataDirectoryTest, SnapshotsAreThereAsAWholeOrNotAtAll) {
  auto directory = Open();
  auto map = *directory->CreateMap("a", "config", 5);
  {
    auto writer = map->BeginSnapshot("half");
    ASSERT_TRUE(writer.ok());
    ASSERT_TRUE(writer->Add("state", "x").ok());
  }
  EXPECT_TRUE(map->Snapshots().empty());
  const SnapshotManifest manifest = Snapshot(*map, "whole", 0);
  EXPECT_THAT(Ids(map->Snapshots()), ElementsAre("whole"));
  EXPECT_TRUE(absl::IsAlreadyExists(map->BeginSnapshot("whole").status()));
  const std::string folder = map->SnapshotFolder("whole");
  EXPECT_EQ(*ReadSnapshotFile(folder, manifest, "state"), "state of whole");
  ASSERT_TRUE(WriteFileSynced(folder + "/state", "state of whale").ok());
  EXPECT_TRUE(absl::IsDataLoss(ReadSnapshotFile(folder, manifest, "state").status()));
  ASSERT_TRUE(WriteFileSynced(folder + "/state", "state of").ok());
  EXPECT_TRUE(absl::IsDataLoss(ReadSnapshotFile(folder, manifest, "state").status()));
  ASSERT_TRUE(RemoveAll(folder + "/state").ok());
  EXPECT_TRUE(absl::IsDataLoss(ReadSnapshotFile(folder, manifest, "state").status()));
  const absl::Status missing = map->FindSnapshot("other").status();
  EXPECT_TRUE(absl::IsNotFound(missing));
  EXPECT_THAT(std::string(missing.message()), HasSubstr("Snapshots: whole"));
}

TEST_F(DataDirectoryTest, TheNewestAutomaticSnapshotsStayAndTheLogIsCutBehindThem) {
  StoreOptions options;
  options.path = folder_.path();
  options.sync = SyncPolicy::kOff;
  options.segment_bytes = 200;  // two records a segment
  auto directory = *DataDirectory::Open(options);
  auto map = *directory->CreateMap("a", "config", 5);
  Append(*map, 10);
  Snapshot(*map, "asked", 10);
  for (int i = 2; i <= 6; ++i) {
    Append(*map, 10);
    Snapshot(*map, "auto-" + std::to_string(i), 10 * i, true);
    map->Prune(2);
  }
  EXPECT_THAT(Ids(map->Snapshots()), ElementsAre("auto-6", "auto-5", "asked"));
  EXPECT_GT(map->log()->Stats().first_index, 45u);
  EXPECT_LE(map->log()->Stats().first_index, 51u);
  // The map is recovered from one of these two: the last one is not given away.
  EXPECT_TRUE(map->DeleteSnapshot("auto-6").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(map->DeleteSnapshot("auto-5")));
  EXPECT_TRUE(map->DeleteSnapshot("asked").ok());
  EXPECT_TRUE(absl::IsNotFound(map->DeleteSnapshot("asked")));
}

TEST_F(DataDirectoryTest, ARestoreBeginsALineageThatNeverSeesTheOldLogAgain) {
  {
    auto directory = Open();
    auto map = *directory->CreateMap("a", "config", 5);
    Append(*map, 3);
    const SnapshotManifest base = Snapshot(*map, "base", 3);
    Append(*map, 4);
    Snapshot(*map, "later", 7);
    ASSERT_TRUE(map->StartLineage(99, base).ok());
    EXPECT_EQ(map->log()->Stats().last_index, 0u);
    Append(*map, 2);
  }
  auto directory = Open();
  auto map = *directory->OpenMap("a");
  EXPECT_EQ(map->lineage(), 99u);
  EXPECT_EQ(map->base_snapshot(), "base");
  EXPECT_EQ(map->log()->Stats().last_index, 2u);
  const auto usable = map->RecoverySnapshots();
  EXPECT_THAT(Ids(usable), ElementsAre("base"));
  EXPECT_EQ(usable[0].log_index, 0u);
  EXPECT_THAT(Ids(map->Snapshots()), ElementsAre("later", "base"));
  EXPECT_TRUE(absl::IsFailedPrecondition(map->DeleteSnapshot("base")));
  EXPECT_TRUE(map->DeleteSnapshot("later").ok());
  Snapshot(*map, "new", 2);
  EXPECT_TRUE(map->DeleteSnapshot("base").ok());
}

}  // namespace
}  // namespace clearance
