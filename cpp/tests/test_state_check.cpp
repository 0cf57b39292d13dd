#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>
#include <vector>

#include "checked_arm.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
}  // namespace

BOOST_FIXTURE_TEST_SUITE(samples, Check)

BOOST_AUTO_TEST_CASE(an_arm_that_moves_as_expected_is_taken_as_measured) {
  for (int k = 0; k < 100; ++k) {
    move();
    take(q, dq);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST((check.q() - q).norm() < 1e-12);
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(the_state_of_a_reset_taken_at_once_is_no_old_sample) {
  take(q, dq);
  BOOST_TEST(check.implausible() == 0);
  BOOST_TEST((check.q() - q).norm() == 0.0);
}

BOOST_AUTO_TEST_CASE(
    a_sample_that_repeats_the_one_before_is_replaced_by_the_prediction) {
  move();
  take(q, dq);
  const Vec7 seen = q;
  for (int k = 0; k < 3; ++k) {
    move();
    take(seen, dq);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST((check.q() - q).norm() < 1e-12);
  }
  move();
  take(q, dq);
  BOOST_TEST((check.q() - q).norm() < 1e-12);
}

BOOST_AUTO_TEST_CASE(a_sample_of_five_cycles_ago_is_old_too) {
  std::vector<Vec7> past{q};
  for (int k = 0; k < 5; ++k) {
    move();
    take(q, dq);
    past.push_back(q);
  }
  for (const int age : {5, 2, 3}) {
    move();
    take(past[past.size() - age], dq);
    past.push_back(q);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST(check.is_in_doubt());
    BOOST_TEST((check.q() - q).norm() < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(a_way_without_a_speed_and_a_speed_without_a_way_are_none) {
  for (const double error : {0.003, -0.01}) {
    check.reset(q, dq);
    take(q, dq);
    move();
    take_wrong(4, error);
    BOOST_TEST(check.implausible() == 1);
  }
  for (const double error : {0.5, -2.0}) {
    check.reset(q, dq);
    take(q, dq);
    move();
    Vec7 wrong = dq;
    wrong[4] += error;
    take(q, wrong);
    BOOST_TEST(check.implausible() == 1);
  }
}

BOOST_AUTO_TEST_CASE(a_surprise_is_believed_and_leaves_a_doubt) {
  for (const bool is_real : {true, false}) {
    check.reset(q, dq);
    take(q, dq);
    move();
    const Vec7 q_expected = q, dq_expected = dq;
    dq[2] += 0.25;  // a blow
    q[2] += 0.5 * kPeriod * 0.25;
    take(q, dq);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST(check.is_in_doubt());
    BOOST_TEST((check.q() - q).norm() < 1e-12);
    if (!is_real) {
      q = q_expected;
      dq = dq_expected;
    }
    move();
    take(q, dq);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST((check.q() - q).norm() < 1e-12);
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
  }
}

/// A speed that is made of positions is wrong twice: where a wrong one comes, and where
/// it goes.
BOOST_AUTO_TEST_CASE(a_surprise_that_the_next_sample_knows_nothing_of_was_none) {
  for (const double speed_error : {0.0, -0.25}) {
    check.reset(q, dq);
    take(q, dq);
    move();
    Vec7 wrong = q, wrong_speed = dq;
    wrong[2] += 0.5 * kPeriod * 0.25;
    wrong_speed[2] += 0.25;
    take(wrong, wrong_speed);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST(check.is_jump());
    move();
    Vec7 seen = dq;
    seen[2] += speed_error;
    take(q, seen);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST(check.is_return());
    BOOST_TEST((check.q() - q).norm() < 1e-12);
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
    move();
    take(q, dq);
    BOOST_TEST(!(check.is_jump() || check.is_return()));
    BOOST_TEST((check.q() - q).norm() < 1e-12);
  }
}

/// A contact that brakes for several cycles: each way is near the one without it, too.
BOOST_AUTO_TEST_CASE(a_surprise_that_goes_on_is_not_taken_back) {
  dq[2] = 1.0;
  check.reset(q, dq);
  take(q, dq);
  for (int k = 0; k < 4; ++k) {
    q += kPeriod * dq;
    q[2] -= 0.5 * kPeriod * 0.25;
    dq[2] -= 0.25;
    take(q, dq);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST(!check.is_return());
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(of_a_surprise_and_what_contradicts_it_either_may_be_wrong) {
  for (const bool is_real : {true, false}) {
    check.reset(q, dq);
    take(q, dq);
    move();
    surprise(is_real);
    move();
    take_wrong(4, 0.05);
    BOOST_TEST(check.implausible() == 1);
    if (!is_real) BOOST_TEST((check.dq() - dq).norm() < 1e-12);
    move();
    take(q, dq);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST((check.q() - q).norm() < 1e-12);
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
  }
}

/// Else the arm would brake against a speed that comes and goes.
BOOST_AUTO_TEST_CASE(of_a_surprise_and_many_wrong_samples_the_surprise_stays_off) {
  take(q, dq);
  move();
  surprise(false);
  for (int k = 1; k <= 4; ++k) {
    move();
    take_wrong(4, k % 2 == 0 ? 0.05 : -0.05);
    BOOST_TEST(check.implausible() == k);
    BOOST_TEST(check.is_return() == (k == 1));
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
  }
}

/// Else a second wrong sample would bring the refuted one back.
BOOST_AUTO_TEST_CASE(what_is_kept_of_a_surprise_is_forgotten_with_the_next_sample) {
  take(q, dq);
  move();
  surprise(false);
  BOOST_TEST(check.is_jump());
  for (const double error : {0.05, 0.0, -0.05}) {
    move();
    take_wrong(4, error);
    BOOST_TEST(check.implausible() == (error == 0.0 ? 0 : 1));
    BOOST_TEST((check.q() - q).norm() < 1e-12);
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(a_surprise_after_a_wrong_sample_is_bridged_once_and_not_counted) {
  take(q, dq);
  move();
  take_wrong(2, 0.05);
  BOOST_TEST(check.implausible() == 1);
  const Vec7 q_expected = q + kPeriod * dq;
  dq[2] += 0.25;  // a blow, and then the arm as it is
  move();
  take(q, dq);
  BOOST_TEST(check.implausible() == 1);
  BOOST_TEST((check.q() - q_expected).norm() < 1e-12);
  move();
  take(q, dq);
  BOOST_TEST(check.implausible() == 0);
  BOOST_TEST((check.q() - q).norm() < 1e-12);
}

BOOST_AUTO_TEST_CASE(samples_that_go_on_to_repeat_are_no_old_ones) {
  move();
  take(q, dq);
  const Vec7 seen = q;
  for (int k = 0; k < StateCheck::kAgreed; ++k) take(seen, Vec7::Zero());
  BOOST_TEST((check.q() - seen).norm() > 1e-3);  // the prediction went on
  for (int k = 0; k < 100; ++k) take(seen, Vec7::Zero());
  BOOST_TEST((check.q() - seen).norm() < 1e-9);
  BOOST_TEST(check.dq().norm() < 1e-9);
  BOOST_TEST(check.implausible() == 0);
}

BOOST_AUTO_TEST_CASE(at_rest_every_sample_is_a_repeated_one_and_is_taken) {
  dq.setZero();
  check.reset(q, dq);
  for (int k = 0; k < 10; ++k) take(q, dq);
  BOOST_TEST((check.q() - q).norm() == 0.0);
  BOOST_TEST(check.implausible() == 0);
}

BOOST_AUTO_TEST_CASE(what_no_joint_can_do_is_not_believed_and_its_joint_is_named) {
  for (int i = 0; i < kNumJoints; ++i) {
    for (const bool is_speed : {false, true}) {
      check.reset(q, dq);
      move();
      Vec7 q_wrong = q, dq_wrong = dq;
      if (is_speed) {
        dq_wrong[i] += 5.0;
      } else {
        q_wrong[i] -= 0.05;
      }
      take(q_wrong, dq_wrong);
      BOOST_TEST(check.implausible() == 1);
      BOOST_TEST(check.joint() == i);
      BOOST_TEST((check.q() - q).norm() < 1e-12);
      BOOST_TEST((check.dq() - dq).norm() < 1e-12);
      move();
      take(q, dq);
      BOOST_TEST(check.implausible() == 0);
    }
  }
}

BOOST_AUTO_TEST_CASE(no_number_is_counted_and_never_believed) {
  for (int k = 1; k < 50; ++k) {
    move();
    Vec7 wrong = q;
    wrong[3] = kNaN;
    take(wrong, dq);
    BOOST_REQUIRE(check.implausible() == k);
    BOOST_REQUIRE(check.q().allFinite() && check.dq().allFinite());
  }
}

BOOST_AUTO_TEST_CASE(samples_that_agree_are_believed_after_all_and_not_before) {
  q[2] += 0.3;  // a sensor was set anew, or the link was down
  for (int k = 1; k <= StateCheck::kAgreed; ++k) {
    move();
    take(q, dq);
    BOOST_TEST(check.implausible() == k);
    BOOST_TEST(std::abs(check.q()[2] - q[2]) > 0.2);
  }
  move();
  take(q, dq);
  BOOST_TEST(check.implausible() == 0);
  BOOST_TEST((check.q() - q).norm() == 0.0);
}

BOOST_AUTO_TEST_CASE(samples_that_disagree_with_one_another_are_not_believed) {
  for (int k = 1; k <= 30; ++k) {
    move();
    take_wrong(2, k % 2 == 0 ? 0.3 : -0.3);
    BOOST_TEST(check.implausible() == k);
  }
}

BOOST_AUTO_TEST_SUITE_END()
