#include <boost/test/unit_test.hpp>

#include "checked_arm.hpp"

using namespace dovetail;
using namespace dovetail::testing;

BOOST_FIXTURE_TEST_SUITE(lost_messages, Check)

/// A tool was pushed, or slipped off, meanwhile: the arm must not be blind then.
BOOST_AUTO_TEST_CASE(messages_that_were_lost_and_not_told_are_counted_by_the_way) {
  const Vec7 one = 80.0 * Vec7::Unit(5), all = Vec7::Constant(50.0);
  for (const Vec7& push : {Vec7(0.0 * all), one, Vec7(-one), all}) {
    for (int lost = 2; lost <= 5; ++lost) {
      start(Vec7::Constant(1.2));
      for (int k = 0; k <= lost; ++k) {
        move();
        q += 0.5 * kPeriod * kPeriod * push;
        dq += kPeriod * push;
      }
      take(q, dq);
      BOOST_TEST(check.implausible() == 0);
      BOOST_TEST(check.missed() == lost * kPeriod);
      BOOST_TEST(check.is_jump());
      BOOST_TEST((check.q() - q).norm() < 1e-12);
      move();
      take(q, dq);
      BOOST_TEST(check.implausible() == 0);
      BOOST_TEST(check.missed() == 0.0);
      BOOST_TEST((check.q() - q).norm() < 1e-12);
    }
  }
}

BOOST_AUTO_TEST_CASE(what_only_one_of_the_joints_shows_is_no_lost_message) {
  for (const double error : {2.4e-3, 4.8e-3, 6e-3, 0.02}) {
    start(Vec7::Constant(1.2));
    move();
    take_wrong(2, error);
    BOOST_TEST(check.implausible() == 1);
    BOOST_TEST(check.missed() == 0.0);
    move();
  }
  start(Vec7::Zero());  // at rest, its speed made of positions
  take(q + 2e-3 * Vec7::Unit(2), 0.8 * Vec7::Unit(2));
  BOOST_TEST(check.implausible() == 1);
  BOOST_TEST(check.missed() == 0.0);
}

BOOST_AUTO_TEST_CASE(a_wrong_sample_that_was_taken_for_a_late_one_is_taken_back) {
  start(1.2 * Vec7::Unit(2));
  move();
  take_wrong(2, 3.0 * kPeriod * dq[2]);
  BOOST_TEST(check.missed() == 3.0 * kPeriod);
  move();
  take(q, dq);
  BOOST_TEST(check.is_return());
  BOOST_TEST((check.q() - q).norm() < 1e-12);
  BOOST_TEST((check.dq() - dq).norm() < 1e-12);
}

/// Else four true samples would be refused, and the arm stopped.
BOOST_AUTO_TEST_CASE(so_is_one_that_comes_soon_after_a_surprise) {
  for (int later = 0; later < 5; ++later) {
    start(Vec7::Unit(0));
    move();
    surprise(true);
    BOOST_TEST(check.is_jump());
    for (int k = 0; k < later; ++k) {
      move();
      take(q, dq);
    }
    move();
    take(q + 3.0 * kPeriod * dq, dq);
    BOOST_TEST(check.missed() == 3.0 * kPeriod);
    for (int k = 0; k < 5; ++k) {
      move();
      take(q, dq);
      BOOST_TEST(check.implausible() == 0);
      BOOST_TEST((check.q() - q).norm() < 1e-12);
    }
  }
}

BOOST_AUTO_TEST_CASE(joints_that_are_fast_at_once_are_no_lost_message) {
  start(1.2 * Vec7::Unit(0));
  move();
  Vec7 fast = limits.dq_max;
  fast[0] = dq[0];
  take(q + 3.0 * kPeriod * dq, fast);
  BOOST_TEST(check.missed() == 0.0);
  BOOST_TEST(check.implausible() == 1);
}

BOOST_AUTO_TEST_CASE(a_reset_forgets_them) {
  start(Vec7::Constant(1.2));
  take(q + 4.0 * kPeriod * dq, dq);
  BOOST_TEST(check.missed() > 0.0);
  check.reset(q, dq);
  BOOST_TEST(check.missed() == 0.0);
}

BOOST_AUTO_TEST_SUITE_END()
