#include "dovetail/last_line.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace dovetail {
namespace {

constexpr double kSlowRate = 19.0;    // 3 Hz: motion below it is no oscillation [1/s]
constexpr double kQuickest = 0.002;   // shortest half swing that is no noise [s]
constexpr double kSlowest = 0.07;     // longest half swing: 7 Hz [s]
constexpr double kHysteresis = 0.02;  // of dq_max: a turn that is no noise
constexpr double kWidth = 0.105;      // of dq_max: a swing that matters
constexpr double kKept = 0.7;         // of the swing before: it does not decay
constexpr int kSwings = 4;            // half swings in a row
constexpr double kExcuse = 0.03;      // a change of acceleration acts that long [s]
constexpr double kForget = 5.0;       // excuses and work fade at [1/s]
constexpr double kWork = 0.2;         // of limiters that is no noise [J]
constexpr double kPush = 20.0;        // of limiters on the tool that is no noise [N]
constexpr double kImpulse = 0.8;      // of it: 40 N for 20 ms [N s]
constexpr double kLeft = 0.4;         // of the speed margin, to end a motion in

}  // namespace

const char* name(EndCause cause) noexcept {
  switch (cause) {
    case EndCause::kNone:
      return "none";
    case EndCause::kOscillation:
      return "oscillation";
    case EndCause::kEnergy:
      return "energy";
    case EndCause::kForce:
      return "force";
    case EndCause::kSpeed:
      return "speed";
  }
  return "unknown";
}

std::string describe(EndCause cause, int joint, double value, double limit) {
  std::ostringstream text;
  const char* unit = "rad/s";
  switch (cause) {
    case EndCause::kOscillation:
      text << "speed of A" << joint + 1 << " swings to and fro by ";
      break;
    case EndCause::kSpeed:
      text << "speed of A" << joint + 1 << " is ";
      break;
    case EndCause::kEnergy:
      text << "limiters drove the arm with ";
      unit = "J";
      break;
    case EndCause::kForce:
      text << "limiters press the tool with ";
      unit = "N";
      break;
    case EndCause::kNone:
      return "";
  }
  text << value << ' ' << unit << ", allowed is " << limit << ' ' << unit;
  return text.str();
}

LastLine::LastLine(const LimitParams& limits) noexcept
    : dq_max_(limits.dq_max),
      dq_end_((1.0 - kLeft * limits.delta_v) * limits.dq_max),
      is_on_(limits.last_line) {}

void LastLine::reset() noexcept {
  swing_.fill(Swing{});
  work_ = impulse_ = 0.0;
  cause_ = EndCause::kNone;
  joint_ = -1;
  value_ = limit_ = 0.0;
}

void LastLine::end(EndCause cause, int joint, double value, double limit) noexcept {
  if (cause_ != EndCause::kNone) return;
  cause_ = cause;
  joint_ = joint;
  value_ = value;
  limit_ = limit;
}

/// Follows one joint's speed to its next turn; true where it swings on and on.
bool LastLine::swings(int joint, const LastLineInput& input,
                      const Fading& fading) noexcept {
  Swing& s = swing_[static_cast<std::size_t>(joint)];
  const double dq = input.dq[joint];
  s.excused =
      std::max(fading.left * s.excused, kExcuse * std::abs(input.explained[joint]));
  s.slow += fading.slow * (dq - s.slow);
  s.since += input.elapsed;
  const double fast = s.direction * (dq - s.slow);
  if (fast > s.direction * s.extreme) {
    s.extreme = s.direction * fast;
    return false;
  }
  if (s.direction * s.extreme - fast < kHysteresis * dq_max_[joint]) return false;
  const double width = std::abs(s.extreme - s.turn);
  s.least = kWidth * dq_max_[joint] + s.excused;
  const bool is_swing = width > s.least && s.since > kQuickest && s.since < kSlowest;
  s.count = !is_swing ? 0 : (width > kKept * s.width ? s.count + 1 : 1);
  s.width = width;
  s.turn = s.extreme;
  s.extreme = s.direction * fast;
  s.direction = -s.direction;
  s.since = 0.0;
  return s.count >= kSwings;
}

bool LastLine::check(const LastLineInput& input) noexcept {
  if (!is_on_) return false;
  const Fading fading{forget_.left(kForget, input.elapsed),
                      1.0 - slow_.left(kSlowRate, input.elapsed)};
  for (int i = 0; i < kNumJoints; ++i) {
    if (swings(i, input, fading)) {
      const Swing& s = swing_[static_cast<std::size_t>(i)];
      end(EndCause::kOscillation, i, s.width, s.least);
    }
    if (!input.is_jump && std::abs(input.dq[i]) > dq_end_[i]) {
      end(EndCause::kSpeed, i, input.dq[i], dq_end_[i]);
    }
  }
  work_ = fading.left * work_ + std::max(input.limiter_power, 0.0) * input.elapsed;
  if (work_ > kWork) end(EndCause::kEnergy, -1, work_, kWork);
  const double push = input.limiter_push;
  impulse_ = push > kPush ? impulse_ + push * input.elapsed : 0.0;
  if (impulse_ > kImpulse) end(EndCause::kForce, -1, push, kPush);
  return cause_ != EndCause::kNone;
}

}  // namespace dovetail
