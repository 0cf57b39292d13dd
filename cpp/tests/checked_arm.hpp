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
};

}  // namespace dovetail::testing
