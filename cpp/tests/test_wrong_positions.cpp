#include <boost/test/unit_test.hpp>
#include <cmath>

#include "declared_arm.hpp"
#include "dovetail/servo_cycle.hpp"
#include "fake_cabinet.hpp"

using namespace dovetail;
using namespace dovetail::testing;
using fri::SessionState;

namespace {

constexpr double kMostTorque = 20.0;   // [Nm] that one wrong message may be worth
constexpr double kMostSpeed = 3.0;     // of dq_max: a sent position that ends a motion
constexpr double kMostApart = 0.1745;  // [rad]: from the measured one

ServoParams servo(double period) {
  ServoParams params;
  params.period = period;
  params.observer_gain = std::min(1.0, period / 0.005);
  return params;
}

/// An arm in motion behind a cabinet that judges the positions that it is sent.
struct Cell {
  ChainParams chain = iiwa14_with_tool();
  double period;
  LimitParams limits = declared_limits(period);
  ServoCycle cycle{servo(period), chain, declared_law(), limits, kUsualTask};
  RigidPlant plant{chain, chain, nominal_rotors()};
  FakeCabinet cabinet;
  Order order;
  Vec7 q_sent, tau = Vec7::Zero();
  double fastest = 0.0, apart = 0.0, step = 0.0;  // of what was sent

  explicit Cell(double period_) : period(period_) {
    cabinet.send_period = static_cast<std::uint32_t>(std::lround(1e3 * period));
    plant.reset(cabinet.q, Vec7::Zero());
    q_sent = cabinet.q;
    order.target.quat_wxyz_d = Vec4(0, 1, 0, 0);
    for (const auto state :
         {SessionState::kMonitoringWait, SessionState::kMonitoringReady,
          SessionState::kCommandingWait}) {
      cabinet.state = state;
      exchange();
    }
    cabinet.state = SessionState::kCommandingActive;
  }

  /// One message, its position wrong by this, and its answer.
  void exchange(const Vec7& error = Vec7::Zero()) {
    cabinet.q = plant.q() + error;
    const std::uint8_t* bytes = cabinet.message();
    const ServoCycle::Action action = cycle.receive(bytes, cabinet.size());
    order.motion = cycle.state().motion;
    ++order.serial;
    std::array<std::uint8_t, fri::kMaxDatagram> out{};
    std::size_t size = 0;
    if (action == ServoCycle::Action::kSend) size = cycle.reply(out.data());
    if (action == ServoCycle::Action::kAnswer) size = cycle.answer(order, out.data());
    const auto command = cabinet.read(out.data(), size);
    if (!command || !command->tau) return;
    judge(*command);
    plant.apply(tau, period);
  }

  void judge(const fri::CommandMessage& command) {
    const Vec7 q = vector(*command.q), now = vector(*command.tau);
    // Out of a motion the position that is sent is the cabinet's own.
    if (cycle.state().refusal == Refusal::kNone && cycle.state().motion > 0) {
      const Vec7 speed = (q - q_sent).cwiseAbs() / period;
      fastest = std::max(fastest, speed.cwiseQuotient(limits.dq_max).maxCoeff());
      apart = std::max(apart, (q - plant.q()).cwiseAbs().maxCoeff());
    }
    step = std::max(step, (now - tau).cwiseAbs().maxCoeff());
    q_sent = q;
    tau = now;
  }

  void pass(int cycles) {
    for (int k = 0; k < cycles; ++k) exchange();
  }

  /// Gets into motion, and forgets what that took.
  void go(double f_star) {
    order.target.f_star.head<3>() << 0.6 * f_star, f_star, 0.0;
    pass(static_cast<int>(0.15 / period));
    fastest = apart = step = 0.0;
  }

  bool is_stopped() const { return cycle.state().is_stopped; }
};

Vec7 wrong(int joint, double size) { return size * Vec7::Unit(joint); }

}  // namespace

BOOST_AUTO_TEST_SUITE(wrong_positions_behind_fri)

