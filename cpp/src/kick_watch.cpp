#include "dovetail/kick_watch.hpp"

#include <algorithm>
#include <cmath>

namespace dovetail {
namespace {

constexpr double kQuickest = 500.0;  // of accelerations that are no noise [1/s]
constexpr double kRound = 3.0;       // times that a torque takes to act, once round

}  // namespace

KickWatch::KickWatch(const LimitParams& limits) noexcept
    : dq_max_(limits.dq_max),
      time_(limits.brake_rate > 0.0 ? 1.0 / limits.brake_rate : 0.0) {}

void KickWatch::reset() noexcept {
  wait_ = 0.0;
  ddq_.setZero();
}

bool KickWatch::sees(const Vec7& dq, const Vec7& change, double elapsed) noexcept {
  ddq_ += (1.0 - decay_.left(kQuickest, elapsed)) * (change / elapsed - ddq_);
  if (!ddq_.allFinite()) ddq_.setZero();  // it would never end
  wait_ = std::max(wait_ - elapsed, 0.0);
  if (wait_ > 0.0) return false;
  for (int i = 0; i < kNumJoints; ++i) {
    if (ddq_[i] * dq[i] > 0.0 && std::abs(dq[i] + time_ * ddq_[i]) > dq_max_[i]) {
      wait_ = kRound * time_;
      return true;
    }
  }
  return false;
}

}  // namespace dovetail
