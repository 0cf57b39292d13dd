#include <boost/test/unit_test.hpp>
#include <limits>
#include <stdexcept>
#include <string>

#include "arm.hpp"
#include "dovetail/watchdog.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kPeriod = 0.005;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Watched {
  LimitParams limits = limits_for(kPeriod);
  Watchdog watchdog{WatchdogParams{}, limits};
  WatchdogInput input{tool_down_posture(),
                      Vec7::Zero(),
                      Vec7(Vec7::Zero()),
                      Vec7(Vec7::Zero()),
                      Vec7(Vec7::Zero()),
                      0.0,
                      kPeriod};

  /// The cycle in which the verdict stops being kFollow; 0 for not within `cycles`.
  int acts_in(int cycles) {
    for (int k = 1; k <= cycles; ++k) {
      if (watchdog.check(input) != Verdict::kFollow) return k;
    }
    return 0;
  }
  StopReason reason() const { return watchdog.facts().reason; }
};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(each_cause, Watched)

BOOST_AUTO_TEST_CASE(nothing_wrong_is_followed) {
  BOOST_TEST(acts_in(1000) == 0);
  BOOST_CHECK(reason() == StopReason::kNone);
}

BOOST_AUTO_TEST_CASE(a_target_that_is_too_old_holds_until_the_next) {
  input.target_age = 0.15;
  BOOST_TEST(acts_in(10) == 0);
  input.target_age = 0.151;
  BOOST_CHECK(watchdog.check(input) == Verdict::kHold);
  BOOST_CHECK(reason() == StopReason::kTargetTimeout);
  BOOST_TEST(!watchdog.is_stopped());
  input.target_age = 0.0;
  BOOST_CHECK(watchdog.check(input) == Verdict::kFollow);
  BOOST_CHECK(reason() == StopReason::kNone);
}

BOOST_AUTO_TEST_CASE(a_joint_beyond_its_limit_stops_at_once) {
  for (const double side : {-1.0, 1.0}) {
    watchdog.clear();
    input.q = tool_down_posture();
    input.q[3] = side * (limits.q_max[3] + 0.019);
    BOOST_TEST(acts_in(10) == 0);
    input.q[3] = side * (limits.q_max[3] + 0.021);
    BOOST_TEST(acts_in(10) == 1);
    BOOST_CHECK(reason() == StopReason::kPosition);
    BOOST_TEST(watchdog.facts().joint == 3);
    BOOST_TEST(watchdog.facts().value == input.q[3]);
    BOOST_TEST(watchdog.facts().limit == side * limits.q_max[3]);
  }
}

BOOST_AUTO_TEST_CASE(a_joint_that_stays_too_fast_stops) {
  input.dq[5] = -1.14 * limits.dq_max[5];
  BOOST_TEST(acts_in(100) == 0);
  input.dq[5] = -1.16 * limits.dq_max[5];
  BOOST_TEST(acts_in(100) == 2);  // 10 ms
  BOOST_CHECK(reason() == StopReason::kSpeed);
  BOOST_TEST(watchdog.facts().joint == 5);
}

BOOST_AUTO_TEST_CASE(one_reading_that_is_too_fast_does_not_stop) {
  for (int k = 0; k < 100; ++k) {
    input.dq[2] = k % 2 == 0 ? 3.0 * limits.dq_max[2] : 0.0;
    BOOST_CHECK(watchdog.check(input) == Verdict::kFollow);
  }
}

BOOST_AUTO_TEST_CASE(lost_periods_count_as_long_as_they_were) {
  input.dq[2] = 3.0 * limits.dq_max[2];
  input.elapsed = 3.0 * kPeriod;
  BOOST_TEST(acts_in(10) == 1);
}

BOOST_AUTO_TEST_CASE(torque_that_is_not_as_commanded_stops) {
  input.tau_commanded = Vec7(Vec7::Constant(5.0));
  input.tau_measured = Vec7(Vec7::Constant(5.0));
  (*input.tau_measured)[6] = 5.0 - 0.29 * limits.tau_max[6];
  BOOST_TEST(acts_in(100) == 0);
  (*input.tau_measured)[6] = 5.0 - 0.31 * limits.tau_max[6];
  BOOST_TEST(acts_in(100) == 20);  // 100 ms
  BOOST_CHECK(reason() == StopReason::kTorqueTracking);
  BOOST_TEST(watchdog.facts().joint == 6);
}

BOOST_AUTO_TEST_CASE(torques_that_the_cabinet_does_not_send_are_not_judged) {
  input.tau_measured = Vec7(Vec7::Constant(1e3));
  input.tau_commanded.reset();
  input.tau_external.reset();
  BOOST_TEST(acts_in(100) == 0);
}

BOOST_AUTO_TEST_CASE(an_external_torque_stops) {
  (*input.tau_external)[1] = 0.59 * limits.tau_max[1];
  BOOST_TEST(acts_in(100) == 0);
  (*input.tau_external)[1] = 0.61 * limits.tau_max[1];
  BOOST_TEST(acts_in(100) == 2);
  BOOST_CHECK(reason() == StopReason::kExternalTorque);
}