BOOST_AUTO_TEST_CASE(one_wrong_position_ends_no_motion_and_is_worth_a_bounded_torque) {
  double fastest = 0.0, apart = 0.0, step = 0.0;
  int spikes = 0;
  for (const double period : {0.001, 0.002, 0.005}) {
    for (const double size :
         {0.001, 0.002, 0.003, 0.004, 0.005, 0.01, 0.045, 0.08, 0.1, 0.25, 0.5}) {
      for (int joint = 0; joint < 7; ++joint) {
        for (const double f_star : {0.0, 1.5}) {
          Cell cell(period);
          cell.go(f_star);
          cell.exchange(wrong(joint, spikes++ % 2 == 0 ? size : -size));
          cell.pass(20);
          BOOST_TEST_INFO(period << " s, A" << joint + 1 << " " << size << " rad, "
                                 << describe(cell.cycle.state().facts));
          BOOST_TEST(!cell.is_stopped());
          BOOST_TEST(cell.cycle.state().is_plausible);
          fastest = std::max(fastest, cell.fastest);
          apart = std::max(apart, cell.apart);
          step = std::max(step, cell.step);
        }
      }
    }
  }
  BOOST_TEST_MESSAGE(spikes << " spikes: sent at " << fastest << " of dq_max, " << apart
                            << " rad apart, step " << step << " Nm");
  BOOST_TEST(fastest < 0.5 * kMostSpeed);
  BOOST_TEST(apart < 0.5 * kMostApart);
  BOOST_TEST(step <= kMostTorque);
}

