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
/// A position that is none (input.hpp) is not taken: the next one counts for both
/// intervals, and nothing of it stays. So it is with one that was not believed, if the
/// next is where it was expected before. If not, the arm may be there: it is followed.
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
    waited_ = 0.0;
    believed_ = {q_, dq_, 0.0};
    is_doubted_ = false;
  }

  /// Takes the measured q [rad] after `elapsed` [s] under the acceleration a [rad/s2],
  /// and returns the velocity [rad/s] at its end.
  const Vec7& update(const Vec7& q, const Vec7& a, double elapsed) noexcept {
    const double step =
        elapsed > kShortestTime && std::isfinite(elapsed) ? elapsed : period_;
    const bool was_doubted = is_doubted_;
    is_doubted_ = false;
    if (!was_doubted) believed_ = {q_, dq_, waited_};
    waited_ += step;
    believed_.waited += step;
    if (!is_configuration(q) || !a.allFinite()) return dq_;
    if (was_doubted) go_back(q, a);
    const double T = waited_;
    waited_ = 0.0;
    const Vec7 predicted = q_ + T * dq_ + (0.5 * T * T) * a;
    const Vec7 surprise = (q - predicted).cwiseMax(-most(T)).cwiseMin(most(T));
    const double gain = std::min(1.0, gain_ * T / period_);
    dq_ += T * a + (gain / T) * surprise;
    q_ = q;
    return dq_;
  }

  /// The position that was taken last was not believed.
  void doubt() noexcept { is_doubted_ = true; }

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

  struct State {
    Vec7 q, dq;
    double waited;  // since q [s]
  };

  /// What one position may correct [rad].
  static double most(double time) noexcept {
    return kLargestNoise + 0.5 * kLargestUnknown * time * time;
  }

  /// Forgets what was not believed, if this position is where it was expected before.
  void go_back(const Vec7& q, const Vec7& a) noexcept {
    const double T = believed_.waited;
    const Vec7 expected = believed_.q + T * believed_.dq + (0.5 * T * T) * a;
    if ((q - expected).cwiseAbs().maxCoeff() > most(period_)) return;
    q_ = believed_.q;
    dq_ = believed_.dq;
    waited_ = believed_.waited;
  }

  double period_;
  double gain_;
  Vec7 q_ = Vec7::Zero();
  Vec7 dq_ = Vec7::Zero();
  double waited_ = 0.0;                              // since q_ [s]
  State believed_{Vec7::Zero(), Vec7::Zero(), 0.0};  // before what is in doubt
  bool is_doubted_ = false;                          // the last position
};

}  // namespace dovetail
