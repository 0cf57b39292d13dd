// The way of the desired pose to a Target's that jumps.
#include <boost/test/unit_test.hpp>

#include "arm.hpp"
#include "dovetail/osc.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

using enum AxisMode;

constexpr double kPeriod = 0.005;

}  // namespace

BOOST_AUTO_TEST_SUITE(way_to_a_target)

BOOST_AUTO_TEST_CASE(near_half_a_turn_the_way_that_was_begun_is_gone_on_with) {
  OperationalSpace osc(turns_at_once(), {kFree, kFree, kFree, kHold, kHold, kPose},
                       kPeriod);
  const auto error = [&](double angle) {  // asked for, of an arm that stands [rad]
    Target target;
    target.quat_wxyz_d = quat_of(about_z(angle));
    const Mat3 R = Mat3::Identity();
    return osc.desired_acceleration(Vec3::Zero(), R, Vec6::Zero(), target)[5] / 400.0;
  };
  osc.reset(Vec3::Zero(), quat_of(Mat3::Identity()));
  for (const double sign : {1.0, -1.0}) {
    for (const double angle : {0.1, -3.0, -3.2, -3.6, -3.1, -3.3, -2.0}) {
      BOOST_TEST(std::abs(error(sign * angle) - sign * angle) < 1e-9);
    }
    // The other way is shorter by more than noise and motion: it is taken.
    BOOST_TEST(std::abs(error(sign * 3.1) - sign * 3.1) < 1e-9);
    BOOST_TEST(std::abs(error(sign * 3.7) - sign * (3.7 - 2.0 * M_PI)) < 1e-9);
    // Another start remembers nothing.
    error(sign * 3.1);
    osc.reset(Vec3::Zero(), quat_of(Mat3::Identity()));
    BOOST_TEST(std::abs(error(sign * 3.2) - sign * (3.2 - 2.0 * M_PI)) < 1e-9);
  }
}

BOOST_AUTO_TEST_CASE(a_position_that_jumps_is_gone_to_at_move_speed) {
  const OscParams osc_params;
  OperationalSpace osc(osc_params, {kPose, kHold, kPose, kFree, kFree, kFree}, kPeriod);
  const Vec3 start(0.4, 0.1, 0.3);
  const auto error = [&](const Vec3& to, const Vec6& speed) {
    Target target;
    target.position_d = to;
    target.velocity_d = speed;
    Vec6 f = osc.desired_acceleration(start, Mat3::Identity(), Vec6::Zero(), target);
    // What is held stands still.
    f[1] += 40.0 * speed[1];
    return Vec3((f - 40.0 * speed).head<3>() / 400.0);  // D = 2 sqrt(K)
  };
  osc.reset(start, quat_of(Mat3::Identity()));
  Vec3 moved = Vec3::Zero();
  const double step = osc_params.move_speed * kPeriod;
  for (int k = 0; k < 120; ++k) {  // to and fro, and beside a speed of its own
    Vec3 to(0.03, 0.0, -0.04);
    Vec6 speed = Vec6::Zero();
    if (k > 40) to = -to;
    if (k > 40) speed << 0.03, 0.0, 0.04, 1.0, 0.0, 0.0;
    const Vec3 way = to - moved;
    const double most = step + kPeriod * speed.head<3>().norm();
    moved += way * std::min(most / std::max(way.norm(), 1e-9), 1.0);
    const Vec3 aside(0.0, 0.3, 0.0);  // another axis takes no part in the length
    BOOST_TEST((error(start + to + aside, speed) - moved).norm() < 1e-9);
  }
  BOOST_TEST((moved - Vec3(-0.03, 0.0, 0.04)).norm() < 1e-12);  // there
  // What is left of the way is what a Target changes.
  const Vec3 back(0.01, 0.0, 0.0);
  error(start + moved + back, Vec6::Zero());
  BOOST_TEST((osc.way_to_come().head<3>() - 400.0 * back).norm() < 1e-9);
  osc.forget_way();
  BOOST_TEST(error(start + moved, Vec6::Zero()).norm() < step + 1e-9);
}

