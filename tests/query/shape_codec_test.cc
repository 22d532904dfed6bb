#include "server/query/shape_codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace clearance {
namespace {

Sites RandomSites(size_t count, std::mt19937& random) {
  std::uniform_real_distribution<float> value(-3, 3);
  Sites sites(count);
  for (SurfaceSite& site : sites) {
    for (int i = 0; i < 3; ++i) site.p_L[i] = value(random), site.normal_L[i] = value(random);
    site.normal_L.normalize();
    site.sigma_m = std::abs(value(random));
  }
  return sites;
}

Sites Ordered(Sites sites) {
  std::sort(sites.begin(), sites.end(), ComesFirst);
  return sites;
}

void ExpectSame(const Sites& a, const Sites& b) {
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].p_L, b[i].p_L);
    EXPECT_EQ(a[i].normal_L, b[i].normal_L);
    EXPECT_EQ(a[i].sigma_m, b[i].sigma_m);
  }
}

TEST(ShapeCodec, GivesBackEverySiteInParts) {
  std::mt19937 random(1);
  const Sites sites = RandomSites(1000, random);
  Sites back;
  for (const auto& [first, count] : {std::pair<size_t, size_t>{0, 400}, {400, 1}, {401, 599}}) {
    std::string bytes;
    AppendSites(sites, first, count, &bytes);
    EXPECT_EQ(bytes.size(), count * kSiteBytes);
    ASSERT_TRUE(ReadSites(bytes, &back).ok());
  }
  ExpectSame(back, sites);
}

TEST(ShapeCodec, TellsWhatChangedOnly) {
  std::mt19937 random(2);
  for (int round = 0; round < 100; ++round) {
    const Sites before = RandomSites(random() % 300, random);
    Sites after = before;
    for (uint64_t gone = random() % 20; gone > 0 && !after.empty(); --gone) {
      after.erase(after.begin() + static_cast<int64_t>(random() % after.size()));
    }
    for (const SurfaceSite& site : RandomSites(random() % 20, random)) after.push_back(site);
    if (!after.empty() && round % 3 == 0) after.push_back(after[0]);  // twice the same
    std::shuffle(after.begin(), after.end(), random);
    std::string bytes;
    if (!AppendSiteChanges(before, after, &bytes)) {
      EXPECT_TRUE(bytes.empty());
      continue;
    }
    EXPECT_LE(bytes.size(), (before.size() + 7) / 8 + 21 * kSiteBytes);
    Sites back;
    ASSERT_TRUE(ReadSiteChanges(bytes, before, &back).ok());
    ExpectSame(Ordered(back), Ordered(after));
  }
}

TEST(ShapeCodec, RefusesDamagedBytes) {
  std::mt19937 random(3);
  const Sites before = RandomSites(100, random);
  std::string bytes, changes;
  AppendSites(before, 0, 10, &bytes);
  ASSERT_TRUE(AppendSiteChanges(before, before, &changes));
  Sites back;
  EXPECT_TRUE(absl::IsDataLoss(ReadSites(bytes.substr(1), &back)));
  EXPECT_TRUE(absl::IsDataLoss(ReadSiteChanges(changes.substr(0, 5), before, &back)));
  EXPECT_TRUE(absl::IsDataLoss(ReadSiteChanges(changes + "x", before, &back)));
  for (const float bad : {NAN, INFINITY, -INFINITY, 1e30f, -1e6f}) {
    for (int value = 0; value < 7; ++value) {  // position, normal, sigma
      std::vector<float> values = {1, 2, 3, 0, 0, 1, 0.1f};
      values[value] = bad;
      const std::string site(reinterpret_cast<const char*>(values.data()), kSiteBytes);
      EXPECT_TRUE(absl::IsDataLoss(ReadSites(site, &back))) << bad << " as value " << value;
    }
  }
}

}  // namespace
}  // namespace clearance
