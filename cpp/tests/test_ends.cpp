#include <boost/test/unit_test.hpp>
#include <cmath>

#include "dovetail/rigid_plant.hpp"
#include "dovetail/servo_cycle.hpp"
#include "fake_cabinet.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kPeriod = 0.001;

/// What a hold acts against, and how a motion ends that the last line saw.
struct Arm : RestingArm {
  LimitParams limits = limits_for(kPeriod);

  Arm() { limits.walls = false; }

  Controller controller() const {
    Controller controller(chain, {}, limits, kUsualTask, kPeriod);
    controller.reset(q, p, quat);
    return controller;
  }

  /// Presses against what does not give way: the estimate takes it for a push.
  void press(Controller& pinned, int cycles) {
    target.f_star << 0.0, 10.0, 10.0, 0.0, 0.0, 0.0;
    for (int k = 0; k < cycles; ++k) {
      static_cast<void>(pinned.step(q, Vec7::Zero(), target));
    }
  }

  /// A7 moves like this until the last line sees it. \param speed  by time [s]
  template <typename Speed>
  void move_a7(Controller& pinned, EndCause cause, const Speed& speed) {
    Vec7 dq = Vec7::Zero();
    for (int k = 0; k < 100; ++k) {
      dq[6] = speed(kPeriod * k);
      q[6] += kPeriod * dq[6];
      if (pinned.step(q, dq, target).flags.ended) {
        BOOST_CHECK(pinned.end().cause() == cause);
        return;
      }
      BOOST_REQUIRE(pinned.state().implausible() == 0);
    }
    BOOST_FAIL("the motion was not ended");
  }

  void oscillate(Controller& pinned) {
    move_a7(pinned, EndCause::kOscillation,
            [](double t) { return 0.5 * std::sin(2.0 * M_PI * 50.0 * t); });
  }

  void race(Controller& pinned) {
    const double most = 0.999 * limits.dq_max[6];
    move_a7(pinned, EndCause::kSpeed,
            [&](double t) { return std::min(200.0 * t, most); });
  }
};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(holds, Arm)

BOOST_AUTO_TEST_CASE(no_push_is_estimated_to_be_stronger_than_the_motor) {
  limits.estimate_rate = 1000.0;
  limits.armature[6] = 0.3;
  limits.last_line = false;
  for (const double sign : {1.0, -1.0}) {
    Controller pushed = controller();
    Vec7 dq = Vec7::Zero();
    dq[6] = -2.5 * sign;
    pushed.believe(q, dq);
    double largest = 0.0;
    for (int k = 0; k < 25; ++k) {
      static_cast<void>(pushed.step(q, dq, target));
      BOOST_REQUIRE(pushed.state().implausible() == 0);
      largest = std::max(largest, sign * pushed.disturbance()[6]);
      dq[6] += 0.2 * sign;  // 200 rad/s2: 60 Nm
      q[6] += kPeriod * dq[6];
    }
    BOOST_TEST(largest == limits.tau_max[6]);
  }
}

