#include "dovetail/limit_stage.hpp"

#include <limits>

#include "dovetail/qp.hpp"
#include "dovetail/saturation.hpp"

namespace dovetail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// After the end of a motion a wall is worth so much mass [kg]: held against a jam it
// would drive the joints.
constexpr double kEndRho = 1.0;

void limit_by_qp(const LimitParams& limits, const CycleModel& model,
                 const CycleBounds& bounds, bool is_ended,
                 StepResult& result) noexcept {
  const Mat37 Jc = model.terms.J.topRows<3>();
  const Vec3 djc = model.terms.dJdq.head<3>();
  const double rho = is_ended ? kEndRho : limits.rho;
  // After an end a joint has its own motor alone. That others help one that is not
  // strong enough is right in free space; what it touches they would only load.
  const Vec7 beyond = Vec7::Constant(is_ended ? kInfinity : 0.0);
  const QpResult qp = solve_qp({model.terms.M, model.Minv, result.a0, bounds.lb,
                                bounds.ub, Jc, djc, bounds.cl, bounds.cu, model.h,
                                model.lo - beyond, model.hi + beyond, rho});
  result.a = qp.a;
  result.tau = qp.tau;
  result.flags.torque = qp.torque;
  result.flags.wall_displaced = qp.wall_displaced;
  result.flags.unsafe = qp.unsafe;
  result.flags.qp_early = !qp.ok;
  bounds.mark_joints(qp.upper, qp.lower, result.flags);
  bounds.mark_walls(qp.wall_upper, qp.wall_lower, result.flags);
}

void limit_by_cascade(const LimitParams& limits, const CycleModel& model,
                      const CycleBounds& bounds, StepResult& result) noexcept {
  Vec7 a = result.a0;
  const Mat37 Jc = model.terms.J.topRows<3>();
  const Vec3 djc = model.terms.dJdq.head<3>();
  if (limits.walls) {
    const SaturationResult walls =
        scs(a, model.Minv, Jc, djc, bounds.cl, bounds.cu, limits.s0_wall);
    bounds.mark_walls(walls.upper, walls.lower, result.flags);
    a = walls.a;
  }
  const SaturationResult joints = limits.exact_sjs
                                      ? sjs_exact(a, model.Minv, bounds.lb, bounds.ub)
                                      : sjs(a, model.Minv, bounds.lb, bounds.ub);
  bounds.mark_joints(joints.upper, joints.lower, result.flags);
  result.flags.qp_early = !joints.ok;
  const Vec7 a_safe = Vec7::Zero().cwiseMax(bounds.lb).cwiseMin(bounds.ub);
  const TorqueBlend blend =
      blend_torque(joints.a, a_safe, model.terms.M, model.h, model.lo, model.hi);
  result.a = blend.a;
  result.tau = blend.tau;
  result.flags.torque = blend.limited;
  result.flags.unsafe = blend.unsafe;
  if (!limits.walls) return;
  const Vec3 ddx = Jc * blend.a + djc;
  for (int i = 0; i < 3; ++i) {
    if (ddx[i] > bounds.cu[i] + kWallTolerance ||
        ddx[i] < bounds.cl[i] - kWallTolerance) {
      result.flags.wall_displaced |= bit(i);
    }
  }
}

}  // namespace

void limit_acceleration(const LimitParams& limits, const CycleModel& model,
                        const CycleBounds& bounds, bool is_ended,
                        StepResult& result) noexcept {
  if (limits.scheme == Scheme::kQp) {
    limit_by_qp(limits, model, bounds, is_ended, result);
  } else {
    limit_by_cascade(limits, model, bounds, result);
  }
  result.a += model.push;
  result.a0 += model.push;
}

}  // namespace dovetail
