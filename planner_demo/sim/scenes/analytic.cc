#include <cmath>
#include <numbers>

#include "planner_demo/sim/random.h"
#include "planner_demo/sim/scenes/scenes.h"

namespace clearance::sim {
namespace {

std::vector<Solid> ShapeNamed(std::string_view shape) {
  if (shape == "plane") return {MakeBox({0.0, -20.0, -20.0}, {1.0, 20.0, 20.0})};
  if (shape == "box") return {MakeBox({-0.8, -0.5, -0.6}, {0.8, 0.5, 0.6})};
  if (shape == "sphere") return {MakeSphere({0.0, 0.0, 0.0}, 1.0)};
  if (shape == "pole") return {MakeUprightCylinder({0.0, 0.0, -3.0}, 0.04, 6.0)};
  // "corner": two walls and a floor that meet in the origin, concave towards the camera.
  return {MakeBox({0.0, -20.0, -20.0}, {1.0, 20.0, 20.0}),
          MakeBox({-20.0, 0.0, -20.0}, {1.0, 1.0, 20.0}),
          MakeBox({-20.0, -20.0, -2.5}, {1.0, 1.0, -1.5})};
}

}  // namespace

Scene MakeAnalytic(std::string_view shape, uint64_t seed, int frame_count) {
  Random random(seed);
  Scene scene;
  scene.name = std::string(shape);
  scene.notes = "One analytic shape at the origin, seen from several sides.";
  scene.frame_count = frame_count > 0 ? frame_count : 24;
  scene.future_frames = 0;
  scene.voxel_size_m = 0.1;
  scene.sensor =
      DepthCamera::WithHorizontalView(640, 480, 75.0 * std::numbers::pi / 180.0, 2e-4, 12.0);
  scene.static_solids = ShapeNamed(shape);
  // Walls are seen from their open side only; the others from all around.
  const bool wall = shape == "plane" || shape == "corner";
  const double middle_rad = (shape == "corner" ? 1.25 : 1.0) * std::numbers::pi;
  const double reach_rad = wall ? 0.6 : std::numbers::pi;
  const double phase = random.Uniform(0.0, 1.0);
  const double period_s = scene.frame_count / scene.rate_hz;
  scene.T_W_X = [=](double time_s) {
    const double turn = time_s / period_s + phase / scene.frame_count;
    const double angle = middle_rad + reach_rad * (2.0 * turn - 1.0);
    const double height = wall ? 0.8 * std::sin(9.0 * turn) : 1.5 * std::sin(9.0 * turn);
    return LookAt({4.0 * std::cos(angle), 4.0 * std::sin(angle), height}, {0.0, 0.0, 0.0});
  };
  return scene;
}

}  // namespace clearance::sim
