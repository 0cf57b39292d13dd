#include "dovetail/contact_approach.hpp"

#include <algorithm>
#include <cmath>

#include "dovetail/bounds.hpp"

namespace dovetail {
namespace {

// Time in which a speed near contact is corrected [s]: the estimate makes the loop up
// to twice as quick; with 0.04 an arm with 10 ms of delay swung on at 12 Hz.
constexpr double kNearTime = 0.05;

// Fastest surface that the tool may go along with near contact [m/s]. It need not: a
// tool that stands is not pushed.
constexpr double kFastestSurface = 0.1;

// Height over the near plane in which near_press comes to act whole [m].
constexpr double kNearBand = 0.002;

// In which the weight is learned [s]: a start is at least as long above the plane, and
// a hand that touches the tool for a moment is no weight.
constexpr double kWeightTime = 0.1;

// Most of the weight along one axis that near_press counts from [m/s2]: the public
// inertia sets of the iiwa differ by up to 4 in this.
constexpr double kLargestWeight = 5.0;

}  // namespace

double height(const Target& target, const ToolMotion& tool) noexcept {
  return target.near_plane.head<3>().dot(tool.p) - target.near_plane[3];
}

ContactApproach::ContactApproach(const LimitParams& limits, double period) noexcept
    : near_speed_(limits.near_speed),
      near_press_(limits.near_press),
      brake_(limits.eta_wall * limits.ddx_max),
      margin_(limits.delta_x),
      brake_rate_(limits.brake_rate),
      quickest_(std::max(limits.brake_rate, 2.0 / (limits.kappa * period))),
      is_passive_(limits.passive),
      is_qp_(limits.scheme == Scheme::kQp),
      weight_share_(1.0 - std::exp(-period / kWeightTime)) {}

void ContactApproach::follow_weight(const Target& target,
                                    const CycleModel& model) noexcept {
  if (height(target, model.tool) <= 0.0) return;
  weight_ += weight_share_ * (model.push_tool - weight_);
  weight_ = weight_.cwiseMax(-kLargestWeight).cwiseMin(kLargestWeight);
  if (!weight_.allFinite()) weight_.setZero();  // it would never end
}

double ContactApproach::excess_press(const Target& target,
                                     const ToolMotion& tool) const noexcept {
  const Vec3 normal = target.near_plane.head<3>();
  const double share = 1.0 - std::clamp(height(target, tool) / kNearBand, 0.0, 1.0);
  const Vec3 tare = target.f_tare.head<3>();
  const Vec3 holding = tare == Vec3::Zero() ? Vec3(-weight_) : tare;
  const double press = normal.dot(holding - target.f_star.head<3>());
  return share * std::max(press - near_press_, 0.0);
}

/// Height over the near plane [m] in which the tool can be braked to near_speed.
double ContactApproach::braking_room(const Target& target,
                                     const ToolMotion& tool) const noexcept {
  const Vec3 normal = target.near_plane.head<3>();
  const double fall = std::min(normal.dot(tool.twist.head<3>()), 0.0);
  return std::max(height(target, tool) + kNearTime * fall, 0.0);
}

/// Speed limit of a TCP axis [m/s]: near_speed below the near plane, above it what can
/// be braked to that in the room that there is.
double ContactApproach::speed_limit(int axis, double room) const noexcept {
  return std::sqrt(near_speed_ * near_speed_ + 2.0 * brake_[axis] * room);
}

/// `under_push` of a limit that nothing is held against at.
double ContactApproach::below(double limit, double push, double speed) const noexcept {
  if (!is_passive_) return limit - push;
  return under_push(limit, push, speed, 0.0, brake_rate_);
}

/// Whether a TCP coordinate [m] is inside the walls' margins.
bool ContactApproach::is_inside(int axis, double p, const Walls& walls) const noexcept {
  return !(p > walls.max()[axis] - margin_ || p < walls.min()[axis] + margin_);
}

/// How much of an axis' acceleration [m/s2] is a push of its limiters: what was neither
/// asked for nor holds weight nor brakes. With passive limits nothing, inside the
/// walls. One that cancels a contact finds no motion to brake, and presses the harder
/// the more it is pressed.
double ContactApproach::pushed(double asked, double kept, double tare,
                               double speed) const noexcept {
  const auto [low, high] = std::minmax({asked, tare, 0.0});
  const double excess = kept - std::clamp(kept, low, high);
  const double braking = excess * speed < 0.0 ? quickest_ * std::abs(speed) : 0.0;
  return std::max(std::abs(excess) - braking, 0.0);
}

FStarCut ContactApproach::cut(const Target& target, const CycleModel& model,
                              const OperationalSpace& osc, const CycleBounds& bounds,
                              const Walls& walls, Vec6& f_star) const noexcept {
  FStarCut cut;
  const ChainTerms& terms = model.terms;
  const Vec7 lost = osc.params().use_coriolis ? Vec7(model.h - terms.c) : model.h;
  Vec3 drift = terms.J.topRows<3>() * (model.Minv * -lost).eval();
  if (!osc.params().use_jdot) drift += terms.dJdq.head<3>();
  const Vec6 wanted = desired_velocity(target);
  const double room = braking_room(target, model.tool);
  for (int i = 0; i < 3; ++i) {
    if (osc.task()[i] == AxisMode::kFree) continue;
    const double near = speed_limit(i, room);
    const double speed = model.tool.twist[i];
    const bool is_force = osc.task()[i] == AxisMode::kForce;
    const double surface =
        is_force ? std::clamp(wanted[i], -kFastestSurface, kFastestSurface) : 0.0;
    const double tare = target.f_tare[i];
    const double push = model.push_tool[i] + tare;  // weight is held already
    double high =
        below((near + std::max(surface, 0.0) - speed) / kNearTime, push, speed) + tare;
    double low =
        -below((near + std::max(-surface, 0.0) + speed) / kNearTime, -push, -speed) +
        tare;
    if (f_star[i] > high - drift[i] || f_star[i] < low - drift[i]) cut.near |= bit(i);
    if (is_qp_ && bounds.cu[i] < high) {
      high = bounds.cu[i];
      if (f_star[i] > high - drift[i]) cut.upper |= bit(i);
    }
    if (is_qp_ && bounds.cl[i] > low) {
      low = bounds.cl[i];
      if (f_star[i] < low - drift[i]) cut.lower |= bit(i);
    }
    const double asked = f_star[i];
    f_star[i] = std::max(std::min(asked, high - drift[i]), low - drift[i]);
    if (is_inside(i, model.tool.p[i], walls)) {
      cut.push[i] = pushed(asked + drift[i], f_star[i] + drift[i], tare, speed);
    }
  }
  return cut;
}

}  // namespace dovetail
