// Least and greatest measure over squares of pixels, to decide about many pixels at once.
#pragma once

#include <memory>
#include <vector>

#include "server/integration/range_image.h"

namespace clearance {

// Level L has cells of 2^L x 2^L pixels. Refers to the image, which must outlive it. Pixels without
// a return count as 0 in both: they are no evidence for anything beyond them. In clouds, a pixel
// between returns takes the nearest of them where most of its neighbours have one: rays leave gaps
// between each other, not holes.
class RangePyramid {
 public:
  explicit RangePyramid(const RangeImage& image);

  struct Bounds {
    float least, greatest;
  };
  // Over the pixels [u0, u1] x [v0, v1], which must lie in the image; up to a few cells more on
  // each side are included: `least` may be too small and `greatest` too great, never the reverse.
  Bounds Over(int u0, int u1, int v0, int v1) const;

  int levels() const { return static_cast<int>(levels_.size()); }

  // Least measure over the 3 x 3 cells around each cell of `level` >= 1; pixels outside the image
  // count as 0. Row stride is dilated_width(level).
  const float* dilated_least(int level) const { return levels_[level].dilated.get(); }
  int dilated_width(int level) const { return levels_[level].width; }

 private:
  struct Level {
    int width = 0, height = 0;
    const float* least = nullptr;  // of the arrays below, or the image itself
    const float* greatest = nullptr;
    std::unique_ptr<float[]> own_least, own_greatest, dilated;
  };
  static Level Halve(const Level& fine);
  static void Dilate(Level& level, bool wraps);

  std::vector<float> closed_;  // a cloud's pixels with gaps closed
  std::vector<Level> levels_;  // [0] holds the pixels, not dilated
};

}  // namespace clearance
