/// The rows that a run of control cycles leaves, and what a policy step takes from
/// them.
#pragma once

#include <cstdint>

#include "dovetail/chain.hpp"
#include "dovetail/cycle_row.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// Tool after the last cycle, by the controller's model, and what the cycles reported.
struct StepSummary {
  Vec3 p;              ///< TCP position [m]
  Vec4 quat_wxyz;      ///< TCP rotation, w >= 0
  Vec6 twist;          ///< TCP velocity, linear then angular [m/s, rad/s]
  Vec3 force;          ///< largest contact force of any row [N]; zero without rows
  Vec6 wrench;         ///< estimated, of the last row [N, Nm]; zero without rows
  std::int64_t flags;  ///< packed flags of all rows, or-ed
};

/// \param q, dq  measured after the last cycle [rad, rad/s]
/// \param rows   count x kCycleColumns numbers
StepSummary summarize(const Chain& chain, const Vec7& q, const Vec7& dq,
                      const double* rows, int count) noexcept;

/// How many rows have a number below its column's low or above its high; a NaN is
/// neither.
int count_outside(const double* rows, int count, const double* low,
                  const double* high) noexcept;

/// Unit quaternion of a rotation matrix, w >= 0.
Vec4 quat_wxyz(const Mat3& R) noexcept;

}  // namespace dovetail
