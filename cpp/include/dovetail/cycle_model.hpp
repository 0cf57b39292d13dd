/// The arm's model in one cycle: inertia, bias forces, motor range, and the push.
#pragma once

#include "dovetail/chain.hpp"
#include "dovetail/cholesky.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// Everything that the law, the bounds and the limits of a cycle calculate with.
struct CycleModel {
  ChainTerms terms;    ///< at q + dq period / 2 when mid_interval; M with armature
  ToolMotion tool;     ///< at the measured state
  Cholesky<7> factor;  ///< of M
  Mat7 Minv;           ///< M^-1
  Vec7 h;              ///< c + D dq [Nm]
  Vec7 lo, hi;         ///< overlay torque that the motors can give [Nm]
  Vec7 push;           ///< M^-1 r, with r cut to the usual [rad/s2]
  Vec7 push_whole;     ///< M^-1 r, for a joint at its limit [rad/s2]
  Vec3 push_tool;      ///< `push` at the TCP [m/s2]

  /// Calculates all of it at (q [rad], dq [rad/s]) with the disturbance r [Nm]. Does
  /// not allocate, does not throw.
  void update(const Chain& chain, const LimitParams& limits, double period,
              const Vec7& q, const Vec7& dq, const Vec7& r) noexcept;

  /// Keeps `lo` and `hi` within `step` [Nm] of the last torque. Where gravity has moved
  /// them away from it, the way back is as quick as that allows.
  void keep_near(const Vec7& tau_last, const Vec7& step) noexcept;
};

}  // namespace dovetail
