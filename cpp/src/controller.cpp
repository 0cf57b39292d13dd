#include "dovetail/controller.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dovetail/input.hpp"
#include "dovetail/parameters.hpp"
#include "dovetail/qp.hpp"
#include "dovetail/saturation.hpp"

namespace dovetail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Of tau_max: what is taken for a disturbance, but of a joint that is at its limit.
constexpr double kUsualEstimate = 0.3;

// After the last line a wall is worth so much mass [kg]: held against a jam it would
// drive the joints.
constexpr double kEndRho = 1.0;

/// Whether a torque may leave, and what it was made from.
bool is_finite(const StepResult& result) noexcept {
  return (result.a0 + result.a + result.tau).allFinite();
}

/// The paper's bounds as printed may be empty: the side moved towards wins.
Interval not_empty(Interval interval, double v) noexcept {
  if (interval.lb <= interval.ub) return interval;
  if (v >= 0.0) {
    interval.lb = interval.ub;
  } else {
    interval.ub = interval.lb;
  }
  return interval;
}

/// Whether a Target asks for nothing new.
bool is_same(const Target& a, const Target& b) noexcept {
  return a.joint_mode == b.joint_mode && a.stay == b.stay && a.f_star == b.f_star &&
         a.position_d == b.position_d && a.quat_wxyz_d == b.quat_wxyz_d &&
         a.velocity_d == b.velocity_d && a.acceleration_d == b.acceleration_d &&
         a.near_plane == b.near_plane && a.q_d == b.q_d && a.f_tare == b.f_tare;
}

std::uint8_t bit(int i) noexcept { return static_cast<std::uint8_t>(1U << i); }

}  // namespace

Controller::Controller(const ChainParams& chain, const OscParams& osc,
                       const LimitParams& limits, const TaskSpec& task, double period)
    : chain_((check_chain(chain), chain)),
      osc_((check_osc(osc), check_task(task), osc), task, period),
      limits_((check_limits(limits), limits)),
      period_((check_period(period), period)),
      joint_params_{limits.bounds,    period,         limits.kappa,
                    limits.eta,       limits.delta_q, limits.delta_v,
                    limits.authority, limits.passive, limits.brake_rate},
      wall_params_{limits.bounds,    period,         limits.kappa,
                   limits.eta_wall,  limits.delta_x, limits.delta_v,
                   limits.authority, limits.passive, limits.brake_rate},
      x_min_(limits.x_min),
      x_max_(limits.x_max),
      check_(limits, period),
      last_line_(limits) {
  const auto walls_off = Vec3::Constant(kInfinity);
  bounds_.cl = -walls_off;
  bounds_.cu = walls_off;
  bounds_.cl_cause.fill(BoundCause::kAcceleration);
  bounds_.cu_cause.fill(BoundCause::kAcceleration);
  reset(Vec7::Zero(), Vec3::Zero(), Vec4(1.0, 0.0, 0.0, 0.0));
}

void Controller::reset(const Vec7& q, const Vec3& p_hold, const Vec4& quat_hold,
                       const Vec7& dq) noexcept {
  hold_at(p_hold, quat_hold);
  if (!goes_on(q, dq)) {
    disturbance_ = steady_ = weight_ = Vec7::Zero();
    osc_.forget_sag();
  }
  of_jump_.setZero();
  dq_last_ = tau_last_ = a_last_ = a0_last_ = Vec7::Zero();
  staying_ = 0;
  resume();
  has_last_ = is_soft_ = false;
  lagged_ = since_ = 0.0;
  was_plausible_ = is_time_ = is_number_ = true;
  is_return_ = false;
  has_start_ = is_configuration(q) && is_speed(dq);
  if (!has_start_) return;
  check_.reset(q, dq);
  update_model(q, dq);
}

void Controller::hold_at(const Vec3& p_hold, const Vec4& quat_hold) noexcept {
  has_hold_ = is_pose(p_hold, quat_hold);
  if (has_hold_) osc_.reset(p_hold, quat_hold);
  has_posture_ = false;
}

