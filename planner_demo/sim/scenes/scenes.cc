#include "planner_demo/sim/scenes/scenes.h"

#include <array>

namespace clearance::sim {
namespace {

constexpr std::array kAnalytic = {"plane", "box", "sphere", "corner", "pole"};

struct Named {
  const char* name;
  Scene (*make)(uint64_t seed, int frame_count);
};
constexpr std::array kScenes = {Named{"crossing", MakeCrossing},
                                Named{"street", MakeStreet},
                                Named{"orbit", MakeOrbit},
                                Named{"cubes", MakeCubes},
                                Named{"hall", MakeHall},
                                Named{"parking", MakeParking},
                                Named{"busy_crossing", MakeBusyCrossing},
                                Named{"busy_street", MakeBusyStreet}};

}  // namespace

std::vector<std::string> SceneNames() {
  std::vector<std::string> names;
  for (const Named& scene : kScenes) names.emplace_back(scene.name);
  for (const char* shape : kAnalytic) names.emplace_back(shape);
  return names;
}

std::optional<Scene> MakeScene(std::string_view name, uint64_t seed, int frame_count) {
  for (const Named& scene : kScenes) {
    if (name == scene.name) return scene.make(seed, frame_count);
  }
  for (const char* shape : kAnalytic) {
    if (name == shape) return MakeAnalytic(name, seed, frame_count);
  }
  return std::nullopt;
}

}  // namespace clearance::sim
