#include "client/cli/frame_prefetcher.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/client/test_files.h"

namespace clearance::cli {
namespace {

TEST(FramePrefetcher, GivesTheFramesInOrderThenOutOfRange) {
  client::TestFolder folder;
  WriteDepthSequence(folder);
  const auto sequence = client::Sequence::Open(folder.path());
  FramePrefetcher frames(*sequence, 1, 3, /*ahead=*/1);
  EXPECT_EQ(frames.Next()->frame_id, 1u);
  EXPECT_EQ(frames.Next()->frame_id, 2u);
  EXPECT_EQ(frames.Next().status().code(), absl::StatusCode::kOutOfRange);
}

TEST(FramePrefetcher, GivesTheFramesBeforeADamagedOneThenItsError) {
  client::TestFolder folder;
  WriteDepthSequence(folder);
  std::filesystem::remove(folder.path() / "depth/000001.png");
  const auto sequence = client::Sequence::Open(folder.path());
  FramePrefetcher frames(*sequence, 0, 3);
  EXPECT_TRUE(frames.Next().ok());
  EXPECT_EQ(frames.Next().status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(frames.Next().status().code(), absl::StatusCode::kOutOfRange);
}

TEST(FramePrefetcher, StopsWhenNobodyWantsMore) {
  client::TestFolder folder;
  WriteDepthSequence(folder);
  const auto sequence = client::Sequence::Open(folder.path());
  FramePrefetcher frames(*sequence, 0, 3, /*ahead=*/1);
}

}  // namespace
}  // namespace clearance::cli
