#pragma once

#include <cmath>

namespace dovetail {

/// exp(-rate time), for a time that is nearly always the last one.
class Decay {
 public:
  /// What is left after this time [s] at this rate [1/s].
  double left(double rate, double time) noexcept {
    const double exponent = -rate * time;
    if (exponent != exponent_) left_ = std::exp(exponent_ = exponent);
    return left_;
  }

 private:
  double exponent_ = 0.0;
  double left_ = 1.0;
};

}  // namespace dovetail
