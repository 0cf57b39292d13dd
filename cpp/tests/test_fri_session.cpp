#include <boost/test/unit_test.hpp>
#include <limits>

#include "dovetail/fri_session.hpp"
#include "fri_fixtures.hpp"

using namespace dovetail::fri;
using namespace dovetail::fri::testing;

namespace {

using S = SessionState;
constexpr S kStates[] = {S::kIdle, S::kMonitoringWait, S::kMonitoringReady,
                         S::kCommandingWait, S::kCommandingActive};
constexpr Joints kIpo = {1, 2, 3, 4, 5, 6, 7};
constexpr Joints kMeasured = {1.1, 2.1, 3.1, 4.1, 5.1, 6.1, 7.1};
constexpr Joints kFiltered = {0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7};
constexpr Joints kTau = {7, 6, 5, 4, 3, 2, 1};

/// A session and the cabinet it hears, one message per call.
struct Loop {
  explicit Loop(Version version = Version::k1_15) : session(version) {
    message.q_measured = kMeasured;
    message.q_commanded = kIpo;
    message.connection = ConnectionInfo{S::kIdle, Quality::kGood, 5u, 1u};
    message.header.sequence = 100;
  }

  /// The next message in this state, after `lost` that never came.
  SessionStep next(S state, std::uint32_t lost = 0) {
    message.header.sequence += lost + 1;
    message.connection->state = state;
    const bool is_commanding = state >= S::kCommandingWait;
    message.q_ipo = is_commanding && has_ipo ? std::optional(kIpo) : std::nullopt;
    message.command_mode = is_commanding ? mode : CommandMode::kNone;
    return session.receive(message);
  }
  SessionStep again() { return session.receive(message); }
  SessionStep at(std::uint32_t sequence) {
    MonitoringMessage old = message;
    old.header.sequence = sequence;
    return session.receive(old);
  }
  const CommandMessage& answer() { return session.answer(kFiltered, kTau); }

  /// Along the usual road to a state.
  void go(S state) {
    for (const S s : kStates) {
      next(s);
      if (s == state) return;
    }
  }

  FriSession session;
  MonitoringMessage message;
  CommandMode mode = CommandMode::kTorque;
  bool has_ipo = true;
};

Reply reply_in(S state) {
  if (state == S::kIdle) return Reply::kNothing;
  if (state == S::kCommandingWait) return Reply::kMirror;
  return state == S::kCommandingActive ? Reply::kActive : Reply::kHeader;
}

}  // namespace

BOOST_AUTO_TEST_CASE(each_state_has_its_answer) {
  Loop loop;
  BOOST_TEST((loop.next(S::kIdle).reply == Reply::kNothing));
  for (const S state : {S::kMonitoringWait, S::kMonitoringReady}) {
    BOOST_TEST((loop.next(state).reply == Reply::kHeader));
    const CommandMessage& answer = loop.answer();
    BOOST_TEST((!answer.q && !answer.tau && !answer.wrench));
  }
  BOOST_TEST((loop.next(S::kCommandingWait).reply == Reply::kMirror));
  BOOST_TEST((loop.answer().q == kIpo && loop.answer().tau == Joints{}));
  BOOST_TEST((loop.next(S::kCommandingActive).reply == Reply::kActive));
  BOOST_TEST((loop.answer().q == kFiltered && loop.answer().tau == kTau));
  BOOST_TEST(loop.session.diagnose() == "");
}

BOOST_AUTO_TEST_CASE(a_message_without_connection_data_is_idle) {
  Loop loop;
  loop.go(S::kCommandingActive);
  loop.message.header.sequence++;
  loop.message.connection.reset();
  const SessionStep step = loop.again();
  BOOST_TEST((step.state == S::kIdle && step.reply == Reply::kNothing));
}

BOOST_AUTO_TEST_CASE(headers_count_our_answers_and_reflect_the_cabinets_count) {
  Loop loop;
  loop.next(S::kMonitoringWait);
  for (std::uint32_t k = 0; k < 5; ++k) {
    loop.next(S::kMonitoringWait);
    const Header header = loop.answer().header;
    BOOST_TEST(header.sequence == k);
    BOOST_TEST(header.reflected == loop.message.header.sequence);
  }
  BOOST_TEST(loop.session.counters().sent == 5u);
  BOOST_TEST(loop.session.counters().accepted == 6u);
}

