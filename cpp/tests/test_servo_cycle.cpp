#include <boost/test/unit_test.hpp>
#include <cmath>

#include "dovetail/rigid_plant.hpp"
#include "servo_bench.hpp"

using namespace dovetail;
using namespace dovetail::testing;
using fri::SessionState;
using Action = ServoCycle::Action;

BOOST_FIXTURE_TEST_SUITE(session, Loop)

BOOST_AUTO_TEST_CASE(each_state_gets_the_answer_it_needs) {
  cabinet.state = SessionState::kIdle;
  BOOST_CHECK(exchange() == Action::kNothing);
  cabinet.state = SessionState::kMonitoringWait;
  BOOST_CHECK(exchange() == Action::kSend);
  BOOST_TEST(!command->q.has_value());
  cabinet.state = SessionState::kMonitoringReady;
  BOOST_CHECK(exchange() == Action::kSend);
  cabinet.state = SessionState::kCommandingWait;
  BOOST_CHECK(exchange() == Action::kSend);
  BOOST_TEST((vector(*command->q) - cabinet.q).norm() == 0.0);
  BOOST_TEST(vector(*command->tau).norm() == 0.0);
  cabinet.state = SessionState::kCommandingActive;
  BOOST_CHECK(exchange() == Action::kAnswer);
  BOOST_TEST(command->q.has_value());
  BOOST_TEST(command->tau.has_value());
  BOOST_TEST(state().motion == 1);
  BOOST_TEST(state().tick == 1);
}

