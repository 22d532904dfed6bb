#include "server/map/field_codec.h"

#include <gtest/gtest.h>

#include <map>
#include <random>

#include "server/map/field_differences.h"

namespace clearance {
namespace {

FieldBlock RandomBlock(std::mt19937& random) {
  std::uniform_int_distribution<int> component(-30720, 30720);
  FieldBlock block;
  for (FieldVoxel& voxel : block.voxels) {
    voxel.attributes = static_cast<uint16_t>((random() & 0x3fff) << 2 | random() % 3);
    if (random() % 4 == 0) continue;
    voxel.dx = static_cast<int16_t>(component(random));
    voxel.dy = static_cast<int16_t>(component(random));
    voxel.dz = static_cast<int16_t>(component(random));
  }
  return block;
}

TEST(FieldCodec, GivesBackEveryVoxelWholeOrByDifferences) {
  std::mt19937 random(1);
  std::string bytes;
  std::vector<FieldBlock> before, after;
  for (int i = 0; i < 50; ++i) {
    before.push_back(RandomBlock(random));
    after.push_back(before.back());
    const uint64_t changes = i % 5 == 0 ? 512 : random() % 100;
    for (uint64_t c = 0; c < changes; ++c) {
      after.back().voxels[random() % 512] = RandomBlock(random).voxels[c];
    }
    AppendBlock(&after.back(), DistanceField::kNoTile, nullptr, &bytes);
    AppendBlock(&after.back(), DistanceField::kNoTile, &before.back(), &bytes);
    AppendBlock(nullptr, static_cast<uint8_t>(i % 3), nullptr, &bytes);
  }
  BlockReader reader(bytes);
  for (int i = 0; i < 50; ++i) {
    const auto whole = reader.Next(nullptr);
    ASSERT_TRUE(whole.ok()) << whole.status();
    EXPECT_EQ(whole->data->voxels, after[i].voxels);
    EXPECT_EQ(whole->tile, DistanceField::kNoTile);
    const auto differences = reader.Next(&before[i]);
    ASSERT_TRUE(differences.ok()) << differences.status();
    EXPECT_EQ(differences->data->voxels, after[i].voxels);
    const auto tile = reader.Next(&before[i]);
    ASSERT_TRUE(tile.ok()) << tile.status();
    EXPECT_EQ(tile->data, nullptr);
    EXPECT_EQ(tile->tile, i % 3);
  }
  EXPECT_TRUE(reader.done());
}

TEST(FieldCodec, AFewChangedVoxelsCostAFewBytes) {
  std::mt19937 random(2);
  const FieldBlock before = RandomBlock(random);
  FieldBlock after = before;
  for (int i = 0; i < 10; ++i) after.voxels[i * 50].attributes ^= 4;
  std::string bytes;
  AppendBlock(&after, DistanceField::kNoTile, &before, &bytes);
  EXPECT_EQ(bytes.size(), 1u + 64 + 10 * 8);
}

TEST(FieldCodec, RefusesDamagedBytes) {
  std::mt19937 random(3);
  const FieldBlock block = RandomBlock(random);
  std::string whole, differences;
  AppendBlock(&block, DistanceField::kNoTile, nullptr, &whole);
  FieldBlock other = block;
  other.voxels[7].dx ^= 1;
  AppendBlock(&other, DistanceField::kNoTile, &block, &differences);
  const auto code = [](const std::string& bytes, const FieldBlock* before) {
    return BlockReader(bytes).Next(before).status().code();
  };
  const auto damaged = absl::StatusCode::kDataLoss;
  EXPECT_EQ(code("", nullptr), damaged);
  EXPECT_EQ(code(whole.substr(0, whole.size() - 1), nullptr), damaged);
  EXPECT_EQ(code(differences.substr(0, 40), &block), damaged);
  EXPECT_EQ(code(differences.substr(0, differences.size() - 1), &block), damaged);
  EXPECT_EQ(code(differences, nullptr), damaged);
  EXPECT_EQ(code("\x07", nullptr), damaged);
  EXPECT_EQ(code(std::string("\0", 1), nullptr), damaged);
  EXPECT_EQ(code(std::string("\0\x03", 2), nullptr), damaged) << "no such state";
  EXPECT_EQ(code(std::string("\0\xff", 2), nullptr), damaged);
}

TEST(FieldCodec, NeverReadsPastRandomBytes) {
  std::mt19937 random(4);
  const FieldBlock before = RandomBlock(random);
  int blocks = 0;
  for (int round = 0; round < 2000; ++round) {
    std::string bytes(random() % 6000, '\0');
    for (char& c : bytes) c = static_cast<char>(random());
    if (!bytes.empty()) bytes[0] = static_cast<char>(random() % 3);
    BlockReader reader(bytes);
    while (!reader.done()) {
      const auto block = reader.Next(random() % 2 ? &before : nullptr);
      if (!block.ok()) break;
      ++blocks;
    }
  }
  EXPECT_GT(blocks, 0);
}

TEST(DistanceFieldDifferences, AreExactlyTheBlocksThatChanged) {
  std::mt19937 random(5);
  DistanceField field(0.1, 5);
  const auto at = [&] {
    return BlockIndex{static_cast<int>(random() % 40) - 20, static_cast<int>(random() % 40) - 20,
                      static_cast<int>(random() % 8) - 4};
  };
  for (int i = 0; i < 2000; ++i) field.Set(at(), std::make_shared<FieldBlock>());
  for (int round = 0; round < 50; ++round) {
    const DistanceField before = field;
    for (int i = 0; i < 30; ++i) {
      const BlockIndex index = at();
      const uint64_t what = random() % 3;
      if (what == 0) field.Set(index, nullptr);
      if (what == 1) field.Set(index, nullptr, static_cast<uint8_t>(random() % 3));
      if (what == 2) field.Set(index, std::make_shared<FieldBlock>());
    }
    using Content = std::pair<const FieldBlock*, uint8_t>;
    std::map<BlockIndex, Content> old, now;
    before.ForEach([&](const auto& b, const auto& d, uint8_t t) { old[b] = {d.get(), t}; });
    field.ForEach([&](const auto& b, const auto& d, uint8_t t) { now[b] = {d.get(), t}; });
    std::vector<BlockIndex> expected, got;
    std::map<BlockIndex, int> all;
    for (const auto& [index, content] : old) all[index];
    for (const auto& [index, content] : now) all[index];
    for (const auto& [index, unused] : all) {
      const Content nothing{nullptr, DistanceField::kNoTile};
      const Content a = old.contains(index) ? old[index] : nothing;
      const Content b = now.contains(index) ? now[index] : nothing;
      if (a != b) expected.push_back(index);
    }
    for (const auto& d : DifferencesBetween(before, field)) {
      got.push_back(d.index);
      EXPECT_EQ(d.after.get(), field.FindBlock(d.index));
      EXPECT_EQ(d.before.get(), before.FindBlock(d.index));
    }
    EXPECT_EQ(got, expected);
    EXPECT_TRUE(DifferencesBetween(field, field).empty());
  }
}

}  // namespace
}  // namespace clearance
