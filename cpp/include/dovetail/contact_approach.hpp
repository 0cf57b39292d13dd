/// Limits of f* for a tool that comes near contact: the speed at which it touches and
/// the force with which it presses (docs/control.md, Law).
#pragma once

#include "dovetail/cycle_bounds.hpp"
#include "dovetail/cycle_model.hpp"
#include "dovetail/osc.hpp"
#include "dovetail/types.hpp"
#include "dovetail/walls.hpp"

namespace dovetail {

/// What the limits cut from f*, in bits of X, Y, Z.
struct FStarCut {
  unsigned near = 0;         ///< by the speed near contact
  unsigned upper = 0;        ///< by the upper end of a wall's interval
  unsigned lower = 0;        ///< by the lower end
  Vec3 push = Vec3::Zero();  ///< acceleration by limiters that brake nothing [m/s2]
};

/// Height of the tool over a Target's near plane [m].
[[nodiscard]] double height(const Target& target, const ToolMotion& tool) noexcept;

/// One thread. Nothing allocates or throws.
class ContactApproach {
 public:
  ContactApproach(const LimitParams& limits, double period) noexcept;

  /// Forgets the weight.
  void reset() noexcept { weight_.setZero(); }
  /// Learns in free air, above the near plane, how weight that nothing compensates
  /// accelerates the tool. Near contact it stays as it was: what pulls there is
  /// contact.
  void follow_weight(const Target& target, const CycleModel& model) noexcept;

  /// How much of f* against the near plane's normal is more than near_press [m/s2]:
  /// below the plane whole, above it less and less, so that nothing switches. It counts
  /// from the f* that holds the weight: the tare, or without one what was learned. A
  /// limit below the weight would leave the tool hovering, or pressing by itself.
  [[nodiscard]] double excess_press(const Target& target,
                                    const ToolMotion& tool) const noexcept;

  /// Cuts f* of X, Y, Z to what the speed near contact and, in scheme `qp`, the walls
  /// allow. The program, which knows no axes but the limited one, would pay for the
  /// rest with the other axes and the rotation; and near contact its interval is too
  /// short for a loop with delay.
  FStarCut cut(const Target& target, const CycleModel& model,
               const OperationalSpace& osc, const CycleBounds& bounds,
               const Walls& walls, Vec6& f_star) const noexcept;

 private:
  double braking_room(const Target& target, const ToolMotion& tool) const noexcept;
  double speed_limit(int axis, double room) const noexcept;
  double below(double limit, double push, double speed) const noexcept;
  bool is_inside(int axis, double p, const Walls& walls) const noexcept;
  double pushed(double asked, double kept, double tare, double speed) const noexcept;

  double near_speed_;  // [m/s]
  double near_press_;  // [m/s2]
  Vec3 brake_;         // what a wall plans to brake with [m/s2]
  double margin_;      // of the walls [m]
  double brake_rate_;  // of passive limits [1/s]
  double quickest_;    // braking of any limit [1/s]
  bool is_passive_, is_qp_;
  double weight_share_;         // of a cycle, in the mean that the weight is [1]
  Vec3 weight_ = Vec3::Zero();  // acceleration by it [m/s2]
};

}  // namespace dovetail
