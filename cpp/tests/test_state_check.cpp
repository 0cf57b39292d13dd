#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>
#include <vector>

#include "arm.hpp"
#include "dovetail/rigid_plant.hpp"
#include "dovetail/state_check.hpp"
#include "dovetail/velocity_observer.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kPeriod = 0.001;
constexpr double kMostTorque = 20.0;  // [Nm] that one wrong sample may be worth

/// An arm whose inertia is 1 kg m2 in every joint, moving at 0.5 rad/s.
struct Check {
  LimitParams limits = limits_for(kPeriod);
  StateCheck check{limits, kPeriod};
  Vec7 q = tool_down_posture();
  Vec7 dq = Vec7::Constant(0.5);

  Check() { check.reset(q, dq); }

  void take(const Vec7& q_seen, const Vec7& dq_seen) {
    check.take(q_seen, dq_seen, Vec7::Zero(), Vec7::Zero(), Vec7::Ones(), kPeriod);
  }

  void move() { q += kPeriod * dq; }
};

/// The arm in closed loop, as a value: two of them can go on from the same cycle.
struct Loop {
  ChainParams chain = iiwa14_with_tool();
  Controller controller;
  RigidPlant plant;
  Target target;

  /// `LimitConfig.for_period` of a robot, and the rotors and friction of the nominal
  /// arm.
  static LimitParams limits(double period) {
    LimitParams limits = limits_for(period);
    const bool is_fast = period < 0.003;
    limits.kappa = is_fast ? 27.5 : 7.5;
    limits.delta_q = is_fast ? 0.012 : 0.045;
    limits.delta_v = is_fast ? 0.15 : 0.30;
    limits.delta_x = is_fast ? 0.015 : 0.020;
    limits.estimate_rate = limits.brake_rate = is_fast ? 60.0 : 50.0;
    limits.armature.setConstant(0.1);
    limits.damping.setConstant(0.5);
    return limits;
  }

  static OscParams law() {
    OscParams osc;
    osc.stiffness.tail<3>().setConstant(200.0);
    return osc;
  }

  static PlantParams nominal() {
    PlantParams params;
    params.armature.setConstant(0.1);
    params.damping.setConstant(0.5);
    return params;
  }

  Loop(double period, std::uint64_t seed)
      : controller(chain, law(), limits(period), kUsualTask, period),
        plant(chain, chain, nominal()) {
    std::mt19937_64 random(seed);
    const Vec7 q = tool_down_posture() + random_vector(random, 0.05);
    Vec3 p;
    Mat3 R;
    Chain(chain).pose(q, p, R);
    plant.reset(q, random_vector(random, 0.3));
    controller.reset(q, p, quat_of(R), plant.dq());
    target.quat_wxyz_d = quat_of(R);
    target.f_star.head<3>() = random_vector(random, 3.0).head<3>();
    plant.set_external_force(random_vector(random, 10.0).head<3>());
  }

