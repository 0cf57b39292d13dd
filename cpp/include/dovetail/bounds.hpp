/// Interval of accelerations of one coordinate (a joint or a wall axis) that
/// keeps its position and speed inside their limits now and for ever after.
/// Robust form of viability: Del Prete, RA-L 2018; docs/safety.md.
#pragma once

#include <cstdint>
#include <limits>

#include "dovetail/types.hpp"

namespace dovetail {

/// Which limit set one end of the interval.
enum class BoundCause : std::uint8_t {
  kAcceleration = 0,
  kVelocity = 1,
  kPosition = 2
};

/// Parameters that a cycle's coordinates share. The paper's kinds use `dt` only: they
/// have no margins.
struct BoundsParams {
  BoundsKind kind = BoundsKind::kViability;
  double dt = 0.001;     ///< control period [s]
  double kappa = 5.0;    ///< bound interval T over the period, >= 1
  double eta = 0.6;      ///< share of a_max planned for braking, (0, 1]
  double delta_x = 0.0;  ///< position margin [rad] or [m]
  double delta_v = 0.0;  ///< speed margin, as a share of v_max
  /// Most that may brake what is beyond its limit already, over a_max, >= 1.
  double authority = 1.0;
  /// Against a push the bound only brakes (docs/control.md, Passive limits).
  bool passive = true;
  double brake_rate = 60.0;  ///< of that braking [1/s]: what the loop's delay allows
  /// Of one coordinate. Most that its acceleration can change: what is asked for takes
  /// a ramp to become braking [rad/s3]. Viability only.
  double jerk = std::numeric_limits<double>::infinity();
  /// Speed limit that falls towards the position limit, sqrt(o^2 + 2 D d) - o at the
  /// distance d from it, with D = taper_brake [rad/s2] and o = taper_offset [rad/s].
  /// Viability only.
  double taper_brake = std::numeric_limits<double>::infinity();
  double taper_offset = 0.0;
};

/// Accelerations lb <= a <= ub [rad/s2] or [m/s2]. Always lb <= ub, except
/// kPaperPrinted, which can be empty (that is what it is kept to show).
struct Interval {
  double lb = 0.0;
  double ub = 0.0;
  BoundCause lb_cause = BoundCause::kAcceleration;
  BoundCause ub_cause = BoundCause::kAcceleration;
};

/// Largest and smallest acceleration that may be asked for, so that with the push the
/// coordinate can still stop inside its limits.
/// \param push            estimated acceleration by what the model does not know
/// \param x, v            position [rad, m] and speed
/// \param x_min, x_max    position limits, margin not yet taken off
/// \param v_max, a_max    speed and acceleration limits, both > 0
/// Does not allocate, does not throw. Non-finite x or v give non-finite bounds
/// or bounds of the wrong side: reject them before.
[[nodiscard]] Interval acceleration_bounds(double x, double v, double x_min,
                                           double x_max, double v_max, double a_max,
                                           const BoundsParams& params,
                                           double push = 0.0) noexcept;

/// Share of `brake_rate` that still damps a motion away from a limit against a push.
inline constexpr double kDampingAway = 0.25;

/// The most that may be asked for below `limit`, which bounds the sum with the push.
///
/// A push away from the limit leaves more room. One towards it takes room, but only as
/// braking: never below `-brake_rate v`, and at rest only by the share of the push that
/// `held` allows. So the estimate of a contact cannot push the arm into it. A motion
/// away may still be slowed, by `kDampingAway` times that rate.
/// \param v     speed towards the limit
/// \param held  share of the push that may be held against at rest, 0 to 1
[[nodiscard]] double under_push(double limit, double push, double v, double held,
                                double brake_rate) noexcept;

}  // namespace dovetail