BOOST_AUTO_TEST_CASE(two_large_wrong_positions_or_one_after_a_loss_end_none_either) {
  for (const double period : {0.001, 0.002, 0.005}) {
    for (int joint = 0; joint < 7; ++joint) {
      for (const double sign : {-1.0, 1.0}) {
        Cell pair(period), late(period);
        pair.go(1.0);
        pair.exchange(wrong(joint, 0.045));
        pair.exchange(wrong(joint, sign * 0.045));
        pair.pass(20);
        late.go(1.0);
        late.plant.apply(late.tau, period);
        ++late.cabinet.sequence;
        late.exchange(wrong(joint, sign * 0.08));
        late.pass(20);
        for (const Cell* cell : {&pair, &late}) {
          BOOST_TEST(!cell->is_stopped());
          BOOST_TEST(cell->fastest < 0.5 * kMostSpeed);
          BOOST_TEST(cell->apart < 0.5 * kMostApart);
          BOOST_TEST(cell->step <= kMostTorque);
        }
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(
    three_in_a_row_are_a_stop_and_what_is_sent_stays_where_the_arm_is) {
  Cell cell(0.001);
  cell.go(1.0);
  for (int k = 1; k <= 3; ++k) {
    cell.exchange(wrong(3, 0.08));
    BOOST_TEST(cell.is_stopped() == (k == 3));
  }
  BOOST_CHECK(cell.cycle.state().facts.reason == StopReason::kImplausible);
  BOOST_TEST(cell.cycle.state().facts.joint == 3);
  BOOST_TEST(cell.fastest < 0.5 * kMostSpeed);
}

BOOST_AUTO_TEST_CASE(no_motion_begins_at_a_wrong_position) {
  for (const double size : {0.005, 0.08, 0.5}) {
    Cell cell(0.001);
    cell.exchange(wrong(2, size));
    BOOST_CHECK(cell.cycle.state().refusal == Refusal::kStart);
    BOOST_TEST(cell.cycle.state().motion == 0);
    BOOST_TEST(cell.tau.norm() == 0.0);
    cell.pass(2);
    BOOST_TEST(cell.cycle.state().motion == 1);
    cell.pass(20);
    BOOST_TEST(!cell.is_stopped());
    BOOST_TEST((cell.q_sent - cell.plant.q()).cwiseAbs().maxCoeff() < 1e-3);
  }
}

/// Wrong positions once went past the watchdog's limit, and a stop was latched by one.
BOOST_AUTO_TEST_CASE(a_wrong_position_is_no_joint_past_its_limit) {
  Cell cell(0.001);
  cell.go(0.0);
  const double beyond = cell.limits.q_max[5] - cell.plant.q()[5] + 0.1;
  cell.exchange(wrong(5, beyond));
  BOOST_TEST(!cell.is_stopped());
  BOOST_TEST(cell.cycle.state().implausible == 1);
  cell.pass(5);
  BOOST_TEST(!cell.is_stopped());
}

/// A hold that came to rest in that message once drove the arm to where it never was.
BOOST_AUTO_TEST_CASE(an_arm_is_not_held_where_it_never_was) {
  Cell cell(0.005);
  cell.go(1.0);
  cell.cycle.watchdog().request_stop();
  int left = 1000;
  for (; !cell.cycle.state().is_at_rest && left > 0; --left) {
    cell.exchange(left % 4 == 0 ? wrong(1, 0.3) : Vec7(Vec7::Zero()));
  }
  BOOST_TEST(left > 0);
  const Vec7 rest = cell.plant.q();
  cell.pass(200);
  BOOST_TEST((cell.plant.q() - rest).cwiseAbs().maxCoeff() < 0.01);
}

BOOST_AUTO_TEST_CASE(the_log_has_what_was_measured_and_says_that_it_was_not_believed) {
  Cell cell(0.001);
  cell.go(0.0);
  const Vec7 before = cell.plant.q();
  cell.exchange(wrong(4, 0.08));
  const ServoState& state = cell.cycle.state();
  BOOST_TEST(!state.is_plausible);
  BOOST_TEST((state.q - before).norm() < 1e-4);
  std::vector<double> row(servo_columns().size());
  BOOST_REQUIRE(
      cell.cycle.log().copy(state.rows - 1, state.rows, row.size(), row.data()));
  const int q5 = column_at(offsetof(CycleRow, q)) + 4;
  BOOST_TEST(std::abs(row[q5] - before[4] - 0.08) < 1e-4);
  Flags flags;
  flags.implausible = true;
  const auto is_set =
      static_cast<std::int64_t>(row[column_at(offsetof(CycleRow, flags))]);
  BOOST_TEST((is_set & pack_flags(flags)) != 0);
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_AUTO_TEST_SUITE(what_the_cabinet_says_in_a_motion)

BOOST_AUTO_TEST_CASE(a_safety_stop_is_one_here_in_the_very_message) {
  for (const bool is_safety : {true, false}) {
    Cell cell(0.005);
    cell.go(1.0);
    if (is_safety) {
      cell.cabinet.safety = fri::SafetyState::kStop0;
    } else {
      cell.cabinet.drives = fri::DriveState::kOff;
    }
    cell.exchange();
    BOOST_TEST(cell.is_stopped());
    BOOST_CHECK(cell.cycle.state().facts.reason ==
                (is_safety ? StopReason::kSafety : StopReason::kDrivesOff));
    cell.cabinet.safety = fri::SafetyState::kNormal;
    cell.cabinet.drives = fri::DriveState::kActive;
    cell.exchange();
    BOOST_TEST(cell.is_stopped());
    cell.cycle.clear();
    cell.exchange();
    BOOST_TEST(!cell.is_stopped());
  }
}

BOOST_AUTO_TEST_CASE(what_ends_a_motion_is_known_afterwards) {
  const auto end_of = [](auto change) {
    Cell cell(0.005);
    cell.go(0.0);
    const FakeCabinet before = cell.cabinet;
    change(cell.cabinet);
    cell.exchange();
    const std::uint32_t sequence = cell.cabinet.sequence;
    cell.cabinet = before;
    cell.cabinet.sequence = sequence;
    cell.pass(3);
    BOOST_TEST(cell.cycle.state().motion == 2);  // it has gone on
    return cell.cycle.state().end;
  };
  using Cause = MotionEnd::Cause;
  const MotionEnd period = end_of([](FakeCabinet& c) { c.send_period = 10; });
  BOOST_CHECK(period.cause == Cause::kPeriod);
  BOOST_TEST(change_of(period).before == "5 ms");
  BOOST_TEST(change_of(period).after == "10 ms");
  const MotionEnd mode =
      end_of([](FakeCabinet& c) { c.mode = fri::CommandMode::kWrench; });
  BOOST_CHECK(mode.cause == Cause::kProblem);
  BOOST_TEST(change_of(mode).what == "clientCommandMode");
  BOOST_TEST(change_of(mode).before == "TORQUE");
  BOOST_TEST(change_of(mode).after == "WRENCH");
  const MotionEnd measured = end_of([](FakeCabinet& c) { c.sends_measured = false; });
  BOOST_TEST(change_of(measured).what == "measuredJointPosition");
  BOOST_TEST(change_of(measured).after == "missing");
  const MotionEnd ipo = end_of([](FakeCabinet& c) { c.sends_ipo = false; });
  BOOST_TEST(change_of(ipo).what == "ipoData.jointPosition");
  const MotionEnd joints = end_of([](FakeCabinet& c) { c.num_joints = 6; });
  BOOST_TEST(change_of(joints).after == "6");
}

BOOST_AUTO_TEST_SUITE_END()
