// Whole drives against a server process.
#include <gtest/gtest.h>
#include <ompl/util/Console.h>

#include <nlohmann/json.hpp>

#include "planner_demo/episode/course.h"
#include "planner_demo/episode/episode.h"
#include "planner_demo/episode/report.h"
#include "planner_demo/episode/sensor_rig.h"
#include "planner_demo/episode/server_process.h"

namespace clearance::demo {
namespace {

class LiveEpisode : public testing::Test {
 protected:
  void SetUp() override {
    ompl::msg::noOutputHandler();
    auto server = ServerProcess::Start(CLEARANCE_SERVER_BINARY);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    client::ClientOptions options;
    options.address = server_->address();
    options.connect_timeout = absl::Seconds(30);
    auto client = client::EsdfClient::Connect(options);
    ASSERT_TRUE(client.ok()) << client.status();
    client_ = *std::move(client);
    // A quiet crossing and a short way: the pavement's corner.
    course_ = *MakeCourse("crossing", 3);
    course_.scene.sensor = sim::Lidar{24, 180, -0.4, 0.17, 30.0};
    course_.mission.goal_W = {-8.0, -7.0, 0.15};
    truth_ = TruthOf(course_.scene);
    rig_ = std::make_unique<SensorRig>(course_.scene, RigNoise(), 3);
    course_.start_s = 0.6;
    course_.unobstructed_s = StraightAhead(course_.robot, course_.mission, 0.0).ends_s();
    stage_ = StageOf(course_, *rig_, *truth_, 3);
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<client::EsdfClient> client_;
  Course course_;
  std::unique_ptr<Truth> truth_;
  std::unique_ptr<SensorRig> rig_;
  Stage stage_;
};

TEST_F(LiveEpisode, ArrivesUnharmedAndTheSameWayAgain) {
  EpisodeOptions options;
  options.pilot.latency_s = 0.2;
  std::vector<Eigen::Vector3d> first, second;
  bool late = false;
  for (auto* track : {&first, &second}) {
    options.observer = [track](const Moment& moment) { track->push_back(moment.robot.position_W); };
    const auto result = RunEpisode(stage_, client_.get(), options);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_FALSE(result->verdict.collision.has_value()) << result->outcome;
    EXPECT_GT(result->cycles.size(), 5u);
    for (const Cycle& cycle : result->cycles) {
      EXPECT_FALSE(cycle.blind) << cycle.problem;
      EXPECT_GT(cycle.lookups, 1000u);
      late |= cycle.late;
    }
    if (!late) {
      EXPECT_TRUE(result->in_time) << result->outcome;
    }
  }
  // A cycle that a busy machine makes late is thrown away, and the drive differs.
  if (!late) {
    EXPECT_EQ(first, second);
  }
}

TEST_F(LiveEpisode, BaselinesDifferInWhatTheyAreToldAlone) {
  EpisodeOptions options;
  options.row = Row::kStaticFusion;
  const auto fused = RunEpisode(stage_, client_.get(), options);
  ASSERT_TRUE(fused.ok()) << fused.status();
  options.row = Row::kFrozenSnapshot;
  const auto frozen = RunEpisode(stage_, client_.get(), options);
  ASSERT_TRUE(frozen.ok()) << frozen.status();
  options.row = Row::kStraightAhead;
  const auto straight = RunEpisode(stage_, nullptr, options);
  ASSERT_TRUE(straight.ok()) << straight.status();
  EXPECT_NEAR(straight->driven_s, stage_.unobstructed_s, 1.0);
  const auto json = ToJson({Summarise({*fused}), Summarise({*frozen}), Summarise({*straight})});
  for (const char* row : {"static_fusion", "frozen_snapshot", "straight_ahead"}) {
    ASSERT_TRUE(json.contains(row)) << row;
    for (const char* key : {"collisions", "success_rate", "min_clearance_m", "time_to_goal_s",
                            "planning_ms_p50", "planning_ms_p95", "queries_per_s"}) {
      EXPECT_TRUE(json[row].contains(key)) << row << " " << key;
    }
  }
}

TEST_F(LiveEpisode, AServerThatLeavesStopsTheRobot) {
  EpisodeOptions options;
  RobotState last;
  double fastest_mps = 0.0;
  options.observer = [&](const Moment& moment) {
    if (moment.frame == 12) {
      EXPECT_GT(moment.robot.speed_mps, 0.2);
      server_->Stop();
    }
    // The mirror still answers from its last view; from a second on that is too old.
    if (moment.frame >= 24 && moment.cycle != nullptr) {
      EXPECT_TRUE(moment.cycle->blind);
    }
    fastest_mps = std::max(fastest_mps, moment.robot.speed_mps);
    last = moment.robot;
  };
  const auto result = RunEpisode(stage_, client_.get(), options);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_FALSE(result->map_lost.empty());
  EXPECT_FALSE(result->in_time);
  EXPECT_FALSE(result->verdict.collision.has_value());
  EXPECT_EQ(last.speed_mps, 0.0);
  EXPECT_LT(fastest_mps, 3.0);
}

TEST_F(LiveEpisode, WithoutAServerThereIsNoDrive) {
  server_->Stop();
  const auto result = RunEpisode(stage_, client_.get(), EpisodeOptions());
  EXPECT_EQ(result.status().code(), absl::StatusCode::kUnavailable) << result.status();
}

}  // namespace
}  // namespace clearance::demo
