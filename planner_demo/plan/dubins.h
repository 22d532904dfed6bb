// The shortest curve between two poses in the plane that turns no tighter than a radius.
#pragma once

#include <array>

namespace clearance::demo {

struct PlanarPose {
  double x_m = 0.0, y_m = 0.0, heading_rad = 0.0;
};

// Three pieces: left arc, right arc or straight (Dubins 1957). OMPL's own class ends the program
// where rounding breaks an assertion; this one picks, among the words that end at the target, the
// shortest.
class DubinsCurve {
 public:
  DubinsCurve(const PlanarPose& from, const PlanarPose& to, double radius_m);

  double length_m() const { return length_m_; }
  PlanarPose At(double along_m) const;  // 0 .. length_m

 private:
  PlanarPose from_;
  double radius_m_;
  std::array<int, 3> turns_{};        // 1: left, 0: straight, -1: right
  std::array<double, 3> pieces_m_{};  // lengths
  double length_m_ = 0.0;
};

}  // namespace clearance::demo
