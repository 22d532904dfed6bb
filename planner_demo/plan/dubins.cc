#include "planner_demo/plan/dubins.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace clearance::demo {
namespace {

constexpr double kTurn = 2.0 * M_PI;
constexpr double kFullTurn_rad = 1e-7;  // less than this short of a full turn is none

double Positive(double angle_rad) {
  const double wrapped = angle_rad - kTurn * std::floor(angle_rad / kTurn);
  return wrapped > kTurn - kFullTurn_rad ? 0.0 : wrapped;
}

PlanarPose Advance(const PlanarPose& from, int turn, double length_m, double radius_m) {
  PlanarPose to = from;
  if (turn == 0) {
    to.x_m += length_m * std::cos(from.heading_rad);
    to.y_m += length_m * std::sin(from.heading_rad);
    return to;
  }
  to.heading_rad += turn * length_m / radius_m;
  to.x_m += turn * radius_m * (std::sin(to.heading_rad) - std::sin(from.heading_rad));
  to.y_m += turn * radius_m * (std::cos(from.heading_rad) - std::cos(to.heading_rad));
  return to;
}

struct Word {
  std::array<int, 3> turns;
  double t, p, q;  // in radii; not finite where there is none
};

}  // namespace

DubinsCurve::DubinsCurve(const PlanarPose& from, const PlanarPose& to, double radius_m)
    : from_(from), radius_m_(radius_m) {
  // In units of the radius, with the target straight ahead on the x axis.
  const double dx = to.x_m - from.x_m, dy = to.y_m - from.y_m;
  const double d = std::hypot(dx, dy) / radius_m;
  const double theta = d > 0.0 ? std::atan2(dy, dx) : 0.0;
  const double a = from.heading_rad - theta, b = to.heading_rad - theta;
  const double sa = std::sin(a), sb = std::sin(b), ca = std::cos(a), cb = std::cos(b);
  const double cab = std::cos(a - b);
  const auto root = [](double square) {
    return square < 0.0 && square > -1e-9 ? 0.0 : std::sqrt(square);
  };

  std::array<Word, 6> words;
  {
    const double turn = std::atan2(cb - ca, d + sa - sb);
    words[0] = {{1, 0, 1},
                Positive(turn - a),
                root(2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb)),
                Positive(b - turn)};
  }
  {
    const double turn = std::atan2(ca - cb, d - sa + sb);
    words[1] = {{-1, 0, -1},
                Positive(a - turn),
                root(2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa)),
                Positive(turn - b)};
  }
  {
    const double p = root(d * d - 2.0 + 2.0 * cab + 2.0 * d * (sa + sb));
    const double turn = std::atan2(-ca - cb, d + sa + sb) - std::atan2(-2.0, p);
    words[2] = {{1, 0, -1}, Positive(turn - a), p, Positive(turn - b)};
  }
  {
    const double p = root(d * d - 2.0 + 2.0 * cab - 2.0 * d * (sa + sb));
    const double turn = std::atan2(ca + cb, d - sa - sb) - std::atan2(2.0, p);
    words[3] = {{-1, 0, 1}, Positive(a - turn), p, Positive(b - turn)};
  }
  {
    const double p =
        Positive(kTurn - std::acos((6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0));
    const double t = Positive(a - std::atan2(ca - cb, d - sa + sb) + 0.5 * p);
    words[4] = {{-1, 1, -1}, t, p, Positive(a - b - t + p)};
  }
  {
    const double p =
        Positive(kTurn - std::acos((6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0));
    const double t = Positive(-a + std::atan2(cb - ca, d + sa - sb) + 0.5 * p);
    words[5] = {{1, -1, 1}, t, p, Positive(b - a - t + p)};
  }
  length_m_ = std::numeric_limits<double>::infinity();
  for (const Word& word : words) {
    const double length_m = (word.t + word.p + word.q) * radius_m;
    if (!(length_m < length_m_)) continue;
    PlanarPose end = from;
    const std::array<double, 3> pieces = {word.t * radius_m, word.p * radius_m, word.q * radius_m};
    for (int i = 0; i < 3; ++i) end = Advance(end, word.turns[i], pieces[i], radius_m);
    const double off_m =
        std::hypot(end.x_m - to.x_m, end.y_m - to.y_m) +
        radius_m * std::abs(std::remainder(end.heading_rad - to.heading_rad, kTurn));
    if (off_m > 1e-5 * (1.0 + length_m)) continue;
    turns_ = word.turns;
    pieces_m_ = pieces;
    length_m_ = length_m;
  }
}

PlanarPose DubinsCurve::At(double along_m) const {
  PlanarPose at = from_;
  for (int i = 0; i < 3 && along_m > 0.0; ++i) {
    at = Advance(at, turns_[i], std::min(along_m, pieces_m_[i]), radius_m_);
    along_m -= pieces_m_[i];
  }
  return at;
}

}  // namespace clearance::demo
