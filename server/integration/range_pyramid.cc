#include "server/integration/range_pyramid.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace clearance {
namespace {

constexpr int kRowsAtOnce = 32;
constexpr int kFullNeighbourhood = 5;  // of 8 neighbours, to call a gap a gap

// Gaps between rays of a cloud closed by the nearest of their neighbours.
std::vector<float> CloseGaps(const RangeImage& image) {
  const int width = image.width(), height = image.height();
  std::vector<float> closed = image.measures();
  tbb::parallel_for(tbb::blocked_range<int>(0, height, kRowsAtOnce),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int v = rows.begin(); v < rows.end(); ++v) {
                        for (int u = 0; u < width; ++u) {
                          if (image.measure(u, v) > 0.f) continue;
                          int returns = 0;
                          float nearest = 0.f;
                          for (int dv = -1; dv <= 1; ++dv) {
                            for (int du = -1; du <= 1; ++du) {
                              int nu = u + du;
                              const int nv = v + dv;
                              if (image.wraps()) nu = (nu + width) % width;
                              if (nu < 0 || nv < 0 || nu >= width || nv >= height) continue;
                              const float m = image.measure(nu, nv);
                              if (!(m > 0.f)) continue;
                              nearest = returns++ ? std::min(nearest, m) : m;
                            }
                          }
                          if (returns >= kFullNeighbourhood)
                            closed[static_cast<size_t>(v) * width + u] = nearest;
                        }
                      }
                    });
  return closed;
}

struct Less {
  float operator()(float a, float b) const { return a < b ? a : b; }
};
struct Greater {
  float operator()(float a, float b) const { return a > b ? a : b; }
};

// Plain loops over disjoint rows, for the vectoriser. `merged` has room for an even number.
template <typename Pick>
void Merge(const float* __restrict upper, const float* __restrict lower, int width, Pick pick,
           float* __restrict merged, float* __restrict out) {
  for (int u = 0; u < width; ++u) merged[u] = pick(upper[u], lower[u]);
  if (width % 2) merged[width] = merged[width - 1];
  for (int u = 0; u < (width + 1) / 2; ++u) out[u] = pick(merged[2 * u], merged[2 * u + 1]);
}

void LeastOfThree(const float* __restrict a, const float* __restrict b, const float* __restrict c,
                  int width, float* __restrict out) {
  const Less less;
  for (int u = 0; u < width; ++u) out[u] = less(less(a[u], b[u]), c[u]);
}

}  // namespace

RangePyramid::RangePyramid(const RangeImage& image) {
  if (!image.is_pinhole()) closed_ = CloseGaps(image);
  Level base;
  base.width = image.width();
  base.height = image.height();
  base.least = base.greatest = image.is_pinhole() ? image.measures().data() : closed_.data();
  levels_.push_back(std::move(base));
  while (levels_.back().width > 1 || levels_.back().height > 1) {
    levels_.push_back(Halve(levels_.back()));
    Dilate(levels_.back(), image.wraps());
  }
}

RangePyramid::Level RangePyramid::Halve(const Level& fine) {
  Level level;
  level.width = (fine.width + 1) / 2;
  level.height = (fine.height + 1) / 2;
  const size_t size = static_cast<size_t>(level.width) * level.height;
  level.own_least = std::make_unique_for_overwrite<float[]>(size);
  level.own_greatest = std::make_unique_for_overwrite<float[]>(size);
  tbb::parallel_for(tbb::blocked_range<int>(0, level.height, kRowsAtOnce),
                    [&](const tbb::blocked_range<int>& rows) {
                      std::vector<float> merged(2 * level.width);
                      for (int v = rows.begin(); v < rows.end(); ++v) {
                        // The last row and column repeat where the size is odd.
                        const size_t upper = static_cast<size_t>(2 * v) * fine.width;
                        const size_t lower = 2 * v + 1 < fine.height ? upper + fine.width : upper;
                        const size_t out = static_cast<size_t>(v) * level.width;
                        Merge(fine.least + upper, fine.least + lower, fine.width, Less{},
                              merged.data(), level.own_least.get() + out);
                        Merge(fine.greatest + upper, fine.greatest + lower, fine.width, Greater{},
                              merged.data(), level.own_greatest.get() + out);
                      }
                    });
  level.least = level.own_least.get();
  level.greatest = level.own_greatest.get();
  return level;
}

void RangePyramid::Dilate(Level& level, bool wraps) {
  const int width = level.width, height = level.height;
  level.dilated = std::make_unique_for_overwrite<float[]>(static_cast<size_t>(width) * height);
  tbb::parallel_for(
      tbb::blocked_range<int>(0, height, kRowsAtOnce), [&](const tbb::blocked_range<int>& rows) {
        // Across first, for one row more on either side; then down.
        std::vector<float> across(static_cast<size_t>(rows.size() + 2) * width, 0.f);
        for (int v = std::max(0, rows.begin() - 1); v < std::min(height, rows.end() + 1); ++v) {
          const float* in = level.least + static_cast<size_t>(v) * width;
          float* out = &across[static_cast<size_t>(v - rows.begin() + 1) * width];
          if (width > 2) LeastOfThree(in, in + 1, in + 2, width - 2, out + 1);
          if (wraps && width > 2) {
            // The last cell may be a partial one: take one cell more across the seam.
            out[0] = std::min({in[width - 2], in[width - 1], in[0], in[1]});
            out[width - 1] = out[0];
          }
        }
        for (int v = rows.begin(); v < rows.end(); ++v) {
          const float* middle = &across[static_cast<size_t>(v - rows.begin() + 1) * width];
          LeastOfThree(middle - width, middle, middle + width, width,
                       level.dilated.get() + static_cast<size_t>(v) * width);
        }
      });
}

RangePyramid::Bounds RangePyramid::Over(int u0, int u1, int v0, int v1) const {
  // At most 9 x 9 cells: fine enough to be sharp, few enough to be cheap.
  int level = 0;
  while ((std::max(u1 - u0, v1 - v0) >> level) > 7) ++level;
  const Level& cells = levels_[std::min(level, levels() - 1)];
  level = std::min(level, levels() - 1);
  const float* least = cells.least;
  const float* greatest = cells.greatest;
  Bounds bounds{least[static_cast<size_t>(v0 >> level) * cells.width + (u0 >> level)], 0.f};
  for (int v = v0 >> level; v <= v1 >> level; ++v) {
    for (int u = u0 >> level; u <= u1 >> level; ++u) {
      const size_t i = static_cast<size_t>(v) * cells.width + u;
      bounds.least = std::min(bounds.least, least[i]);
      bounds.greatest = std::max(bounds.greatest, greatest[i]);
    }
  }
  return bounds;
}

}  // namespace clearance
