/// How a motion behind FRI ended: the facts of the message that ended it.
#pragma once

#include <cstdint>
#include <string>

#include "dovetail/fri_session.hpp"

namespace dovetail {

/// The message that ended a motion, or that none came any more.
struct MotionEnd {
  enum class Cause : std::uint8_t {
    kNone,     ///< no motion has ended yet
    kSession,  ///< the cabinet has left COMMANDING_ACTIVE, or begun another motion
    kPeriod,   ///< its period has changed
    kProblem,  ///< a field or the command mode has
    kSilence,  ///< nothing came for too long, or another cabinet came
  };
  Cause cause = Cause::kNone;
  fri::Problem problem = fri::Problem::kNone;
  fri::SessionState session = fri::SessionState::kIdle;
  fri::CommandMode mode = fri::CommandMode::kNone;
  std::uint8_t safety = 0;          ///< fri::SafetyState
  std::uint8_t operation_mode = 2;  ///< fri::OperationMode
  int num_joints = 7;
  double period_before = 0.0, period = 0.0;  ///< told by the cabinet [s]
  std::uint64_t implausible = 0;             ///< messages of that motion
  std::int8_t joint = -1;          ///< of the last implausible one, 0 to 6; -1: none
  double since_implausible = 0.0;  ///< that one's age at the end [s]
};

/// What changed in the message that ended a motion; values and units in words. Empty
/// where nothing did but the session's state.
struct Change {
  std::string what, before, after;
};
Change change_of(const MotionEnd& end);

const char* name(MotionEnd::Cause cause) noexcept;

}  // namespace dovetail
