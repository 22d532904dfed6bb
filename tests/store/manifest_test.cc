#include "server/store/manifest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

namespace clearance {
namespace {

using ::testing::HasSubstr;

SnapshotManifest Example() {
  SnapshotManifest m;
  m.map = "street";
  m.snapshot_id = "evening";
  m.comment = "after \"the\" r\xc3\xa9paration";
  m.automatic = true;
  m.epoch = (1ull << 53) - 1;
  m.revision = 12;
  m.field_revision = 11;
  m.stamp_ns = -5;
  m.lineage = ~0ull >> 11;
  m.log_index = 77;
  m.created_unix_ns = 1'700'000'000'123'456'789;
  m.config = std::string("\0\1\xff", 3);
  m.files = {{"static.vdb", 1ull << 40, 0xdeadbeef}, {"state.bin", 0, 0}};
  return m;
}

TEST(Manifest, ComesBackAsItWasWritten) {
  const std::string text = EncodeManifest(Example());
  const auto m = DecodeManifest(text);
  ASSERT_TRUE(m.ok()) << m.status();
  EXPECT_EQ(EncodeManifest(*m), text);
  EXPECT_EQ(m->comment, Example().comment);
  EXPECT_EQ(m->config, Example().config);
  EXPECT_EQ(m->stamp_ns, -5);
  EXPECT_EQ(m->created_unix_ns, Example().created_unix_ns);
  EXPECT_EQ(m->lineage, Example().lineage);
  ASSERT_EQ(m->files.size(), 2u);
  EXPECT_EQ(m->files[0].crc32c, 0xdeadbeefu);
  EXPECT_EQ(m->total_bytes(), 1ull << 40);
}

TEST(Manifest, NoFlippedBitChangesWhatItSays) {
  const std::string text = EncodeManifest(Example());
  std::mt19937 random(11);
  for (int trial = 0; trial < 3000; ++trial) {
    std::string flipped = text;
    const size_t at = random() % text.size();
    flipped[at] = static_cast<char>(flipped[at] ^ (1 << random() % 8));
    const auto m = DecodeManifest(flipped);
    if (!m.ok()) continue;
    EXPECT_EQ(EncodeManifest(*m), text) << at;  // a blank between tokens
  }
}

TEST(Manifest, DepthThatNoManifestHasIsDataLossAndNoStackOverflow) {
  for (const std::string open : {"[", "{\"a\":"}) {
    std::string deep = "{\"snapshot\": {\"a\": ";
    for (int i = 0; i < 300'000; ++i) deep += open;
    EXPECT_TRUE(absl::IsDataLoss(DecodeManifest(deep).status()));
    deep += "1";
    for (int i = 0; i < 300'000; ++i) deep += open == "[" ? "]" : "}";
    deep += "}, \"crc32c\": \"00000000\"}";
    EXPECT_TRUE(absl::IsDataLoss(DecodeManifest(deep).status()));
  }
}

TEST(Manifest, EveryTruncationIsDataLoss) {
  const std::string text = EncodeManifest(Example());
  for (size_t size = 0; size + 2 < text.size(); ++size) {
    EXPECT_TRUE(absl::IsDataLoss(DecodeManifest(text.substr(0, size)).status())) << size;
  }
}

TEST(Manifest, OneFromANewerServerIsRefusedInSoManyWords) {
  const std::string sealed = SealJson("snapshot", R"({"format_version": 2, "more": [1]})");
  const absl::Status status = DecodeManifest(sealed).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("format version 2; this server knows up to 1"));
  EXPECT_TRUE(absl::IsDataLoss(DecodeManifest(SealJson("snapshot", "{}")).status()));
  EXPECT_TRUE(absl::IsDataLoss(DecodeManifest("[]").status()));
  EXPECT_TRUE(absl::IsDataLoss(
      DecodeManifest(SealJson("snapshot", R"({"format_version": 1, "map": 3})")).status()));
}

TEST(Manifest, HexComesBack) {
  const std::string bytes("\0\x7f\xff", 3);
  EXPECT_EQ(ToHex(bytes), "007fff");
  EXPECT_EQ(FromHex("007fff"), bytes);
  EXPECT_EQ(FromHex("0x"), "");
  EXPECT_EQ(FromHex("123"), "");
}

}  // namespace
}  // namespace clearance
