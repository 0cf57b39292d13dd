/// @file
/// An arm that moves, and the check of what is measured of it.
#pragma once

#include "arm.hpp"
#include "dovetail/state_check.hpp"

namespace dovetail::testing {

constexpr double kPeriod = 0.001;

/// An arm whose inertia is 1 kg m2 in every joint, moving at 0.5 rad/s.
struct Check {
  LimitParams limits = limits_for(kPeriod);
  StateCheck check{limits, kPeriod};
  Vec7 q = tool_down_posture();
  Vec7 dq = Vec7::Constant(0.5);

  Check() { check.reset(q, dq); }

  void take(const Vec7& q_seen, const Vec7& dq_seen) {
    check.take(q_seen, dq_seen, Vec7::Zero(), Vec7::Zero(), Vec7::Ones(), kPeriod);
  }

  void move() { q += kPeriod * dq; }

  /// Begins anew, at a speed.
  void start(const Vec7& speed) {
    dq = speed;
    check.reset(q, dq);
    take(q, dq);
  }

  /// Takes a speed that jumps in one joint, and its way; `is_real`: the arm has it.
  void surprise(bool is_real) {
    const Vec7 blow = 0.25 * Vec7::Unit(2), way = 0.5 * kPeriod * blow;
    take(q + way, dq + blow);
    if (!is_real) return;
    dq += blow;
    q += way;
  }

  /// Takes a sample whose position is wrong in one joint.
  void take_wrong(int joint, double error) { take(q + error * Vec7::Unit(joint), dq); }
};

}  // namespace dovetail::testing
