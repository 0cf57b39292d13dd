#include "dovetail/motion_end.hpp"

#include <sstream>

namespace dovetail {
namespace {

std::string milliseconds(double seconds) {
  std::ostringstream text;
  text << 1e3 * seconds << " ms";
  return text.str();
}

Change change_of_field(const MotionEnd& end) {
  switch (end.problem) {
    case fri::Problem::kNumJoints:
      return {"numberOfJoints", "7", std::to_string(end.num_joints)};
    case fri::Problem::kNoMeasured:
      return {"measuredJointPosition", "there", "missing"};
    case fri::Problem::kNoIpo:
      return {"ipoData.jointPosition", "there", "missing"};
    case fri::Problem::kCommandMode:
      return {"clientCommandMode", name(fri::CommandMode::kTorque), name(end.mode)};
    case fri::Problem::kTransition:  // at the start of a motion alone
    case fri::Problem::kNone:
      break;
  }
  return {};
}

}  // namespace

Change change_of(const MotionEnd& end) {
  switch (end.cause) {
    case MotionEnd::Cause::kPeriod:
      return {"send period x receive multiplier", milliseconds(end.period_before),
              milliseconds(end.period)};
    case MotionEnd::Cause::kProblem:
      return change_of_field(end);
    default:
      return {};
  }
}

const char* name(MotionEnd::Cause cause) noexcept {
  switch (cause) {
    case MotionEnd::Cause::kNone:
      return "none";
    case MotionEnd::Cause::kSession:
      return "session";
    case MotionEnd::Cause::kPeriod:
      return "period";
    case MotionEnd::Cause::kProblem:
      return "problem";
    case MotionEnd::Cause::kSilence:
      return "silence";
  }
  return "unknown";
}

}  // namespace dovetail
