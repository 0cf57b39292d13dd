#include "dovetail/standstill.hpp"

#include <algorithm>
#include <cmath>

namespace dovetail {
namespace {

// Stable with any delay there is.
constexpr double kStiffness = 50.0;        // [1/s2]
constexpr double kDamping = 15.0;          // [1/s]
constexpr double kQuickest = 40.0;         // of speeds that are damped: 6 Hz [1/s]
constexpr double kRestSpeed = 0.02;        // [rad/s]
constexpr double kFreeBraking = 1000.0;    // beyond what the limits allow [1/s]
constexpr double kShortestBraking = 0.02;  // [s]

}  // namespace

Standstill::Standstill(const LimitParams& limits, double period) noexcept
    : brake_time_(std::max(limits.kappa * period, kShortestBraking)),
      most_(limits.eta * limits.ddq_max) {}

Vec7 Standstill::braking(const Vec7& dq) const noexcept {
  return (-dq / brake_time_).cwiseMax(-most_).cwiseMin(most_);
}

void Standstill::begin(const Vec7& dq) noexcept {
  is_at_rest_ = false;
  dq_ = dq;
}

Vec7 Standstill::acceleration(const Vec7& q, const Vec7& dq, double elapsed) noexcept {
  if (!is_at_rest_) {
    q_ = q;
    is_at_rest_ = dq.cwiseAbs().maxCoeff() < kRestSpeed;
  }
  dq_ += (1.0 - std::exp(-kQuickest * elapsed)) * (dq - dq_);
  return kStiffness * (q_ - q) - kDamping * dq_;
}

void free_braking(const LimitParams& limits, const Vec7& q, const Vec7& dq,
                  CycleBounds& bounds) noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    if (is_at_limit(limits, i, q[i])) continue;
    bounds.ub[i] += kFreeBraking * std::max(-dq[i], 0.0);
    bounds.lb[i] -= kFreeBraking * std::max(dq[i], 0.0);
  }
}

}  // namespace dovetail