void Controller::update_model(const Vec7& q, const Vec7& dq) noexcept {
  const double ahead = limits_.mid_interval ? 0.5 * period_ : 0.0;
  chain_.evaluate(q + ahead * dq, dq, terms_);
  chain_.tool_motion(q, dq, tool_);
  terms_.M.diagonal() += limits_.armature;
  factor_.factor(terms_.M);
  Minv_ = factor_.inverse();
  h_ = terms_.c + limits_.damping.cwiseProduct(dq);
  const Vec7 usual = kUsualEstimate * limits_.tau_max;
  const Vec7 cut = disturbance_.cwiseMax(-usual).cwiseMin(usual);
  push_.noalias() = Minv_ * cut;
  push_whole_ = push_;
  if (cut != disturbance_) push_whole_.noalias() = Minv_ * disturbance_;
  push_x_.noalias() = terms_.J.topRows<3>() * push_;
  lo_ = -limits_.tau_max - tool_.g;
  hi_ = limits_.tau_max - tool_.g;
}

void Controller::update_bounds(const Vec7& q, const Vec7& dq) noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    const double push = is_behind(i, q[i]) ? push_whole_[i] : push_[i];
    const Interval joint = not_empty(
        acceleration_bounds(q[i], dq[i], limits_.q_min[i], limits_.q_max[i],
                            limits_.dq_max[i], limits_.ddq_max[i], joint_params_, push),
        dq[i]);
    bounds_.lb[i] = joint.lb;
    bounds_.ub[i] = joint.ub;
    bounds_.lb_cause[i] = joint.lb_cause;
    bounds_.ub_cause[i] = joint.ub_cause;
  }
  if (!limits_.walls) return;
  for (int i = 0; i < 3; ++i) {
    const double speed = tool_.twist[i];
    const Interval wall = not_empty(
        acceleration_bounds(tool_.p[i], speed, x_min_[i], x_max_[i], limits_.dx_max[i],
                            limits_.ddx_max[i], wall_params_, push_x_[i]),
        speed);
    bounds_.cl[i] = wall.lb;
    bounds_.cu[i] = wall.ub;
    bounds_.cl_cause[i] = wall.lb_cause;
    bounds_.cu_cause[i] = wall.ub_cause;
  }
}

void Controller::mark_joints(unsigned upper, unsigned lower,
                             Flags& flags) const noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    const bool is_upper = (upper >> i) & 1U;
    if (!is_upper && !((lower >> i) & 1U)) continue;
    switch (is_upper ? bounds_.ub_cause[i] : bounds_.lb_cause[i]) {
      case BoundCause::kPosition:
        flags.joint_position |= bit(i);
        break;
      case BoundCause::kVelocity:
        flags.joint_velocity |= bit(i);
        break;
      case BoundCause::kAcceleration:
        flags.joint_acceleration |= bit(i);
        break;
    }
  }
}

void Controller::mark_walls(unsigned upper, unsigned lower,
                            Flags& flags) const noexcept {
  for (int i = 0; i < 3; ++i) {
    const bool is_upper = (upper >> i) & 1U;
    if (!is_upper && !((lower >> i) & 1U)) continue;
    switch (is_upper ? bounds_.cu_cause[i] : bounds_.cl_cause[i]) {
      case BoundCause::kPosition:
        flags.wall_position |= bit(i);
        break;
      case BoundCause::kVelocity:
        flags.wall_velocity |= bit(i);
        break;
      case BoundCause::kAcceleration:
        flags.wall_acceleration |= bit(i);
        break;
    }
  }
}

void Controller::limit_by_qp(StepResult& result) noexcept {
  const Mat37 Jc = terms_.J.topRows<3>();
  const Vec3 djc = terms_.dJdq.head<3>();
  const bool is_ended = last_line_.cause() != EndCause::kNone;
  const double rho = is_ended ? kEndRho : limits_.rho;
  // After an end a joint has its own motor alone. That others help one that is not
  // strong enough is right in free space; what it touches they would only load.
  const Vec7 beyond = Vec7::Constant(is_ended ? kInfinity : 0.0);
  const QpResult qp =
      solve_qp({terms_.M, Minv_, result.a0, bounds_.lb, bounds_.ub, Jc, djc, bounds_.cl,
                bounds_.cu, h_, lo_ - beyond, hi_ + beyond, rho});
  result.a = qp.a + push_;
  result.a0 += push_;
  result.tau = qp.tau;
  result.flags.torque = qp.torque;
  result.flags.wall_displaced = qp.wall_displaced;
  result.flags.unsafe = qp.unsafe;
  result.flags.qp_early = !qp.ok;
  mark_joints(qp.upper, qp.lower, result.flags);
  mark_walls(qp.wall_upper, qp.wall_lower, result.flags);
}

