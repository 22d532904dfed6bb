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

}  // namespace

RangePyramid::RangePyramid(const RangeImage& image) {
  Level base;
  base.width = image.width();
  base.height = image.height();
  base.least = image.is_pinhole() ? image.measures() : CloseGaps(image);
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
  level.least.resize(size);
  level.greatest.resize(size);
  const float* least = fine.least.data();
  const float* greatest = fine.greatest.empty() ? least : fine.greatest.data();
  tbb::parallel_for(tbb::blocked_range<int>(0, level.height, kRowsAtOnce),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int v = rows.begin(); v < rows.end(); ++v) {
                        // The last row and column repeat where the size is odd.
                        const size_t upper = static_cast<size_t>(2 * v) * fine.width;
                        const size_t lower = 2 * v + 1 < fine.height ? upper + fine.width : upper;
                        float* out_least = &level.least[static_cast<size_t>(v) * level.width];
                        float* out_greatest = &level.greatest[static_cast<size_t>(v) * level.width];
                        const int pairs = fine.width / 2;
                        for (int u = 0; u < pairs; ++u) {
                          const size_t a = upper + 2 * u, b = lower + 2 * u;
                          out_least[u] = std::min(std::min(least[a], least[a + 1]),
                                                  std::min(least[b], least[b + 1]));
                          out_greatest[u] = std::max(std::max(greatest[a], greatest[a + 1]),
                                                     std::max(greatest[b], greatest[b + 1]));
                        }
                        if (pairs < level.width) {
                          const size_t a = upper + 2 * pairs, b = lower + 2 * pairs;
                          out_least[pairs] = std::min(least[a], least[b]);
                          out_greatest[pairs] = std::max(greatest[a], greatest[b]);
                        }
                      }
                    });
  return level;
}

void RangePyramid::Dilate(Level& level, bool wraps) {
  const int width = level.width, height = level.height;
  level.dilated.assign(level.least.size(), 0.f);
  std::vector<float> across(level.least.size(), 0.f);
  tbb::parallel_for(tbb::blocked_range<int>(0, height, kRowsAtOnce),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int v = rows.begin(); v < rows.end(); ++v) {
                        const float* in = &level.least[static_cast<size_t>(v) * width];
                        float* out = &across[static_cast<size_t>(v) * width];
                        for (int u = 1; u + 1 < width; ++u) {
                          out[u] = std::min(std::min(in[u - 1], in[u]), in[u + 1]);
                        }
                        if (wraps && width > 2) {
                          // The last cell may be a partial one: take one cell more across the seam.
                          out[0] = std::min({in[width - 2], in[width - 1], in[0], in[1]});
                          out[width - 1] = std::min({in[width - 2], in[width - 1], in[0], in[1]});
                        }
                      }
                    });
  tbb::parallel_for(tbb::blocked_range<int>(1, std::max(1, height - 1), kRowsAtOnce),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int v = rows.begin(); v < rows.end(); ++v) {
                        const float* mid = &across[static_cast<size_t>(v) * width];
                        float* out = &level.dilated[static_cast<size_t>(v) * width];
                        for (int u = 0; u < width; ++u) {
                          out[u] = std::min(std::min(mid[u - width], mid[u]), mid[u + width]);
                        }
                      }
                    });
}

RangePyramid::Bounds RangePyramid::Over(int u0, int u1, int v0, int v1) const {
  // At most 9 x 9 cells: fine enough to be sharp, few enough to be cheap.
  int level = 0;
  while ((std::max(u1 - u0, v1 - v0) >> level) > 7) ++level;
  const Level& cells = levels_[std::min(level, levels() - 1)];
  level = std::min(level, levels() - 1);
  const float* least = cells.least.data();
  const float* greatest = cells.greatest.empty() ? least : cells.greatest.data();
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
