#include "dovetail/servo_cycle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "dovetail/cycle_log.hpp"
#include "dovetail/input.hpp"

namespace dovetail {
namespace {

// Measurements in a row that cannot be, from which on the arm is stopped.
constexpr int kImplausibleMax = 3;

using fri::Joints;
using fri::MonitoringMessage;
using fri::SessionState;

constexpr double kLeanRate = 10.0;  // how quickly a lean is reached [1/s]

// Between two messages before a motion an arm goes no farther than at this share of its
// speed limits, and this for noise [rad].
constexpr double kBeforeSpeed = 1.3;
constexpr double kBeforeNoise = 5e-4;

Vec7 vector_of(const Joints& joints) noexcept {
  return Eigen::Map<const Vec7>(joints.data());
}

Joints joints_of(const Vec7& v) noexcept {
  Joints joints;
  Eigen::Map<Vec7>(joints.data()) = v;
  return joints;
}

std::size_t rows_of(const ServoParams& params) {
  const double rows = params.log_seconds / params.period;
  if (!(rows >= 1.0 && rows <= 1e7)) {
    throw std::invalid_argument("servo log_seconds is " +
                                std::to_string(params.log_seconds) +
                                " s; allowed: one period up to 1e7 of them");
  }
  return static_cast<std::size_t>(std::ceil(rows));
}

void require_filter(double frequency, double period) {
  if (frequency > 0.0 && frequency < 0.5 / period) return;
  throw std::invalid_argument("servo position_filter is " + std::to_string(frequency) +
                              " Hz; allowed: above 0 and below half the rate, " +
                              std::to_string(0.5 / period) + " Hz");
}

/// A factor that is none would silence the watchdog, whose torques it multiplies.
void require_sign(const char* element, double sign) {
  if (std::abs(sign) == 1.0) return;
  throw std::invalid_argument("servo " + std::string(element) + " is " +
                              std::to_string(sign) + "; allowed: -1 or 1");
}

}  // namespace

ServoCycle::ServoCycle(const ServoParams& params, const ChainParams& chain,
                       const OscParams& osc, const LimitParams& limits,
                       const TaskSpec& task)
    : params_(params),
      session_(params.version),
      controller_(chain, osc, limits, task, params.period),
      observer_(params.period, params.observer_gain),
      watchdog_(params.watchdog, limits),
      log_(rows_of(params), column_at(sizeof(ServoRow))),
      fastest_(kBeforeSpeed * limits.dq_max) {
  require_filter(params.position_filter, params.period);
  require_sign("measured_sign", params.measured_sign);
  require_sign("commanded_sign", params.commanded_sign);
  require_sign("external_sign", params.external_sign);
  // A first-order low-pass by Tustin's rule, exact at its own frequency.
  const double w = std::tan(M_PI * params.position_filter * params.period);
  filter_b_ = w / (1.0 + w);
  filter_a_ = (1.0 - w) / (1.0 + w);
}

void ServoCycle::note(const MonitoringMessage& message) noexcept {
  state_.session = state_.last_session = message.state();
  if (message.connection) {
    state_.quality = message.connection->quality;
    state_.send_period = message.connection->send_period.value_or(0);
    state_.multiplier =
        std::max<std::uint32_t>(1, message.connection->receive_multiplier.value_or(1));
  }
  if (message.safety) state_.safety = static_cast<std::uint8_t>(*message.safety);
  if (message.operation_mode) {
    state_.operation_mode = static_cast<std::uint8_t>(*message.operation_mode);
  }
  if (message.control_mode) {
    state_.control_mode = static_cast<std::uint8_t>(*message.control_mode);
  }
  if (!message.drive_states.empty()) {
    const fri::DriveState first = message.drive_states[0];
    const bool is_common =
        std::all_of(message.drive_states.begin(), message.drive_states.end(),
                    [&](fri::DriveState s) { return s == first; });
    state_.drives =
        static_cast<std::uint8_t>(is_common ? first : fri::DriveState::kTransitioning);
  }
  state_.tracking = message.tracking.value_or(0.0);
  const Vec7 unknown = Vec7::Constant(kUnset);
  state_.tau_measured =
      message.tau_measured
          ? Vec7(params_.measured_sign * vector_of(*message.tau_measured))
          : unknown;
  state_.tau_external =
      message.tau_external
          ? Vec7(params_.external_sign * vector_of(*message.tau_external))
          : unknown;
  state_.tau_commanded =
      message.tau_commanded
          ? Vec7(params_.commanded_sign * vector_of(*message.tau_commanded))
          : unknown;
  if (!is_active_ || step_.is_first_active) note_position(message);
}

/// Outside a motion: one may begin where two messages in a row agree.
void ServoCycle::note_position(const MonitoringMessage& message) noexcept {
  if (!message.q_measured || !is_configuration(vector_of(*message.q_measured))) return;
  state_.q = vector_of(*message.q_measured);
  const double told = 1e-3 * state_.send_period;
  const double elapsed = (1.0 + step_.missed) * (told > 0.0 ? told : params_.period);
  const Vec7 farthest = (elapsed * fastest_).array() + kBeforeNoise;
  const bool is_near = ((state_.q - q_measured_).cwiseAbs() - farthest).maxCoeff() <= 0;
  may_begin_ = has_measured_ && is_near;
  q_measured_ = state_.q;
  has_measured_ = true;
}

/// A stop of the cabinet is one here, in the message that says so.
void ServoCycle::note_safety(const MonitoringMessage& message) noexcept {
  if (message.safety && *message.safety != fri::SafetyState::kNormal) {
    watchdog_.stop_for({StopReason::kSafety, -1, 1.0 * state_.safety, 0.0});
  }
  for (std::size_t i = 0; i < message.drive_states.size(); ++i) {
    if (message.drive_states[i] != fri::DriveState::kOff) continue;
    watchdog_.stop_for({StopReason::kDrivesOff, static_cast<std::int8_t>(i), 0.0, 0.0});
  }
}

/// Why this cabinet must not be commanded, though it would take commands.
Refusal ServoCycle::find_refusal(const MonitoringMessage& message) const noexcept {
  if (step_.problem != fri::Problem::kNone || !message.q_measured) {
    return Refusal::kProblem;
  }
  const bool is_first = !is_active_ || step_.is_first_active;
  if (is_first && !is_configuration(vector_of(*message.q_measured))) {
    return Refusal::kProblem;  // within a motion it is a damped hold
  }
  const double period = 1e-3 * state_.send_period * state_.multiplier;
  if (state_.send_period != 0 && std::abs(period - params_.period) > 1e-9) {
    return Refusal::kPeriod;
  }
  const bool is_active = step_.state == SessionState::kCommandingActive;
  if (is_first && is_active && !may_begin_) {
    return Refusal::kStart;
  }
  return Refusal::kNone;
}

void ServoCycle::begin_motion(const Vec7& q) noexcept {
  is_active_ = true;
  has_target_ = false;
  ++state_.motion;
  state_.implausible = 0;
  implausible_joint_ = -1;
  state_.first = session_.message().header.sequence;
  state_.time = 0.0;
  state_.is_at_rest = false;
  observer_.reset(q);
  watchdog_.begin();
  Vec3 p;
  Mat3 R;
  controller_.chain().pose(q, p, R);
  controller_.reset(q, p, quat_wxyz(R));
  filtered_ = q;
  q_last_ = q;
  lean_.setZero();
  q_hold_ = q;
  a_last_.setZero();
  target_age_ = 0.0;
  measured_ = 0.0;
  elapsed_ = params_.period;
}

void ServoCycle::end_motion(MotionEnd::Cause cause) noexcept {
  if (!is_active_) return;
  const MonitoringMessage& message = session_.message();
  state_.end = {cause,
                step_.problem,
                state_.session,
                message.command_mode.value_or(fri::CommandMode::kNone),
                state_.safety,
                state_.operation_mode,
                message.num_joints.value_or(7),
                params_.period,
                1e-3 * state_.send_period * state_.multiplier,
                state_.implausible,
                static_cast<std::int8_t>(implausible_joint_),
                state_.time - implausible_at_};
  is_active_ = may_begin_ = false;
  state_.is_plausible = true;
  has_target_ = false;
  state_.is_waiting = false;
  state_.dq.setZero();
}

void ServoCycle::lose_session() noexcept {
  end_motion(MotionEnd::Cause::kSilence);
  session_.reset();
  has_measured_ = may_begin_ = false;
  state_.session = SessionState::kIdle;
  state_.refusal = Refusal::kNone;
}

ServoCycle::Action ServoCycle::receive(const std::uint8_t* bytes,
                                       std::size_t size) noexcept {
  step_ = session_.receive(bytes, size);
  if (!step_.is_new) return Action::kNothing;
  const MonitoringMessage& message = session_.message();
  note(message);
  const bool is_commanding = step_.state >= SessionState::kCommandingWait;
  state_.refusal = is_commanding ? find_refusal(message) : Refusal::kNone;
  if (step_.state == SessionState::kCommandingActive &&
      state_.refusal == Refusal::kNone) {
    return receive_active(step_);
  }
  switch (state_.refusal) {
    case Refusal::kPeriod:
      end_motion(MotionEnd::Cause::kPeriod);
      break;
    case Refusal::kProblem:
      end_motion(MotionEnd::Cause::kProblem);
      break;
    default:
      end_motion(MotionEnd::Cause::kSession);
  }
  return step_.reply == fri::Reply::kNothing ? Action::kNothing : Action::kSend;
}

ServoCycle::Action ServoCycle::receive_active(const fri::SessionStep& step) noexcept {
  const Vec7 q = vector_of(*session_.message().q_measured);
  const bool is_first = !is_active_ || step.is_first_active;
  if (is_first) {
    end_motion(MotionEnd::Cause::kSession);  // if it ended without a message
    begin_motion(q);
  } else {
    measured_ += (1.0 + step.missed) * params_.period / state_.multiplier;
  }
  note_safety(session_.message());
  if (step.reply != fri::Reply::kActive) return Action::kNothing;
  if (is_first) {
    ++state_.tick;
    controller_.take(q, observer_.dq(), params_.period);
  } else {
    observer_.update(q, a_last_, measured_);
    controller_.take(q, observer_.dq(), measured_);
    elapsed_ += measured_;
    state_.time += measured_;
    state_.tick += std::max(1L, std::lround(measured_ / params_.period));
    measured_ = 0.0;
  }
  note_belief(q);
  state_.is_waiting = true;
  return Action::kAnswer;
}

/// What the controller believes of what was measured.
void ServoCycle::note_belief(const Vec7& q) noexcept {
  const StateCheck& check = controller_.state();
  q_measured_ = q;
  dq_observed_ = observer_.dq();
  state_.q = check.q();
  state_.dq = check.dq();
  state_.is_plausible = check.implausible() == 0;
  if (state_.is_plausible) return;
  observer_.doubt();
  ++state_.implausible;
  implausible_at_ = state_.time;
  implausible_joint_ = check.joint();
  if (check.implausible() < kImplausibleMax) return;
  watchdog_.stop_for({StopReason::kImplausible, static_cast<std::int8_t>(check.joint()),
                      static_cast<double>(check.implausible()), kImplausibleMax});
}

std::size_t ServoCycle::reply(std::uint8_t* out) noexcept {
  const MonitoringMessage& message = session_.message();
  const Joints q = message.q_ipo.value_or(message.q_measured.value_or(Joints{}));
  return session_.answer(q, Joints{}, out);
}

/// The order's Target, or a joint target that damps the arm and holds it where it
/// comes to rest.
Target ServoCycle::choose_target(const Order& order, Flags& flags) noexcept {
  const bool is_for_this = order.serial != 0 && order.motion == state_.motion;
  if (is_for_this && order.serial != serial_) target_age_ = 0.0;
  serial_ = order.serial;
  has_target_ = is_for_this;
  const Vec7 gravity = controller_.chain().gravity(state_.q);
  WatchdogInput input{state_.q, state_.dq, {}, {}, {}, 0.0, elapsed_};
  if (state_.tau_measured.allFinite()) input.tau_measured = state_.tau_measured;
  if (state_.tau_external.allFinite()) input.tau_external = state_.tau_external;
  if (state_.tau_commanded.allFinite()) {
    input.tau_commanded = params_.commanded_is_total
                              ? state_.tau_commanded
                              : Vec7(state_.tau_commanded + gravity);
  }
  // In lockstep time stands still while the learner thinks.
  if (has_target_ && !params_.lockstep) input.target_age = target_age_;
  Verdict verdict = watchdog_.check(input);
  state_.facts = watchdog_.facts();
  state_.is_stopped = verdict == Verdict::kStop;
  flags.stopped = state_.is_stopped;
  flags.target_late = verdict == Verdict::kHold;
  if (!has_target_ && verdict == Verdict::kFollow) verdict = Verdict::kHold;
  state_.is_held = verdict != Verdict::kFollow;
  if (verdict == Verdict::kFollow) {
    state_.is_at_rest = false;
    Target followed = order.target;
    followed.age += target_age_;
    return followed;
  }
  if (!state_.is_at_rest) {
    q_hold_ = state_.q;
    state_.is_at_rest = state_.dq.cwiseAbs().maxCoeff() < watchdog_.params().rest_speed;
  }
  Target hold;
  hold.joint_mode = true;
  hold.q_d = q_hold_;
  return hold;
}

/// Nobody leans an arm that does not follow.
Vec7 ServoCycle::wanted_lean(const Order& order) const noexcept {
  if (state_.is_held || !order.lean.allFinite()) return Vec7::Zero();
  return order.lean.cwiseMax(-kLeanMax).cwiseMin(kLeanMax);
}

/// What the controller ended outlives this motion: a stop, until it is cleared.
void ServoCycle::note_end(const Flags& flags) noexcept {
  if (!flags.ended) return;
  const LastLine& end = controller_.end();
  watchdog_.stop_for({StopReason::kLastLine, static_cast<std::int8_t>(end.joint()),
                      end.value(), end.limit(), end.cause()});
}

std::size_t ServoCycle::answer(const Order& order, std::uint8_t* out) noexcept {
  if (order.latch != latch_) {
    latch_ = order.latch;
    controller_.hold_at(order.p_hold, order.quat_hold);
  }
  target_age_ += elapsed_;
  Flags flags;
  const Target target = choose_target(order, flags);
  StepResult result = controller_.act(target);
  note_end(result.flags);
  result.flags.target_late = flags.target_late;
  result.flags.stopped = flags.stopped;
  log_row(result, target);
  filtered_ = filter_b_ * (state_.q + q_last_) + filter_a_ * filtered_;
  q_last_ = state_.q;
  a_last_ = result.a;
  lean_ += std::min(1.0, kLeanRate * params_.period) * (wanted_lean(order) - lean_);
  elapsed_ = 0.0;
  state_.is_waiting = false;
  return session_.answer(joints_of(filtered_ + lean_), joints_of(result.tau), out);
}

void ServoCycle::log_row(const StepResult& result, const Target& target) noexcept {
  const ToolMotion& motion = controller_.tool();
  ServoRow row;
  row.cycle.time = state_.time;
  row.cycle.q = q_measured_;
  row.cycle.dq = dq_observed_;
  row.cycle.tau = result.tau;
  row.cycle.position = motion.p;
  row.cycle.quat_wxyz = quat_wxyz(motion.R);
  row.cycle.velocity = motion.twist.head<3>();
  row.cycle.angular_velocity = motion.twist.tail<3>();
  row.cycle.contact_force.setConstant(kUnset);  // no sensor for it
  row.cycle.f_star = target.f_star.head<3>();
  row.cycle.flags = static_cast<double>(pack_flags(result.flags));
  const bool is_sensed = state_.tau_external.allFinite();
  const Vec6 wrench =
      is_sensed ? controller_.wrench(state_.tau_external) : controller_.wrench();
  row.cycle.wrench_force = wrench.head<3>();
  row.cycle.wrench_moment = wrench.tail<3>();
  row.tau_measured = state_.tau_measured;
  row.tau_external = state_.tau_external;
  row.sequence = session_.message().header.sequence;
  row.motion = static_cast<double>(state_.motion);
  row.elapsed = elapsed_;
  row.reason = static_cast<double>(state_.facts.reason);
  write_row(row, log_.next_row());
  log_.commit();
  state_.rows = log_.count();
}

}  // namespace dovetail
