#include "server/integration/local_voxels.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "server/field/lanes.h"

namespace clearance {
namespace {

// Chunks are of fixed size, so that sums are formed in the same order for any number of threads.
constexpr size_t kChunk = 16384;
constexpr size_t kBlocksAtOnce = 256;

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

// Eight points, x, y and z apart; those beyond `count` repeat the last.
std::array<Lanes, 3> EightPoints(const Eigen::Matrix3Xf& points_X, const uint32_t* indices,
                                 int count) {
  std::array<Lanes, 3> p;
  for (int k = 0; k < kLanes; ++k) {
    const float* from = points_X.data() + size_t{3} * indices[std::min(k, count - 1)];
    for (int axis = 0; axis < 3; ++axis) p[axis][k] = from[axis];
  }
  return p;
}

void AppendRuns(const Eigen::Matrix3Xf& points_X, const uint32_t* begin, const uint32_t* end,
                const LocalOrigin& origin, float h, std::vector<Run>& runs) {
  const float per_h = 1.f / h;
  const Eigen::Matrix3f& R = origin.R_M_X;
  constexpr float kFarthest = static_cast<float>(kReach - 1);
  std::array<float, 3> last = {NAN, NAN, NAN};  // the voxel that the current run is in
  for (const uint32_t* i = begin; i < end; i += kLanes) {
    const int count = static_cast<int>(std::min<ptrdiff_t>(kLanes, end - i));
    const std::array<Lanes, 3> p_X = EightPoints(points_X, i, count);
    std::array<Lanes, 3> voxel, from_corner;
    LanesInt is_new{}, within = LanesInt{} - 1;
    for (int a = 0; a < 3; ++a) {
      const Lanes p = R(a, 0) * p_X[0] + R(a, 1) * p_X[1] + R(a, 2) * p_X[2] + origin.t_m[a];
      voxel[a] = Floor(p * per_h);
      from_corner[a] = p - voxel[a] * h;
      within &= (voxel[a] < kFarthest) & (voxel[a] > -kFarthest);
      Lanes before = __builtin_shuffle(voxel[a], LanesInt{0, 0, 1, 2, 3, 4, 5, 6});
      before[0] = last[a];
      is_new |= voxel[a] != before;
      last[a] = voxel[a][kLanes - 1];
    }
    const uint32_t starts = Bits(is_new), usable = Bits(within);
    for (int k = 0; k < count; ++k) {
      if (!(usable >> k & 1)) continue;
      const Eigen::Vector3f corner(from_corner[0][k], from_corner[1][k], from_corner[2][k]);
      if (starts >> k & 1) {
        runs.push_back({KeyOf(static_cast<int>(voxel[0][k]), static_cast<int>(voxel[1][k]),
                              static_cast<int>(voxel[2][k])),
                        corner, 1});
      } else {
        runs.back().sum += corner;
        ++runs.back().count;
      }
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

constexpr uint64_t BlockKey(uint64_t key) { return key >> 9; }

// Runs by block, in the order they came within a block.
struct RunsByBlock {
  std::vector<uint32_t> order;  // of runs
  std::vector<uint32_t> begin;  // into `order`, one more than there are blocks; blocks rising
};

// Blocks of a frame lie in a box of a few hundred thousand: one counting pass sorts them.
class BlockBox {
 public:
  static constexpr uint64_t kLargest = uint64_t{1} << 21;

  explicit BlockBox(const std::vector<Run>& runs) {
    std::array<uint32_t, 3> high{};
    low_.fill(~0u);
    for (const Run& run : runs) {
      for (int axis = 0; axis < 3; ++axis) {
        const uint32_t at = Coordinate(run.key, axis);
        low_[axis] = std::min(low_[axis], at);
        high[axis] = std::max(high[axis], at);
      }
    }
    for (int axis = 0; axis < 3; ++axis) side_[axis] = high[axis] - low_[axis] + 1;
  }
  uint64_t size() const { return side_[0] * side_[1] * side_[2]; }
  size_t At(uint64_t key) const {
    return ((Coordinate(key, 0) - low_[0]) * side_[1] + Coordinate(key, 1) - low_[1]) * side_[2] +
           Coordinate(key, 2) - low_[2];
  }

 private:
  static uint32_t Coordinate(uint64_t key, int axis) {
    return static_cast<uint32_t>(key >> (43 - 17 * axis)) & ((1 << 17) - 1);
  }
  std::array<uint32_t, 3> low_;
  std::array<uint64_t, 3> side_{};
};

RunsByBlock GroupByBlock(const std::vector<Run>& runs) {
  RunsByBlock out;
  out.order.resize(runs.size());
  out.begin.push_back(0);
  if (runs.empty()) return out;
  if (const BlockBox box(runs); box.size() <= BlockBox::kLargest) {
    std::vector<uint32_t> position(box.size(), 0);
    for (const Run& run : runs) ++position[box.At(run.key)];
    uint32_t sum = 0;
    for (uint32_t& p : position) {
      const uint32_t count = p;
      p = sum;
      sum += count;
      if (count > 0) out.begin.push_back(sum);
    }
    for (size_t i = 0; i < runs.size(); ++i) {
      out.order[position[box.At(runs[i].key)]++] = static_cast<uint32_t>(i);
    }
    return out;
  }
  for (size_t i = 0; i < runs.size(); ++i) out.order[i] = static_cast<uint32_t>(i);
  std::stable_sort(out.order.begin(), out.order.end(), [&](uint32_t a, uint32_t b) {
    return BlockKey(runs[a].key) < BlockKey(runs[b].key);
  });
  for (size_t i = 1; i <= out.order.size(); ++i) {
    if (i == out.order.size() ||
        BlockKey(runs[out.order[i]].key) != BlockKey(runs[out.order[i - 1]].key)) {
      out.begin.push_back(static_cast<uint32_t>(i));
    }
  }
  return out;
}

// The voxels of one block, from its runs.
class BlockGatherer {
 public:
  void Gather(const std::vector<Run>& runs, const uint32_t* begin, const uint32_t* end) {
    used_ = {};
    for (const uint32_t* i = begin; i != end; ++i) {
      const Run& run = runs[*i];
      const uint16_t offset = OffsetOfKey(run.key);
      if (!Test(used_, offset)) {
        Set(used_, offset);
        sum_[offset].setZero();
        count_[offset] = 0;
      }
      sum_[offset] += run.sum;
      count_[offset] += run.count;
    }
  }
  void Append(const BlockIndex& block, LocalVoxels& out) const {
    const float h = static_cast<float>(out.voxel_size_m);
    const uint32_t begin = static_cast<uint32_t>(out.offset.size());
    for (int word = 0; word < 8; ++word) {
      for (uint64_t bits = used_[word]; bits; bits &= bits - 1) {
        const int offset = word * 64 + __builtin_ctzll(bits);
        const VoxelIndex in_block = VoxelAt({0, 0, 0}, offset);
        // Rounding may put a mean a hair beyond its voxel; indices made from it must stay the same.
        const Eigen::Vector3f mean =
            (sum_[offset] / static_cast<float>(count_[offset])).cwiseMax(0.f).cwiseMin(h);
        out.offset.push_back(static_cast<uint16_t>(offset));
        out.centroid.push_back(in_block.cast<float>() * h + mean);
        out.count.push_back(count_[offset]);
      }
    }
    out.blocks.push_back({block, begin, static_cast<uint32_t>(out.offset.size())});
  }

 private:
  BlockMask used_{};
  std::array<Eigen::Vector3f, kBlockVoxels> sum_;
  std::array<uint32_t, kBlockVoxels> count_;
};

template <typename T>
void AppendAll(std::vector<T>& all, const std::vector<T>& part) {
  all.insert(all.end(), part.begin(), part.end());
}

}  // namespace

LocalVoxels GatherVoxels(const Eigen::Matrix3Xf& points_X, const std::vector<uint32_t>& indices,
                         const Pose& T_M_X, double voxel_size_m) {
  const LocalOrigin origin(T_M_X, voxel_size_m);
  const std::vector<Run> runs =
      FindRuns(points_X, indices, origin, static_cast<float>(voxel_size_m));
  const RunsByBlock by_block = GroupByBlock(runs);
  const size_t blocks = by_block.begin.size() - 1;
  std::vector<LocalVoxels> parts((blocks + kBlocksAtOnce - 1) / kBlocksAtOnce);
  tbb::parallel_for(size_t{0}, parts.size(), [&](size_t part) {
    parts[part].voxel_size_m = voxel_size_m;
    BlockGatherer gatherer;
    for (size_t b = part * kBlocksAtOnce; b < std::min(blocks, (part + 1) * kBlocksAtOnce); ++b) {
      const uint32_t* order = by_block.order.data();
      gatherer.Gather(runs, order + by_block.begin[b], order + by_block.begin[b + 1]);
      gatherer.Append(BlockOfKey(runs[order[by_block.begin[b]]].key, origin.block), parts[part]);
    }
  });
  if (parts.size() == 1) return std::move(parts[0]);
  LocalVoxels out;
  out.voxel_size_m = voxel_size_m;
  for (const LocalVoxels& part : parts) {
    const uint32_t first = static_cast<uint32_t>(out.offset.size());
    for (const LocalVoxels::Block& b : part.blocks) {
      out.blocks.push_back({b.block, first + b.begin, first + b.end});
    }
    AppendAll(out.offset, part.offset);
    AppendAll(out.centroid, part.centroid);
    AppendAll(out.count, part.count);
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
