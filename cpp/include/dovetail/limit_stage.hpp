/// From the acceleration that was asked for to one that keeps every limit, and its
/// torque: by a quadratic program, or by the paper's cascade (docs/control.md, Limits).
#pragma once

#include "dovetail/cycle_bounds.hpp"
#include "dovetail/cycle_model.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// Makes a, tau and the flags of `result` from its a0. The push, which a0 is without,
/// comes on top of both accelerations. Does not allocate, does not throw.
/// \param is_ended  the last line has ended the motion
void limit_acceleration(const LimitParams& limits, const CycleModel& model,
                        const CycleBounds& bounds, bool is_ended,
                        StepResult& result) noexcept;

}  // namespace dovetail
