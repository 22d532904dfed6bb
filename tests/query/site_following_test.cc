#include "server/query/site_following.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>
#include <tuple>

#include "server/query/object_tree.h"
#include "tests/query/query_fixture.h"

namespace clearance {
namespace {

constexpr double kVoxel = 0.1;

using Place = std::tuple<float, float, float>;
std::set<Place> PlacesOf(const ObjectShape& shape) {
  std::set<Place> places;
  for (const SurfaceSite& s : shape.sites) places.emplace(s.p_L.x(), s.p_L.y(), s.p_L.z());
  return places;
}

// Sites in the middle of their voxels, so that small moves do not leave them.
std::vector<SurfaceSite> Centred(int count) {
  std::vector<SurfaceSite> sites;
  for (int i = 0; i < count; ++i) {
    const VoxelIndex v(i % 7 - 3, i / 7 % 7 - 3, i / 49 - 3);
    sites.push_back({VoxelCentre(v, kVoxel).cast<float>(), Eigen::Vector3f::UnitZ(), 0.01f});
  }
  return sites;
}

TEST(SiteFollowing, KeepsTheShapeWhileSitesOnlyTremble) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> tremble(-0.004f, 0.004f);
  const auto first = BuildObjectShape(Centred(200), kVoxel);
  auto shape = first;
  for (int frame = 0; frame < 50; ++frame) {
    std::vector<SurfaceSite> newest = Centred(200);
    for (SurfaceSite& s : newest) {
      s.p_L += Eigen::Vector3f(tremble(random), tremble(random), tremble(random));
      s.sigma_m *= 1 + 10 * tremble(random);
    }
    std::shuffle(newest.begin(), newest.end(), random);
    shape = FollowSites(shape, newest, kVoxel);
    EXPECT_EQ(shape, first);
  }
}

TEST(SiteFollowing, FollowsWhatMovedTurnedCameAndWent) {
  const auto published = BuildObjectShape(Centred(200), kVoxel);
  const auto changed = [&](auto change) {
    std::vector<SurfaceSite> newest = Centred(200);
    change(newest);
    const auto shape = FollowSites(published, newest, kVoxel);
    EXPECT_NE(shape, published);
    const std::set<Place> before = PlacesOf(*published), after = PlacesOf(*shape);
    std::vector<Place> differ;
    std::set_symmetric_difference(before.begin(), before.end(), after.begin(), after.end(),
                                  std::back_inserter(differ));
    return differ.size();
  };
  EXPECT_EQ(changed([](auto& s) { s[5].p_L.x() += 0.02f; }), 2u) << "one old place, one new";
  EXPECT_EQ(changed([](auto& s) { s.erase(s.begin() + 5); }), 1u);
  EXPECT_EQ(changed([](auto& s) { s[5].p_L.x() += 5; }), 2u);
  EXPECT_EQ(changed([](auto& s) { s[5].normal_L = Eigen::Vector3f::UnitX(); }), 0u);
  EXPECT_EQ(changed([](auto& s) { s[5].sigma_m = 0.05f; }), 0u);
}

TEST(SiteFollowing, NeverStraysFromWhatWasMeasured) {
  std::mt19937 random(2);
  std::normal_distribution<float> noise(0, 0.01f);
  const auto truth = testing::CarShape(kVoxel);
  std::shared_ptr<const ObjectShape> shape;
  for (int frame = 0; frame < 20; ++frame) {
    std::vector<SurfaceSite> newest = truth->sites;
    for (SurfaceSite& s : newest) s.p_L += noise(random) * s.normal_L;
    shape = FollowSites(shape, newest, kVoxel);
    ASSERT_EQ(shape->sites.size(), newest.size());
    // Each site of one has one of the other within the tolerance.
    std::vector<SurfaceSite> held = shape->sites;
    for (const SurfaceSite& s : newest) {
      const auto near = std::find_if(held.begin(), held.end(), [&](const SurfaceSite& h) {
        return (h.p_L - s.p_L).norm() <= 0.1f * static_cast<float>(kVoxel);
      });
      ASSERT_NE(near, held.end());
      held.erase(near);
    }
  }
}

}  // namespace
}  // namespace clearance
