// What a cycle asks for: of the task, of the joints, or of an arm whose motion was
// ended; before the limits. And how quickly an answer to a doubtful state may come.
#include <algorithm>
#include <cmath>

#include "dovetail/controller.hpp"

namespace dovetail {
namespace {

// After the last line: a hold that is stable with any delay there is.
constexpr double kEndStiffness = 50.0;   // [1/s2]
constexpr double kEndDamping = 15.0;     // [1/s]
constexpr double kFreeBraking = 1000.0;  // beyond what the limits allow [1/s]
constexpr double kRestSpeed = 0.02;      // [rad/s]
constexpr double kEndQuickest = 40.0;    // of speeds that are damped: 6 Hz [1/s]

// An axis that stays is held where it comes to be slower than this [m/s].
constexpr double kStaySpeed = 0.01;
constexpr double kStayError = 0.02;  // largest way back that is used [m]

// Time in which a speed near contact is corrected [s]: the estimate makes the loop up
// to twice as quick; with 0.04 an arm with 10 ms of delay swung on at 12 Hz.
constexpr double kNearTime = 0.05;

// Share of what a joint's speed limit allows that the way to a pose that jumps uses:
// a joint at its limit would be missed by the other axes.
constexpr double kWayShare = 0.85;

// Fastest surface that the tool may go along with near contact [m/s]. It need not: a
// tool that stands is not pushed.
constexpr double kFastestSurface = 0.1;

// Height over the near plane in which near_press comes to act whole [m].
constexpr double kNearBand = 0.002;

// At which a wall comes in from where the tool was at the start, outside of it [m/s].
constexpr double kReturnSpeed = 0.05;

// While the state is in doubt: what a torque may change in a cycle [Nm]. A bad sample
// may be worth 20, of which encoders' noise and gravity's change have their part.
constexpr double kLargestStep = 18.0;

// Cycles for which it does, and what of one comes back in each. A torque that lags for
// longer drives an oscillation, which then looks doubtful.
constexpr double kPatience = 9.0;
constexpr double kRegained = 0.2;

constexpr double kFewPeriods = 3.0;  // between the last cycle and a reset that goes on

std::uint8_t bit(int i) noexcept { return static_cast<std::uint8_t>(1U << i); }

}  // namespace

/// Whether the arm goes on from where it is: what pulls at it pulls on, too. One whose
/// measured speed is not told was put there.
bool Controller::goes_on(const Vec7& q, const Vec7& dq) const noexcept {
  if (!has_last_ || dq == Vec7::Zero()) return false;
  const Vec7 reach = kFewPeriods * period_ * limits_.dq_max;
  return ((q - check_.q()).cwiseAbs().array() <= reach.array()).all();
}

/// A wall that the tool is behind at the start, margin included, begins at the tool,
/// and comes in slowly: it takes the tool along.
void Controller::update_walls(double elapsed) noexcept {
  const double way = kReturnSpeed * elapsed;
  const double margin = wall_params_.delta_x;
  x_min_ = has_walls_ ? Vec3(x_min_.array() + way) : Vec3(tool_.p.array() - margin);
  x_max_ = has_walls_ ? Vec3(x_max_.array() - way) : Vec3(tool_.p.array() + margin);
  x_min_ = x_min_.cwiseMin(limits_.x_min);
  x_max_ = x_max_.cwiseMax(limits_.x_max);
  has_walls_ = true;
}

/// Of the tool over the near plane [m].
double Controller::height(const Target& target) const noexcept {
  return target.near_plane.head<3>().dot(tool_.p) - target.near_plane[3];
}

/// Height over the near plane [m] in which the tool can be braked to near_speed.
double Controller::braking_room(const Target& target) const noexcept {
  const Vec3 normal = target.near_plane.head<3>();
  const double fall = std::min(normal.dot(tool_.twist.head<3>()), 0.0);
  return std::max(height(target) + kNearTime * fall, 0.0);
}

/// Speed limit of a TCP axis [m/s]: near_speed below the near plane, above it what can
/// be braked to that in the room that there is.
double Controller::speed_limit(int axis, double room) const noexcept {
  const double brake = limits_.eta_wall * limits_.ddx_max[axis];
  return std::sqrt(limits_.near_speed * limits_.near_speed + 2.0 * brake * room);
}

/// How much of f* against the near plane's normal is more than near_press [m/s2]: below
/// the plane whole, above it less and less over kNearBand, so that nothing switches.
double Controller::excess_press(const Target& target) const noexcept {
  const Vec3 normal = target.near_plane.head<3>();
  const double share = 1.0 - std::clamp(height(target) / kNearBand, 0.0, 1.0);
  const double press = normal.dot((target.f_tare - target.f_star).head<3>());
  return share * std::max(press - limits_.near_press, 0.0);
}

/// `under_push` of a limit that nothing is held against at.
double Controller::below(double limit, double push, double speed) const noexcept {
  if (!limits_.passive) return limit - push;
  return under_push(limit, push, speed, 0.0, limits_.brake_rate);
}

/// What of an axis' acceleration [m/s2] is a push of its limiters: what was neither
/// asked for nor holds weight nor brakes. With passive limits nothing, inside the
/// walls. One that cancels a contact finds no motion to brake, and presses the harder
/// the more it is pressed.
double Controller::limiter_push(int axis, double asked, double kept,
                                double tare) const noexcept {
  const double p = tool_.p[axis];
  const double margin = limits_.delta_x;
  if (p > x_max_[axis] - margin || p < x_min_[axis] + margin) return 0.0;
  const auto [low, high] = std::minmax({asked, tare, 0.0});
  const double excess = kept - std::clamp(kept, low, high);
  const double speed = tool_.twist[axis];
  const double rate = std::max(limits_.brake_rate, 2.0 / (limits_.kappa * period_));
  const double braking = excess * speed < 0.0 ? rate * std::abs(speed) : 0.0;
  return std::max(std::abs(excess) - braking, 0.0);
}

/// Asks the tool for no more than its limits allow. The QP, which knows no axes but the
/// limited one, would pay for the rest with the other axes and the rotation; and near
/// contact its interval is too short for a loop with delay.
void Controller::keep_inside(const Target& target, Vec6& f_star, StepResult& result,
                             Vec3& push_by_limits) const noexcept {
  const Vec7 lost = osc_.params().use_coriolis ? Vec7(h_ - terms_.c) : h_;
  Vec3 drift = terms_.J.topRows<3>() * (Minv_ * -lost).eval();
  if (!osc_.params().use_jdot) drift += terms_.dJdq.head<3>();
  const bool is_qp = limits_.scheme == Scheme::kQp;
  const Vec6 wanted = desired_velocity(target);
  const double room = braking_room(target);
  unsigned upper = 0;
  unsigned lower = 0;
  for (int i = 0; i < 3; ++i) {
    if (osc_.task()[i] == AxisMode::kFree) continue;
    const double near = speed_limit(i, room);
    const double speed = tool_.twist[i];
    const bool is_force = osc_.task()[i] == AxisMode::kForce;
    const double surface =
        is_force ? std::clamp(wanted[i], -kFastestSurface, kFastestSurface) : 0.0;
    const double push = push_x_[i] + target.f_tare[i];  // weight is held already
    const double tare = target.f_tare[i];
    double high =
        below((near + std::max(surface, 0.0) - speed) / kNearTime, push, speed) + tare;
    double low =
        -below((near + std::max(-surface, 0.0) + speed) / kNearTime, -push, -speed) +
        tare;
    const std::uint8_t axis = bit(i);
    if (f_star[i] > high - drift[i] || f_star[i] < low - drift[i]) {
      result.flags.wall_velocity |= axis;
    }
    if (is_qp && bounds_.cu[i] < high) {
      high = bounds_.cu[i];
      if (f_star[i] > high - drift[i]) upper |= axis;
    }
    if (is_qp && bounds_.cl[i] > low) {
      low = bounds_.cl[i];
      if (f_star[i] < low - drift[i]) lower |= axis;
    }
    const double asked = f_star[i];
    f_star[i] = std::max(std::min(f_star[i], high - drift[i]), low - drift[i]);
    push_by_limits[i] = limiter_push(i, asked + drift[i], f_star[i] + drift[i], tare);
  }
  mark_walls(upper, lower, result.flags);
}

/// Springs to where the tool came to rest, on force axes that are asked for nothing.
void Controller::stay(const Target& target, Vec6& f_star) noexcept {
  for (int i = 0; i < 3; ++i) {
    const std::uint8_t axis = bit(i);
    if (!(target.stay & axis) || osc_.task()[i] != AxisMode::kForce) {
      staying_ &= ~static_cast<unsigned>(axis);
      continue;
    }
    if (!(staying_ & axis)) {
      anchor_[i] = tool_.p[i];
      if (std::abs(tool_.twist[i]) < kStaySpeed) staying_ |= axis;
    }
    const double error = std::clamp(anchor_[i] - tool_.p[i], -kStayError, kStayError);
    f_star[i] += osc_.params().stiffness[i] * error;
  }
}

/// Share of the way's speed at which no joint meets its speed limit.
double Controller::pace() const noexcept {
  const Vec6 force = task_terms_.Lambda * osc_.way_speed();
  const Vec7 speed = Minv_ * (task_terms_.J.transpose() * force);
  const double share = kWayShare * (1.0 - limits_.delta_v);
  const double over = speed.cwiseQuotient(share * limits_.dq_max).cwiseAbs().maxCoeff();
  return over > 1.0 ? 1.0 / over : 1.0;  // 1 where it is no number
}

/// a0 = M^-1 (u0 - h)
void Controller::follow_task(const Vec7& q, const Vec7& dq, const Target& target,
                             StepResult& result) noexcept {
  if (!has_posture_) posture_ = q;
  has_posture_ = true;
  // Near contact it stays as it was: what pulls there is no weight.
  if (height(target) > 0.0) osc_.follow_sag(terms_.J * push_ + target.f_tare);
  Vec6 f_star;
  const double excess = limits_.walls ? excess_press(target) : 0.0;
  if (excess > 0.0) {
    Target eased = target;
    eased.f_star.head<3>() += excess * target.near_plane.head<3>();
    f_star = osc_.desired_acceleration(tool_.p, tool_.R, tool_.twist, eased);
  } else {
    f_star = osc_.desired_acceleration(tool_.p, tool_.R, tool_.twist, target);
  }
  stay(target, f_star);
  const Vec3 asked = f_star.head<3>();
  Vec3 pushed = Vec3::Zero();
  if (limits_.walls) keep_inside(target, f_star, result, pushed);
  osc_.evaluate(terms_, terms_.M, factor_, dq, f_star,
                osc_.posture_acceleration(q, posture_), task_terms_);
  osc_.set_pace(pace());
  // Axis by axis, as it was cut: through Lambda a brake of one would drive another.
  limiter_power_ = task_terms_.Lambda.diagonal()
                       .head<3>()
                       .cwiseProduct(f_star.head<3>() - asked)
                       .dot(tool_.twist.head<3>());
  limiter_push_ = task_terms_.Lambda.diagonal().head<3>().cwiseProduct(pushed).norm();
  result.a0.noalias() = Minv_ * (task_terms_.u0 - h_);
}

/// a0 = K (q_d - q) - D dq, each joint inside its own interval: one that cannot follow
/// must not draw the others along. What pushes is held against.
void Controller::follow_joints(const Vec7& q, const Vec7& dq, const Target& target,
                               StepResult& result) noexcept {
  has_posture_ = false;
  limiter_push_ = 0.0;
  osc_.forget_way();
  const Vec7 wanted = osc_.joint_acceleration(q, dq, target.q_d) - held(steady_);
  result.a0 = wanted.cwiseMax(bounds_.lb).cwiseMin(bounds_.ub);
  if (!wanted.allFinite()) result.a0 = wanted;  // a NaN must not pass for a bound
  unsigned upper = 0, lower = 0;
  for (int i = 0; i < kNumJoints; ++i) {
    if (wanted[i] > bounds_.ub[i]) upper |= bit(i);
    if (wanted[i] < bounds_.lb[i]) lower |= bit(i);
  }
  mark_joints(upper, lower, result.flags);
  task_terms_ = {Mat67::Zero(), Mat6::Zero(), Vec6::Zero(), terms_.M * result.a0 + h_,
                 true};
}

/// What the last known motion needs to end, softly [rad/s2].
Vec7 Controller::braking() const noexcept {
  const double time = std::max(limits_.kappa * period_, 0.02);  // [s]
  const Vec7 most = limits_.eta * limits_.ddq_max;
  return (-dq_last_ / time).cwiseMax(-most).cwiseMin(most);
}

/// Held where the motion ended, softly: what it was about is not known here. A limit
/// then takes work from the arm and gives none: it is a stop to its own joint, by a
/// torque of that joint alone (Gauss's principle), and braking is free. Elsewhere it
/// may take torques of other joints, and forbid a pushed joint to brake: both can load
/// a spring at the tool, turn by turn.
void Controller::follow_end(const Vec7& q, const Vec7& dq, double elapsed,
                            StepResult& result) noexcept {
  if (!is_at_rest_) {
    q_end_ = q;
    is_at_rest_ = dq.cwiseAbs().maxCoeff() < kRestSpeed;
  }
  dq_end_ += (1.0 - std::exp(-kEndQuickest * elapsed)) * (dq - dq_end_);
  result.a0 = kEndStiffness * (q_end_ - q) - kEndDamping * dq_end_ - held(disturbance_);
  result.flags = Flags{};
  for (int i = 0; i < kNumJoints; ++i) {
    if (is_behind(i, q[i])) continue;
    bounds_.ub[i] += kFreeBraking * std::max(-dq[i], 0.0);
    bounds_.lb[i] -= kFreeBraking * std::max(dq[i], 0.0);
  }
  has_posture_ = false;
  osc_.forget_way();
}

/// Whether a joint stands within a limit's margin, or beyond.
bool Controller::is_behind(int joint, double q) const noexcept {
  return q > limits_.q_max[joint] - limits_.delta_q ||
         q < limits_.q_min[joint] + limits_.delta_q;
}

/// While the state is in doubt the torque changes slowly, into a damped hold and out of
/// it, too: on the straight line between the last torque and the wanted one, which
/// keeps limits that both keep. Joint by joint each would disturb the others. What was
/// begun slowly is ended slowly: the rest of a step does not come at once where the
/// doubt ends.
void Controller::soften(StepResult& result) noexcept {
  const Vec7 change = result.tau - tau_last_;
  const double most = change.cwiseAbs().maxCoeff();
  const bool is_large = has_last_ && most > kLargestStep;
  lagged_ = check_.is_refused() ? 0.0 : std::max(lagged_ - kRegained, 0.0);
  const bool may_wait = is_large && lagged_ < kPatience;
  is_soft_ = may_wait && (is_soft_ || check_.is_in_doubt() || check_.is_remarked());
  if (!is_soft_) return;
  lagged_ += 1.0;
  result.tau = tau_last_ + (kLargestStep / most) * change;
  // The last torque may be beyond limits that gravity has moved since.
  result.tau = result.tau.cwiseMax(lo_).cwiseMin(hi_);
  result.a = Minv_ * (result.tau - h_) + push_;
}

}  // namespace dovetail
