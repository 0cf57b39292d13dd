/// What a control cycle takes for input. All else becomes a damped hold and a flag.
///
/// Every number must be finite and of a size that has a meaning; a NaN compares false.
#pragma once

#include <cmath>
#include <limits>

#include "dovetail/types.hpp"

#if __FINITE_MATH_ONLY__
#error "a NaN must be seen before it becomes a torque: build without -ffast-math"
#endif

namespace dovetail {

// Beyond these a number is not a measurement, and its square may overflow.
constexpr double kLargestAngle = 1e3;   // [rad]
constexpr double kLargestSpeed = 1e3;   // [rad/s]
constexpr double kLargestTarget = 1e9;  // any element of a Target or of a pose to hold

// How far the squared length of a unit vector or quaternion may be from 1.
constexpr double kUnitTolerance = 2e-3;

// Below it a time between two cycles is none [s]: a division by it may overflow.
constexpr double kShortestTime = 1e-6;
// Beyond it the arm was not controlled in between [s].
constexpr double kLongestTime = 10.0;

template <typename Vector>
[[nodiscard]] bool is_within(const Vector& v, double limit) noexcept {
  return (v.array().abs() <= limit).all();
}

template <typename Vector>
[[nodiscard]] bool is_unit(const Vector& v) noexcept {
  return std::abs(v.squaredNorm() - 1.0) <= kUnitTolerance;
}

/// Joint positions [rad].
[[nodiscard]] inline bool is_configuration(const Vec7& q) noexcept {
  return is_within(q, kLargestAngle);
}

/// Joint speeds [rad/s].
[[nodiscard]] inline bool is_speed(const Vec7& dq) noexcept {
  return is_within(dq, kLargestSpeed);
}

/// A TCP position [m] and rotation (wxyz).
[[nodiscard]] inline bool is_pose(const Vec3& p, const Vec4& quat_wxyz) noexcept {
  return is_within(p, kLargestTarget) && is_unit(quat_wxyz);
}

/// A unit normal and an offset [m]; at minus infinity it is nowhere, whatever its
/// normal.
[[nodiscard]] inline bool is_plane(const Vec4& plane) noexcept {
  const Vec3 normal = plane.head<3>();
  if (plane[3] == -std::numeric_limits<double>::infinity()) {
    return is_within(normal, kLargestTarget);
  }
  return is_unit(normal) && std::abs(plane[3]) <= kLargestTarget;
}

/// Every field of a Target, those that the task does not use included.
[[nodiscard]] inline bool is_usable(const Target& target) noexcept {
  return is_within(target.f_star, kLargestTarget) &&
         is_within(target.f_tare, kLargestTarget) &&
         is_pose(target.position_d, target.quat_wxyz_d) &&
         is_within(target.velocity_d, kLargestTarget) &&
         is_within(target.acceleration_d, kLargestTarget) && target.age >= 0.0 &&
         target.age <= kLargestTarget && is_plane(target.near_plane) &&
         is_configuration(target.q_d);
}

}  // namespace dovetail
