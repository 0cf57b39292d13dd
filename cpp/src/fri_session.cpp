#include "dovetail/fri_session.hpp"

#include <algorithm>
#include <cmath>

namespace dovetail::fri {

namespace {

// A step back by less is a message that was overtaken; by more, a new count.
constexpr std::int64_t kReorderWindow = 32;
// So many older messages, each one after the other, are a new count too.
constexpr std::uint32_t kNewCount = 8;

bool is_finite(const Joints& values) noexcept {
  return std::all_of(values.begin(), values.end(),
                     [](double x) { return std::isfinite(x); });
}

bool is_commanding(SessionState state) noexcept {
  return state >= SessionState::kCommandingWait;
}

/// Whether a cabinet goes from one state to another with nothing between.
bool is_legal(SessionState from, SessionState to) noexcept {
  using S = SessionState;
  if (from == to || to == S::kIdle) return true;
  switch (from) {
    case S::kIdle:  // a client may hear of a session late
    case S::kCommandingWait:
      return true;
    case S::kMonitoringWait:
      return to == S::kMonitoringReady;
    case S::kMonitoringReady:
      return to == S::kMonitoringWait || to == S::kCommandingWait;
    case S::kCommandingActive:
      return to != S::kCommandingWait;
  }
  return false;
}

}  // namespace

SessionStep FriSession::receive(const std::uint8_t* bytes, std::size_t size) noexcept {
  const DecodeResult result = decode_monitoring(bytes, size, version_, incoming_);
  if (result.ok()) return receive(incoming_);
  ++counters_.received;
  ++(result.status == DecodeStatus::kIdentifier ? counters_.wrong_identifier
                                                : counters_.undecodable);
  failure_ = result;
  ++failures_in_a_row_;
  SessionStep step;
  step.decode = result;
  step.state = step.previous = step_.state;
  return step;
}

SessionStep FriSession::receive(const MonitoringMessage& message) noexcept {
  ++counters_.received;
  failures_in_a_row_ = 0;
  SessionStep step;
  step.state = step.previous = step_.state;
  const Order place = order(message.header.sequence, step.missed);
  if (place == Order::kSame || place == Order::kOlder) {
    ++(place == Order::kSame ? counters_.duplicates : counters_.older);
    return step;
  }
  ++counters_.accepted;
  counters_.missed += step.missed;
  message_ = message;
  last_sequence_ = message.header.sequence;
  step.is_new = true;
  step.state = message.state();
  enter(step, place == Order::kFirst);
  step.problem = find_problem(step);
  if (step.problem != Problem::kNone) ++counters_.problems;
  step.reply = reply_for(step);
  step_ = step;
  return step;
}

/// Where a message stands in the cabinet's count, which starts anew with a session.
FriSession::Order FriSession::order(std::uint32_t sequence,
                                    std::uint32_t& missed) noexcept {
  if (!has_session_) return Order::kFirst;
  const std::int64_t ahead =
      static_cast<std::int32_t>(sequence - last_sequence_);  // wraps round
  if (ahead > 0) {
    older_in_a_row_ = 0;
    missed = static_cast<std::uint32_t>(ahead - 1);
    return Order::kNext;
  }
  if (ahead == 0) return Order::kSame;
  older_in_a_row_ = sequence == last_older_ + 1 ? older_in_a_row_ + 1 : 1;
  last_older_ = sequence;
  if (ahead >= -kReorderWindow && older_in_a_row_ < kNewCount) return Order::kOlder;
  return Order::kFirst;
}

/// Notes sessions, motions and transitions.
void FriSession::enter(SessionStep& step, bool is_first) noexcept {
  using S = SessionState;
  const bool is_idle = step.state == S::kIdle;
  if (is_first) {
    older_in_a_row_ = 0;
    periods_ = 0;
    next_sequence_ = 0;
    is_refused_ = false;
    step.is_new_session = !is_idle;
    if (!is_idle) ++counters_.sessions;
  }
  // In the first message, or behind lost ones, every state may be the next.
  const bool is_odd =
      !is_first && step.missed == 0 && !is_legal(step.previous, step.state);
  if (is_odd) ++counters_.odd_transitions;
  const bool was_active = step.previous == S::kCommandingActive && !is_first;
  step.is_first_active = step.state == S::kCommandingActive && !was_active;
  if (step.is_first_active) {
    ++counters_.motions;
    is_refused_ = is_odd;
  }
  has_session_ = !is_idle;
}

Problem FriSession::find_problem(const SessionStep& step) const noexcept {
  if (message_.num_joints && *message_.num_joints != 7) return Problem::kNumJoints;
  if (!is_commanding(step.state)) return Problem::kNone;
  if (!message_.q_measured) return Problem::kNoMeasured;
  if (!message_.q_ipo) return Problem::kNoIpo;
  if (message_.command_mode && *message_.command_mode != mode_)
    return Problem::kCommandMode;
  if (step.state == SessionState::kCommandingActive && is_refused_)
    return Problem::kTransition;
  return Problem::kNone;
}

/// The multiplier counts the cabinet's periods, lost messages included: the answers
/// stay in step with its receive slots.
Reply FriSession::reply_for(const SessionStep& step) noexcept {
  if (step.state == SessionState::kIdle) return Reply::kNothing;
  const std::uint32_t multiplier = std::max<std::uint32_t>(
      message_.connection ? message_.connection->receive_multiplier.value_or(1) : 1, 1);
  periods_ += std::uint64_t{step.missed} + 1;
  if (periods_ < multiplier) return Reply::kNothing;
  periods_ %= multiplier;
  if (!is_commanding(step.state)) return Reply::kHeader;
  const bool is_active = step.state == SessionState::kCommandingActive;
  return is_active && step.problem == Problem::kNone ? Reply::kActive : Reply::kMirror;
}

/// What lets the robot be: the position it is asked to hold, and no torque.
void FriSession::fill_safe() noexcept {
  command_.q = message_.q_ipo ? message_.q_ipo : message_.q_measured;
  const CommandMode mode = message_.command_mode.value_or(mode_);
  if (mode == CommandMode::kTorque) command_.tau = Joints{};
  if (mode == CommandMode::kWrench) command_.wrench = Wrench{};
}

const CommandMessage& FriSession::answer(const Joints& q, const Joints& tau) noexcept {
  command_ = {};
  if (step_.reply == Reply::kActive && is_finite(q) && is_finite(tau)) {
    command_.q = q;
    if (mode_ == CommandMode::kTorque) command_.tau = tau;
    if (mode_ == CommandMode::kWrench) command_.wrench = Wrench{};
  } else if (step_.reply == Reply::kActive || step_.reply == Reply::kMirror) {
    if (step_.reply == Reply::kActive) ++counters_.bad_commands;
    fill_safe();
  }
  command_.header.sequence = next_sequence_++;
  command_.header.reflected = message_.header.sequence;
  ++counters_.sent;
  return command_;
}

std::size_t FriSession::answer(const Joints& q, const Joints& tau,
                               std::uint8_t* out) noexcept {
  return encode_command(answer(q, tau), version_, out);
}

}  // namespace dovetail::fri
