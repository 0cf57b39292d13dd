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

// Of the search along a ramp: most steps, and what is near enough [rad/s2].
constexpr int kRampSteps = 20;
constexpr double kRampTolerance = 1e-3;

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

/// What a coordinate does when `a` is held over T and then becomes full braking at its
/// jerk: the room that is left in each limit on the way.
class Ramp {
 public:
  Ramp(double d, double v, double v_max, double brake,
       const BoundsParams& params) noexcept
      : d_(d),
        v_(v),
        v_max_(v_max),
        brake_(brake),
        T_(params.kappa * params.dt),
        jerk_(params.jerk),
        share_(1.0 - params.delta_v),
        offset_(params.taper_offset),
        taper_(std::min(params.taper_brake, brake / (share_ * share_))) {}

  /// Smallest room that is left [rad/s]: below 0 a limit will be broken. It falls as
  /// `a` grows.
  double room(double a, BoundCause& cause) const noexcept {
    const double v1 = v_ + a * T_;
    const double left = d_ - (v_ + 0.5 * a * T_) * T_;
    if (v1 <= 0.0 && a <= 0.0) {  // turns round within T, or has done
      cause = BoundCause::kPosition;
      return (v_ > 0.0 ? d_ - 0.5 * v_ * v_ / -a : left) / T_;
    }
    const double rise = std::isinf(jerk_) ? 0.0 : std::max(a, 0.0) / jerk_;
    const double v_peak = v1 + 0.5 * std::max(a, 0.0) * rise;
    const double at_peak = left - (v1 + std::max(a, 0.0) * rise / 3.0) * rise;
    double least = v_max_ - v_peak;
    cause = BoundCause::kVelocity;
    const auto take = [&](double room) {
      if (room >= least) return;
      least = room;
      cause = BoundCause::kPosition;
    };
    take(tapered(at_peak) - v_peak);
    // From the peak, or from `a`, on to full braking.
    const double from = std::min(a, 0.0);
    double speed = v_peak, room = at_peak;
    if (!std::isinf(jerk_) && from > -brake_) {
      const double time = (from + brake_) / jerk_;
      const double end = speed + (from - 0.5 * jerk_ * time) * time;
      if (end <= 0.0) {  // stands still before that
        const double stop =
            (from + std::sqrt(from * from + 2.0 * jerk_ * speed)) / jerk_;
        room -= (speed + (0.5 * from - jerk_ * stop / 6.0) * stop) * stop;
        take(room / T_);
        return least;
      }
      room -= (speed + (0.5 * from - jerk_ * time / 6.0) * time) * time;
      speed = end;
      take(tapered(room) - speed);
    }
    take((room - 0.5 * speed * speed / brake_) / T_);
    return least;
  }

  /// Largest acceleration in [low, high] that leaves room.
  Bound largest(double low, double high) const noexcept {
    Bound bound{high, BoundCause::kAcceleration};
    BoundCause cause = BoundCause::kPosition;
    double above = room(high, cause);
    if (!(above < 0.0)) return bound;
    bound.cause = cause;
    double below = room(low, cause);
    if (!(below > 0.0)) return {low, cause};
    // Illinois: the secant, an end that stays twice counting half.
    int last = 0;
    for (int i = 0; i < kRampSteps; ++i) {
      const double a = (low * above - high * below) / (above - below);
      const double here = room(a, cause);
      if (here >= 0.0) {
        low = a;
        below = here;
        if (last > 0) above *= 0.5;
        last = 1;
      } else {
        high = a;
        above = here;
        bound.cause = cause;
        if (last < 0) below *= 0.5;
        last = -1;
      }
      if (high - low < kRampTolerance || below < kRampTolerance * T_) break;
    }
    bound.value = low;
    return bound;
  }

 private:
  double tapered(double room) const noexcept {
    if (std::isinf(taper_)) return v_max_;
    return share_ * (std::sqrt(offset_ * offset_ + 2.0 * taper_ * std::max(room, 0.0)) -
                     offset_);
  }

  double d_, v_, v_max_, brake_, T_, jerk_, share_, offset_, taper_;
};

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
  const bool is_ramped = !(std::isinf(params.jerk) && std::isinf(params.taper_brake));
  if (!is_ramped && d >= 0.0 && v_end <= v_max &&
      2.0 * brake * room >= v_brake * v_brake) {
    return {params.passive ? a_most : a_max - push, BoundCause::kAcceleration};
  }
  const double speed = (v_max - v) / T;
  Bound bound;
  if (is_ramped) {
    // At most a turn within T: of a hair's breadth no more is made than of the limit.
    const double least = std::max(-a_max, (v > 0.0 ? -2.0 : -1.0) * v / T);
    bound = Ramp(d, v, v_max, brake, params).largest(std::min(least, a_full), a_full);
    if (bound.cause == BoundCause::kAcceleration) {
      return {params.passive ? a_most : a_max - push, BoundCause::kAcceleration};
    }
  } else {
    const double position =
        std::min(position_bound(d, v, T), stopping_bound(d, v, T, brake));
    bound = smallest(position, speed, a_full);
    bound.value = std::max(bound.value, -a_max);
  }
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