BOOST_AUTO_TEST_CASE(a_stop_that_is_asked_for_comes_at_once) {
  watchdog.request_stop();
  BOOST_TEST(acts_in(1) == 1);
  BOOST_CHECK(reason() == StopReason::kRequested);
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_FIXTURE_TEST_SUITE(order_and_end, Watched)

BOOST_AUTO_TEST_CASE(of_several_causes_the_first_in_order_is_the_reason) {
  // all at once, each long enough; then one after the other is taken away
  const auto reason_now = [&] {
    watchdog.clear();
    BOOST_CHECK(watchdog.check(input) == Verdict::kStop);
    return reason();
  };
  input.target_age = 1.0;
  (*input.tau_external)[0] = 2.0 * limits.tau_max[0];
  (*input.tau_measured)[0] = 2.0 * limits.tau_max[0];
  input.dq[0] = 2.0 * limits.dq_max[0];
  input.q[0] = 2.0 * limits.q_max[0];
  input.elapsed = 1.0;  // long enough for every clock
  watchdog.request_stop();
  BOOST_CHECK(watchdog.check(input) == Verdict::kStop);
  BOOST_CHECK(reason() == StopReason::kRequested);
  BOOST_CHECK(reason_now() == StopReason::kPosition);
  input.q[0] = 0.0;
  BOOST_CHECK(reason_now() == StopReason::kSpeed);
  input.dq[0] = 0.0;
  BOOST_CHECK(reason_now() == StopReason::kTorqueTracking);
  (*input.tau_measured)[0] = 0.0;
  BOOST_CHECK(reason_now() == StopReason::kExternalTorque);
  (*input.tau_external)[0] = 0.0;
  watchdog.clear();
  BOOST_CHECK(watchdog.check(input) == Verdict::kHold);
  BOOST_CHECK(reason() == StopReason::kTargetTimeout);
}

BOOST_AUTO_TEST_CASE(a_stop_stays_with_its_first_reason_until_cleared) {
  watchdog.request_stop();
  static_cast<void>(watchdog.check(input));
  input.q[0] = 10.0;
  watchdog.begin();  // a new motion is no excuse
  BOOST_CHECK(watchdog.check(input) == Verdict::kStop);
  BOOST_CHECK(reason() == StopReason::kRequested);
  input.q[0] = 0.0;
  watchdog.clear();
  BOOST_CHECK(watchdog.check(input) == Verdict::kFollow);
  BOOST_CHECK(reason() == StopReason::kNone);
}

BOOST_AUTO_TEST_CASE(a_cause_that_is_still_there_stops_again_after_clear) {
  input.q[0] = 10.0;
  BOOST_TEST(acts_in(1) == 1);
  watchdog.clear();
  BOOST_TEST(acts_in(1) == 1);
}

BOOST_AUTO_TEST_CASE(a_new_motion_forgets_what_was_nearly_confirmed) {
  input.dq[0] = 2.0 * limits.dq_max[0];
  BOOST_CHECK(watchdog.check(input) == Verdict::kFollow);
  watchdog.begin();
  BOOST_CHECK(watchdog.check(input) == Verdict::kFollow);
  BOOST_CHECK(watchdog.check(input) == Verdict::kStop);
}

BOOST_AUTO_TEST_CASE(infinity_switches_a_cause_off) {
  WatchdogParams params;
  params.target_timeout = params.position_margin = params.speed_margin = kInfinity;
  params.torque_error = params.external_torque = kInfinity;
  watchdog = Watchdog(params, limits);
  input.target_age = 1e9;
  (*input.tau_external)[0] = (*input.tau_measured)[1] = 1e6;
  input.dq[0] = input.q[0] = 1e3;
  BOOST_TEST(acts_in(100) == 0);
}

BOOST_AUTO_TEST_CASE(a_stop_is_told_with_joint_value_and_limit) {
  input.q[3] = 2.5;
  static_cast<void>(watchdog.check(input));
  BOOST_TEST(describe(watchdog.facts()) ==
             "position of A4 is 2.5 rad, allowed is 2.0944 rad");
  input.q[3] = 0.0;
  input.target_age = 0.2;
  watchdog.clear();
  static_cast<void>(watchdog.check(input));
  BOOST_TEST(describe(watchdog.facts()) ==
             "no new Target for 200 ms, allowed are 150 ms");
}

BOOST_AUTO_TEST_CASE(settings_out_of_range_are_refused_by_name) {
  WatchdogParams params;
  params.external_torque = 0.0;
  BOOST_CHECK_EXCEPTION(Watchdog(params, limits), std::invalid_argument,
                        [](const std::invalid_argument& error) {
                          return std::string(error.what()).find("external_torque") !=
                                 std::string::npos;
                        });
}

BOOST_AUTO_TEST_SUITE_END()
