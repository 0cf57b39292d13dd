#include <array>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "arm.hpp"
#include "dovetail/kick_watch.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr std::array<double, 4> kPeriods = {0.001, 0.002, 0.0025, 0.005};
constexpr int kWrist = 5;

/// The watch of one joint that is accelerated evenly [rad/s2] from a speed [rad/s].
struct Watch {
  LimitParams limits;
  KickWatch watch;
  double speed;

  explicit Watch(double from = 0.0, double brake_rate = 50.0)
      : limits(limits_for(0.005)),
        watch((limits.brake_rate = brake_rate, limits)),
        speed(from) {}

  bool sees(double acceleration, double period) {
    Vec7 dq = Vec7::Zero();
    Vec7 change = Vec7::Zero();
    change[kWrist] = acceleration * period;
    dq[kWrist] = speed += acceleration * period;
    return watch.sees(dq, change, period);
  }

  /// Speed at which it is seen [rad/s]; beyond the limit where it never is.
  double seen_at(double acceleration, double period) {
    while (std::abs(speed) < limits.dq_max[kWrist]) {
      if (sees(acceleration, period)) break;
    }
    return std::abs(speed);
  }
};

}  // namespace

BOOST_AUTO_TEST_CASE(a_kick_is_seen_while_the_joint_is_within_its_limit) {
  for (const double period : kPeriods) {
    for (const double sign : {1.0, -1.0}) {
      const double most = limits_for(period).dq_max[kWrist];
      // By 1 / brake_rate ahead, and a few cycles of the filter's later.
      const double at = Watch().seen_at(sign * 60.0, period);
      BOOST_TEST(at > most - 60.0 / 50.0);
      BOOST_TEST(at < most - 60.0 / 50.0 + 60.0 * (period + 0.006));
    }
  }
}

BOOST_AUTO_TEST_CASE(what_comes_to_no_speed_limit_is_no_kick) {
  for (const double period : kPeriods) {
    const double most = limits_for(period).dq_max[kWrist];
    Watch gentle(0.5 * most);
    for (double t = 0.0; t < 0.03; t += period) BOOST_TEST(!gentle.sees(15.0, period));
    Watch braked(0.95 * most);  // however strongly
    for (double t = 0.0; t < 0.01; t += period) {
      BOOST_TEST(!braked.sees(-200.0, period));
    }
  }
}

BOOST_AUTO_TEST_CASE(it_is_not_seen_again_before_what_was_done_came_round) {
  for (const double period : kPeriods) {
    Watch kicked;
    int cycles = 0;
    int seen = 0;
    int first = -1;
    for (double t = 0.0; t < 3.0 / 50.0 - 1e-9 || first < 0; t += period, ++cycles) {
      if (kicked.sees(200.0, period)) {
        ++seen;
        if (first < 0) t = 0.0, first = cycles;
      }
    }
    BOOST_TEST(seen == 1);
    bool is_again = false;
    for (int i = 0; i < 3; ++i) is_again = is_again || kicked.sees(200.0, period);
    BOOST_TEST(is_again);
    kicked.watch.reset();
    kicked.speed = 0.0;
    BOOST_TEST(!kicked.sees(1.0, period));  // it forgets what was
  }
}

BOOST_AUTO_TEST_CASE(encoder_noise_is_no_kick) {
  std::mt19937 rng(3);
  std::normal_distribution<double> noise(0.0, 0.015);  // [rad/s]: three times `hard`
  for (const double period : kPeriods) {
    Watch watch(0.0, 60.0);
    Vec7 last = Vec7::Zero();
    for (int i = 0; i < 20000; ++i) {
      Vec7 dq = Vec7::NullaryExpr([&](auto) { return noise(rng); });
      dq[kWrist] += 1.5;  // of 2.36
      BOOST_TEST_REQUIRE(!(i > 10 && watch.watch.sees(dq, dq - last, period)));
      last = dq;
    }
  }
}

BOOST_AUTO_TEST_CASE(without_a_brake_rate_only_what_is_too_fast_already_is_one) {
  const double most = limits_for(0.005).dq_max[kWrist];
  Watch watch(0.0, 0.0);
  BOOST_TEST(!watch.sees(100.0, 0.005));
  watch.speed = most;
  BOOST_TEST(watch.sees(100.0, 0.005));
}