BOOST_AUTO_TEST_CASE(a_hold_acts_against_twelve_hundredths_of_a_motor_or_ten_nm) {
  limits.ddq_max.setConstant(1e3);
  Controller pinned = controller();
  press(pinned, 300);
  target.joint_mode = true;
  target.q_d = q;
  const StepResult held = pinned.step(q, Vec7::Zero(), target);
  const Vec7 r = pinned.disturbance();
  const Vec7 most = (0.12 * limits.tau_max).cwiseMax(10.0).eval();
  BOOST_TEST(((r.cwiseAbs() - most).array() > 0.0).count() >= 2);
  BOOST_TEST(((r.cwiseAbs() - most).array() < 0.0).count() >= 2);
  const Vec7 asked = pinned.inertia() * held.a0 + pinned.bias();
  // The same share in every joint: cut joint by joint it is no pull at the tool any
  // more, and drives the joints round a tool that something holds.
  const double share = 1.0 / r.cwiseQuotient(most).cwiseAbs().maxCoeff();
  BOOST_TEST((asked + share * r).norm() < 1e-9);
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_FIXTURE_TEST_SUITE(ends, Arm)

BOOST_AUTO_TEST_CASE(after_an_oscillation_the_arm_holds_weight_and_not_what_came_late) {
  Controller pinned = controller();
  press(pinned, 60);
  const Vec7 r = pinned.disturbance();
  BOOST_TEST(r.norm() > 50.0);
  oscillate(pinned);
  const Vec7 held = pinned.disturbance();
  BOOST_TEST(held.head<6>().norm() < 0.7 * r.head<6>().norm());
  BOOST_TEST(held.head<6>().norm() > 0.2 * r.head<6>().norm());
}

BOOST_AUTO_TEST_CASE(after_an_oscillation_a_joint_at_its_limit_keeps_its_load) {
  for (const double sign : {1.0, -1.0}) {
    Arm arm;
    arm.limits.delta_q = 0.02;
    (sign > 0.0 ? arm.limits.q_max : arm.limits.q_min)[1] = arm.q[1] + sign * 0.01;
    Controller pinned = arm.controller();
    arm.press(pinned, 60);
    const Vec7 r = pinned.disturbance();
    BOOST_TEST(std::abs(r[1]) > 5.0);
    arm.oscillate(pinned);
    const Vec7 held = pinned.disturbance();
    BOOST_TEST(std::abs(held[1]) > 0.9 * std::abs(r[1]));
    BOOST_TEST(std::abs(held[0]) < 0.7 * std::abs(r[0]));
  }
}

BOOST_AUTO_TEST_CASE(a_joint_that_is_too_fast_is_braked_against_what_pushes_it) {
  Controller pinned = controller();
  press(pinned, 60);
  const Vec7 r = pinned.disturbance();
  race(pinned);
  const Vec7 held = pinned.disturbance();
  BOOST_TEST(held.head<6>().norm() > 0.9 * r.head<6>().norm());
}

BOOST_AUTO_TEST_CASE(after_the_end_a_limit_takes_torque_of_its_own_joint_alone) {
  // Torques of the others, which would keep their accelerations, loaded a spring at the
  // tool until the arm ran away.
  for (const double sign : {1.0, -1.0}) {
    Arm arm;
    Arm near;
    (sign > 0.0 ? near.limits.q_max : near.limits.q_min)[2] = arm.q[2] + sign * 0.05;
    Controller far_off = arm.controller();
    Controller at_limit = near.controller();
    arm.race(far_off);
    near.race(at_limit);
    Vec7 q = arm.q, dq = Vec7::Zero();
    far_off.believe(q, dq);
    at_limit.believe(q, dq);
    Vec7 change = Vec7::Zero();
    for (int k = 0; k < 200 && change.isZero(0.0); ++k) {
      dq[2] = sign * std::min(0.03 * k, 0.6);
      q += kPeriod * dq;
      const StepResult free = far_off.step(q, dq, arm.target);
      const StepResult kept = at_limit.step(q, dq, arm.target);
      BOOST_REQUIRE(at_limit.state().implausible() == 0);
      change = kept.tau - free.tau;
    }
    BOOST_TEST(sign * change[2] < -0.01);
    change[2] = 0.0;
    BOOST_TEST(change.norm() < 1e-9);
  }
}

BOOST_AUTO_TEST_CASE(after_the_end_limiters_are_passive_until_it_is_resumed) {
  limits.passive = false;
  Controller pinned = controller();
  const auto cancels = [&] {  // what pushes, beside +-A
    const Vec7 push = pinned.inverse_inertia() * pinned.disturbance();
    BOOST_TEST(push.cwiseAbs().maxCoeff() > 2.0);
    return (pinned.bounds().ub - (limits.ddq_max - push)).norm() < 1e-9;
  };
  press(pinned, 60);
  BOOST_TEST(cancels());
  oscillate(pinned);
  pinned.believe(q, Vec7::Zero());
  press(pinned, 60);
  BOOST_TEST(!cancels());
  pinned.resume();
  press(pinned, 1);
  BOOST_TEST(cancels());
}

BOOST_AUTO_TEST_CASE(an_axis_that_is_let_go_explains_what_it_changes) {
  const auto swing = [&](bool is_let_go) {
    Controller watched = controller();
    Target held = target;
    held.stay = is_let_go ? 7 : 0;
    Vec7 at = q, dq = Vec7::Zero();
    StepResult result;
    const auto move = [&](double speed) {
      dq[0] = speed;
      at += kPeriod * dq;
      result = watched.step(at, dq, held);
      BOOST_REQUIRE(watched.state().implausible() == 0);
    };
    for (int k = 0; k < 50; ++k) move(0.0);
    for (int k = 0; k < 800; ++k) move(0.15 * std::sin(M_PI * k / 800));
    held.stay = 0;
    for (int k = 0; k < 280; ++k) move(0.13 * std::sin(2.0 * M_PI * 0.01 * k));
    return result.flags.ended;
  };
  BOOST_TEST(!swing(true));
  BOOST_TEST(swing(false));
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_FIXTURE_TEST_SUITE(doubts, Arm)

BOOST_AUTO_TEST_CASE(what_was_begun_slowly_is_ended_slowly_when_the_doubt_is_over) {
  limits.armature.setConstant(0.1);
  limits.tau_max *= 2.0;
  limits.ddq_max *= 4.0;
  const auto largest_step = [&](bool is_deceived) {
    Controller asked = controller();
    PlantParams rotors;
    rotors.armature = limits.armature;
    RigidPlant plant(chain, chain, rotors);
    plant.reset(q, Vec7::Zero());
    target.f_star.setZero();
    Vec7 tau = Vec7::Zero();
    double largest = 0.0;
    for (int k = 0; k < 40; ++k) {
      if (k == 20) target.f_star.head<3>() << 20.0, 20.0, 20.0;
      Vec7 seen = plant.q();
      if (is_deceived && k == 10) seen[6] += 0.1;
      const Vec7 next = asked.step(seen, plant.dq(), target).tau;
      largest = std::max(largest, (next - tau).cwiseAbs().maxCoeff());
      BOOST_REQUIRE(asked.state().is_in_doubt() == (is_deceived && k >= 10 && k <= 20));
      tau = next;
      plant.apply(tau, kPeriod);
    }
    return largest;
  };
  BOOST_TEST(largest_step(false) > 50.0);
  BOOST_TEST(largest_step(true) < 18.0 + 1e-9);
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_AUTO_TEST_SUITE(behind_fri)

BOOST_AUTO_TEST_CASE(what_the_last_line_ended_is_a_stop_with_its_reason) {
  const double period = 0.005;
  const LimitParams limits = limits_for(period);
  FakeCabinet cabinet;
  ServoCycle cycle(ServoParams{}, iiwa14_with_tool(), OscParams{}, limits, kUsualTask);
  Order order;
  order.target.quat_wxyz_d = Vec4(0, 1, 0, 0);
  std::array<std::uint8_t, fri::kMaxDatagram> out;
  const auto exchange = [&] {
    const std::uint8_t* bytes = cabinet.message();
    const auto action = cycle.receive(bytes, cabinet.size());
    if (action == ServoCycle::Action::kSend) cycle.reply(out.data());
    if (action == ServoCycle::Action::kAnswer) cycle.answer(order, out.data());
    order.motion = cycle.state().motion;
    ++order.serial;
  };
  for (int state = 1; state <= 4; ++state) {
    cabinet.state = static_cast<fri::SessionState>(state);
    exchange();
  }
  double speed = 0.0;  // of A7, beyond what its margin leaves and below its limit
  for (int k = 0; k < 60 && !cycle.state().is_stopped; ++k) {
    speed = std::min(speed + 0.2, 0.99 * limits.dq_max[6]);
    cabinet.q[6] += period * speed;
    exchange();
  }
  const StopFacts& facts = cycle.state().facts;
  BOOST_TEST(cycle.state().is_stopped);
  BOOST_CHECK(facts.reason == StopReason::kLastLine);
  BOOST_CHECK(facts.end == EndCause::kSpeed);
  BOOST_TEST(facts.joint == 6);
  BOOST_TEST(facts.value > facts.limit);
  BOOST_TEST(facts.limit == (1.0 - 0.4 * limits.delta_v) * limits.dq_max[6]);
  cabinet.state = fri::SessionState::kMonitoringReady;
  exchange();
  for (int state = 3; state <= 4; ++state) {
    cabinet.state = static_cast<fri::SessionState>(state);
    exchange();
  }
  exchange();
  BOOST_TEST(cycle.state().is_stopped);  // a new motion does not end it
}

BOOST_AUTO_TEST_SUITE_END()