BOOST_AUTO_TEST_CASE(a_rotation_that_jumps_is_turned_to_at_turn_speed) {
  OscParams osc_params;
  osc_params.error_clamp_rotation = 4.0;
  osc_params.f_clamp_angular = 1e4;
  OperationalSpace osc(osc_params, {kFree, kFree, kFree, kHold, kHold, kPose}, kPeriod);
  const auto error = [&](double angle, double speed, double now = 0.0) {
    Target target;
    target.quat_wxyz_d = quat_of(about_z(angle));
    target.velocity_d[5] = speed;
    const Mat3 R = about_z(now);
    const Vec6 f = osc.desired_acceleration(Vec3::Zero(), R, Vec6::Zero(), target);
    return (f[5] - 40.0 * speed) / 400.0;  // D = 2 sqrt(K)
  };
  osc.reset(Vec3::Zero(), quat_of(Mat3::Identity()));
  const double step = osc_params.turn_speed * kPeriod;
  double turned = 0.0;
  for (int k = 1; k < 150; ++k) {  // to and fro, and beside a speed of its own
    const double speed = k < 50 ? 0.0 : -0.4;
    const double to = k < 50 ? 0.2 : -0.3;
    const double most = step - kPeriod * speed;
    turned += std::clamp(to - turned, -most, most);
    BOOST_TEST(std::abs(error(to, speed) - turned) < 1e-9);
  }
  BOOST_TEST(turned == -0.3);  // there
  // Half a turn away the way that was begun is gone on with, whatever noise says.
  osc.forget_way();
  for (int k = 1; k <= 60; ++k) {
    const double noise = k % 2 == 0 ? 0.1 : -0.1;
    BOOST_TEST(std::abs(error(M_PI + 0.5 + noise, 0.0, 0.5) - k * step) < 1e-9);
  }
}

BOOST_AUTO_TEST_CASE(a_pace_slows_the_way_and_not_the_speed_that_a_target_has) {
  const OscParams law;
  OperationalSpace osc(law, {kPose, kPose, kPose, kHold, kHold, kPose}, kPeriod);
  osc.reset(Vec3::Zero(), quat_of(Mat3::Identity()));
  const auto moved = [&](double speed) {  // by one cycle, along x and about z
    Target target;
    target.position_d = Vec3(1.0, 0.0, 0.0);
    target.quat_wxyz_d = quat_of(about_z(1.0));
    target.velocity_d << speed, 0.0, 0.0, 0.0, 0.0, speed;
    const Mat3 R = Mat3::Identity();
    osc.forget_way();
    osc.set_pace(0.1);
    const Vec6 f = osc.desired_acceleration(Vec3::Zero(), R, Vec6::Zero(), target);
    return Vec6((f - 40.0 * target.velocity_d) / 400.0 / kPeriod);  // D = 2 sqrt(K)
  };
  for (const double speed : {0.0, 0.01, 0.2}) {
    const Vec6 now = moved(speed);
    const double move = 0.1 * (law.move_speed + speed);
    const double turn = 0.1 * (law.turn_speed + speed);
    BOOST_TEST(std::abs(now[0] - std::max(move, speed)) < 1e-9);
    BOOST_TEST(std::abs(now[5] - std::max(turn, speed)) < 1e-9);
    // What the next pace is made from does not depend on this one.
    BOOST_TEST(std::abs(osc.way_speed()[0] - (law.move_speed + speed)) < 1e-9);
    const double scaled = law.length_scale * (law.turn_speed + speed);
    BOOST_TEST(std::abs(osc.way_speed()[5] - scaled) < 1e-9);
    BOOST_TEST((osc.way_speed().segment<4>(1)).norm() < 1e-9);
  }
  osc.set_pace(0.1);
  osc.forget_way();  // the next way begins at full pace
  Target target;
  target.position_d = Vec3(1.0, 0.0, 0.0);
  const Vec6 f =
      osc.desired_acceleration(Vec3::Zero(), Mat3::Identity(), Vec6::Zero(), target);
  BOOST_TEST(std::abs(f[0] - 400.0 * law.move_speed * kPeriod) < 1e-9);
}

BOOST_AUTO_TEST_CASE(the_integral_term_follows_a_pull_within_its_bounds) {
  const OscParams law;
  OperationalSpace osc(law, {kPose, kForce, kHold, kFree, kPose, kHold}, kPeriod);
  osc.reset(Vec3::Zero(), quat_of(Mat3::Identity()));
  const Target target;  // where the tool is
  const auto asked = [&] {
    return osc.desired_acceleration(Vec3::Zero(), Mat3::Identity(), Vec6::Zero(),
                                    target);
  };
  Vec6 pull;
  pull << 0.1, 0.2, -2.0, 0.2, 5.0, -0.2;
  const double left = std::exp(-kPeriod / law.integral_time);
  osc.integrate(pull);
  BOOST_TEST(std::abs(asked()[0] + 0.1 * (1.0 - left)) < 1e-12);
  osc.integrate(pull);
  BOOST_TEST(std::abs(asked()[0] + 0.1 * (1.0 - left * left)) < 1e-12);
  for (int k = 0; k < 1000; ++k) osc.integrate(pull);
  Vec6 most;
  most << -0.1, 0.0, law.integral_clamp_linear, 0.0, -law.integral_clamp_angular, 0.2;
  BOOST_TEST((asked() - most).norm() < 1e-9);
  osc.integrate(Vec6::Zero());  // it leaves its bound at once
  BOOST_TEST(std::abs(asked()[2] - law.integral_clamp_linear * left) < 1e-9);
  osc.reset_integral();
  BOOST_TEST(asked().norm() == 0.0);
}

BOOST_AUTO_TEST_SUITE_END()