void Controller::limit_by_cascade(StepResult& result) noexcept {
  Vec7 a = result.a0;
  const Mat37 Jc = terms_.J.topRows<3>();
  const Vec3 djc = terms_.dJdq.head<3>();
  if (limits_.walls) {
    const SaturationResult walls =
        scs(a, Minv_, Jc, djc, bounds_.cl, bounds_.cu, limits_.s0_wall);
    mark_walls(walls.upper, walls.lower, result.flags);
    a = walls.a;
  }
  const SaturationResult joints = limits_.exact_sjs
                                      ? sjs_exact(a, Minv_, bounds_.lb, bounds_.ub)
                                      : sjs(a, Minv_, bounds_.lb, bounds_.ub);
  mark_joints(joints.upper, joints.lower, result.flags);
  result.flags.qp_early = !joints.ok;
  const Vec7 a_safe = Vec7::Zero().cwiseMax(bounds_.lb).cwiseMin(bounds_.ub);
  const TorqueBlend blend = blend_torque(joints.a, a_safe, terms_.M, h_, lo_, hi_);
  result.a = blend.a + push_;
  result.a0 += push_;
  result.tau = blend.tau;
  result.flags.torque = blend.limited;
  result.flags.unsafe = blend.unsafe;
  if (!limits_.walls) return;
  const Vec3 ddx = Jc * blend.a + djc;
  for (int i = 0; i < 3; ++i) {
    if (ddx[i] > bounds_.cu[i] + kWallTolerance ||
        ddx[i] < bounds_.cl[i] - kWallTolerance) {
      result.flags.wall_displaced |= bit(i);
    }
  }
}

/// The damped hold: this acceleration, by a torque that holds against h, softly.
StepResult Controller::hold(const Vec7& a, const Vec7& h) noexcept {
  StepResult result;
  result.flags.bad_input = true;
  result.a = result.a0 = a;
  result.tau = terms_.M * a + h;
  if (is_finite(result) && (lo_ + hi_).allFinite()) {
    result.tau = result.tau.cwiseMax(lo_).cwiseMin(hi_);
    soften(result);
  } else {  // the model is not: gravity compensation alone holds
    result.a = result.a0 = result.tau = Vec7::Zero();
  }
  return result;
}

/// Slow down inside the joints' limits, against what pushes.
StepResult Controller::brake(const Vec7& q, const Vec7& dq) noexcept {
  update_model(q, dq);
  update_bounds(q, dq);
  dq_last_ = dq;
  const Vec7 asked =
      (braking() - held(disturbance_)).cwiseMax(bounds_.lb).cwiseMin(bounds_.ub);
  const StepResult result = hold(asked + push_, bias());
  a_last_ = a0_last_ = result.a;
  tau_last_ = result.tau;
  has_last_ = true;
  return result;
}

void Controller::limit(StepResult& result) noexcept {
  if (limits_.scheme == Scheme::kQp) {
    limit_by_qp(result);
  } else {
    limit_by_cascade(result);
  }
}

/// Shows the cycle to the last line: what a new Target changes is explained by it.
bool Controller::is_explained(const Target& target, const Vec7& dq,
                              const StepResult& result, double elapsed) noexcept {
  const bool is_new = !has_last_ || !is_same(target, target_last_);
  target_last_ = target;
  Vec7 explained = Vec7::Zero();
  if (is_new) explained = (result.a0 - a0_last_).cwiseAbs();
  if (is_new && !target.joint_mode) {
    const Vec6 way = task_terms_.Lambda * osc_.way_to_come();
    explained += (Minv_ * (task_terms_.J.transpose() * way)).cwiseAbs();
  }
  // Less braking than was asked for is no drive: the arm must be driven, too.
  const double added = limiter_power_ + dq.dot(result.tau - task_terms_.u0);
  const double driven = dq.dot(result.tau - h_);
  // A wall that takes the tool back inside works against what is asked.
  const bool is_led = x_min_ != limits_.x_min || x_max_ != limits_.x_max;
  const double power = target.joint_mode || is_led ? 0.0 : std::min(added, driven);
  return !last_line_.check(
      {dq, explained, power, limiter_push_, elapsed, check_.is_jump()});
}

