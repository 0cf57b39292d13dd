/// The intervals of acceleration of one cycle: of the joints, and of the TCP by the
/// walls.
#pragma once

#include <array>

#include "dovetail/bounds.hpp"
#include "dovetail/cycle_model.hpp"
#include "dovetail/types.hpp"
#include "dovetail/walls.hpp"

namespace dovetail {

/// Whether a joint stands within a position limit's margin, or beyond it.
[[nodiscard]] inline bool is_at_limit(const LimitParams& limits, int joint,
                                      double q) noexcept {
  return q > limits.q_max[joint] - limits.delta_q ||
         q < limits.q_min[joint] + limits.delta_q;
}

/// Bounds of what may be asked for: the push comes on top. The walls' are infinite
/// where walls are off.
class CycleBounds {
 public:
  Vec7 lb, ub;  ///< joints [rad/s2]
  Vec3 cl, cu;  ///< TCP axes [m/s2]
  std::array<BoundCause, 7> lb_cause, ub_cause;
  std::array<BoundCause, 3> cl_cause, cu_cause;

  CycleBounds(const LimitParams& limits, double period) noexcept;

  /// Calculates all of them. After the last line has ended a motion the limits are
  /// passive, whatever the settings say.
  void update(const LimitParams& limits, const CycleModel& model, const Walls& walls,
              const Vec7& q, const Vec7& dq, bool is_ended) noexcept;

  /// Flags joints (bits) that an upper or a lower end holds, by what set that end.
  void mark_joints(unsigned upper, unsigned lower, Flags& flags) const noexcept;
  /// Flags TCP axes (bits) likewise.
  void mark_walls(unsigned upper, unsigned lower, Flags& flags) const noexcept;

 private:
  BoundsParams joint_params_;
  BoundsParams wall_params_;
};

}  // namespace dovetail
