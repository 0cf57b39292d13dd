/// What a client has to say in each state of an FRI session. No socket, no clock.
///
/// One receive() per datagram; where it says so, one answer() follows. Survives lost,
/// doubled and reordered messages, the end of a motion and of a session. Nothing here
/// allocates or throws but describe() and diagnose(). One thread at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "dovetail/fri_packet.hpp"

namespace dovetail::fri {

enum class Reply : std::uint8_t {
  kNothing,  ///< IDLE, not due by the receive multiplier, or not a new message
  kHeader,   ///< MONITORING_*: the header alone
  kMirror,   ///< COMMANDING_WAIT, or a problem: the interpolator's position, no torque
  kActive,   ///< COMMANDING_ACTIVE: the caller's position and torque
};

enum class Problem : std::uint8_t {
  kNone,
  kNumJoints,    ///< the robot has not seven joints
  kNoMeasured,   ///< no measured joint position
  kNoIpo,        ///< commanding without the interpolator's position
  kCommandMode,  ///< the Java application chose another client command mode
  kTransition,   ///< COMMANDING_ACTIVE out of a state from which it cannot come
};

struct SessionCounters {
  std::uint64_t received = 0;  ///< datagrams
  std::uint64_t accepted = 0;  ///< new messages
  std::uint64_t sent = 0;      ///< answers
  std::uint64_t missed = 0;    ///< messages lost on the way, by the sequence
  std::uint64_t duplicates = 0;
  std::uint64_t older = 0;             ///< overtaken by a later one, dropped
  std::uint64_t undecodable = 0;       ///< dropped
  std::uint64_t wrong_identifier = 0;  ///< another program's, dropped
  std::uint64_t sessions = 0;
  std::uint64_t motions = 0;          ///< entries into COMMANDING_ACTIVE
  std::uint64_t odd_transitions = 0;  ///< that no cabinet should make
  std::uint64_t problems = 0;         ///< messages with a Problem
  std::uint64_t bad_commands = 0;     ///< not finite: the mirror was sent instead
};

/// What one datagram means.
struct SessionStep {
  DecodeResult decode;  ///< where it is not ok, the rest is as before
  SessionState state = SessionState::kIdle;
  SessionState previous = SessionState::kIdle;
  Reply reply = Reply::kNothing;
  Problem problem = Problem::kNone;
  std::uint32_t missed = 0;     ///< messages lost just before this one
  bool is_new = false;          ///< false: duplicate, older or undecodable
  bool is_new_session = false;  ///< the first message of a session
  /// The first message of a motion: set-points and observers start afresh.
  bool is_first_active = false;
};

class FriSession {
 public:
  /// `mode`: the client command mode that the Java application must have chosen.
  explicit FriSession(Version version, CommandMode mode = CommandMode::kTorque) noexcept
      : version_(version), mode_(mode) {}

  /// One datagram, as it came.
  SessionStep receive(const std::uint8_t* bytes, std::size_t size) noexcept;

  /// One message that is decoded already.
  SessionStep receive(const MonitoringMessage& message) noexcept;

  /// The answer to the last message, with its header. q [rad] and tau [Nm, gravity
  /// excluded] are sent where the reply is kActive; otherwise they do not matter. Call
  /// once where the reply is not kNothing, and send it.
  const CommandMessage& answer(const Joints& q, const Joints& tau) noexcept;

  /// answer() as bytes; `out` has room for kMaxDatagram.
  std::size_t answer(const Joints& q, const Joints& tau, std::uint8_t* out) noexcept;

  /// Forgets session and counters: another peer.
  void reset() noexcept { *this = FriSession(version_, mode_); }

  Version version() const noexcept { return version_; }
  SessionState state() const noexcept { return step_.state; }
  const MonitoringMessage& message() const noexcept { return message_; }
  const SessionCounters& counters() const noexcept { return counters_; }
  const DecodeResult& last_failure() const noexcept { return failure_; }

  /// Why no command acts on the robot, likely causes first; empty where all is well.
  std::string diagnose() const;

 private:
  enum class Order : std::uint8_t { kFirst, kNext, kSame, kOlder };

  Order order(std::uint32_t sequence, std::uint32_t& missed) noexcept;
  void enter(SessionStep& step, bool is_first) noexcept;
  Problem find_problem(const SessionStep& step) const noexcept;
  Reply reply_for(const SessionStep& step) noexcept;
  void fill_safe() noexcept;

  Version version_;
  CommandMode mode_;
  MonitoringMessage message_;
  MonitoringMessage incoming_;
  CommandMessage command_;
  SessionStep step_;
  SessionCounters counters_;
  DecodeResult failure_;
  std::uint32_t next_sequence_ = 0;  // of our next command
  std::uint32_t last_sequence_ = 0;  // of the cabinet
  std::uint32_t last_older_ = 0;
  std::uint32_t older_in_a_row_ = 0;
  std::uint32_t failures_in_a_row_ = 0;
  std::uint64_t periods_ = 0;  // since the last slot in which an answer was due
  bool has_session_ = false;
  bool is_refused_ = false;  // COMMANDING_ACTIVE that came out of the wrong state
};

const char* name(SessionState state) noexcept;  ///< "MONITORING_WAIT", ...
const char* name(CommandMode mode) noexcept;    ///< "TORQUE", ...

/// A problem and its likely causes in words. Allocates.
std::string describe(Problem problem);

}  // namespace dovetail::fri
