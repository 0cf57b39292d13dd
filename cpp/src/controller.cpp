#include "dovetail/controller.hpp"

#include <algorithm>
#include <cmath>

#include "dovetail/input.hpp"
#include "dovetail/limit_stage.hpp"
#include "dovetail/parameters.hpp"
#include "dovetail/qp.hpp"

namespace dovetail {
namespace {

// Share of what a joint's speed limit allows that the way to a pose that jumps uses:
// a joint at its limit would be missed by the other axes.
constexpr double kWayShare = 0.85;

// Of the change of torque that is allowed: from here on it is on its way.
constexpr double kRampShare = 0.99;

constexpr double kFewPeriods = 3.0;  // between the last cycle and a reset that goes on

/// Whether a torque may leave, and what it was made from.
bool is_finite(const StepResult& result) noexcept {
  return (result.a0 + result.a + result.tau).allFinite();
}

/// Whether a Target asks for nothing new.
bool is_same(const Target& a, const Target& b) noexcept {
  return a.joint_mode == b.joint_mode && a.stay == b.stay && a.f_star == b.f_star &&
         a.position_d == b.position_d && a.quat_wxyz_d == b.quat_wxyz_d &&
         a.velocity_d == b.velocity_d && a.acceleration_d == b.acceleration_d &&
         a.near_plane == b.near_plane && a.q_d == b.q_d && a.f_tare == b.f_tare;
}

}  // namespace

Controller::Controller(const ChainParams& chain, const OscParams& osc,
                       const LimitParams& limits, const TaskSpec& task, double period)
    : chain_((check_chain(chain), chain)),
      osc_((check_osc(osc), check_task(task), osc), task, period),
      limits_((check_limits(limits), limits)),
      period_((check_period(period), period)),
      bounds_(limits, period),
      check_(limits, period),
      observer_(limits),
      walls_(limits),
      approach_(limits, period),
      standstill_(limits, period),
      last_line_(limits) {
  reset(Vec7::Zero(), Vec3::Zero(), Vec4(1.0, 0.0, 0.0, 0.0));
}

void Controller::reset(const Vec7& q, const Vec3& p_hold, const Vec4& quat_hold,
                       const Vec7& dq) noexcept {
  hold_at(p_hold, quat_hold);
  if (!goes_on(q, dq)) {
    observer_.reset();
    osc_.reset_integral();
    approach_.reset();
  }
  observer_.begin_jump();
  anchor_.reset();
  slew_.reset();
  resume();
  taken_ = Taken{};
  if (!goes_on(q, dq)) sent_.setZero();
  last_ = LastCycle{};
  was_plausible_ = true;
  has_start_ = is_configuration(q) && is_speed(dq);
  if (!has_start_) return;
  check_.reset(q, dq);
  update_model(q, dq);
}

void Controller::resume() noexcept {
  last_line_.reset();
  walls_.reset();
  posture_.reset();
}

void Controller::hold_at(const Vec3& p_hold, const Vec4& quat_hold) noexcept {
  has_hold_ = is_pose(p_hold, quat_hold);
  if (has_hold_) osc_.reset(p_hold, quat_hold);
  posture_.reset();
}

/// Whether the arm goes on from where it is: what pulls at it pulls on, too. One whose
/// measured speed is not told was put there.
bool Controller::goes_on(const Vec7& q, const Vec7& dq) const noexcept {
  if (!last_.is_valid || dq == Vec7::Zero()) return false;
  const Vec7 reach = kFewPeriods * period_ * limits_.dq_max;
  return ((q - check_.q()).cwiseAbs().array() <= reach.array()).all();
}

void Controller::take(const Vec7& q, const Vec7& dq, double elapsed) noexcept {
  const bool is_time = elapsed >= 0.0 && elapsed < kLongestTime;  // no NaN
  const double told = is_time && elapsed > kShortestTime ? elapsed : period_;
  const Vec7 inertia = model_.terms.M.diagonal();
  check_.take(q, dq, last_.a, model_.Minv * observer_.of_jump(), inertia, told);
  taken_.elapsed += told + check_.missed();
  taken_.is_time = taken_.is_time && is_time;
  taken_.is_number = is_configuration(q) && is_speed(dq);
  taken_.is_return = taken_.is_return || check_.is_return();
  if (check_.is_return()) observer_.take_back_jump();
  if (check_.is_jump()) observer_.begin_jump();
}

StepResult Controller::act(const Target& target) noexcept {
  const Vec7& q = check_.q();
  const Vec7& dq = check_.dq();
  const Taken taken = taken_;
  taken_ = Taken{.is_number = taken.is_number};
  const bool is_plausible = check_.implausible() == 0;
  // Where belief comes back, its step is no push.
  const bool may_learn = is_plausible && was_plausible_ && !taken.is_return;
  was_plausible_ = is_plausible;
  if (may_learn) observe(dq, taken.elapsed);

  const bool is_usable = is_usable_cycle(target, taken.is_time);
  // A hand may move the arm now.
  if (!is_usable && check_.implausible() < 2) osc_.forget_way();
  StepResult result = is_usable ? follow(target, q, dq, taken.elapsed) : brake(q, dq);
  result.flags.implausible = !is_plausible;
  result.flags.bad_input = result.flags.bad_input || !taken.is_number;
  result.flags.ended = is_ended();
  return result;
}

/// Whether there is a state, a pose and a Target that a cycle can use.
bool Controller::is_usable_cycle(const Target& target, bool is_time) const noexcept {
  return has_start_ && has_hold_ && is_usable(target) && is_time &&
         check_.implausible() < 2;
}

/// Learns the disturbance from the interval that has just ended, whose model is still
/// there.
void Controller::observe(const Vec7& dq, double elapsed) noexcept {
  if (!last_.is_valid) return;
  observer_.update({.M = model_.terms.M,
                    .h = model_.h,
                    .tau = last_.tau,
                    .change = dq - last_.dq,
                    .elapsed = elapsed,
                    .is_jump = check_.is_jump(),
                    .is_ended = is_ended()});
}

void Controller::update_model(const Vec7& q, const Vec7& dq) noexcept {
  model_.update(chain_, limits_, period_, q, dq, observer_.torque());
  model_.keep_near(sent_, limits_.dtau_max * period_);
}

void Controller::update_bounds(const Vec7& q, const Vec7& dq) noexcept {
  bounds_.update(limits_, model_, walls_, q, dq, is_ended());
}

/// Acceleration with which a standstill or a joint target opposes a disturbance
/// [rad/s2].
Vec7 Controller::opposing(const Vec7& r) const noexcept {
  return model_.Minv * observer_.opposed(r);
}

/// A cycle with usable input: what is asked for, brought into the limits.
StepResult Controller::follow(const Target& target, const Vec7& q, const Vec7& dq,
                              double elapsed) noexcept {
  update_model(q, dq);
  walls_.update(model_.tool.p, elapsed);
  update_bounds(q, dq);
  StepResult result;
  if (is_ended()) {
    stand_still(q, dq, elapsed, result);
  } else {
    const LimiterEffort effort = target.joint_mode
                                     ? follow_joints(q, dq, target, result)
                                     : follow_task(q, dq, target, result);
    limit(result);
    if (is_finite(result) && !is_explained(target, dq, result, effort, elapsed)) {
      end_motion(q, dq);
      stand_still(q, dq, elapsed, result);
    }
  }
  if (is_finite(result)) {
    finish(dq, result);
  } else {
    observer_.drop();
    osc_.reset_integral();
    approach_.reset();
    result = brake(q, dq);
  }
  return result;
}

/// a0 = M^-1 (u0 - h)
Controller::LimiterEffort Controller::follow_task(const Vec7& q, const Vec7& dq,
                                                  const Target& target,
                                                  StepResult& result) noexcept {
  const ToolMotion& tool = model_.tool;
  if (!posture_) posture_ = q;
  // Near contact it stays as it was: what pulls there is no weight.
  if (height(target, tool) > 0.0) {
    osc_.integrate(model_.terms.J * model_.push + target.f_tare);
  }
  approach_.follow_weight(target, model_);
  Vec6 f_star;
  const double excess = limits_.walls ? approach_.excess_press(target, tool) : 0.0;
  if (excess > 0.0) {
    Target eased = target;
    eased.f_star.head<3>() += excess * target.near_plane.head<3>();
    f_star = osc_.desired_acceleration(tool.p, tool.R, tool.twist, eased);
  } else {
    f_star = osc_.desired_acceleration(tool.p, tool.R, tool.twist, target);
  }
  anchor_.pull(target, osc_, tool, f_star);
  const Vec3 asked = f_star.head<3>();
  FStarCut cut;
  if (limits_.walls) {
    cut = approach_.cut(target, model_, osc_, bounds_, walls_, f_star);
    result.flags.wall_velocity |= cut.near;
    bounds_.mark_walls(cut.upper, cut.lower, result.flags);
  }
  osc_.evaluate(model_.terms, model_.terms.M, model_.factor, dq, f_star,
                osc_.posture_acceleration(q, *posture_), task_terms_);
  osc_.set_pace(pace());
  // Axis by axis, as it was cut: through Lambda a brake of one would drive another.
  const auto mass = task_terms_.Lambda.diagonal().head<3>();
  LimiterEffort effort;
  effort.power = mass.cwiseProduct(f_star.head<3>() - asked).dot(tool.twist.head<3>());
  effort.push = mass.cwiseProduct(cut.push).norm();
  result.a0.noalias() = model_.Minv * (task_terms_.u0 - model_.h);
  return effort;
}

/// Share of the way's speed at which no joint meets its speed limit.
double Controller::pace() const noexcept {
  const Vec6 force = task_terms_.Lambda * osc_.way_speed();
  const Vec7 speed = model_.Minv * (task_terms_.J.transpose() * force);
  const double share = kWayShare * (1.0 - limits_.delta_v);
  const double over = speed.cwiseQuotient(share * limits_.dq_max).cwiseAbs().maxCoeff();
  return over > 1.0 ? 1.0 / over : 1.0;  // 1 where it is no number
}

/// a0 = K (q_d - q) - D dq, each joint inside its own interval: one that cannot follow
/// must not draw the others along. What pushes is held against.
Controller::LimiterEffort Controller::follow_joints(const Vec7& q, const Vec7& dq,
                                                    const Target& target,
                                                    StepResult& result) noexcept {
  posture_.reset();
  osc_.forget_way();
  const Vec7 wanted =
      osc_.joint_acceleration(q, dq, target.q_d) - opposing(observer_.steady());
  result.a0 = wanted.cwiseMax(bounds_.lb).cwiseMin(bounds_.ub);
  if (!wanted.allFinite()) result.a0 = wanted;  // a NaN must not pass for a bound
  unsigned upper = 0, lower = 0;
  for (int i = 0; i < kNumJoints; ++i) {
    if (wanted[i] > bounds_.ub[i]) upper |= bit(i);
    if (wanted[i] < bounds_.lb[i]) lower |= bit(i);
  }
  bounds_.mark_joints(upper, lower, result.flags);
  task_terms_ = {Mat67::Zero(), Mat6::Zero(), Vec6::Zero(),
                 model_.terms.M * result.a0 + model_.h, true};
  return {};
}

void Controller::limit(StepResult& result) noexcept {
  limit_acceleration(limits_, model_, bounds_, is_ended(), result);
}

/// Shows the cycle to the last line: what a new Target changes is explained by it.
bool Controller::is_explained(const Target& target, const Vec7& dq,
                              const StepResult& result, const LimiterEffort& effort,
                              double elapsed) noexcept {
  const bool is_new = !last_.is_valid || !is_same(target, last_target_);
  last_target_ = target;
  Vec7 explained = Vec7::Zero();
  if (is_new) explained = (result.a0 - last_.a0).cwiseAbs();
  if (is_new && !target.joint_mode) {
    const Vec6 way = task_terms_.Lambda * osc_.way_to_come();
    explained += (model_.Minv * (task_terms_.J.transpose() * way)).cwiseAbs();
  }
  // Less braking than was asked for is no drive: the arm must be driven, too.
  const double added = effort.power + dq.dot(result.tau - task_terms_.u0);
  const double driven = dq.dot(result.tau - model_.h);
  // A wall that takes the tool back inside works against what is asked.
  const bool is_led = walls_.is_widened();
  // A torque on its way to the wanted one drives on for a while: that is no limiter.
  const Vec7 step = kRampShare * period_ * limits_.dtau_max;
  const bool is_ramp = ((result.tau - sent_).cwiseAbs().array() >= step.array()).any();
  const bool is_free = target.joint_mode || is_led || is_ramp;
  const double power = is_free ? 0.0 : std::min(added, driven);
  return !last_line_.check(
      {dq, explained, power, effort.push, elapsed, check_.is_jump()});
}

/// From here on the arm stands still. What may have driven the motion is forgotten, but
/// for what holds a joint at its limit: a load that grew as quickly would take it past
/// the limit.
void Controller::end_motion(const Vec7& q, const Vec7& dq) noexcept {
  if (last_line_.is_loop()) {
    unsigned at_limit = 0;
    for (int i = 0; i < kNumJoints; ++i) {
      if (is_at_limit(limits_, i, q[i])) at_limit |= bit(i);
    }
    observer_.keep_slow_part(at_limit);
    slew_.begin();  // no hurry, and a wrong state may have been the cause
  }
  standstill_.begin(dq);
  update_model(q, dq);
  update_bounds(q, dq);
}

/// Keeps the arm where the motion ended, softly: what it was about is not known here.
void Controller::stand_still(const Vec7& q, const Vec7& dq, double elapsed,
                             StepResult& result) noexcept {
  posture_.reset();
  osc_.forget_way();
  result.flags = Flags{};
  result.a0 = standstill_.acceleration(q, dq, elapsed) - opposing(observer_.torque());
  free_braking(limits_, q, dq, bounds_);
  limit(result);
}

/// Slows down inside the joints' limits, against what pushes, without a task.
StepResult Controller::brake(const Vec7& q, const Vec7& dq) noexcept {
  update_model(q, dq);
  update_bounds(q, dq);
  const Vec7 asked = (standstill_.braking(dq) - opposing(observer_.torque()))
                         .cwiseMax(bounds_.lb)
                         .cwiseMin(bounds_.ub);
  const Vec7 h = bias();
  StepResult result;
  result.flags.bad_input = true;
  result.a = result.a0 = asked + model_.push;
  result.tau = model_.terms.M * result.a + h;
  if (is_finite(result) && (model_.lo + model_.hi).allFinite()) {
    result.tau = result.tau.cwiseMax(model_.lo).cwiseMin(model_.hi);
    slow_down(result);
  } else {  // the model is not: gravity compensation alone holds
    const Vec7 step = limits_.dtau_max * period_;
    result.a = result.a0 = Vec7::Zero();
    result.tau = Vec7::Zero().cwiseMax(sent_ - step).cwiseMin(sent_ + step);
  }
  remember(dq, result.a, result.a, result.tau);
  return result;
}

/// Lets the torque change slowly where the state is in doubt.
void Controller::slow_down(StepResult& result) noexcept {
  if (!slew_.limit(check_, last_.tau, !last_.is_valid, result.tau)) return;
  // The last torque may be beyond limits that gravity has moved since.
  result.tau = result.tau.cwiseMax(model_.lo).cwiseMin(model_.hi);
  result.a = model_.Minv * (result.tau - model_.h) + model_.push;
}

/// Clips what is left beyond the motors, and remembers the cycle.
void Controller::finish(const Vec7& dq, StepResult& result) noexcept {
  slow_down(result);
  const Vec7 clipped = result.tau.cwiseMax(model_.lo).cwiseMin(model_.hi);
  remember(dq, result.a0, result.a, clipped);
  if ((clipped - result.tau).cwiseAbs().maxCoeff() > kTorqueTolerance) {
    result.flags.unsafe = true;
    last_.a = model_.Minv * (clipped - model_.h) + model_.push;
  }
  result.tau = clipped;
  result.flags.displaced = (result.a - result.a0).norm();
}

void Controller::remember(const Vec7& dq, const Vec7& a0, const Vec7& a,
                          const Vec7& tau) noexcept {
  last_.is_valid = true;
  last_.dq = dq;
  last_.a0 = a0;
  last_.a = a;
  last_.tau = tau;
  sent_ = tau;
}

}  // namespace dovetail
