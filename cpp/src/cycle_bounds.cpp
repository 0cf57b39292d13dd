#include "dovetail/cycle_bounds.hpp"

#include <limits>

namespace dovetail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

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

}  // namespace

CycleBounds::CycleBounds(const LimitParams& limits, double period) noexcept
    : cl(Vec3::Constant(-kInfinity)),
      cu(Vec3::Constant(kInfinity)),
      joint_params_{limits.bounds,    period,         limits.kappa,
                    limits.eta,       limits.delta_q, limits.delta_v,
                    limits.authority, limits.passive, limits.brake_rate},
      wall_params_{limits.bounds,    period,         limits.kappa,
                   limits.eta_wall,  limits.delta_x, limits.delta_v,
                   limits.authority, limits.passive, limits.brake_rate} {
  wall_params_.jerk = limits.jerk_wall;
  cl_cause.fill(BoundCause::kAcceleration);
  cu_cause.fill(BoundCause::kAcceleration);
}

void CycleBounds::update(const LimitParams& limits, const CycleModel& model,
                         const Walls& walls, const Vec7& q, const Vec7& dq,
                         bool is_ended) noexcept {
  joint_params_.passive = wall_params_.passive = limits.passive || is_ended;
  for (int i = 0; i < kNumJoints; ++i) {
    const double push =
        is_at_limit(limits, i, q[i]) ? model.push_whole[i] : model.push[i];
    joint_params_.jerk = limits.jerk_max[i];
    joint_params_.taper_brake = limits.taper_brake[i];
    joint_params_.taper_offset = limits.taper_offset[i];
    const Interval joint = not_empty(
        acceleration_bounds(q[i], dq[i], limits.q_min[i], limits.q_max[i],
                            limits.dq_max[i], limits.ddq_max[i], joint_params_, push),
        dq[i]);
    lb[i] = joint.lb;
    ub[i] = joint.ub;
    lb_cause[i] = joint.lb_cause;
    ub_cause[i] = joint.ub_cause;
  }
  if (!limits.walls) return;
  for (int i = 0; i < 3; ++i) {
    const double speed = model.tool.twist[i];
    const Interval wall = not_empty(
        acceleration_bounds(model.tool.p[i], speed, walls.min()[i], walls.max()[i],
                            limits.dx_max[i], limits.ddx_max[i], wall_params_,
                            model.push_tool[i]),
        speed);
    cl[i] = wall.lb;
    cu[i] = wall.ub;
    cl_cause[i] = wall.lb_cause;
    cu_cause[i] = wall.ub_cause;
  }
}

void CycleBounds::mark_joints(unsigned upper, unsigned lower,
                              Flags& flags) const noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    const bool is_upper = (upper >> i) & 1U;
    if (!is_upper && !((lower >> i) & 1U)) continue;
    switch (is_upper ? ub_cause[i] : lb_cause[i]) {
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

void CycleBounds::mark_walls(unsigned upper, unsigned lower,
                             Flags& flags) const noexcept {
  for (int i = 0; i < 3; ++i) {
    const bool is_upper = (upper >> i) & 1U;
    if (!is_upper && !((lower >> i) & 1U)) continue;
    switch (is_upper ? cu_cause[i] : cl_cause[i]) {
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

}  // namespace dovetail
