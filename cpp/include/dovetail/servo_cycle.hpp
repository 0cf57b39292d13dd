/// One cycle of the servo loop: message in, command out. No socket, no clock, no
/// thread.
///
/// Datagram -> FriSession -> velocity observer -> state check -> watchdog -> controller
/// -> command. Gravity is never added: the cabinet compensates it. Everything behind
/// the state check, the position that is sent included, acts on what it believes.
#pragma once

#include <array>
#include <cstdint>

#include "dovetail/controller.hpp"
#include "dovetail/cycle_row.hpp"
#include "dovetail/fri_message.hpp"
#include "dovetail/fri_session.hpp"
#include "dovetail/motion_end.hpp"
#include "dovetail/ring_log.hpp"
#include "dovetail/velocity_observer.hpp"
#include "dovetail/watchdog.hpp"

namespace dovetail {

struct ServoParams {
  fri::Version version = fri::Version::k1_15;
  double period = 0.005;          ///< control period: send period x multiplier [s]
  bool lockstep = false;          ///< replies wait for grants; simulated cabinets only
  double position_filter = 20.0;  ///< of the position command, first order [Hz]
  double observer_gain = 1.0;     ///< of the velocity observer
  double measured_sign = -1.0;   ///< wire over joint, measured torque (docs/cabinet.md)
  double commanded_sign = -1.0;  ///< the same, commanded torque
  double external_sign = 1.0;    ///< the same, external torque
  bool commanded_is_total = false;  ///< commanded torque on the wire holds gravity
  double log_seconds = 10.0;        ///< length of the ring log [s]
  WatchdogParams watchdog;
};

/// Why a cabinet that sends well is not commanded.
enum class Refusal : std::uint8_t {
  kNone,
  kPeriod,   ///< its period is not the controller's
  kProblem,  ///< the session has one: FriSession::diagnose
  kStart,    ///< a motion would begin far from where the message before was measured
};

/// What the learner's side asks for; the newest counts.
struct Order {
  Target target;
  std::uint64_t serial = 0;  ///< grows with every Target; 0 is none
  std::uint64_t motion = 0;  ///< the only one that the Target is for
  std::uint64_t tick = 0;    ///< lockstep: cycles of that motion below it are answered
  std::uint64_t latch = 0;   ///< grows with every pose to hold
  Vec3 p_hold = Vec3::Zero();
  Vec4 quat_hold{1.0, 0.0, 0.0, 0.0};
  /// Added to the position that is sent [rad], within +-kLeanMax: a cabinet without a
  /// spring of its own does not feel it.
  Vec7 lean = Vec7::Zero();
};

/// Largest lean of a joint's sent position [rad].
constexpr double kLeanMax = 0.05;

/// What the loop last knew; copied to the learner's side.
struct ServoState {
  std::uint64_t tick = 0;    ///< control periods while active, lost ones included
  std::uint64_t motion = 0;  ///< how often COMMANDING_ACTIVE was entered
  std::uint32_t first = 0;   ///< sequence of the message that began that motion
  std::uint64_t rows = 0;    ///< rows of the log so far
  double time = 0.0;         ///< since the motion began [s]
  /// Measured [rad] and observed [rad/s]; where that was not believed, predicted.
  Vec7 q = Vec7::Zero(), dq = Vec7::Zero();
  bool is_plausible = true;
  std::uint64_t implausible = 0;  ///< messages of this motion that were not believed
  Vec7 tau_measured = Vec7::Constant(kUnset);   ///< on the joint, with gravity [Nm]
  Vec7 tau_external = Vec7::Constant(kUnset);   ///< on the joint [Nm]
  Vec7 tau_commanded = Vec7::Constant(kUnset);  ///< on the joint, as the wire has it
  fri::SessionState session = fri::SessionState::kIdle;
  fri::SessionState last_session = fri::SessionState::kIdle;  ///< a silence keeps it
  fri::Quality quality = fri::Quality::kPoor;
  std::uint8_t safety = 0;          ///< fri::SafetyState
  std::uint8_t operation_mode = 2;  ///< fri::OperationMode
  std::uint8_t control_mode = 3;    ///< fri::ControlMode
  std::uint8_t drives = 0;          ///< fri::DriveState, TRANSITIONING where mixed
  std::uint32_t send_period = 0;    ///< [ms]
  std::uint32_t multiplier = 0;
  double tracking = 0.0;
  Refusal refusal = Refusal::kNone;
  bool is_waiting = false;  ///< an active cycle has not been answered yet
  bool is_held = false;     ///< no Target is followed: late, or none in this motion
  bool is_stopped = false;
  bool is_at_rest = false;  ///< the hold or stop has come to rest
  StopFacts facts;
  MotionEnd end;  ///< of the last motion that ended
};

/// One thread. `receive` and `answer` do not allocate or throw.
class ServoCycle {
 public:
  /// Throws std::invalid_argument naming what is out of range.
  ServoCycle(const ServoParams& params, const ChainParams& chain, const OscParams& osc,
             const LimitParams& limits, const TaskSpec& task);

