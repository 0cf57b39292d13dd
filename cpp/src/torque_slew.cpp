#include "dovetail/torque_slew.hpp"

#include <algorithm>

namespace dovetail {
namespace {

// What a torque may change in a cycle [Nm]. A bad sample may be worth 20, of which
// encoders' noise and gravity's change have their part.
constexpr double kLargestStep = 18.0;

// Cycles for which it does, and what of one comes back in each. A torque that lags for
// longer drives an oscillation, which then looks doubtful.
constexpr double kPatience = 9.0;
constexpr double kRegained = 0.2;

}  // namespace

bool TorqueSlew::limit(const StateCheck& check, const Vec7& tau_last, bool is_first,
                       Vec7& tau) noexcept {
  const Vec7 change = tau - tau_last;
  const double most = change.cwiseAbs().maxCoeff();
  const bool is_large = !is_first && most > kLargestStep;
  lag_ = check.is_refused() ? 0.0 : std::max(lag_ - kRegained, 0.0);
  const bool may_wait = is_large && lag_ < kPatience;
  is_slow_ = may_wait && (is_slow_ || check.is_in_doubt() || check.is_remarked());
  if (!is_slow_) return false;
  lag_ += 1.0;
  tau = tau_last + (kLargestStep / most) * change;
  return true;
}

}  // namespace dovetail