  StepResult step(const Vec7& q_error = Vec7::Zero(),
                  const Vec7& dq_error = Vec7::Zero()) {
    const StepResult result =
        controller.step(plant.q() + q_error, plant.dq() + dq_error, target);
    plant.apply(result.tau, controller.period());
    return result;
  }
};

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
    Vec7 wrong = q;
    wrong[4] += error;
    take(wrong, dq);
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
    Vec7 blow = Vec7::Zero();
    blow[2] = 0.25;
    take(q + 0.5 * kPeriod * blow, dq + blow);
    if (is_real) {
      dq += blow;
      q += 0.5 * kPeriod * blow;
    }
    move();
    Vec7 wrong = q;
    wrong[4] += 0.05;
    take(wrong, dq);
    BOOST_TEST(check.implausible() == 1);
    if (!is_real) BOOST_TEST((check.dq() - dq).norm() < 1e-12);
    move();
    take(q, dq);
    BOOST_TEST(check.implausible() == 0);
    BOOST_TEST((check.q() - q).norm() < 1e-12);
    BOOST_TEST((check.dq() - dq).norm() < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(a_surprise_after_a_wrong_sample_is_bridged_once_and_not_counted) {
  take(q, dq);
  move();
  Vec7 wrong = q;
  wrong[2] += 0.05;
  take(wrong, dq);
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
    Vec7 wrong = q;
    wrong[2] += k % 2 == 0 ? 0.3 : -0.3;
    take(wrong, dq);
    BOOST_TEST(check.implausible() == k);
  }
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_AUTO_TEST_SUITE(closed_loop)

BOOST_AUTO_TEST_CASE(one_wrong_sample_of_any_size_is_worth_a_bounded_torque) {
  std::mt19937_64 random(5);
  double worst = 0.0, after = 0.0;
  int believed = 0, refused = 0;
  for (const double period : {0.001, 0.005}) {
    for (int episode = 0; episode < 30; ++episode) {
      Loop right(period, 100 + episode);
      for (int k = 0; k < 30; ++k) static_cast<void>(right.step());
      for (int error = 0; error < 20; ++error) {
        const double size = std::pow(10.0, random_vector<Vec3>(random, 3.0)[0] - 2.0);
        const int i = static_cast<int>(random() % 14);
        Vec7 q_error = Vec7::Zero(), dq_error = Vec7::Zero();
        (i < 7 ? q_error[i] : dq_error[i - 7]) = error % 2 == 0 ? size : -size;
        if (error % 7 == 0) q_error = random_vector(random, size);
        Loop a = right, b = right;
        const StepResult good = a.step(), bad = b.step(q_error, dq_error);
        (bad.flags.implausible ? refused : believed) += 1;
        worst = std::max(worst, (good.tau - bad.tau).cwiseAbs().maxCoeff());
        const StepResult good_next = a.step(), bad_next = b.step();
        after = std::max(after, (good_next.tau - bad_next.tau).cwiseAbs().maxCoeff());
      }
    }
  }
  BOOST_TEST_MESSAGE("worst torque step " << worst << " Nm, then " << after);
  BOOST_TEST(worst <= kMostTorque);
  BOOST_TEST(after <= kMostTorque);
  BOOST_TEST(worst > 1.0);
  BOOST_TEST(believed > 100);
  BOOST_TEST(refused > 100);
}

/// Bursts of wrong positions as an FRI client has them, its velocity made of them: they
/// once left the believed state behind, and the torque with it, for 20 cycles.
BOOST_AUTO_TEST_CASE(a_burst_of_wrong_positions_is_worth_a_bounded_step_and_is_over) {
  std::mt19937_64 random(6);
  for (const double period : {0.001, 0.005}) {
    double worst = 0.0;
    for (int episode = 0; episode < 40; ++episode) {
      Loop loop(period, 300 + episode);
      VelocityObserver observer(period, std::min(1.0, period / 0.005));
      observer.reset(loop.plant.q());
      loop.plant.reset(loop.plant.q(), Vec7::Zero());
      loop.controller.believe(loop.plant.q(), Vec7::Zero());
      const double size = std::pow(10.0, random_vector<Vec3>(random, 1.0)[0] - 2.0);
      const Vec7 error = random_vector(random, size);
      const int first = 40, last = first + 1 + episode % 5;
      StepResult before;
      for (int k = 0; k < last + 20; ++k) {
        const bool is_bad = k >= first && k < last;
        const double sign = episode % 3 == 0 && k % 2 == 0 ? -1.0 : 1.0;
        const Vec7 seen = loop.plant.q() + (is_bad ? Vec7(sign * error) : Vec7::Zero());
        const Vec7 dq = k == 0 ? observer.dq() : observer.update(seen, before.a);
        const StepResult result = loop.controller.step(seen, dq, loop.target);
        if (k >= first && k <= last + 10) {
          worst = std::max(worst, (result.tau - before.tau).cwiseAbs().maxCoeff());
        }
        loop.plant.apply(result.tau, period);
        before = result;
      }
      const StateCheck& check = loop.controller.state();
      BOOST_TEST(check.implausible() == 0);
      BOOST_TEST(!check.is_in_doubt());
    }
    BOOST_TEST_MESSAGE("worst torque step " << worst << " Nm");
    BOOST_TEST(worst <= kMostTorque);
    BOOST_TEST(worst > 1.0);
  }
}

BOOST_AUTO_TEST_CASE(the_first_lost_sample_changes_nothing_and_the_second_is_held) {
  Loop loop(0.001, 3);
  for (int k = 0; k < 50; ++k) static_cast<void>(loop.step());
  Loop blind = loop;
  const Vec7 lost = Vec7::Constant(kNaN);
  const StepResult good = loop.step(), first = blind.step(lost);
  BOOST_TEST(first.flags.implausible);
  BOOST_TEST(first.flags.bad_input);
  BOOST_TEST((first.tau - good.tau).cwiseAbs().maxCoeff() < 0.5);
  const StepResult second = blind.step(lost);
  BOOST_TEST(second.flags.implausible);
  BOOST_TEST(second.flags.bad_input);
  BOOST_TEST(second.a.dot(blind.controller.state().dq()) < 0.0);  // it brakes
  const StepResult again = blind.step();
  BOOST_TEST(!again.flags.implausible);
  BOOST_TEST(!again.flags.bad_input);
}

BOOST_AUTO_TEST_CASE(a_jump_that_stays_is_a_damped_hold_until_it_is_believed) {
  Loop loop(0.001, 4);
  for (int k = 0; k < 50; ++k) static_cast<void>(loop.step());
  Vec7 jump = Vec7::Zero();
  jump[4] = 0.2;
  for (int k = 1; k <= StateCheck::kAgreed + 1; ++k) {
    const StepResult result = loop.step(jump);
    BOOST_TEST(result.flags.implausible == (k <= StateCheck::kAgreed));
    BOOST_TEST(result.flags.bad_input == (k > 1 && k <= StateCheck::kAgreed));
  }
}

BOOST_AUTO_TEST_SUITE_END()
