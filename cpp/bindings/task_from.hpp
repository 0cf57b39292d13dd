/// How Python's numbers become a task, for every class that is built with one.
#pragma once

#include <array>

#include "dovetail/types.hpp"

namespace dovetail::binding {

/// \param modes  of X Y Z C B A (twist order); what no byte can hold becomes 255. The
///               controller refuses what is no AxisMode as task[i].
inline TaskSpec task_from(const std::array<int, 6>& modes) {
  TaskSpec task;
  for (int i = 0; i < 6; ++i) {
    const bool is_byte = modes[i] >= 0 && modes[i] <= 255;
    task[i] = static_cast<AxisMode>(is_byte ? modes[i] : 255);
  }
  return task;
}

}  // namespace dovetail::binding
