/// Checks by element: of everything that a controller is built from, once, and of what
/// enters at a border that can still refuse it.
#pragma once

#include "dovetail/types.hpp"

namespace dovetail {

/// Throws std::invalid_argument naming the element, its value and the allowed range.
void check_chain(const ChainParams& chain);
void check_osc(const OscParams& osc);
void check_limits(const LimitParams& limits);
void check_task(const TaskSpec& task);
void check_period(double period);

/// The same of what a cycle takes (input.hpp): where a cycle brakes, these throw.
void check_configuration(const Vec7& q);
void check_state(const Vec7& q, const Vec7& dq);
void check_hold(const Vec3& p_hold, const Vec4& quat_hold);
void check_target(const Target& target);

}  // namespace dovetail
