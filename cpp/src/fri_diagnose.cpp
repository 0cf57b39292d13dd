#include "dovetail/fri_session.hpp"

namespace dovetail::fri {

namespace {

bool are_active(const List<DriveState, 7>& drives) noexcept {
  for (const DriveState drive : drives)
    if (drive != DriveState::kActive) return false;
  return true;
}

/// Why COMMANDING_WAIT does not end, or no motion begins.
std::string robot_reason(const MonitoringMessage& message) {
  if (message.safety && *message.safety != SafetyState::kNormal)
    return "a safety stop is active: look at the safety messages on the smartPAD";
  if (are_active(message.drive_states)) return "";
  if (message.operation_mode && *message.operation_mode != OperationMode::kAut)
    return "the drives are off in T1 or T2: hold the enabling switch";
  return "the drives are off: start or resume the Java application";
}

/// The version is not in the message, but what is missing tells.
std::string version_reason(const MonitoringMessage& message, Version version) {
  const bool looks_like_2 =
      version == Version::k1_15 && message.q_measured && !message.q_commanded;
  if (!looks_like_2) return "";
  return "; it sends no commandedJointPosition, which looks like FRI 2.x: compare the "
         "versions";
}

}  // namespace

const char* name(CommandMode mode) noexcept {
  switch (mode) {
    case CommandMode::kNone:
      return "none";
    case CommandMode::kPosition:
      return "POSITION";
    case CommandMode::kWrench:
      return "WRENCH";
    case CommandMode::kTorque:
      return "TORQUE";
    case CommandMode::kCartesianPose:
      return "CARTESIAN_POSE";
  }
  return "unknown";
}

const char* name(SessionState state) noexcept {
  switch (state) {
    case SessionState::kIdle:
      return "IDLE";
    case SessionState::kMonitoringWait:
      return "MONITORING_WAIT";
    case SessionState::kMonitoringReady:
      return "MONITORING_READY";
    case SessionState::kCommandingWait:
      return "COMMANDING_WAIT";
    case SessionState::kCommandingActive:
      return "COMMANDING_ACTIVE";
  }
  return "unknown";
}

std::string describe(Problem problem) {
  switch (problem) {
    case Problem::kNone:
      return "";
    case Problem::kNumJoints:
      return "the robot has not 7 joints: this client is for an LBR";
    case Problem::kNoMeasured:
      return "the cabinet sends no measured joint position: compare the FRI versions";
    case Problem::kNoIpo:
      return "the cabinet commands without the interpolator's joint position: the "
             "overlay must be a joint overlay, and the FRI versions the same";
    case Problem::kCommandMode:
      return "the Java application's overlay has the wrong client command mode: it "
             "must be ClientCommandMode.TORQUE";
    case Problem::kTransition:
      return "the cabinet became COMMANDING_ACTIVE without COMMANDING_WAIT: two "
             "cabinets send to this port, or it is no cabinet; end the motion and "
             "start it again";
  }
  return "unknown";
}

std::string FriSession::diagnose() const {
  if (failures_in_a_row_ > 2)
    return "the last " + std::to_string(failures_in_a_row_) +
           " datagrams could not be read: " + describe(failure_);
  if (counters_.received == 0)
    return "no datagram has come: is the FRI session open in the Java application, is "
           "its client address this machine's, and do port and firewall let it in?";
  if (step_.problem == Problem::kCommandMode)
    return describe(step_.problem) + ", and is " +
           name(message_.command_mode.value_or(CommandMode::kNone));
  if (step_.problem != Problem::kNone)
    return describe(step_.problem) + version_reason(message_, version_);
  const std::string state = name(step_.state);
  switch (step_.state) {
    case SessionState::kIdle:
      return "the session is IDLE: start the Java application";
    case SessionState::kMonitoringWait:
      return state + ": the cabinet does not yet find the answers good enough. If it " +
             "stays so: answers do not reach it (firewall, wrong client address), come "
             "late (processor load, no real-time priority), or the FRI versions "
             "differ" +
             version_reason(message_, version_);
    case SessionState::kMonitoringReady: {
      const std::string why = robot_reason(message_);
      return state + ": the connection is good; the Java application must start a " +
             "motion with the FRI joint overlay" + (why.empty() ? "" : "; " + why);
    }
    case SessionState::kCommandingWait: {
      const std::string why = robot_reason(message_);
      return state + ": the motion is being synchronised" +
             (why.empty() ? "" : "; " + why);
    }
    case SessionState::kCommandingActive:
      return "";
  }
  return "";
}

}  // namespace dovetail::fri
