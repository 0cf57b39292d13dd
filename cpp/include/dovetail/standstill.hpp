/// The standstill: an arm without a usable command is damped until it rests, and kept
/// there, softly.
#pragma once

#include "dovetail/cycle_bounds.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// One thread. Nothing allocates or throws.
class Standstill {
 public:
  Standstill(const LimitParams& limits, double period) noexcept;

  /// Acceleration that ends a motion of dq [rad/s] [rad/s2].
  Vec7 braking(const Vec7& dq) const noexcept;

  /// A motion was ended at dq [rad/s]: the arm is kept where it comes to rest.
  void begin(const Vec7& dq) noexcept;
  /// Acceleration to that place [rad/s2], `elapsed` [s] after the last time.
  Vec7 acceleration(const Vec7& q, const Vec7& dq, double elapsed) noexcept;

 private:
  double brake_time_;  // [s]
  Vec7 most_;          // braking [rad/s2]
  bool is_at_rest_ = false;
  Vec7 q_ = Vec7::Zero();   // where the arm is kept [rad]
  Vec7 dq_ = Vec7::Zero();  // its speed, without what is too quick to damp [rad/s]
};

/// Lets joints be braked beyond their bounds, inside their limits. A limit then takes
/// work from the arm and gives none: it is a stop to its own joint, by a torque of that
/// joint alone (Gauss's principle), and braking is free. Elsewhere it may take torques
/// of other joints, and forbid a pushed joint to brake: both can load a spring at the
/// tool, turn by turn.
void free_braking(const LimitParams& limits, const Vec7& q, const Vec7& dq,
                  CycleBounds& bounds) noexcept;

}  // namespace dovetail
