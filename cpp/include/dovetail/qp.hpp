/// The quadratic program of one control cycle, solved by a dual active set
/// (Goldfarb and Idnani 1983) on fixed-size data: no allocation, bounded
/// iterations.
#pragma once

#include <cstdint>

#include "dovetail/types.hpp"

namespace dovetail {

/// Constraints added and dropped, at most, in C++ as in Python.
constexpr int kQpIterations = 100;

/// min 1/2 |a - a0|_M^2 + rho/2 |s|^2  subject to  lb <= a <= ub,
/// cl - s <= Jc a + djc <= cu + s,  lo <= M a + h <= hi.
/// The box is never given up; walls are soft below it; torque rows are hard
/// unless they exclude the box, then they are met as well as the box allows
/// (`unsafe`).
struct QpProblem {
  const Mat7& M;                 ///< inertia matrix [kg m2], positive definite
  const Mat7& Minv;              ///< its inverse
  const Vec7& a0;                ///< wanted acceleration [rad/s2]
  const Vec7& lb;                ///< [rad/s2], lb <= ub
  const Vec7& ub;                ///< [rad/s2]
  const Mat37& Jc;               ///< rows of the walls
  const Vec3& djc;               ///< dJc dq [m/s2]
  const Vec3& cl;                ///< [m/s2], cl <= cu; -inf and inf switch a wall off
  const Vec3& cu;                ///< [m/s2]
  const Vec7& h;                 ///< bias torque [Nm]
  const Vec7& lo;                ///< [Nm], lo <= hi
  const Vec7& hi;                ///< [Nm]
  double rho = 1e6;              ///< weight of the wall slack
  int max_iter = kQpIterations;  ///< constraints added and dropped
};

/// Masks: bit i is joint A(i+1) or axis X, Y, Z.
struct QpResult {
  Vec7 a;                           ///< inside [lb, ub] exactly [rad/s2]
  Vec7 tau;                         ///< M a + h [Nm], not clipped
  std::uint8_t upper = 0;           ///< joints held at ub
  std::uint8_t lower = 0;           ///< joints held at lb
  std::uint8_t wall_upper = 0;      ///< axes held at cu
  std::uint8_t wall_lower = 0;      ///< axes held at cl
  std::uint8_t torque = 0;          ///< joints held at lo or hi
  std::uint8_t wall_displaced = 0;  ///< walls exceeded by more than kWallTolerance
  int iterations = 0;               ///< constraints added and dropped, 0 if none active
  bool ok = true;       ///< false: stopped early or non-finite, safe answer given
  bool unsafe = false;  ///< a torque row is exceeded by more than kTorqueTolerance
};

constexpr double kWallTolerance = 1e-3;    ///< [m/s2]
constexpr double kTorqueTolerance = 1e-6;  ///< [Nm]

/// Solves one problem. With a NaN anywhere, or an a0 that is not finite, the answer is
/// clip(0, lb, ub), a NaN bound being none. When stopped early it is the largest step
/// from clip(0, lb, ub) towards the clipped iterate that keeps the torque rows. Does
/// not allocate, does not throw.
[[nodiscard]] QpResult solve_qp(const QpProblem& problem) noexcept;

}  // namespace dovetail
