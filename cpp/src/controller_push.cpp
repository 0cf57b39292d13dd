// What pushes the arm: the disturbance estimate, what of it a hold acts against, and
// what of it is forgotten when.
#include <algorithm>

#include "dovetail/controller.hpp"

namespace dovetail {
namespace {

// Of tau_max: what the disturbance estimate takes of one measurement at most.
constexpr double kLargestSurprise = 0.25;
constexpr double kLargestEstimate = 1.0;  // ... that is taken for a disturbance

constexpr double kEndRate = 60.0;  // of the estimate after the last line [1/s]
// Of the estimate's slow part, with which a hold after the last line begins [1/s].
constexpr double kWeightRate = 8.0;

// Of a kick this share is learned at once. The whole would be a loop without a margin.
constexpr double kKickShare = 0.6;

// Of tau_max: the most of a disturbance that a hold acts against. A hold in contact is
// an integrator that would push ever harder.
constexpr double kLargestHeld = 0.12;
constexpr double kLeastHeld = 10.0;  // [Nm]: a push of 30 N at the wrist

constexpr double kFewPeriods = 3.0;  // between the last cycle and a reset that goes on

}  // namespace

/// Whether the arm goes on from where it is: what pulls at it pulls on, too. One whose
/// measured speed is not told was put there.
bool Controller::goes_on(const Vec7& q, const Vec7& dq) const noexcept {
  if (!has_last_ || dq == Vec7::Zero()) return false;
  const Vec7 reach = kFewPeriods * period_ * limits_.dq_max;
  return ((q - check_.q()).cwiseAbs().array() <= reach.array()).all();
}

/// r += share (M ddq + h - u - r) over the interval that has just ended, whose model
/// terms_ and h_ still hold. What one cycle adds is bounded: no sample throws the arm.
void Controller::update_disturbance(const Vec7& dq, double elapsed) noexcept {
  if (!has_last_ || limits_.estimate_rate == 0.0) return;
  double rate = limits_.estimate_rate;
  if (last_line_.cause() != EndCause::kNone) rate = std::min(rate, kEndRate);
  const Vec7 change = dq - dq_last_;
  double left = decay_.left(rate, elapsed);
  if (kick_.sees(dq, change, elapsed) && !last_line_.is_loop())
    left *= 1.0 - kKickShare;
  const double share = 1.0 - left;
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
  weight_ += std::min(kWeightRate * elapsed, 1.0) * (disturbance_ - weight_);
}

/// The part of the disturbance that a hold acts against [rad/s2]: of what pulls at the
/// tool the same share in all joints. Cut joint by joint, the rest would drive the
/// joints around a tool that something holds.
Vec7 Controller::held() const noexcept {
  const Vec7 most = (kLargestHeld * limits_.tau_max)
                        .cwiseMax(kLeastHeld)
                        .cwiseMin(0.5 * limits_.tau_max);
  const double over = disturbance_.cwiseQuotient(most).cwiseAbs().maxCoeff();
  return Minv_ * (disturbance_ / std::max(over, 1.0));
}

/// Whether a joint stands within a limit's margin, or beyond.
bool Controller::is_behind(int joint, double q) const noexcept {
  return q > limits_.q_max[joint] - limits_.delta_q ||
         q < limits_.q_min[joint] + limits_.delta_q;
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
