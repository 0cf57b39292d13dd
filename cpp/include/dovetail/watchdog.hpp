/// When the arm must not follow its Target: pure logic, no clock, no socket.
///
/// Checked in this order in every cycle; the first that acts is the reason:
///   1. a stop that was asked for       4. torque not as commanded
///   2. joint position out of limits    5. external torque too large
///   3. joint speed out of limits       6. no fresh Target
/// 1 to 5 are controlled stops: the arm brakes, is held, and stays so until clear().
/// 6 is the same damped hold, and ends with the next Target.
#pragma once

#include <optional>
#include <string>

#include "dovetail/last_line.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

struct WatchdogParams {
  double target_timeout = 0.15;   ///< without a new Target: damped hold [s]
  double position_margin = 0.02;  ///< beyond q_min and q_max [rad]
  double speed_margin = 0.15;     ///< beyond dq_max, as a share of it
  double torque_error = 0.3;      ///< measured from commanded, share of tau_max
  double external_torque = 0.6;   ///< share of tau_max
  double confirm = 0.01;          ///< speed, external torque: at least this long [s]
  double confirm_tracking = 0.1;  ///< torque not as commanded: at least this long [s]
  double rest_speed = 0.02;       ///< below it in every joint the arm is held [rad/s]
};

/// Logs hold these numbers: one never changes its meaning.
enum class StopReason : std::uint8_t {
  kNone,
  kRequested,
  kPosition,
  kSpeed,
  kTorqueTracking,
  kExternalTorque,
  kImplausible,    ///< measurements that cannot be, one after another
  kLastLine,       ///< the controller's last line ended the motion
  kTargetTimeout,  ///< a hold, not a stop
  kSafety,         ///< the cabinet says that a safety stop is active
  kDrivesOff,      ///< the cabinet says that a drive is off, in a motion
};

enum class Verdict : std::uint8_t {
  kFollow,
  kHold,  ///< damped hold until the next Target
  kStop,  ///< damped braking, then hold, until clear()
};

/// The facts of a stop.
struct StopFacts {
  StopReason reason = StopReason::kNone;
  std::int8_t joint = -1;          ///< 0 to 6, -1 where it is no joint's
  double value = 0.0;              ///< what was measured
  double limit = 0.0;              ///< what is allowed
  EndCause end = EndCause::kNone;  ///< of the last line, where it was that
};

const char* name(StopReason reason) noexcept;

/// The reason in words: what, which joint, value, limit. Allocates.
std::string describe(const StopFacts& facts);

/// One cycle's measurements. Torques act on the joint: the wire's signs are undone.
struct WatchdogInput {
  Vec7 q;                             ///< [rad]
  Vec7 dq;                            ///< [rad/s]
  std::optional<Vec7> tau_measured;   ///< gravity included [Nm]
  std::optional<Vec7> tau_commanded;  ///< gravity included [Nm]
  std::optional<Vec7> tau_external;   ///< [Nm]
  double target_age = 0.0;            ///< since the last new Target [s]
  double elapsed = 0.0;               ///< since the last cycle [s]
};

/// One thread. After construction nothing allocates or throws.
class Watchdog {
 public:
  /// Throws std::invalid_argument naming the number that is out of range. Infinity
  /// switches a check off.
  Watchdog(const WatchdogParams& params, const LimitParams& limits);

  /// A new motion begins: forgets what was nearly confirmed, keeps a stop.
  void begin() noexcept;

  Verdict check(const WatchdogInput& input) noexcept;

  /// A controlled stop from the next check on.
  void request_stop() noexcept;

  /// A controlled stop for what was found elsewhere; an earlier one stays.
  void stop_for(const StopFacts& facts) noexcept;

  /// Ends a stop. A cause that is still there stops the arm again.
  void clear() noexcept;

  const StopFacts& facts() const noexcept { return facts_; }
  bool is_stopped() const noexcept { return stopped_; }
  const WatchdogParams& params() const noexcept { return params_; }

 private:
  StopFacts worst(StopReason reason, const Vec7& value,
                  const Vec7& limit) const noexcept;
  bool confirmed(const StopFacts& facts, double needed, double elapsed,
                 double& since) noexcept;
  StopFacts find_stop(const WatchdogInput& input) noexcept;

  WatchdogParams params_;
  LimitParams limits_;
  StopFacts facts_;
  bool stopped_ = false;
  bool requested_ = false;
  double speed_since_ = 0.0;
  double tracking_since_ = 0.0;
  double external_since_ = 0.0;
};

}  // namespace dovetail
