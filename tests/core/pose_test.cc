#include "server/core/pose.h"

#include <gtest/gtest.h>

#include <random>

namespace clearance {
namespace {

Pose RandomPose(std::mt19937& rng, double reach_m, double max_angle_rad) {
  std::uniform_real_distribution<double> u(-1, 1);
  Pose T = Pose::Identity();
  const Eigen::Vector3d axis = Eigen::Vector3d(u(rng), u(rng), u(rng)).normalized();
  T.linear() = Eigen::AngleAxisd(max_angle_rad * u(rng), axis).toRotationMatrix();
  T.translation() = reach_m * Eigen::Vector3d(u(rng), u(rng), u(rng));
  return T;
}

TEST(Pose, LogarithmInvertsTheExponentialAtEveryAngle) {
  std::mt19937 rng(1);
  for (double angle : {0.0, 1e-9, 1e-5, 1e-3, 0.5, 3.0, 3.14159}) {
    for (int i = 0; i < 50; ++i) {
      const Pose T = RandomPose(rng, 10, angle);
      EXPECT_TRUE(ExpScrew(LogScrew(T)).isApprox(T, 1e-9)) << angle;
    }
  }
}

TEST(Pose, ExponentialSolvesTheTwistEquation) {
  // Independent truth: integrate dT/dt = [xi] T in small steps.
  std::mt19937 rng(2);
  std::uniform_real_distribution<double> u(-1, 1);
  for (int i = 0; i < 5; ++i) {
    Screw xi;
    for (int k = 0; k < 6; ++k) xi[k] = u(rng);
    Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
    A.topLeftCorner<3, 3>() << 0, -xi[5], xi[4], xi[5], 0, -xi[3], -xi[4], xi[3], 0;
    A.topRightCorner<3, 1>() = xi.head<3>();
    Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
    const int steps = 20000;
    for (int s = 0; s < steps; ++s) {
      const Eigen::Matrix4d middle = T + (0.5 / steps) * A * T;
      T += (1.0 / steps) * A * middle;
    }
    EXPECT_TRUE(ExpScrew(xi).matrix().isApprox(T, 1e-7));
  }
}

TEST(Pose, ExtrapolationOfAWholePeriodIsTheMotionItself) {
  std::mt19937 rng(3);
  for (int i = 0; i < 50; ++i) {
    const Pose H = RandomPose(rng, 2, 1.5);
    EXPECT_TRUE(ExtrapolateMotion(H, 0.1, 0.1).isApprox(H, 1e-9));
    const Pose half = ExtrapolateMotion(H, 0.1, 0.05);
    EXPECT_TRUE((half * half).isApprox(H, 1e-9));
    EXPECT_TRUE(ExtrapolateMotion(H, 0.1, -0.1).isApprox(H.inverse(), 1e-9));
  }
}

TEST(Pose, TwistIsTheVelocityOfTheBodysOrigin) {
  std::mt19937 rng(4);
  for (int i = 0; i < 50; ++i) {
    const Pose H = RandomPose(rng, 1, 0.4), T = RandomPose(rng, 1000, 3);
    const Twist twist = TwistOfMotion(H, 0.2, T);
    const double dt = 1e-6;
    const Pose next = ExtrapolateMotion(H, 0.2, dt) * T;
    const Eigen::Vector3d velocity = (next.translation() - T.translation()) / dt;
    EXPECT_LT((velocity - twist.linear_mps).norm(), 1e-2);
    const Eigen::AngleAxisd turn(next.linear() * T.linear().transpose());
    EXPECT_LT((turn.axis() * turn.angle() / dt - twist.angular_radps).norm(), 1e-4);
  }
}

TEST(Pose, OrthonormalisingRepairsADriftingChainWithoutMovingItsOrigin) {
  std::mt19937 rng(5);
  Pose T = RandomPose(rng, 10, 3);
  Pose drifted = T;
  drifted.linear() *= 1.001;
  const Pose repaired = Orthonormalized(drifted);
  EXPECT_TRUE(repaired.isApprox(T, 1e-9));
  EXPECT_EQ(repaired.translation(), T.translation());
}

}  // namespace
}  // namespace clearance
