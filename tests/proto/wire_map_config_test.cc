#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "proto/wire/map_config.h"

namespace clearance::wire {
namespace {

using ::testing::HasSubstr;

TEST(WireMapConfig, RoundTripsWhatIsSetAndLeavesTheRestAbsent) {
  MapSettings settings;
  settings.voxel_size_m = 0.2;
  settings.bounds = Aabb(Eigen::Vector3d(-1, -2, -3), Eigen::Vector3d(4, 5, 6));
  settings.drop_oldest_static = true;
  settings.retire_after_s = 12;
  v1::MapConfig message;
  ToProto(settings, &message);
  const auto back = MapSettingsFromProto(message);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->voxel_size_m, 0.2);
  EXPECT_EQ(back->retire_after_s, 12);
  EXPECT_EQ(back->drop_oldest_static, true);
  EXPECT_TRUE(back->bounds->max() == Eigen::Vector3d(4, 5, 6));
  EXPECT_FALSE(back->max_distance_m.has_value());
  EXPECT_FALSE(back->lost_after_s.has_value());
  EXPECT_FALSE(back->memory_limit_bytes.has_value());
}

TEST(WireMapConfig, RefusesNegativeAndNonFiniteNumbersByName) {
  const auto* descriptor = v1::MapConfig::descriptor();
  int checked = 0;
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const auto* field = descriptor->field(i);
    if (field->type() != google::protobuf::FieldDescriptor::TYPE_DOUBLE) continue;
    for (const double bad : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
      v1::MapConfig message;
      message.GetReflection()->SetDouble(&message, field, bad);
      EXPECT_THAT(std::string(MapSettingsFromProto(message).status().message()),
                  HasSubstr("config." + field->name()));
    }
    ++checked;
  }
  EXPECT_EQ(checked, 5);
}

TEST(WireMapConfig, RefusesAnUnknownOverloadPolicy) {
  v1::MapConfig message;
  message.set_overload_policy(static_cast<v1::OverloadPolicy>(17));
  EXPECT_THAT(std::string(MapSettingsFromProto(message).status().message()),
              HasSubstr("config.overload_policy: got 17"));
}

TEST(WireMapConfig, AnEditNeedsARegionAndAnAction) {
  v1::EditRegionRequest request;
  request.set_action(v1::EDIT_ACTION_MARK_FREE);
  EXPECT_THAT(std::string(EditRegionFromProto(request).status().message()), HasSubstr("region"));
  request.mutable_sphere()->set_radius_m(0);
  EXPECT_THAT(std::string(EditRegionFromProto(request).status().message()),
              HasSubstr("sphere.radius_m"));
  request.mutable_sphere()->set_radius_m(1.5);
  ASSERT_TRUE(EditRegionFromProto(request).ok());
  EXPECT_EQ(EditRegionFromProto(request)->sphere->radius_m, 1.5);
  request.mutable_box()->mutable_max()->set_x_m(1);
  ASSERT_TRUE(EditRegionFromProto(request)->box.has_value());
  for (const int action : {0, 9}) {
    request.set_action(static_cast<v1::EditAction>(action));
    EXPECT_THAT(std::string(EditRegionFromProto(request).status().message()), HasSubstr("action"));
  }
}

}  // namespace
}  // namespace clearance::wire
