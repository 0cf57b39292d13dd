#include "dovetail/watchdog.hpp"

#include <cmath>
#include <sstream>
#include <stdexcept>

namespace dovetail {
namespace {

void require(const char* element, double value, const char* unit) {
  if (value > 0.0) return;  // a NaN compares false
  std::ostringstream message;
  message << "watchdog " << element << " is " << value << ' ' << unit
          << "; allowed: above 0 (infinity switches it off)";
  throw std::invalid_argument(message.str());
}

struct Words {
  const char* what;
  const char* unit;
};

Words words_of(StopReason reason) noexcept {
  switch (reason) {
    case StopReason::kPosition:
      return {"position", "rad"};
    case StopReason::kSpeed:
      return {"speed", "rad/s"};
    case StopReason::kTorqueTracking:
      return {"measured from commanded torque", "Nm"};
    case StopReason::kExternalTorque:
      return {"external torque", "Nm"};
    default:
      return {"", ""};
  }
}

}  // namespace

const char* name(StopReason reason) noexcept {
  switch (reason) {
    case StopReason::kNone:
      return "none";
    case StopReason::kRequested:
      return "requested";
    case StopReason::kPosition:
      return "position";
    case StopReason::kSpeed:
      return "speed";
    case StopReason::kTorqueTracking:
      return "torque_tracking";
    case StopReason::kExternalTorque:
      return "external_torque";
    case StopReason::kImplausible:
      return "implausible";
    case StopReason::kLastLine:
      return "last_line";
    case StopReason::kSafety:
      return "safety_stop";
    case StopReason::kDrivesOff:
      return "drives_off";
    case StopReason::kTargetTimeout:
      return "target_timeout";
  }
  return "unknown";
}

std::string describe(const StopFacts& facts) {
  std::ostringstream text;
  switch (facts.reason) {
    case StopReason::kNone:
      return "no stop";
    case StopReason::kRequested:
      return "a stop was asked for";
    case StopReason::kImplausible:
      text << "the measured position or speed of A" << facts.joint + 1 << " cannot be, "
           << facts.value << " messages in a row; allowed are " << facts.limit - 1;
      return text.str();
    case StopReason::kSafety:
      text << "the cabinet says safetyState " << facts.value << ", safety stop level "
           << facts.value - 1 << ", in the middle of a motion; 0 is normal operation. "
           << "Look at the safety messages on the smartPAD";
      return text.str();
    case StopReason::kDrivesOff:
      text << "the cabinet says that the drive of A" << facts.joint + 1
           << " is OFF in the middle of a motion: look at the smartPAD, and in T1 or "
           << "T2 at the enabling switch";
      return text.str();
    case StopReason::kLastLine:
      return describe(facts.end, facts.joint, facts.value, facts.limit);
    case StopReason::kTargetTimeout:
      text << "no new Target for " << 1e3 * facts.value << " ms, allowed are "
           << 1e3 * facts.limit << " ms";
      return text.str();
    default:
      break;
  }
  const Words words = words_of(facts.reason);
  text << words.what << " of A" << facts.joint + 1 << " is " << facts.value << ' '
       << words.unit << ", allowed is " << facts.limit << ' ' << words.unit;
  return text.str();
}

Watchdog::Watchdog(const WatchdogParams& params, const LimitParams& limits)
    : params_(params), limits_(limits) {
  require("target_timeout", params.target_timeout, "s");
  require("position_margin", params.position_margin, "rad");
  require("speed_margin", params.speed_margin, "of dq_max");
  require("torque_error", params.torque_error, "of tau_max");
  require("external_torque", params.external_torque, "of tau_max");
  require("confirm", params.confirm, "s");
  require("confirm_tracking", params.confirm_tracking, "s");
  require("rest_speed", params.rest_speed, "rad/s");
}

void Watchdog::begin() noexcept {
  speed_since_ = tracking_since_ = external_since_ = 0.0;
  if (!stopped_) facts_ = {};
}

void Watchdog::stop_for(const StopFacts& facts) noexcept {
  if (stopped_) return;
  facts_ = facts;
  stopped_ = true;
}

void Watchdog::request_stop() noexcept { requested_ = true; }

void Watchdog::clear() noexcept {
  stopped_ = requested_ = false;
  facts_ = {};
  begin();
}

/// The joint that is farthest over its limit; no reason where none is.
StopFacts Watchdog::worst(StopReason reason, const Vec7& value,
                          const Vec7& limit) const noexcept {
  StopFacts found;
  double most = 1.0;
  for (int i = 0; i < kNumJoints; ++i) {
    const double share = std::abs(value[i]) / std::abs(limit[i]);
    if (!(share > most)) continue;
    most = share;
    found = {reason, static_cast<std::int8_t>(i), value[i], limit[i]};
  }
  return found;
}

/// Whether something has now been there for as long as needed.
bool Watchdog::confirmed(const StopFacts& facts, double needed, double elapsed,
                         double& since) noexcept {
  since = facts.reason == StopReason::kNone ? 0.0 : since + elapsed;
  return facts.reason != StopReason::kNone && since >= needed * (1.0 - 1e-9);
}

StopFacts Watchdog::find_stop(const WatchdogInput& input) noexcept {
  StopFacts position;
  double farthest = params_.position_margin;
  for (int i = 0; i < kNumJoints; ++i) {
    const bool is_above = input.q[i] > limits_.q_max[i];
    const double limit = is_above ? limits_.q_max[i] : limits_.q_min[i];
    const double over = is_above ? input.q[i] - limit : limit - input.q[i];
    if (!(over > farthest)) continue;
    farthest = over;
    position = {StopReason::kPosition, static_cast<std::int8_t>(i), input.q[i], limit};
  }
  const StopFacts speed = worst(StopReason::kSpeed, input.dq,
                                (1.0 + params_.speed_margin) * limits_.dq_max);
  StopFacts tracking;
  if (input.tau_measured && input.tau_commanded) {
    tracking =
        worst(StopReason::kTorqueTracking, *input.tau_measured - *input.tau_commanded,
              params_.torque_error * limits_.tau_max);
  }
  StopFacts external;
  if (input.tau_external) {
    external = worst(StopReason::kExternalTorque, *input.tau_external,
                     params_.external_torque * limits_.tau_max);
  }
  // every clock runs, whichever stop comes first
  const double elapsed = input.elapsed;
  const bool is_fast = confirmed(speed, params_.confirm, elapsed, speed_since_);
  const bool is_lost =
      confirmed(tracking, params_.confirm_tracking, elapsed, tracking_since_);
  const bool is_pushed = confirmed(external, params_.confirm, elapsed, external_since_);
  if (requested_) return {StopReason::kRequested, -1, 0.0, 0.0};
  if (position.reason != StopReason::kNone) return position;
  if (is_fast) return speed;
  if (is_lost) return tracking;
  if (is_pushed) return external;
  return {};
}

Verdict Watchdog::check(const WatchdogInput& input) noexcept {
  const StopFacts found = find_stop(input);
  if (stopped_) return Verdict::kStop;
  if (found.reason != StopReason::kNone) {
    facts_ = found;
    stopped_ = true;
    return Verdict::kStop;
  }
  if (input.target_age > params_.target_timeout) {
    facts_ = {StopReason::kTargetTimeout, -1, input.target_age, params_.target_timeout};
    return Verdict::kHold;
  }
  facts_ = {};
  return Verdict::kFollow;
}

}  // namespace dovetail