BOOST_AUTO_TEST_CASE(without_a_target_the_arm_is_held_where_it_is) {
  activate();
  BOOST_TEST(state().is_held);
  BOOST_TEST(vector(*command->tau).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(a_new_motion_follows_no_old_target) {
  activate();
  order.target.f_star[0] = 3.0;
  exchange();
  BOOST_TEST(vector(*command->tau).norm() > 1.0);
  go_to(SessionState::kMonitoringReady);
  cabinet.q[0] += 0.3;  // moved by hand, or by a program
  go_to(SessionState::kCommandingWait);
  go_to(SessionState::kCommandingActive);
  BOOST_TEST(state().motion == 2);
  BOOST_TEST(state().time == 0.0);
  BOOST_TEST(state().is_held);
  BOOST_TEST(state().dq.norm() == 0.0);
  BOOST_TEST(vector(*command->tau).norm() < 1e-9);
  BOOST_TEST((vector(*command->q) - cabinet.q).norm() < 1e-12);
}

BOOST_AUTO_TEST_CASE(another_period_is_not_commanded) {
  cabinet.send_period = 4;
  activate();
  BOOST_CHECK(state().refusal == Refusal::kPeriod);
  BOOST_TEST(vector(*command->tau).norm() == 0.0);
  BOOST_TEST(state().motion == 0);
}

BOOST_AUTO_TEST_CASE(a_cabinet_that_falls_silent_begins_again) {
  activate();
  cycle.lose_session();
  BOOST_CHECK(state().session == SessionState::kIdle);
  cabinet.sequence = 0;
  activate();
  BOOST_TEST(state().motion == 2);
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_FIXTURE_TEST_SUITE(time_and_signals, Loop)

BOOST_AUTO_TEST_CASE(lost_messages_count_as_time) {
  activate();
  const Vec7 speed = Vec7::Constant(0.1);
  double t = 0.0;
  for (int k = 1; k <= 20; ++k) {
    const int lost = k % 4 == 0 ? 2 : 0;
    lose(lost);
    t += kPeriod * (1 + lost);
    cabinet.q = tool_down_posture() + t * speed;
    order.target.joint_mode = true;
    order.target.q_d = cabinet.q + 0.2 * speed;  // asks for no acceleration
    new_target();
    exchange();
    BOOST_TEST(std::abs(state().time - t) < 1e-12);
  }
  BOOST_TEST(state().tick == 1 + 20 + 5 * 2);
  BOOST_TEST((state().dq - speed).cwiseAbs().maxCoeff() < 0.01);
  std::vector<double> rows(21 * servo_columns().size());
  BOOST_TEST(cycle.log().copy(0, 21, servo_columns().size(), rows.data()));
}

BOOST_AUTO_TEST_CASE(the_path_of_a_target_moves_on_with_the_time_of_its_cycles) {
  const double rate = 0.5;  // [rad/s] about world z
  const auto turned = [&](bool is_renewed) {
    Loop loop;
    loop.activate();
    const Vec4 start = RestingArm().quat;
    loop.order.target.quat_wxyz_d = start;
    loop.order.target.velocity_d[5] = rate;
    RigidPlant plant(chain, chain, {});
    plant.reset(loop.cabinet.q, Vec7::Zero());
    double age = 0.0;
    for (int k = 0; k < 12; ++k) {
      const int lost = k % 4 == 3 ? 1 : 0;
      loop.lose(lost);
      if (k > 0) age += kPeriod * (1 + lost);
      if (is_renewed) {
        const double half = 0.5 * rate * age;
        const Eigen::Quaterniond turn(std::cos(half), 0.0, 0.0, std::sin(half));
        const auto quat =
            turn * Eigen::Quaterniond(start[0], start[1], start[2], start[3]);
        loop.order.target.quat_wxyz_d << quat.w(), quat.x(), quat.y(), quat.z();
        loop.new_target();
      }
      loop.cabinet.q = plant.q();
      loop.exchange();
      plant.apply(vector(*loop.command->tau), kPeriod);
    }
    return plant.q();
  };
  const Vec7 held = turned(false);
  BOOST_TEST((held - cabinet.q).cwiseAbs().maxCoeff() > 0.01);
  BOOST_TEST((held - turned(true)).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(doubled_and_late_messages_change_nothing) {
  activate();
  exchange();
  const ServoState before = state();
  cabinet.sequence -= 1;
  BOOST_CHECK(exchange() == Action::kNothing);
  cabinet.sequence -= 2;
  BOOST_CHECK(exchange() == Action::kNothing);
  BOOST_TEST(state().tick == before.tick);
  BOOST_TEST(state().rows == before.rows);
}

BOOST_AUTO_TEST_CASE(garbage_changes_nothing) {
  activate();
  const ServoState before = state();
  std::array<std::uint8_t, 40> garbage;
  garbage.fill(0xff);
  BOOST_CHECK(cycle.receive(garbage.data(), garbage.size()) == Action::kNothing);
  BOOST_TEST(state().tick == before.tick);
  BOOST_CHECK(state().session == before.session);
}

BOOST_AUTO_TEST_CASE(the_position_command_is_the_measured_one_at_20_hz) {
  activate();
  const double w = std::tan(M_PI * 20.0 * kPeriod);
  Vec7 expected = cabinet.q, last = cabinet.q;
  std::mt19937_64 random(1);
  for (int k = 0; k < 50; ++k) {
    cabinet.q = tool_down_posture() + random_vector(random, 1e-3);
    expected = (w * (cabinet.q + last) + (1.0 - w) * expected) / (1.0 + w);
    last = cabinet.q;
    exchange();
    BOOST_TEST((vector(*command->q) - expected).norm() < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(gravity_is_never_added) {
  activate();
  order.target.joint_mode = true;
  order.target.q_d = cabinet.q;
  for (int k = 0; k < 10; ++k) exchange();
  BOOST_TEST(!state().is_held);
  ToolMotion motion;
  Chain(chain).tool_motion(cabinet.q, Vec7::Zero(), motion);
  BOOST_TEST(motion.g.norm() > 30.0);
  BOOST_TEST(vector(*command->tau).norm() < 1e-6);
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_FIXTURE_TEST_SUITE(holds_and_stops, Loop)

BOOST_AUTO_TEST_CASE(without_new_targets_a_moving_arm_comes_to_rest_and_stays) {
  activate();
  RigidPlant plant(chain, chain, {});
  plant.reset(cabinet.q, Vec7::Zero());
  const auto run = [&](int cycles, bool is_alive) {
    for (int k = 0; k < cycles; ++k) {
      cabinet.q = plant.q();
      if (is_alive) new_target();
      exchange();
      plant.apply(vector(*command->tau), kPeriod);
    }
  };
  order.target.f_star[0] = 1.0;
  run(40, true);
  BOOST_TEST(plant.dq().cwiseAbs().maxCoeff() > 0.1);
  run(29, false);  // 145 ms: still followed
  BOOST_TEST(!state().is_held);
  run(3, false);
  BOOST_TEST(state().is_held);
  BOOST_CHECK(state().facts.reason == StopReason::kTargetTimeout);
  run(200, false);
  BOOST_TEST(state().is_at_rest);
  const Vec7 held = plant.q();
  run(400, false);
  BOOST_TEST((plant.q() - held).cwiseAbs().maxCoeff() < 2e-3);
  run(20, true);
  BOOST_TEST(!state().is_held);
  BOOST_TEST(plant.dq().cwiseAbs().maxCoeff() > 0.02);
}

BOOST_AUTO_TEST_CASE(a_position_that_is_none_is_survived_and_leaves_nothing_behind) {
  for (const double bad : {2e3, -1e300}) {
    Loop loop;
    const Vec7 q = loop.cabinet.q;
    loop.order.target.joint_mode = true;
    loop.order.target.q_d = q;
    loop.activate();
    for (int k = 0; k < 5; ++k) loop.exchange();
    loop.cabinet.q[2] = bad;
    for (int k = 0; k < 4; ++k) {
      loop.exchange();
      BOOST_TEST(loop.state().is_stopped == (k > 1));  // the third is one too many
      BOOST_TEST(!loop.state().is_plausible);
      BOOST_TEST((loop.state().q - q).norm() < 1e-6);
      BOOST_TEST((vector(*loop.command->q) - q).norm() < 1e-9);
      BOOST_TEST(vector(*loop.command->tau).norm() < 1e-6);
      BOOST_TEST(loop.state().dq.norm() < 1e-6);
    }
    loop.cabinet.q = q;
    loop.exchange();
    BOOST_TEST(loop.state().dq.norm() < 1e-6);
    BOOST_TEST(loop.state().is_stopped);
    loop.cycle.watchdog().clear();
    loop.new_target();
    loop.order.target.q_d = q + Vec7::Constant(0.01);
    loop.exchange();
    BOOST_TEST(!loop.state().is_held);
    BOOST_TEST(vector(*loop.command->tau).norm() > 0.5);
    std::vector<double> row(servo_columns().size());
    const std::uint64_t last = loop.state().rows;
    BOOST_REQUIRE(loop.cycle.log().copy(last - 1, last, row.size(), row.data()));
    BOOST_TEST(row[column_at(offsetof(CycleRow, flags))] == 0.0);
  }
}

BOOST_AUTO_TEST_CASE(no_motion_begins_at_a_position_that_is_none) {
  const Vec7 q = cabinet.q;
  cabinet.q[4] = 1e300;
  activate();
  BOOST_TEST(state().motion == 0);
  BOOST_CHECK(state().refusal == Refusal::kProblem);
  cabinet.q = q;
  exchange();
  BOOST_CHECK(state().refusal == Refusal::kStart);  // nothing says that it is there
  exchange();
  BOOST_TEST(state().motion == 1);
  BOOST_TEST((vector(*command->q) - q).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(settings_that_are_no_number_are_refused_by_name) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refuse = [&](double ServoParams::* member, double value) {
    ServoParams spoilt;
    spoilt.*member = value;
    try {
      ServoCycle(spoilt, chain, OscParams{}, limits, kUsualTask);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  BOOST_TEST(refuse(&ServoParams::measured_sign, nan) ==
             "servo measured_sign is nan; allowed: -1 or 1");
  BOOST_TEST(refuse(&ServoParams::commanded_sign, 0.5).find("commanded_sign") != 0U);
  BOOST_TEST(refuse(&ServoParams::external_sign, nan).find("external_sign is nan") !=
             std::string::npos);
}

BOOST_AUTO_TEST_CASE(the_wrench_is_the_cabinets_where_it_sends_one) {
  activate();
  exchange();
  ChainTerms terms;
  Chain(chain).evaluate(cabinet.q, Vec7::Zero(), terms);
  Vec6 wrench;
  wrench << 7.0, -5.0, 3.0, 0.4, -0.3, 0.2;
  cabinet.tau_external = terms.J.transpose() * wrench;
  const auto logged = [&] {
    new_target();
    exchange();
    std::vector<double> row(servo_columns().size());
    const std::uint64_t last = state().rows;
    BOOST_REQUIRE(cycle.log().copy(last - 1, last, row.size(), row.data()));
    return Vec6(Eigen::Map<const Vec6>(row.data() +
                                       column_at(offsetof(CycleRow, wrench_force))));
  };
  BOOST_TEST((logged() - wrench).norm() < 1e-3);  // half a period ahead
  order.target.f_star[0] = 5.0;  // and the arm stands: something holds it back
  cabinet.sends_external = false;
  for (int k = 0; k < 100; ++k) logged();
  const Vec6 estimated = logged();
  BOOST_TEST(estimated.allFinite());
  BOOST_TEST(estimated[0] < -10.0);
}

BOOST_AUTO_TEST_CASE(an_external_torque_stops_until_cleared) {
  activate();
  order.target.f_star[0] = 1.0;
  cabinet.tau_external[1] = 0.7 * limits.tau_max[1];
  for (int k = 0; k < 5; ++k) {
    new_target();
    exchange();
  }
  BOOST_TEST(state().is_stopped);
  BOOST_CHECK(state().facts.reason == StopReason::kExternalTorque);
  cabinet.tau_external.setZero();
  new_target();
  exchange();
  BOOST_TEST(state().is_stopped);
  go_to(SessionState::kMonitoringReady);
  go_to(SessionState::kCommandingWait);
  go_to(SessionState::kCommandingActive);
  new_target();
  exchange();
  BOOST_TEST(state().is_stopped);  // a new motion does not end it
  cycle.watchdog().clear();
  exchange();
  BOOST_TEST(!state().is_stopped);
  BOOST_TEST(!state().is_held);
}

BOOST_AUTO_TEST_CASE(measured_and_commanded_torque_have_the_wires_signs) {
  activate();
  fri::MonitoringMessage m;
  Chain model(chain);
  const Vec7 load = model.gravity(cabinet.q);
  m.header.sequence = cabinet.sequence;
  m.num_joints = 7;
  m.q_measured = m.q_ipo = FakeCabinet::joints(cabinet.q);
  m.tau_measured = FakeCabinet::joints(-load);
  m.tau_commanded = FakeCabinet::joints(Vec7::Constant(-1.0));
  m.command_mode = fri::CommandMode::kTorque;
  m.connection =
      fri::ConnectionInfo{SessionState::kCommandingActive, fri::Quality::kGood, 5U, 1U};
  const std::size_t size = fri::encode_monitoring(m, fri::Version::k1_15, out.data());
  static_cast<void>(cycle.receive(out.data(), size));
  BOOST_TEST((state().tau_measured - load).norm() < 1e-12);
  BOOST_TEST((state().tau_commanded - Vec7::Ones()).norm() < 1e-12);
}

// src/dovetail/doctor/cabinet_spring.py computes the same
BOOST_AUTO_TEST_CASE(a_lean_is_reached_softly_and_ends_with_the_hold) {
  order.target.joint_mode = true;  // asks for no motion: this arm makes none
  order.target.q_d = cabinet.q;
  activate();
  exchange();
  const Vec7 straight = vector(*command->q);
  order.lean = Vec7::Constant(1.0);  // more than is allowed
  double expected = 0.0;
  for (int i = 0; i < 100; ++i) {
    new_target();
    exchange();
    expected += 10.0 * kPeriod * (kLeanMax - expected);
    const Vec7 lean = vector(*command->q) - straight;
    BOOST_TEST((lean.array() - expected).abs().maxCoeff() < 1e-9);
  }
  order.motion = 0;  // of no motion: the arm is held
  for (int i = 0; i < 300; ++i) exchange();
  BOOST_TEST((vector(*command->q) - straight).cwiseAbs().maxCoeff() < 1e-6);
}

BOOST_AUTO_TEST_SUITE_END()
