/// Joint velocity from positions alone: FRI sends no velocity.
///
/// Prediction with the acceleration that the controller commanded, correction with the
/// measured position:
///
///     dq+ = dq + a T
///     q+  = q + dq T + a T^2 / 2
///     dq  = dq+ + gain / T (q_measured - q+)
///
/// Gain 1 takes (q_k - q_k-1) / T, the mean velocity of the interval, and moves it to
/// the interval's end by a T / 2: no lag where the arm does as commanded, and the noise
/// of one difference. A smaller gain trusts the model for longer and has less noise;
/// over several periods it grows with their number, as the noise of the difference
/// becomes less.
///
/// What one measurement may correct is bounded by what noise and an acceleration that
/// the model does not know explain: a wrong one is worth no more.
///
/// A position that is none (input.hpp) is not taken, and one that was not believed is
/// taken back: the next one counts for both intervals, and nothing of it stays. From
/// the third in a row on positions are followed again, for the arm may be there, but
/// the speed is the predicted one.
#pragma once

#include <algorithm>
#include <stdexcept>
#include <string>

#include "dovetail/input.hpp"

namespace dovetail {

/// One thread. After construction nothing allocates or throws.
class VelocityObserver {
 public:
  /// \param period  time between measurements [s]
  /// \param gain    above 0, at most 1
  /// Throws std::invalid_argument for a number out of range.
  explicit VelocityObserver(double period, double gain = 1.0)
      : period_(period), gain_(gain) {
    if (!(period > 0.0 && period <= 0.1)) {
      throw std::invalid_argument("observer period is " + std::to_string(period) +
                                  " s; allowed: above 0 and at most 0.1 s");
    }
    if (!(gain > 0.0 && gain <= 1.0)) {
      throw std::invalid_argument("observer gain is " + std::to_string(gain) +
                                  "; allowed: above 0 and at most 1");
    }
  }

  /// Starts at rest at q [rad].
  void reset(const Vec7& q) noexcept {
    if (is_configuration(q)) q_ = q;
    dq_.setZero();
    waited_ = waited_before_ = 0.0;
    q_before_ = q_;
    dq_before_ = dq_predicted_ = dq_;
    doubted_ = 0;
    is_doubted_ = false;
  }

  /// Takes the measured q [rad] after `elapsed` [s] under the acceleration a [rad/s2],
  /// and returns the velocity [rad/s] at its end.
  const Vec7& update(const Vec7& q, const Vec7& a, double elapsed) noexcept {
    if (!is_doubted_) doubted_ = 0;
    is_doubted_ = false;
    waited_ += elapsed > kShortestTime && std::isfinite(elapsed) ? elapsed : period_;
    q_before_ = q_;
    dq_before_ = dq_;
    waited_before_ = waited_;
    if (!is_configuration(q) || !a.allFinite()) return dq_;
    const double T = waited_;
    waited_ = 0.0;
    dq_predicted_ = dq_ + T * a;
    const Vec7 predicted = q_ + T * dq_ + (0.5 * T * T) * a;
    const double most = kLargestNoise + 0.5 * kLargestUnknown * T * T;
    const Vec7 surprise = (q - predicted).cwiseMax(-most).cwiseMin(most);
    const double gain = std::min(1.0, gain_ * T / period_);
    dq_ += T * a + (gain / T) * surprise;
    q_ = q;
    return dq_;
  }

  /// The position that was taken last was not believed. Once for each at most.
  void take_back() noexcept {
    if (is_doubted_) return;
    is_doubted_ = true;
    if (++doubted_ <= kBridged) {
      q_ = q_before_;
      dq_ = dq_before_;
      waited_ = waited_before_;
    } else if (waited_ == 0.0) {
      dq_ = dq_predicted_;
    }
  }

  /// The same after one period.
  const Vec7& update(const Vec7& q, const Vec7& a) noexcept {
    return update(q, a, period_);
  }

  const Vec7& dq() const noexcept { return dq_; }
  double period() const noexcept { return period_; }
  double gain() const noexcept { return gain_; }

 private:
  static constexpr double kLargestNoise = 2e-4;     // [rad]
  static constexpr double kLargestUnknown = 300.0;  // [rad/s2]
  static constexpr int kBridged = 2;                // positions in a row

  double period_;
  double gain_;
  Vec7 q_ = Vec7::Zero();
  Vec7 dq_ = Vec7::Zero();
  double waited_ = 0.0;  // since q_ [s]
  Vec7 q_before_ = Vec7::Zero();
  Vec7 dq_before_ = Vec7::Zero();
  Vec7 dq_predicted_ = Vec7::Zero();
  double waited_before_ = 0.0;
  int doubted_ = 0;          // positions in a row that were not believed
  bool is_doubted_ = false;  // the last one was not
};

}  // namespace dovetail
