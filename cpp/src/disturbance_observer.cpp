#include "dovetail/disturbance_observer.hpp"

#include <algorithm>

namespace dovetail {
namespace {

// Of tau_max: what the estimate takes of one measurement at most, and is at most.
constexpr double kLargestSurprise = 0.25;
constexpr double kLargestEstimate = 1.0;

constexpr double kEndRate = 60.0;  // largest rate after the end of a motion [1/s]

// With the whole estimate in a joint target, A2 of an arm with 10 ms of delay stood
// with 2.1 Nm RMS of noise [1/s].
constexpr double kSteadyRate = 40.0;

// Of the part with which the standstill after the end of a motion begins [1/s].
constexpr double kSlowRate = 8.0;

// Of tau_max: the most of a disturbance that is acted against. In contact that is an
// integrator, which would push ever harder.
constexpr double kLargestOpposed = 0.12;
constexpr double kLeastOpposed = 10.0;  // [Nm]: a push of 30 N at the wrist

}  // namespace

/// r += share (M ddq + h - u - r). What one cycle adds is bounded: no sample throws the
/// arm.
void DisturbanceObserver::update(const ObservedInterval& interval) noexcept {
  if (!is_on()) return;
  const double rate = interval.is_ended ? std::min(rate_, kEndRate) : rate_;
  const double elapsed = interval.elapsed;
  const double share = 1.0 - decay_.left(rate, elapsed);
  const Vec7& change = interval.change;
  const Vec7 viscous = damping_.cwiseProduct(0.5 * change);  // at the mean speed
  const Vec7 most = kLargestSurprise * tau_max_;
  const Vec7 lost =
      interval.M * change / elapsed + interval.h + viscous - interval.tau - r_;
  const Vec7 before = r_;
  r_ += share * lost.cwiseMax(-most).cwiseMin(most);
  const Vec7 largest = kLargestEstimate * tau_max_;
  r_ = r_.cwiseMax(-largest).cwiseMin(largest);
  if (!r_.allFinite()) r_.setZero();  // it would never end
  of_jump_ = interval.is_jump ? Vec7(r_ - before) : (1.0 - share) * of_jump_;
  steady_ += std::min(kSteadyRate * elapsed, 1.0) * (r_ - steady_);
  slow_ += std::min(kSlowRate * elapsed, 1.0) * (r_ - slow_);
}

void DisturbanceObserver::keep_slow_part(unsigned whole) noexcept {
  of_jump_.setZero();
  for (int i = 0; i < kNumJoints; ++i) {
    if (!((whole >> i) & 1U)) r_[i] = slow_[i];
  }
}

Vec7 DisturbanceObserver::opposed(const Vec7& r) const noexcept {
  const Vec7 most =
      (kLargestOpposed * tau_max_).cwiseMax(kLeastOpposed).cwiseMin(0.5 * tau_max_);
  const double over = r.cwiseQuotient(most).cwiseAbs().maxCoeff();
  return r / std::max(over, 1.0);
}

}  // namespace dovetail
