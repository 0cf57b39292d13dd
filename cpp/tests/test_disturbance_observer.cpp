#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>

#include "arm.hpp"
#include "dovetail/disturbance_observer.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kPeriod = 0.001;  // [s]

/// A unit inertia that stands still while `load` [Nm] pushes: the torque that holds it
/// is what the model does not explain.
struct Loaded {
  LimitParams limits = limits_for(kPeriod);
  DisturbanceObserver observer{limits};
  Mat7 M = Mat7::Identity();
  Vec7 h = Vec7::Zero();

  void stand(const Vec7& load, bool is_jump = false, bool is_ended = false) {
    const Vec7 tau = -load;
    observer.update({.M = M,
                     .h = h,
                     .tau = tau,
                     .change = Vec7::Zero(),
                     .elapsed = kPeriod,
                     .is_jump = is_jump,
                     .is_ended = is_ended});
  }
};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(disturbance_observer, Loaded)

BOOST_AUTO_TEST_CASE(it_follows_a_load_at_its_rate) {
  const Vec7 load = Vec7::Constant(2.0);
  for (int k = 0; k < 20; ++k) stand(load);
  const double left = std::exp(-limits.estimate_rate * 20 * kPeriod);
  BOOST_TEST((observer.torque() - (1.0 - left) * load).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(one_sample_adds_no_more_than_a_share_of_the_motor_torque) {
  stand(Vec7::Constant(1e6));
  const double share = 1.0 - std::exp(-limits.estimate_rate * kPeriod);
  BOOST_TEST((observer.torque() - share * 0.25 * limits.tau_max).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(the_estimate_stays_finite_and_within_the_motor_torque) {
  for (int k = 0; k < 1000; ++k) stand(Vec7::Constant(1e6));
  BOOST_TEST((observer.torque() - limits.tau_max).norm() < 1e-9);
  stand(Vec7::Constant(std::numeric_limits<double>::quiet_NaN()));
  BOOST_TEST(observer.torque().allFinite());
}

BOOST_AUTO_TEST_CASE(what_a_jump_added_can_be_taken_back) {
  stand(Vec7::Constant(1.0));
  const Vec7 before = observer.torque();
  observer.begin_jump();
  stand(Vec7::Constant(9.0), true);
  BOOST_TEST((observer.torque() - before).norm() > 0.1);
  observer.take_back_jump();
  BOOST_TEST((observer.torque() - before).norm() < 1e-12);
}

BOOST_AUTO_TEST_CASE(after_the_end_of_a_motion_it_is_no_quicker_than_60_a_second) {
  limits.estimate_rate = 300.0;
  observer = DisturbanceObserver(limits);
  stand(Vec7::Ones(), false, true);
  BOOST_TEST(std::abs(observer.torque()[0] - (1.0 - std::exp(-0.06))) < 1e-12);
}

BOOST_AUTO_TEST_CASE(the_slow_part_is_kept_alone_but_of_joints_that_keep_all) {
  for (int k = 0; k < 30; ++k) stand(Vec7::Constant(2.0));
  const Vec7 whole = observer.torque();
  observer.keep_slow_part(1U << 3);
  BOOST_TEST(observer.torque()[3] == whole[3]);
  BOOST_TEST(observer.torque()[0] > 0.0);
  BOOST_TEST(observer.torque()[0] < 0.5 * whole[0]);
}

BOOST_AUTO_TEST_CASE(a_share_is_opposed_that_is_the_same_in_all_joints) {
  BOOST_TEST((observer.opposed(Vec7::Constant(5.0)) - Vec7::Constant(5.0)).norm() == 0);
  Vec7 r = Vec7::Constant(4.0);
  r[5] = 40.0;  // 10 Nm are opposed at most
  BOOST_TEST((observer.opposed(r) - 0.25 * r).norm() < 1e-12);
}

BOOST_AUTO_TEST_CASE(switched_off_it_knows_nothing) {
  limits.estimate_rate = 0.0;
  observer = DisturbanceObserver(limits);
  stand(Vec7::Ones());
  BOOST_TEST(!observer.is_on());
  BOOST_TEST(observer.torque().norm() == 0.0);
}

BOOST_AUTO_TEST_SUITE_END()