StepResult Controller::finish(const Vec7& dq, StepResult& result) noexcept {
  soften(result);
  const Vec7 clipped = result.tau.cwiseMax(lo_).cwiseMin(hi_);
  a_last_ = result.a;
  if ((clipped - result.tau).cwiseAbs().maxCoeff() > kTorqueTolerance) {
    result.flags.unsafe = true;
    a_last_ = Minv_ * (clipped - h_) + push_;  // what it will be, for the next sample
  }
  result.tau = clipped;
  result.flags.displaced = (result.a - result.a0).norm();
  dq_last_ = dq;
  tau_last_ = result.tau;
  a0_last_ = result.a0;
  has_last_ = true;
  return result;
}

void Controller::take(const Vec7& q, const Vec7& dq, double elapsed) noexcept {
  const bool is_time = elapsed >= 0.0 && elapsed < kLongestTime;  // no NaN
  const double told = is_time && elapsed > kShortestTime ? elapsed : period_;
  const Vec7 inertia = terms_.M.diagonal();
  check_.take(q, dq, a_last_, Minv_ * of_jump_, inertia, told);
  since_ += told + check_.missed();
  is_time_ = is_time_ && is_time;
  is_number_ = is_configuration(q) && is_speed(dq);
  is_return_ = is_return_ || check_.is_return();
  if (check_.is_return()) disturbance_ -= of_jump_;
  if (check_.is_return()) of_jump_ = -of_jump_;  // of the one that is kept now
  if (check_.is_jump()) of_jump_.setZero();      // until it is learned
}

StepResult Controller::act(const Target& target) noexcept {
  const Vec7& q = check_.q();
  const Vec7& dq = check_.dq();
  const double since = since_;
  const bool is_time = is_time_;
  const bool is_plausible = check_.implausible() == 0;
  const bool is_ended = last_line_.cause() != EndCause::kNone;
  // Where belief comes back, its step is no push.
  const bool may_learn = is_plausible && was_plausible_ && !is_return_;
  if (may_learn) update_disturbance(dq, since);
  was_plausible_ = is_plausible;
  since_ = 0.0;
  is_time_ = true;
  is_return_ = false;
  StepResult result;
  if (!has_start_ || !has_hold_ || !is_usable(target) || !is_time ||
      check_.implausible() > 1) {
    if (check_.implausible() < 2) osc_.forget_way();  // a hand may move the arm now
    result = brake(q, dq);
  } else {
    update_model(q, dq);
    update_walls(since);
    update_bounds(q, dq);
    if (is_ended) {
      follow_end(q, dq, since, result);
    } else if (target.joint_mode) {
      follow_joints(q, dq, target, result);
    } else {
      follow_task(q, dq, target, result);
    }
    limit(result);
    if (!is_finite(result)) {
      disturbance_ = of_jump_ = Vec7::Zero();  // where it could stay
      osc_.forget_sag();
      result = brake(q, dq);
    } else {
      if (!is_ended && !is_explained(target, dq, result, since)) {
        if (last_line_.is_loop()) {
          forget_quick_part(q);
          is_soft_ = true;  // no hurry, and a wrong state may have been the cause
        }
        joint_params_.passive = wall_params_.passive = true;
        is_at_rest_ = false;
        dq_end_ = dq;
        update_model(q, dq);
        update_bounds(q, dq);
        follow_end(q, dq, since, result);
        limit(result);
      }
      result = finish(dq, result);
    }
  }
  result.flags.implausible = !is_plausible;
  result.flags.bad_input = result.flags.bad_input || !is_number_;
  result.flags.ended = last_line_.cause() != EndCause::kNone;
  return result;
}

}  // namespace dovetail
