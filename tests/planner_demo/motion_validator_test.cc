#include "planner_demo/plan/motion_validator.h"

#include <gtest/gtest.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>

#include <cmath>

#include "planner_demo/sim/random.h"
#include "tests/planner_demo/fake_world.h"

namespace clearance::demo {
namespace {

namespace ob = ompl::base;

struct Validated {
  FakeWorld world;
  RobotModel robot = Ball();
  std::shared_ptr<SpaceTime> space;
  ob::SpaceInformationPtr si;
  std::unique_ptr<ClearanceProbe> probe;

  explicit Validated(FakeWorld w, Margins margins = {}) : world(std::move(w)) {
    space = std::make_shared<SpaceTime>(robot,
                                        SpaceTime::Bounds{{-50, -50, 0}, {50, 50, 0}, 0.0, 20.0});
    si = std::make_shared<ob::SpaceInformation>(space);
    probe = std::make_unique<ClearanceProbe>(world.LookupAt(0.0), robot, margins, false, 20.0);
    si->setStateValidityChecker(std::make_shared<ClearanceStateValidity>(si, *probe));
    si->setMotionValidator(std::make_shared<ClearanceMotionValidator>(si, *probe));
    si->setup();
  }
  const ClearanceMotionValidator& validator() const {
    return static_cast<const ClearanceMotionValidator&>(*si->getMotionValidator());
  }
};

Margins FixedMargins(double margin_m) {
  Margins margins;
  margins.static_m = margins.object_m = margins.object_most_m = margin_m;
  return margins;
}

TEST(ClearanceMotionValidator, AgreesWithDenseSamplingOfAnAnalyticWorld) {
  sim::Random random(11);
  int hits = 0, misses = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    FakeWorld world;
    for (int i = 0; i < 2; ++i) {
      world.balls.push_back({{random.Uniform(-8, 8), random.Uniform(-8, 8), 0.0},
                             {random.Uniform(-6, 6), random.Uniform(-6, 6), 0.0},
                             random.Uniform(0.3, 1.5)});
    }
    const Validated setup(world, FixedMargins(0.1));
    RobotState from, to;
    from.position_W = {random.Uniform(-5, 5), random.Uniform(-5, 5), 0.0};
    from.heading_rad = random.Uniform(-M_PI, M_PI);
    to.position_W = {random.Uniform(-5, 5), random.Uniform(-5, 5), 0.0};
    to.heading_rad = random.Uniform(-M_PI, M_PI);
    to.time_s = random.Uniform(3.0, 9.0);
    const Steering steering = setup.space->Steer(from, to);
    if (!steering.feasible) continue;
    double least_m = INFINITY;
    for (int k = 0; k <= 4000; ++k) {
      const RobotState at = setup.space->Along(from, to, steering, steering.duration_s * k / 4000);
      uint32_t object = 0;
      least_m =
          std::min(least_m, setup.world.Distance(at.position_W, at.time_s, &object) - 0.5 - 0.1);
    }
    ob::ScopedState<> a(std::static_pointer_cast<ob::StateSpace>(setup.space)), b(a);
    SpaceTime::Write(from, a.get());
    SpaceTime::Write(to, b.get());
    const bool valid = setup.si->checkMotion(a.get(), b.get());
    // Between two samples nothing closes in by more than half a step at the closing speed.
    const double slack_m = 0.5 * ClearanceMotionValidator::kStep_s * (4.0 + std::sqrt(72.0));
    if (least_m >= 0.0) {
      EXPECT_TRUE(valid);
      ++misses;
    } else if (least_m < -slack_m) {
      EXPECT_FALSE(valid);
      ++hits;
    }
  }
  EXPECT_GT(hits, 200);
  EXPECT_GT(misses, 200);
}

TEST(ClearanceMotionValidator, StopsShortOfTheFirstCollision) {
  FakeWorld world;
  world.wall_x_m = 5.0;
  const Validated setup(world, FixedMargins(0.0));
  RobotState from, to;
  to.position_W.x() = 8.0;
  to.time_s = 8.0;
  ob::ScopedState<> a(std::static_pointer_cast<ob::StateSpace>(setup.space)), b(a), last(a);
  SpaceTime::Write(from, a.get());
  SpaceTime::Write(to, b.get());
  std::pair<ob::State*, double> last_valid{last.get(), -1.0};
  EXPECT_FALSE(setup.si->checkMotion(a.get(), b.get(), last_valid));
  const double x = SpaceTime::Read(last.get()).position_W.x();
  EXPECT_LE(x, 4.5);
  EXPECT_GE(x, 4.0);
  EXPECT_TRUE(setup.si->isValid(last.get()));
}

TEST(ClearanceMotionValidator, APredictedCarIsOnlyInTheWayWhenItIsThere) {
  FakeWorld world;
  world.balls = {{{4.0, -20.0, 0.0}, {0.0, 5.0, 0.0}, 1.0}};  // passes x = 4, y = 0 at 4 s
  const Validated setup(world, FixedMargins(0.1));
  RobotState from, to;
  to.position_W.x() = 8.0;
  to.time_s = 8.0;
  EXPECT_TRUE(setup.validator().FirstInvalid({from, to}).has_value());  // x = 4 at 4 s
  RobotState later = from;
  later.time_s = 2.0;
  to.time_s = 10.0;
  EXPECT_FALSE(setup.validator().FirstInvalid({from, later, to}).has_value());
}

TEST(ClearanceMotionValidator, ALookupThatFailsIsNeverFree) {
  const Validated setup({});
  ClearanceProbe broken(
      [](const Eigen::Matrix3Xd&,
         const std::vector<float>&) -> absl::StatusOr<client::DistanceAnswers> {
        return absl::UnavailableError("the server is gone");
      },
      setup.robot, {}, false, 5.0);
  const ClearanceMotionValidator validator(setup.si, broken);
  RobotState from, to;
  to.position_W.x() = 1.0;
  to.time_s = 3.0;
  EXPECT_TRUE(validator.FirstInvalid({from, to}).has_value());
  EXPECT_EQ(broken.status().code(), absl::StatusCode::kUnavailable);
}

TEST(ClearanceProbe, AFrozenOneKnowsOnlyTheMapsOwnTime) {
  FakeWorld world;
  world.balls = {{{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, 0.5}};
  const RobotModel robot = Ball();
  ClearanceProbe frozen(world.LookupAt(0.0), robot, FixedMargins(0.0), true, 5.0);
  ClearanceProbe seeing(world.LookupAt(0.0), robot, FixedMargins(0.0), false, 5.0);
  RobotState at;
  at.position_W.x() = 4.0;
  at.time_s = 2.0;
  EXPECT_NEAR((*frozen.At({at}))[0].beyond_margin_m, 3.0, 1e-6);
  EXPECT_NEAR((*seeing.At({at}))[0].beyond_margin_m, 1.0, 1e-6);
  at.time_s = 50.0;  // beyond the horizon: as of 5 s
  EXPECT_NEAR((*seeing.At({at}))[0].beyond_margin_m, 0.0, 1e-6);
  EXPECT_EQ(seeing.lookups(), 2u);
}

}  // namespace
}  // namespace clearance::demo
