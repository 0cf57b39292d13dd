#include "dovetail/bounds.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dovetail {
namespace {

// Way behind a limit's margin on which a push comes to be held against [rad] or [m].
constexpr double kHoldWidth = 1e-3;

// A braking rate may be 0; the hold then begins half a second ahead of the margin
// [1/s].
constexpr double kLeastBrakeRate = 1.0;

struct Bound {
  double value;
  BoundCause cause;
};

/// The smallest of the three limits, and which one it is.
Bound smallest(double position, double velocity, double acceleration) noexcept {
  Bound bound{acceleration, BoundCause::kAcceleration};
  if (velocity < bound.value) bound = {velocity, BoundCause::kVelocity};
  if (position < bound.value) bound = {position, BoundCause::kPosition};
  return bound;
}

/// Largest constant acceleration over T that keeps the position below d all along.
double position_bound(double d, double v, double T) noexcept {
  const double at_end = 2.0 * (d - v * T) / (T * T);
  if (v <= 0.0 || at_end > -v / T) return at_end;
  if (d <= 0.0) return at_end;
  // The turning point lies inside the interval. Of a hair's breadth no more is made
  // than of the limit itself: a joint that rests at it would be kicked by noise.
  return std::clamp(-v * v / (2.0 * d), -2.0 * v / T, -v / T);
}

/// Largest constant acceleration over T after which braking with `brake` stops before
/// d.
double stopping_bound(double d, double v, double T, double brake) noexcept {
  const double b = T * (2.0 * v + brake * T);
  const double c = v * v - 2.0 * brake * (d - v * T);
  const double discriminant = b * b - 4.0 * T * T * c;
  const double standstill = -v / T;
  if (!(discriminant >= 0.0)) return standstill;
  return std::max((-b + std::sqrt(discriminant)) / (2.0 * T * T), standstill);
}

/// Upper bound by viability; the lower one is this one mirrored.
Bound viability_upper(double d, double v, double v_max, double a_max, double push,
                      const BoundsParams& params) noexcept {
  const double T = params.kappa * params.dt;
  const double brake = params.eta * a_max;
  // Common case, no root: full acceleration and the push over T are still viable.
  // What pushes away from the limit may be resisted beyond a_max.
  const double a_full = a_max + std::max(push, 0.0);
  const double a_most = a_max + std::max(-push, 0.0);
  const double v_end = v + a_full * T;
  const double room = d - v * T - 0.5 * a_full * T * T;
  const double v_brake = std::max(v_end, 0.0);
  if (d >= 0.0 && v_end <= v_max && 2.0 * brake * room >= v_brake * v_brake) {
    return {params.passive ? a_most : a_max - push, BoundCause::kAcceleration};
  }
  const double position =
      std::min(position_bound(d, v, T), stopping_bound(d, v, T, brake));
  const double speed = (v_max - v) / T;
  Bound bound = smallest(position, speed, a_full);
  bound.value = std::max(bound.value, -a_max);
  // Beyond the limit already: brake harder, but softly for a loop with delay.
  const double beyond = std::min(2.0 * (d - v * T) / (T * T), speed);
  bound.value = std::min(bound.value, std::max(beyond, -params.authority * a_max));
  if (!params.passive) return {std::min(bound.value, a_max) - push, bound.cause};
  // The hold begins ahead of the margin, by half of the way that braking takes.
  const double width = std::max(params.delta_x, kHoldWidth);
  const double met =
      d - 0.5 * std::max(v, 0.0) / std::max(params.brake_rate, kLeastBrakeRate);
  const double held = std::clamp(-met / width, 0.0, 1.0);
  bound.value = under_push(bound.value, push, v, held, params.brake_rate);
  if (bound.value >= a_most) return {a_most, BoundCause::kAcceleration};
  return bound;
}

/// Upper bound of the paper: only the next sample is asked to be inside.
Bound paper_upper(double d, double v, double speed_room, double a_max,
                  double dt) noexcept {
  return smallest(2.0 * (d - v * dt) / (dt * dt), speed_room / dt, a_max);
}

/// Outside the viable set both ends can cross: the side the coordinate moves to wins.
Interval join(const Bound& lower, const Bound& upper, double v) noexcept {
  Interval interval{-lower.value, upper.value, lower.cause, upper.cause};
  if (interval.lb > interval.ub) {
    if (v >= 0.0) {
      interval.lb = interval.ub;
      interval.lb_cause = interval.ub_cause;
    } else {
      interval.ub = interval.lb;
      interval.ub_cause = interval.lb_cause;
    }
  }
  return interval;
}

}  // namespace

Interval acceleration_bounds(double x, double v, double x_min, double x_max,
                             double v_max, double a_max, const BoundsParams& params,
                             double push) noexcept {
  const double dt = params.dt;
  if (params.kind == BoundsKind::kPaperPrinted) {
    // The printed speed bound has x where v is meant; kept as it is.
    const Bound upper = paper_upper(x_max - x, v, v_max - x, a_max, dt);
    const Bound lower = paper_upper(x - x_min, -v, v_max + x, a_max, dt);
    return {-lower.value - push, upper.value - push, lower.cause, upper.cause};
  }
  if (params.kind == BoundsKind::kPaperCorrected) {
    Bound upper = paper_upper(x_max - x, v, v_max - v, a_max, dt);
    Bound lower = paper_upper(x - x_min, -v, v_max + v, a_max, dt);
    upper.value = std::max(upper.value, -a_max);
    lower.value = std::max(lower.value, -a_max);
    const Interval both = join(lower, upper, v);
    return {both.lb - push, both.ub - push, both.lb_cause, both.ub_cause};
  }
  const double speed = (1.0 - params.delta_v) * v_max;
  const double room_up = x_max - x - params.delta_x;
  const double room_down = x - x_min - params.delta_x;
  return join(viability_upper(room_down, -v, speed, a_max, -push, params),
              viability_upper(room_up, v, speed, a_max, push, params), v);
}

double under_push(double limit, double push, double v, double held,
                  double brake_rate) noexcept {
  if (push <= 0.0) return limit - push;
  const double back = std::max(-limit, 0.0);  // what leads back inside
  const double braking = -brake_rate * std::max(v, 0.0) - held * (push + back);
  // On the way out, too: a joint that may not be slowed there, tied to a spring, has no
  // damping in half of each swing, and any delay makes it grow.
  const double damping = kDampingAway * brake_rate * std::max(-v, 0.0) * (1.0 - held);
  return std::min(limit, std::max(limit - push, braking + damping));
}

}  // namespace dovetail
