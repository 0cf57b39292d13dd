/// Checks of everything that a controller is built from, once, at construction.
#pragma once

#include "dovetail/types.hpp"

namespace dovetail {

/// Throws std::invalid_argument naming the element, its value and the allowed range.
void check_chain(const ChainParams& chain);
void check_osc(const OscParams& osc);
void check_limits(const LimitParams& limits);
void check_task(const TaskSpec& task);
void check_period(double period);

}  // namespace dovetail
