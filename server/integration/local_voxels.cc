#include "server/integration/local_voxels.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace clearance {
namespace {

// Chunks are of fixed size, so that sums are formed in the same order for any number of threads.
constexpr size_t kChunk = 16384;

// Consecutive points in one voxel: neighbouring pixels mostly are.
struct Run {
  uint64_t key;
  Eigen::Vector3f sum;  // of points, from the voxel's lower corner
  uint32_t count;
};

// A local origin on a block corner near the sensor: floats from there keep micrometres at any place
// of the map, and indices are exact sums of integers.
struct LocalOrigin {
  BlockIndex block;
  Eigen::Matrix3f R_M_X;
  Eigen::Vector3f t_m;  // of the sensor, from the origin

  LocalOrigin(const Pose& T_M_X, double voxel_size_m)
      : block(BlockOf(VoxelOf(T_M_X.translation(), voxel_size_m))),
        R_M_X(T_M_X.linear().cast<float>()),
        t_m((T_M_X.translation() - BlockOrigin(block, voxel_size_m)).cast<float>()) {}
};

// Voxel offsets from the origin in 20 bits each, ordered like (block, offset in the block).
constexpr int kReach =
    1 << 19;  // voxels from the origin; farther points are out of any sensor's range
constexpr uint64_t KeyOf(int x, int y, int z) {
  const uint64_t a = x + kReach, b = y + kReach, c = z + kReach;
  return ((a >> 3) << 43) | ((b >> 3) << 26) | ((c >> 3) << 9) | ((a & 7) << 6) | ((b & 7) << 3) |
         (c & 7);
}
constexpr uint16_t OffsetOfKey(uint64_t key) { return key & 511; }
BlockIndex BlockOfKey(uint64_t key, const BlockIndex& origin) {
  constexpr uint64_t kMask = (1 << 17) - 1;
  constexpr int kReachBlocks = kReach >> 3;
  return {origin.x + static_cast<int>((key >> 43) & kMask) - kReachBlocks,
          origin.y + static_cast<int>((key >> 26) & kMask) - kReachBlocks,
          origin.z + static_cast<int>((key >> 9) & kMask) - kReachBlocks};
}

void AppendRuns(const Eigen::Matrix3Xf& points_X, const uint32_t* begin, const uint32_t* end,
                const LocalOrigin& origin, float h, std::vector<Run>& runs) {
  const float per_h = 1.f / h;
  Eigen::Vector3f corner = Eigen::Vector3f::Constant(NAN);
  Eigen::Vector3f first = corner;  // the voxel that the current run is in
  for (const uint32_t* i = begin; i != end; ++i) {
    const Eigen::Vector3f p = origin.R_M_X * points_X.col(*i) + origin.t_m;
    const Eigen::Vector3f v = (p * per_h).array().floor();
    if (v != first) {
      if (!(v.cwiseAbs().maxCoeff() < kReach - 1)) continue;
      first = v;
      corner = v * h;
      runs.push_back(
          {KeyOf(static_cast<int>(v.x()), static_cast<int>(v.y()), static_cast<int>(v.z())),
           p - corner, 1});
    } else {
      runs.back().sum += p - corner;
      ++runs.back().count;
    }
  }
}

std::vector<Run> FindRuns(const Eigen::Matrix3Xf& points_X, const std::vector<uint32_t>& indices,
                          const LocalOrigin& origin, float h) {
  const size_t chunks = (indices.size() + kChunk - 1) / kChunk;
  std::vector<std::vector<Run>> parts(chunks);
  tbb::parallel_for(size_t{0}, chunks, [&](size_t c) {
    parts[c].reserve(kChunk / 2);
    AppendRuns(points_X, indices.data() + c * kChunk,
               indices.data() + std::min(indices.size(), (c + 1) * kChunk), origin, h, parts[c]);
  });
  std::vector<size_t> begin(chunks + 1, 0);
  for (size_t c = 0; c < chunks; ++c) begin[c + 1] = begin[c] + parts[c].size();
  std::vector<Run> runs(begin.back());
  tbb::parallel_for(size_t{0}, chunks, [&](size_t c) {
    std::copy(parts[c].begin(), parts[c].end(), runs.begin() + begin[c]);
  });
  return runs;
}

// Order of the runs by key, equal keys in the order they came: a stable radix sort on the bits in
// which keys differ.
std::vector<uint32_t> SortedOrder(const std::vector<Run>& runs) {
  constexpr int kDigitBits = 11;
  constexpr size_t kBuckets = size_t{1} << kDigitBits;
  struct Item {
    uint64_t key;
    uint32_t run;
  };
  std::vector<Item> items(runs.size()), other(runs.size());
  uint64_t all = ~uint64_t{0}, any = 0;
  for (size_t i = 0; i < runs.size(); ++i) {
    items[i] = {runs[i].key, static_cast<uint32_t>(i)};
    all &= runs[i].key;
    any |= runs[i].key;
  }
  const uint64_t differing = any & ~all;
  for (int shift = 0; shift < 64; shift += kDigitBits) {
    if (((differing >> shift) & (kBuckets - 1)) == 0) continue;
    std::vector<uint32_t> position(kBuckets + 1, 0);
    for (const Item& item : items) ++position[((item.key >> shift) & (kBuckets - 1)) + 1];
    for (size_t b = 0; b < kBuckets; ++b) position[b + 1] += position[b];
    for (const Item& item : items) other[position[(item.key >> shift) & (kBuckets - 1)]++] = item;
    std::swap(items, other);
  }
  std::vector<uint32_t> order(runs.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = items[i].run;
  return order;
}

}  // namespace

LocalVoxels GatherVoxels(const Eigen::Matrix3Xf& points_X, const std::vector<uint32_t>& indices,
                         const Pose& T_M_X, double voxel_size_m) {
  LocalVoxels out;
  out.voxel_size_m = voxel_size_m;
  const float h = static_cast<float>(voxel_size_m);
  const LocalOrigin origin(T_M_X, voxel_size_m);
  const std::vector<Run> runs = FindRuns(points_X, indices, origin, h);
  const std::vector<uint32_t> order = SortedOrder(runs);
  for (size_t i = 0; i < order.size();) {
    const uint64_t key = runs[order[i]].key;
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    uint32_t count = 0;
    for (; i < order.size() && runs[order[i]].key == key; ++i) {
      sum += runs[order[i]].sum;
      count += runs[order[i]].count;
    }
    const BlockIndex block = BlockOfKey(key, origin.block);
    const uint32_t voxel = static_cast<uint32_t>(out.offset.size());
    if (out.blocks.empty() || out.blocks.back().block != block) {
      out.blocks.push_back({block, voxel, voxel});
    }
    out.blocks.back().end = voxel + 1;
    const uint16_t offset = OffsetOfKey(key);
    const VoxelIndex in_block = VoxelAt({0, 0, 0}, offset);
    // Rounding may put a mean a hair beyond its voxel; indices made from it must stay the same.
    const Eigen::Vector3f mean = (sum / static_cast<float>(count)).cwiseMax(0.f).cwiseMin(h);
    out.offset.push_back(offset);
    out.centroid.push_back(in_block.cast<float>() * h + mean);
    out.count.push_back(count);
  }
  return out;
}

LocalVoxels Union(const LocalVoxels& a, const LocalVoxels& b) {
  if (b.empty()) return a;
  LocalVoxels out;
  out.voxel_size_m = a.voxel_size_m;
  const auto append = [&out](const LocalVoxels& from, uint32_t i) {
    out.offset.push_back(from.offset[i]);
    out.centroid.push_back(from.centroid[i]);
    out.count.push_back(from.count[i]);
  };
  size_t p = 0, q = 0;
  while (p < a.blocks.size() || q < b.blocks.size()) {
    const bool in_a =
        p < a.blocks.size() && (q == b.blocks.size() || a.blocks[p].block <= b.blocks[q].block);
    const bool in_b =
        q < b.blocks.size() && (p == a.blocks.size() || b.blocks[q].block <= a.blocks[p].block);
    const uint32_t begin = static_cast<uint32_t>(out.offset.size());
    uint32_t i = in_a ? a.blocks[p].begin : 0, j = in_b ? b.blocks[q].begin : 0;
    const uint32_t i_end = in_a ? a.blocks[p].end : 0, j_end = in_b ? b.blocks[q].end : 0;
    while (i < i_end || j < j_end) {
      if (j == j_end || (i < i_end && a.offset[i] <= b.offset[j])) {
        if (j < j_end && a.offset[i] == b.offset[j]) ++j;
        append(a, i++);
      } else {
        append(b, j++);
      }
    }
    out.blocks.push_back({in_a ? a.blocks[p].block : b.blocks[q].block, begin,
                          static_cast<uint32_t>(out.offset.size())});
    p += in_a;
    q += in_b;
  }
  return out;
}

}  // namespace clearance
