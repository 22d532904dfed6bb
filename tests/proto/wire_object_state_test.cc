#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "proto/wire/array.h"
#include "proto/wire/object_state.h"

namespace clearance::wire {
namespace {

using ::testing::HasSubstr;

ObjectState Car() {
  ObjectState car;
  car.id = ObjectId(7);
  car.generation = 2;
  car.class_name = "car";
  car.source_id = "lidar";
  car.life_state = v1::LIFE_STATE_COASTING;
  car.T_W_L = Pose(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()));
  car.T_W_L.translation() = Eigen::Vector3d(1e5 + 1.0 / 3, -2.0 / 7, 0.1);
  car.twist.linear_mps = Eigen::Vector3d(1.0 / 3, 2, 3);
  car.screw_W << 1.0 / 7, 2, 3, 4, 5, 6;
  car.position_sigma_m = 0.1;
  car.velocity_sigma_mps = 0.2;
  car.first_seen_ns = -5;
  car.last_seen_ns = 1LL << 60;
  car.observations = 42;
  return car;
}

TEST(WireObjectState, KeepsEveryBit) {
  const ObjectState car = Car();
  v1::ObjectState message;
  ToProto(car, &message);
  const auto back = ObjectStateFromProto(message, "objects");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->id, car.id);
  EXPECT_EQ(back->generation, car.generation);
  EXPECT_EQ(back->class_name, car.class_name);
  EXPECT_EQ(back->source_id, car.source_id);
  EXPECT_EQ(back->life_state, car.life_state);
  EXPECT_EQ(back->T_W_L.matrix(), car.T_W_L.matrix());
  EXPECT_EQ(back->twist.linear_mps, car.twist.linear_mps);
  EXPECT_EQ(back->screw_W, car.screw_W);
  EXPECT_EQ(back->position_sigma_m, car.position_sigma_m);
  EXPECT_EQ(back->velocity_sigma_mps, car.velocity_sigma_mps);
  EXPECT_EQ(back->first_seen_ns, car.first_seen_ns);
  EXPECT_EQ(back->last_seen_ns, car.last_seen_ns);
  EXPECT_EQ(back->observations, car.observations);
}

TEST(WireObjectState, NamesTheFieldThatIsWrong) {
  const auto error = [](auto damage) {
    v1::ObjectState message;
    ToProto(Car(), &message);
    damage(message);
    const absl::Status status = ObjectStateFromProto(message, "objects").status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    return std::string(status.message());
  };
  EXPECT_THAT(error([](auto& m) { m.mutable_brief()->set_object_id(65536); }),
              HasSubstr("objects.brief.object_id"));
  EXPECT_THAT(
      error([](auto& m) { m.mutable_brief()->set_life_state(static_cast<v1::LifeState>(9)); }),
      HasSubstr("life_state"));
  EXPECT_THAT(error([](auto& m) { m.mutable_brief()->mutable_twist()->set_vx_mps(NAN); }),
              HasSubstr("twist"));
  EXPECT_THAT(error([](auto& m) { m.mutable_world_from_object_f64()->resize(88); }),
              HasSubstr("world_from_object_f64"));
  EXPECT_THAT(error([](auto& m) {
                m.set_world_from_object_f64(
                    EncodeArray({-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0}));
              }),
              HasSubstr("a rotation"))
      << "a reflection";
  EXPECT_THAT(error([](auto& m) { m.clear_screw_f64(); }), HasSubstr("screw_f64"));
  EXPECT_THAT(error([](auto& m) {
                m.set_screw_f64(EncodeArray({0.0, 1e30, 0.0, 0.0, 0.0, 0.0}));
              }),
              HasSubstr("screw_f64"));
  EXPECT_THAT(error([](auto& m) {
                m.set_world_from_object_f64(
                    EncodeArray({1.0, 0.0, 0.0, 1e30, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0}));
              }),
              HasSubstr("away"));
  EXPECT_THAT(error([](auto& m) { m.set_position_sigma_m(-1); }), HasSubstr("position_sigma_m"));
  EXPECT_THAT(error([](auto& m) { m.set_velocity_sigma_mps(INFINITY); }),
              HasSubstr("velocity_sigma_mps"));
}

}  // namespace
}  // namespace clearance::wire
