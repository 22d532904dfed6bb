// Labels as a poor front end sends them.
#pragma once

#include <map>

#include "server/core/frame.h"

namespace clearance::evaluation {

// Pixels of an object within `pixels` of anything else become static. Clouds are looked at as
// images of 0.2 x 0.4 degrees.
void ShrinkLabels(int pixels, Frame& frame);

// Each object's first `frames` frames of sight become static.
class LateLabels {
 public:
  explicit LateLabels(int frames) : frames_(frames) {}
  void Apply(Frame& frame);

 private:
  int frames_;
  std::map<uint16_t, int> seen_;
};

}  // namespace clearance::evaluation
