/// The paper's saturation stages, corrected: Cartesian (SCS), joint (SJS, and
/// its continuation to the exact projection) and motor torque (by blending).
#pragma once

#include <cstdint>

#include "dovetail/types.hpp"

namespace dovetail {

/// Outcome of a saturation stage. Masks: bit i is row i, i.e. joint A(i+1) for
/// SJS, axis X, Y, Z for SCS.
struct SaturationResult {
  Vec7 a;                  ///< joint acceleration [rad/s2]
  std::uint8_t upper = 0;  ///< rows held at their upper bound
  std::uint8_t lower = 0;  ///< rows held at their lower bound
  int passes = 0;          ///< linear solves made, 0 if nothing saturated
  /// False: pass limit reached (sjs_exact only), or a NaN: then a is 0 in the box.
  bool ok = true;
};

/// Saturation in Cartesian space: the acceleration nearest to a0 in the M norm
/// that puts the saturated rows of Jc a + djc on their bounds cl, cu [m/s2].
/// Rows accumulate; at most 4 passes. Near a singularity of the saturated rows
/// their mobility is faded below s0 [1/kg] and the rows are met in part.
[[nodiscard]] SaturationResult scs(const Vec7& a0, const Mat7& Minv, const Mat37& Jc,
                                   const Vec3& djc, const Vec3& cl, const Vec3& cu,
                                   double s0) noexcept;

/// Saturation in joint space with accumulated joints: inside [lb, ub] exactly,
/// at most 8 passes, bit-equal to a0 if nothing saturates. Requires lb <= ub.
[[nodiscard]] SaturationResult sjs(const Vec7& a0, const Mat7& Minv, const Vec7& lb,
                                   const Vec7& ub) noexcept;

/// SJS continued by a primal active set to the M-norm projection of a0 on the
/// box: continuous in a0, inside [lb, ub] exactly whatever `ok` says.
[[nodiscard]] SaturationResult sjs_exact(const Vec7& a0, const Mat7& Minv,
                                         const Vec7& lb, const Vec7& ub) noexcept;

/// Outcome of the torque stage.
struct TorqueBlend {
  Vec7 a;                    ///< a_safe + share (a - a_safe) [rad/s2]
  Vec7 tau;                  ///< M a + h, inside [lo, hi] exactly [Nm]
  double share = 1.0;        ///< of the wanted action that is left, [0, 1]
  std::uint8_t limited = 0;  ///< joints whose torque limit set the share
  bool unsafe = false;       ///< even a_safe exceeds a torque: tau was clipped
};

/// Largest step from a safe action towards the wanted one whose torque M a + h
/// stays inside [lo, hi]. Both actions inside a convex set (box, walls) keep
/// the result in it.
[[nodiscard]] TorqueBlend blend_torque(const Vec7& a, const Vec7& a_safe, const Mat7& M,
                                       const Vec7& h, const Vec7& lo,
                                       const Vec7& hi) noexcept;

}  // namespace dovetail