  enum class Action : std::uint8_t {
    kNothing,
    kSend,    ///< the answer is `reply`
    kAnswer,  ///< an active cycle: the answer is `answer`
  };

  /// Takes one datagram of the cabinet.
  Action receive(const std::uint8_t* bytes, std::size_t size) noexcept;

  /// Writes the answer that moves nothing; `out` has room for kMaxDatagram.
  std::size_t reply(std::uint8_t* out) noexcept;

  /// Runs the controller for the cycle that was received, and writes its answer.
  std::size_t answer(const Order& order, std::uint8_t* out) noexcept;

  /// What the last datagram meant.
  const fri::SessionStep& step() const noexcept { return step_; }

  /// The cabinet has fallen silent or was replaced: the session begins again.
  void lose_session() noexcept;

  Watchdog& watchdog() noexcept { return watchdog_; }
  /// Ends a stop, also one of the controller's last line.
  void clear() noexcept {
    watchdog_.clear();
    controller_.resume();
  }
  const ServoState& state() const noexcept { return state_; }
  const fri::FriSession& session() const noexcept { return session_; }
  const RingLog& log() const noexcept { return log_; }
  const ServoParams& params() const noexcept { return params_; }

 private:
  void note(const fri::MonitoringMessage& message) noexcept;
  void note_position(const fri::MonitoringMessage& message) noexcept;
  void note_safety(const fri::MonitoringMessage& message) noexcept;
  Refusal find_refusal(const fri::MonitoringMessage& message) const noexcept;
  Action receive_active(const fri::SessionStep& step) noexcept;
  void begin_motion(const Vec7& q) noexcept;
  void end_motion(MotionEnd::Cause cause) noexcept;
  void note_belief(const Vec7& q) noexcept;
  void note_end(const Flags& flags) noexcept;
  Target choose_target(const Order& order, Flags& flags) noexcept;
  Vec7 wanted_lean(const Order& order) const noexcept;
  void log_row(const StepResult& result, const Target& target) noexcept;

  ServoParams params_;
  fri::FriSession session_;
  fri::SessionStep step_;
  Controller controller_;
  VelocityObserver observer_;
  Watchdog watchdog_;
  RingLog log_;
  ServoState state_;

  double filter_a_, filter_b_;  // y = b (x_k + x_k-1) + a y_k-1
  Vec7 filtered_ = Vec7::Zero();
  Vec7 q_last_ = Vec7::Zero();
  Vec7 q_measured_ = Vec7::Zero();   // believed or not
  Vec7 dq_observed_ = Vec7::Zero();  // the same
  Vec7 fastest_;                     // before a motion begins [rad/s]
  bool has_measured_ = false;        // in this session
  bool may_begin_ = false;           // the last two positions agree
  double implausible_at_ = 0.0;      // the last one, in the motion's time [s]
  int implausible_joint_ = -1;
  Vec7 lean_ = Vec7::Zero();  // on its way to the order's
  Vec7 a_last_ = Vec7::Zero();
  Vec7 q_hold_ = Vec7::Zero();
  bool is_active_ = false;
  bool has_target_ = false;
  double measured_ = 0.0;     // since the observer's last position [s]
  double elapsed_ = 0.0;      // since the controller's last step [s]
  double target_age_ = 0.0;   // [s]
  std::uint64_t serial_ = 0;  // of the last Target taken
  std::uint64_t latch_ = 0;
};

}  // namespace dovetail
