// What the controller knows of disturbances: the estimate, and how much of it counts.
#include <algorithm>

#include "dovetail/controller.hpp"

namespace dovetail {
namespace {

// Of tau_max: what the disturbance estimate takes of one measurement at most.
constexpr double kLargestSurprise = 0.25;
constexpr double kLargestEstimate = 1.0;  // ... that is taken for a disturbance

constexpr double kEndRate = 60.0;  // of the estimate after the last line [1/s]

// Of the part that a joint target holds against: with the whole, A2 of an arm with 10
// ms of delay stood with 2.1 Nm RMS of noise [1/s].
constexpr double kSteadyRate = 40.0;

// Of the slow part, with which a hold after the last line begins [1/s].
constexpr double kWeightRate = 8.0;

// Of tau_max: the most of a disturbance that a hold acts against. A hold in contact is
// an integrator that would push ever harder.
constexpr double kLargestHeld = 0.12;
constexpr double kLeastHeld = 10.0;  // [Nm]: a push of 30 N at the wrist

}  // namespace

/// r += share (M ddq + h - u - r) over the interval that has just ended, whose model
/// terms_ and h_ still hold. What one cycle adds is bounded: no sample throws the arm.
void Controller::update_disturbance(const Vec7& dq, double elapsed) noexcept {
  if (!has_last_ || limits_.estimate_rate == 0.0) return;
  double rate = limits_.estimate_rate;
  if (last_line_.cause() != EndCause::kNone) rate = std::min(rate, kEndRate);
  const double share = 1.0 - decay_.left(rate, elapsed);
  const Vec7 change = dq - dq_last_;
  const Vec7 viscous = limits_.damping.cwiseProduct(0.5 * change);  // at mean speed
  const Vec7 most = kLargestSurprise * limits_.tau_max;
  const Vec7 lost =
      terms_.M * change / elapsed + h_ + viscous - tau_last_ - disturbance_;
  const Vec7 before = disturbance_;
  disturbance_ += share * lost.cwiseMax(-most).cwiseMin(most);
  const Vec7 largest = kLargestEstimate * limits_.tau_max;
  disturbance_ = disturbance_.cwiseMax(-largest).cwiseMin(largest);
  if (!disturbance_.allFinite()) disturbance_.setZero();  // it would never end
  of_jump_ = check_.is_jump() ? Vec7(disturbance_ - before) : (1.0 - share) * of_jump_;
  steady_ += std::min(kSteadyRate * elapsed, 1.0) * (disturbance_ - steady_);
  weight_ += std::min(kWeightRate * elapsed, 1.0) * (disturbance_ - weight_);
}

/// The part of a disturbance r that a hold acts against [rad/s2]: of what pulls at the
/// tool the same share in all joints. Cut joint by joint, the rest would drive the
/// joints around a tool that something holds.
Vec7 Controller::held(const Vec7& r) const noexcept {
  const Vec7 most = (kLargestHeld * limits_.tau_max)
                        .cwiseMax(kLeastHeld)
                        .cwiseMin(0.5 * limits_.tau_max);
  const double over = r.cwiseQuotient(most).cwiseAbs().maxCoeff();
  return Minv_ * (r / std::max(over, 1.0));
}

/// A loop with delay lives in the quick part of the estimate. What holds a joint at its
/// limit stays: a load that grew as quickly would take it past the limit.
void Controller::forget_quick_part(const Vec7& q) noexcept {
  of_jump_.setZero();
  for (int i = 0; i < kNumJoints; ++i) {
    if (!is_behind(i, q[i])) disturbance_[i] = weight_[i];
  }
}

}  // namespace dovetail
