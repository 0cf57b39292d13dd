/// The clock that servo loops keep time by.
#pragma once

#include <time.h>

namespace dovetail {

/// Time since some moment in the past [s]; never set back.
inline double monotonic() noexcept {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace dovetail
