/// The last line: sees motion that no Target explains, whatever its cause, and ends it.
///
/// Four things are watched, from the measured motion and the torques alone
/// (docs/control.md, Last line):
///   oscillation  a joint's speed swings to and fro, faster than 7 Hz, more widely than
///                the Target's changes explain, and does not decay;
///   energy       limiters do positive work: passive ones never do;
///   force        limiters push the tool, and no motion is there to be braked: what
///                cancels a contact presses ever harder;
///   speed        a joint has used three fifths of its speed margin. A speed that jumps
///                may be a wrong sample's: it is seen in the next cycle, if it is
///                there.
/// Once seen, it stays seen until `reset`.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "dovetail/decay.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// What ended the motion.
enum class EndCause : std::uint8_t { kNone, kOscillation, kEnergy, kForce, kSpeed };

[[nodiscard]] const char* name(EndCause cause) noexcept;

/// The end in words: what, which joint (0 to 6), value and what is allowed. Allocates.
[[nodiscard]] std::string describe(EndCause cause, int joint, double value,
                                   double limit);

/// One cycle as the last line sees it.
struct LastLineInput {
  const Vec7& dq;         ///< measured [rad/s]
  const Vec7& explained;  ///< change of acceleration by a new Target [rad/s2]
  double limiter_power;   ///< power that limiters put into the arm [W]
  double limiter_push;    ///< force of limiters on the tool that brakes nothing [N]
  double elapsed;         ///< since the last cycle [s]
  bool is_jump = false;   ///< dq is of the first surprise of a while (state_check.hpp)
};

/// One thread. Nothing allocates or throws.
class LastLine {
 public:
  explicit LastLine(const LimitParams& limits) noexcept;

  void reset() noexcept;
  /// True from the cycle on in which something was seen.
  bool check(const LastLineInput& input) noexcept;

  EndCause cause() const noexcept { return cause_; }
  /// Whether the disturbance estimate may be part of what was seen. A joint that was
  /// only too fast was pushed: what pushes it must be known to brake it.
  bool is_loop() const noexcept {
    return cause_ != EndCause::kNone && cause_ != EndCause::kSpeed;
  }
  int joint() const noexcept { return joint_; }     ///< 0 to 6, -1 where it is none
  double value() const noexcept { return value_; }  ///< swing, work, force, speed [SI]
  double limit() const noexcept { return limit_; }  ///< what was allowed [SI]

 private:
  /// The swings of one joint's speed about its slow part.
  struct Swing {
    double slow = 0.0;     // the slow part [rad/s]
    double extreme = 0.0;  // since the last turn [rad/s]
    double turn = 0.0;     // value of the last turn [rad/s]
    double width = 0.0;    // of the last swing [rad/s]
    double since = 0.0;    // time since the last turn [s]
    double excused = 0.0;  // swing that the Target explains [rad/s]
    double least = 0.0;    // width from which the last swing counted [rad/s]
    int direction = 1;
    int count = 0;
  };

  /// What the time since the last cycle makes of the past, the same for every joint.
  struct Fading {
    double left;  // of excuses and work
    double slow;  // share of what is new in a slow part
  };

  bool swings(int joint, const LastLineInput& input, const Fading& fading) noexcept;
  void end(EndCause cause, int joint, double value, double limit) noexcept;

  Vec7 dq_max_;
  Vec7 dq_end_;  // three fifths of the speed margin are used beyond it [rad/s]
  bool is_on_;
  std::array<Swing, 7> swing_;
  Decay forget_, slow_;
  double work_ = 0.0;     // that limiters did of late [J]
  double impulse_ = 0.0;  // of limiters that push on and on [N s]
  EndCause cause_ = EndCause::kNone;
  int joint_ = -1;
  double value_ = 0.0;
  double limit_ = 0.0;
};

}  // namespace dovetail
