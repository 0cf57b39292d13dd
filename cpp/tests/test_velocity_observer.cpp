#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "arm.hpp"
#include "dovetail/velocity_observer.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kPeriod = 0.005;

/// q(t) = sin(w t) in each joint, w from 1 to 4 rad/s.
Vec7 frequencies() { return Vec7::LinSpaced(1.0, 4.0); }
Vec7 position(double t) { return (frequencies() * t).array().sin(); }
Vec7 velocity(double t) {
  return frequencies().array() * (frequencies() * t).array().cos();
}
Vec7 acceleration(double t) {
  return -frequencies().array().square() * (frequencies() * t).array().sin();
}

}  // namespace

BOOST_AUTO_TEST_CASE(gain_one_is_the_difference_moved_to_the_end_of_the_interval) {
  std::mt19937_64 random(1);
  VelocityObserver observer(kPeriod);
  Vec7 last = random_vector(random, 1.0);
  observer.reset(last);
  BOOST_TEST(observer.dq().norm() == 0.0);
  for (int k = 0; k < 100; ++k) {
    const Vec7 q = last + random_vector(random, 0.001);  // what an arm can do
    const Vec7 a = random_vector(random, 10.0);
    const Vec7 expected = (q - last) / kPeriod + 0.5 * kPeriod * a;
    BOOST_TEST((observer.update(q, a) - expected).norm() < 1e-9);
    last = q;
  }
}

BOOST_AUTO_TEST_CASE(a_wrong_position_is_worth_no_more_than_a_small_one) {
  for (const double spike : {0.005, 0.1, 3.0}) {
    VelocityObserver observer(0.001, 0.2);
    const Vec7 rest = Vec7::Zero();
    observer.reset(rest);
    observer.update(Vec7::Constant(spike), rest);
    BOOST_TEST(observer.dq().cwiseAbs().maxCoeff() < 0.08);  // 0.35 mrad in 1 ms
    BOOST_TEST(observer.dq().minCoeff() > 0.0);
  }
}

BOOST_AUTO_TEST_CASE(constant_acceleration_is_followed_without_lag_at_any_gain) {
  for (const double gain : {1.0, 0.5, 0.2}) {
    VelocityObserver observer(kPeriod, gain);
    observer.reset(Vec7::Zero());
    const Vec7 a = Vec7::LinSpaced(-3.0, 3.0);
    for (int k = 1; k <= 50; ++k) {
      const double t = k * kPeriod;
      observer.update(0.5 * t * t * a, a);
      BOOST_TEST((observer.dq() - t * a).norm() < 1e-9);
    }
  }
}

BOOST_AUTO_TEST_CASE(an_interval_of_several_periods_counts_as_long_as_it_was) {
  VelocityObserver observer(kPeriod);
  observer.reset(position(0.0));
  double t = 0.0;
  for (int k = 0; k < 300; ++k) {
    const double elapsed = kPeriod * (k % 7 == 0 ? 3 : 1);  // two messages lost
    const Vec7 mean = acceleration(t + 0.5 * elapsed);
    t += elapsed;
    observer.update(position(t), mean, elapsed);
    if (k < 20) continue;  // started at rest, which the sine does not
    BOOST_REQUIRE((observer.dq() - velocity(t)).cwiseAbs().maxCoeff() < 2e-3);
  }
}

BOOST_AUTO_TEST_CASE(a_smaller_gain_has_less_noise) {
  const auto noise_of = [](double gain) {
    std::mt19937_64 random(2);
    VelocityObserver observer(kPeriod, gain);
    observer.reset(Vec7::Zero());
    double sum = 0.0;
    for (int k = 0; k < 2000; ++k) {
      sum += observer.update(random_vector(random, 1e-4), Vec7::Zero()).squaredNorm();
    }
    return std::sqrt(sum / (7 * 2000));
  };
  BOOST_TEST(noise_of(0.3) < 0.7 * noise_of(1.0));
}

BOOST_AUTO_TEST_CASE(numbers_out_of_range_are_refused) {
  BOOST_CHECK_THROW(VelocityObserver(0.0), std::invalid_argument);
  BOOST_CHECK_THROW(VelocityObserver(NAN), std::invalid_argument);
  BOOST_CHECK_THROW(VelocityObserver(0.005, 0.0), std::invalid_argument);
  BOOST_CHECK_THROW(VelocityObserver(0.005, 1.5), std::invalid_argument);
}

BOOST_AUTO_TEST_CASE(a_position_that_is_none_leaves_nothing_behind) {
  VelocityObserver observer(kPeriod);
  const double bad = std::numeric_limits<double>::quiet_NaN();
  Vec7 last = position(0.0);
  observer.reset(last);
  for (int k = 1; k < 300; ++k) {
    Vec7 q = position(k * kPeriod);
    if (k % 7 > 4) q[k % 7] = k % 2 == 0 ? bad : 1e300;  // two in a row
    observer.update(q, acceleration((k - 0.5) * kPeriod));
    BOOST_REQUIRE(observer.dq().allFinite());
    if (k % 7 > 4 || k < 20) continue;
    const double error = (observer.dq() - velocity(k * kPeriod)).cwiseAbs().maxCoeff();
    BOOST_REQUIRE(error < 5e-2);
  }
}

BOOST_AUTO_TEST_CASE(a_position_that_was_not_believed_leaves_nothing_behind) {
  for (const double period : {0.001, kPeriod}) {
    VelocityObserver observer(period, std::min(1.0, period / kPeriod));
    observer.reset(position(0.0));
    for (int k = 1; k < 1000; ++k) {
      const Vec7 a = acceleration((k - 0.5) * period);
      const bool is_wrong = k % 29 < 1 + k / 29 % 3;  // one to three in a row
      const Vec7 q = position(k * period) + (is_wrong ? 0.08 : 0.0) * Vec7::Ones();
      observer.update(q, a, period);
      if (is_wrong) observer.doubt();
      if (is_wrong || k < 300) continue;
      const double error = (observer.dq() - velocity(k * period)).cwiseAbs().maxCoeff();
      BOOST_REQUIRE(error < 5e-2);
    }
  }
}

BOOST_AUTO_TEST_CASE(an_arm_that_went_on_elsewhere_is_followed) {
  VelocityObserver doubting(kPeriod), observer(kPeriod);
  doubting.reset(Vec7::Zero());
  observer.reset(Vec7::Zero());
  for (int k = 0; k < 9; ++k) {
    const Vec7 q = Vec7::Constant(0.3 + 0.001 * k);
    observer.update(q, Vec7::Zero());
    doubting.update(q, Vec7::Zero());
    doubting.doubt();
    BOOST_TEST((observer.dq() - doubting.dq()).norm() == 0.0);
  }
}