BOOST_AUTO_TEST_CASE(the_answer_is_the_bytes_of_kukas_client) {
  for (const auto& [version, text] :
       {std::pair(Version::k1_15, kTorque), std::pair(Version::k2_7, kTorque27)}) {
    Loop loop(version);
    loop.message.header.sequence = UINT32_MAX;
    std::uint8_t out[kMaxDatagram];
    for (int k = 0; k < 131; ++k) {
      loop.next(S::kMonitoringWait);
      loop.session.answer(kFiltered, kTau, out);
    }
    loop.message.header.sequence = 131;
    loop.message.connection->state = S::kCommandingWait;
    loop.message.q_ipo = kGoldenQ;
    loop.message.command_mode = CommandMode::kTorque;
    BOOST_TEST(loop.again().missed == 0u);
    const std::size_t size = loop.session.answer(kFiltered, kTau, out);
    BOOST_TEST(Bytes(out, out + size) == hex(text), boost::test_tools::per_element());
  }
}

BOOST_AUTO_TEST_CASE(every_transition_is_followed_and_odd_ones_are_counted) {
  const bool legal[5][5] = {
      // to IDLE, M_WAIT, M_READY, C_WAIT, C_ACTIVE
      {true, true, true, true, true},  // the first message a client hears of a session
      {true, true, true, false, false}, {true, true, true, true, false},
      {true, true, true, true, true},   {true, true, true, false, true},
  };
  for (int from = 0; from < 5; ++from) {
    for (int to = 0; to < 5; ++to) {
      Loop loop;
      loop.go(kStates[from]);
      const SessionCounters before = loop.session.counters();
      const SessionStep step = loop.next(kStates[to]);
      const SessionCounters& after = loop.session.counters();
      BOOST_TEST_CONTEXT(name(kStates[from]) << " to " << name(kStates[to])) {
        BOOST_TEST((step.previous == kStates[from] && step.state == kStates[to]));
        BOOST_TEST(step.is_new);
        const bool is_odd = !legal[from][to];
        BOOST_TEST(after.odd_transitions - before.odd_transitions ==
                   (is_odd ? 1u : 0u));
        const bool is_refused = is_odd && to == 4;
        BOOST_TEST(
            (step.problem == (is_refused ? Problem::kTransition : Problem::kNone)));
        BOOST_TEST(
            (step.reply == (is_refused ? Reply::kMirror : reply_in(kStates[to]))));
        BOOST_TEST(step.is_new_session == (from == 0 && to != 0));
        BOOST_TEST(step.is_first_active == (to == 4 && from != 4));
        BOOST_TEST(after.motions - before.motions == (to == 4 && from != 4 ? 1u : 0u));
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(a_refused_motion_stays_refused_until_it_ends) {
  Loop loop;
  loop.go(S::kMonitoringReady);
  for (int k = 0; k < 5; ++k) {
    BOOST_TEST((loop.next(S::kCommandingActive).problem == Problem::kTransition));
    BOOST_TEST((loop.answer().q == kIpo && loop.answer().tau == Joints{}));
  }
  BOOST_TEST(
      loop.session.diagnose().starts_with("the cabinet became COMMANDING_ACTIVE"));
  loop.next(S::kMonitoringReady);
  loop.next(S::kCommandingWait);
  BOOST_TEST((loop.next(S::kCommandingActive).reply == Reply::kActive));
}

BOOST_AUTO_TEST_CASE(behind_lost_messages_every_state_may_come) {
  Loop loop;
  loop.go(S::kMonitoringReady);
  const SessionStep step = loop.next(S::kCommandingActive, 20);
  BOOST_TEST((step.reply == Reply::kActive));
  BOOST_TEST(step.is_first_active);
  BOOST_TEST(loop.session.counters().odd_transitions == 0u);
}

BOOST_AUTO_TEST_CASE(a_client_that_starts_late_joins_in_any_state) {
  for (const S state : kStates) {
    Loop loop;
    const SessionStep step = loop.next(state);
    BOOST_TEST((step.reply == reply_in(state)));
    BOOST_TEST(step.missed == 0u);
    BOOST_TEST(step.is_new_session == (state != S::kIdle));
    BOOST_TEST(step.is_first_active == (state == S::kCommandingActive));
  }
}

BOOST_AUTO_TEST_CASE(answers_come_once_per_multiplier) {
  for (const std::uint32_t multiplier : {0u, 1u, 2u, 3u, 4u, 5u}) {
    Loop loop;
    loop.message.connection->receive_multiplier = multiplier;
    const std::uint32_t every = std::max(multiplier, 1u);
    for (std::uint32_t k = 1; k <= 60; ++k) {
      const SessionStep step = loop.next(S::kMonitoringWait);
      BOOST_TEST((step.reply == (k % every == 0 ? Reply::kHeader : Reply::kNothing)));
      BOOST_TEST(step.is_new);
    }
  }
  Loop loop;
  loop.message.connection->receive_multiplier.reset();
  for (int k = 0; k < 5; ++k)
    BOOST_TEST((loop.next(S::kMonitoringWait).reply == Reply::kHeader));
}

BOOST_AUTO_TEST_CASE(answers_stay_in_step_with_the_slots_when_messages_are_lost) {
  Loop loop;
  loop.message.connection->receive_multiplier = 5;
  for (int k = 1; k <= 9; ++k) loop.next(S::kMonitoringWait);
  // The tenth, when an answer was due, is lost: the eleventh is answered at once.
  BOOST_TEST((loop.next(S::kMonitoringWait, 1).reply == Reply::kHeader));
  for (int k = 12; k <= 14; ++k)
    BOOST_TEST((loop.next(S::kMonitoringWait).reply == Reply::kNothing));
  BOOST_TEST((loop.next(S::kMonitoringWait).reply == Reply::kHeader));
  // Twelve lost at once, 16 to 27: 28 answers for 20 and 25, and 30 is the next.
  BOOST_TEST((loop.next(S::kMonitoringWait, 12).reply == Reply::kHeader));
  BOOST_TEST((loop.next(S::kMonitoringWait).reply == Reply::kNothing));
  BOOST_TEST((loop.next(S::kMonitoringWait).reply == Reply::kHeader));
}

BOOST_AUTO_TEST_CASE(lost_messages_are_counted_also_where_the_count_wraps) {
  Loop loop;
  loop.message.header.sequence = UINT32_MAX - 3;
  loop.next(S::kMonitoringWait);
  BOOST_TEST(loop.next(S::kMonitoringWait, 3).missed == 3u);
  BOOST_TEST(loop.next(S::kMonitoringWait, 0).missed == 0u);
  BOOST_TEST(loop.next(S::kMonitoringWait, 1000).missed == 1000u);
  BOOST_TEST(loop.session.counters().missed == 1003u);
  BOOST_TEST(loop.session.counters().sessions == 1u);
}

BOOST_AUTO_TEST_CASE(doubled_and_overtaken_messages_change_nothing) {
  Loop loop;
  loop.go(S::kCommandingActive);
  loop.next(S::kCommandingActive, 2);
  const std::uint32_t newest = loop.message.header.sequence;
  for (const std::uint32_t back : {0u, 1u, 2u, 32u}) {
    MonitoringMessage old = loop.message;
    old.header.sequence = newest - back;
    old.connection->state = S::kMonitoringReady;
    const SessionStep step = loop.session.receive(old);
    BOOST_TEST(!step.is_new);
    BOOST_TEST((step.reply == Reply::kNothing && step.state == S::kCommandingActive));
    BOOST_TEST((loop.session.message() == loop.message));
  }
  BOOST_TEST(loop.session.counters().duplicates == 1u);
  BOOST_TEST(loop.session.counters().older == 3u);
  const SessionStep step = loop.next(S::kCommandingActive);
  BOOST_TEST(
      (step.reply == Reply::kActive && !step.is_first_active && step.missed == 0));
}

BOOST_AUTO_TEST_CASE(motions_follow_each_other_in_one_session) {
  Loop loop;
  loop.go(S::kMonitoringReady);
  for (std::uint64_t k = 1; k <= 3; ++k) {
    BOOST_TEST((loop.next(S::kCommandingWait).reply == Reply::kMirror));
    BOOST_TEST(loop.next(S::kCommandingActive).is_first_active);
    BOOST_TEST(!loop.next(S::kCommandingActive).is_first_active);
    loop.next(k == 1 ? S::kMonitoringReady : S::kMonitoringWait);
    loop.next(S::kMonitoringReady);
    BOOST_TEST(loop.session.counters().motions == k);
  }
  BOOST_TEST(loop.session.counters().sessions == 1u);
}

BOOST_AUTO_TEST_CASE(a_session_may_end_and_another_begin) {
  Loop loop;
  loop.go(S::kCommandingActive);
  loop.answer();
  for (int k = 0; k < 5; ++k)
    BOOST_TEST((loop.next(S::kIdle).reply == Reply::kNothing));
  loop.message.header.sequence = UINT32_MAX;  // the new session counts from 0
  const SessionStep step = loop.next(S::kMonitoringWait);
  BOOST_TEST((step.is_new_session && step.missed == 0));
  BOOST_TEST(loop.answer().header.sequence == 0u);
  BOOST_TEST(loop.session.counters().sessions == 2u);
}

BOOST_AUTO_TEST_CASE(a_cabinet_that_starts_anew_without_idle_is_noticed) {
  Loop far;
  for (int k = 0; k < 200; ++k) far.next(S::kMonitoringWait);
  far.message.header.sequence = UINT32_MAX;
  BOOST_TEST(far.next(S::kMonitoringWait).is_new_session);

  // So soon that it could be reordering: eight in their order settle it.
  Loop near;
  near.message.header.sequence = UINT32_MAX;
  for (int k = 0; k < 20; ++k) near.next(S::kCommandingWait);
  near.next(S::kCommandingActive);
  near.message.header.sequence = UINT32_MAX;
  for (int k = 0; k < 7; ++k) BOOST_TEST(!near.next(S::kCommandingActive).is_new);
  const SessionStep step = near.next(S::kCommandingActive);
  BOOST_TEST((step.is_new_session && step.is_first_active));
  BOOST_TEST(!near.next(S::kCommandingActive).is_new_session);
}

BOOST_AUTO_TEST_CASE(problems_send_what_lets_the_robot_be) {
  Loop ipo;
  ipo.has_ipo = false;
  ipo.next(S::kMonitoringReady);
  BOOST_TEST((ipo.next(S::kCommandingWait).problem == Problem::kNoIpo));
  BOOST_TEST((ipo.answer().q == kMeasured && ipo.answer().tau == Joints{}));
  BOOST_TEST((ipo.next(S::kCommandingActive).reply == Reply::kMirror));
  BOOST_TEST(ipo.session.diagnose().find("interpolator") != std::string::npos);

  Loop mode;
  mode.next(S::kMonitoringReady);
  mode.mode = CommandMode::kPosition;
  BOOST_TEST((mode.next(S::kCommandingWait).problem == Problem::kCommandMode));
  BOOST_TEST((mode.answer().q == kIpo && !mode.answer().tau));
  BOOST_TEST(mode.session.diagnose().ends_with("and is POSITION"));
  mode.mode = CommandMode::kWrench;
  BOOST_TEST((mode.next(S::kCommandingActive).reply == Reply::kMirror));
  BOOST_TEST((!mode.answer().tau && mode.answer().wrench == Wrench{}));

  Loop measured;
  measured.message.q_measured.reset();
  BOOST_TEST((measured.next(S::kMonitoringReady).problem == Problem::kNone));
  BOOST_TEST((measured.next(S::kCommandingActive).problem == Problem::kNoMeasured));
  Loop joints;
  joints.message.num_joints = 6;
  BOOST_TEST((joints.next(S::kMonitoringReady).problem == Problem::kNumJoints));
  BOOST_TEST(joints.session.counters().problems == 1u);
}

BOOST_AUTO_TEST_CASE(commands_that_are_not_finite_become_the_mirror) {
  Loop loop;
  loop.go(S::kCommandingActive);
  Joints bad = kTau;
  bad[3] = std::numeric_limits<double>::quiet_NaN();
  const CommandMessage& answer = loop.session.answer(kFiltered, bad);
  BOOST_TEST((answer.q == kIpo && answer.tau == Joints{}));
  BOOST_TEST(loop.session.counters().bad_commands == 1u);
}

BOOST_AUTO_TEST_CASE(datagrams_that_are_no_messages_are_counted_and_dropped) {
  FriSession session(Version::k1_15);
  BOOST_TEST(session.diagnose().starts_with("no datagram has come"));
  const Bytes good = hex(kMonitoring), framed = hex(kTorque27), own = hex(kTorque);
  BOOST_TEST((session.receive(good.data(), good.size()).reply == Reply::kHeader));
  BOOST_TEST(session.diagnose().find("firewall") != std::string::npos);
  for (int k = 0; k < 3; ++k) {
    const SessionStep step = session.receive(framed.data(), framed.size());
    BOOST_TEST((!step.decode.ok() && !step.is_new && step.reply == Reply::kNothing));
    BOOST_TEST((step.state == S::kMonitoringWait));
  }
  BOOST_TEST(session.diagnose().find("looks like FRI 2.7") != std::string::npos);
  session.receive(own.data(), own.size());
  session.receive(own.data(), 0);
  BOOST_TEST(session.counters().undecodable == 4u);
  BOOST_TEST(session.counters().wrong_identifier == 1u);
  BOOST_TEST(session.counters().received == 6u);
  BOOST_TEST(session.counters().accepted == 1u);
  session.reset();
  BOOST_TEST(session.counters().received == 0u);
}

BOOST_AUTO_TEST_CASE(the_diagnosis_names_what_the_robot_waits_for) {
  Loop loop;
  loop.message.drive_states.push_back(DriveState::kOff);
  loop.message.operation_mode = OperationMode::kT1;
  loop.go(S::kCommandingWait);
  BOOST_TEST(loop.session.diagnose().find("enabling switch") != std::string::npos);
  loop.message.safety = SafetyState::kStop1;
  loop.next(S::kCommandingWait);
  BOOST_TEST(loop.session.diagnose().find("safety stop") != std::string::npos);
  loop.message.q_commanded.reset();
  loop.next(S::kMonitoringWait);
  BOOST_TEST(loop.session.diagnose().find("looks like FRI 2.x") != std::string::npos);
  loop.next(S::kIdle);
  BOOST_TEST(loop.session.diagnose().find("start the Java") != std::string::npos);
}
