#include "server/map/field_codec.h"

#include <array>
#include <bit>
#include <cstring>

#include "absl/strings/str_format.h"
#include "server/map/voxel.h"

namespace clearance {
namespace {

enum Kind : uint8_t { kTile = 0, kWhole = 1, kDifferences = 2 };

constexpr int kVoxelUnits = 256;  // of a site's coordinates
constexpr int kValues = 4;        // dx, dy, dz, attributes
constexpr size_t kWholeBytes = kBlockVoxels * sizeof(FieldVoxel);
// More voxels than these cost about as much as the whole block.
constexpr int kMostDifferences = kBlockVoxels / 2;
// A field reaches 120 voxels at most, so the place of a site never looks like "no site".
constexpr uint16_t kNoPlace = static_cast<uint16_t>(FieldVoxel::kNoSite);

using Values = std::array<uint16_t, kValues>;

// A site's place in its units, counted from the first voxel's centre (modulo 2^16).
Values Encode(const FieldVoxel& voxel, int offset) {
  Values values = {static_cast<uint16_t>(voxel.dx), static_cast<uint16_t>(voxel.dy),
                   static_cast<uint16_t>(voxel.dz), voxel.attributes};
  if (!voxel.has_site()) return values;
  values[0] += static_cast<uint16_t>((offset >> 6) * kVoxelUnits);
  values[1] += static_cast<uint16_t>(((offset >> 3) & 7) * kVoxelUnits);
  values[2] += static_cast<uint16_t>((offset & 7) * kVoxelUnits);
  return values;
}

FieldVoxel Decode(Values values, int offset) {
  if (values[0] != kNoPlace) {
    values[0] -= static_cast<uint16_t>((offset >> 6) * kVoxelUnits);
    values[1] -= static_cast<uint16_t>(((offset >> 3) & 7) * kVoxelUnits);
    values[2] -= static_cast<uint16_t>((offset & 7) * kVoxelUnits);
  }
  return {static_cast<int16_t>(values[0]), static_cast<int16_t>(values[1]),
          static_cast<int16_t>(values[2]), values[3]};
}

bool IsState(uint16_t attributes) { return (attributes & 3) != 3; }

// Differences to the value before, low bytes apart from high ones: mostly zeros.
void AppendWhole(const FieldBlock& block, std::string* bytes) {
  bytes->push_back(static_cast<char>(kWhole));
  const size_t start = bytes->size();
  bytes->resize(start + kWholeBytes);
  char* out = bytes->data() + start;
  Values last{};
  for (int o = 0; o < kBlockVoxels; ++o) {
    const Values values = Encode(block.voxels[o], o);
    for (int i = 0; i < kValues; ++i) {
      const uint16_t step = values[i] - last[i];
      out[(2 * i) * kBlockVoxels + o] = static_cast<char>(step & 0xff);
      out[(2 * i + 1) * kBlockVoxels + o] = static_cast<char>(step >> 8);
    }
    last = values;
  }
}

void AppendDifferences(const FieldBlock& block, const BlockMask& mask, std::string* bytes) {
  bytes->push_back(static_cast<char>(kDifferences));
  bytes->append(reinterpret_cast<const char*>(mask.data()), sizeof(mask));
  for (int o = 0; o < kBlockVoxels; ++o) {
    if (!Test(mask, o)) continue;
    const Values values = Encode(block.voxels[o], o);
    bytes->append(reinterpret_cast<const char*>(values.data()), sizeof(values));
  }
}

absl::Status Damaged(std::string_view what) {
  return absl::DataLossError(absl::StrFormat("field block: %s", what));
}

}  // namespace

void AppendBlock(const FieldBlock* block, uint8_t tile, const FieldBlock* before,
                 std::string* bytes) {
  if (block == nullptr) {
    bytes->push_back(static_cast<char>(kTile));
    bytes->push_back(static_cast<char>(tile));
    return;
  }
  if (before == nullptr) return AppendWhole(*block, bytes);
  BlockMask mask{};
  int count = 0;
  for (int o = 0; o < kBlockVoxels; ++o) {
    if (block->voxels[o] == before->voxels[o]) continue;
    Set(mask, o);
    ++count;
  }
  if (count > kMostDifferences) return AppendWhole(*block, bytes);
  AppendDifferences(*block, mask, bytes);
}

absl::StatusOr<BlockReader::Block> BlockReader::Next(const FieldBlock* before) {
  if (rest_.empty()) return Damaged("the payload ends before its last block");
  const auto kind = static_cast<uint8_t>(rest_[0]);
  rest_.remove_prefix(1);
  if (kind == kTile) {
    if (rest_.empty()) return Damaged("a tile without its state");
    const auto tile = static_cast<uint8_t>(rest_[0]);
    rest_.remove_prefix(1);
    if (tile > 7 || !IsState(tile)) {
      return Damaged(absl::StrFormat("tile %d is no state", tile));
    }
    return Block{nullptr, tile};
  }
  if (kind == kWhole) {
    if (rest_.size() < kWholeBytes) return Damaged("a block that ends early");
    auto data = std::make_shared<FieldBlock>();
    Values last{};
    for (int o = 0; o < kBlockVoxels; ++o) {
      for (int i = 0; i < kValues; ++i) {
        const auto low = static_cast<uint8_t>(rest_[(2 * i) * kBlockVoxels + o]);
        const auto high = static_cast<uint8_t>(rest_[(2 * i + 1) * kBlockVoxels + o]);
        last[i] += static_cast<uint16_t>(low | high << 8);
      }
      data->voxels[o] = Decode(last, o);
      if (!IsState(last[3])) return Damaged("a voxel without a state");
    }
    rest_.remove_prefix(kWholeBytes);
    return Block{std::move(data)};
  }
  if (kind != kDifferences) return Damaged(absl::StrFormat("kind %d is not known", kind));
  if (before == nullptr) return Damaged("differences to a block that is not there");
  BlockMask mask;
  if (rest_.size() < sizeof(mask)) return Damaged("differences that end early");
  std::memcpy(mask.data(), rest_.data(), sizeof(mask));
  rest_.remove_prefix(sizeof(mask));
  size_t count = 0;
  for (const uint64_t word : mask) count += static_cast<size_t>(std::popcount(word));
  if (rest_.size() < count * sizeof(Values)) return Damaged("differences that end early");
  auto data = std::make_shared<FieldBlock>(*before);
  const char* next = rest_.data();
  for (int o = 0; o < kBlockVoxels; ++o) {
    if (!Test(mask, o)) continue;
    Values values;
    std::memcpy(values.data(), next, sizeof(values));
    next += sizeof(values);
    if (!IsState(values[3])) return Damaged("a voxel without a state");
    data->voxels[o] = Decode(values, o);
  }
  rest_.remove_prefix(count * sizeof(Values));
  return Block{std::move(data)};
}

}  // namespace clearance
