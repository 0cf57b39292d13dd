#include "dovetail/state_check.hpp"

#include <algorithm>
#include <cmath>

#include "dovetail/input.hpp"

namespace dovetail {
namespace {

// Beyond what motion explains: noise of a sample [rad], [rad/s].
constexpr double kNoisePosition = 5e-4;
constexpr double kNoiseSpeed = 0.1;

// A joint may be faster than its limit, by this factor, before it is not believed.
constexpr double kSpeedShare = 1.3;

// What hits the arm may be as strong as its motors, over and above them.
constexpr double kKickShare = 3.0;

// What one plausible sample may change, as a torque [Nm], under the stiffest laws that
// act on position [1/s2] and on speed [1/s].
constexpr double kTorque = 10.0;
constexpr double kStiffest = 3000.0;
constexpr double kQuickest = 60.0;
constexpr double kLeastPosition = 2e-4;  // ... and never less than noise [rad]
constexpr double kLeastSpeed = 0.05;     // [rad/s]

// Motion below which a repeated sample says nothing [rad].
constexpr double kStill = 1e-6;

}  // namespace

StateCheck::StateCheck(const LimitParams& limits) noexcept
    : dq_max_(limits.dq_max), tau_max_(limits.tau_max) {}

void StateCheck::reset(const Vec7& q, const Vec7& dq) noexcept {
  q_ = q_seen_ = q;
  dq_ = dq_seen_ = dq;
  since_ = 0.0;
  implausible_ = agreed_ = repeated_ = 0;
  is_fresh_ = true;
}

/// Whether a joint can have come from there in the time; notes the one that cannot.
bool StateCheck::is_reachable(const Vec7& q, const Vec7& dq, const Vec7& q_from,
                              const Vec7& dq_from, const Vec7& kick,
                              double elapsed) noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    const double speed = kSpeedShare * dq_max_[i];
    const bool is_near =
        std::abs(q[i] - q_from[i]) <= speed * elapsed + kNoisePosition &&
        std::abs(dq[i]) <= 2.0 * dq_max_[i] + kNoiseSpeed &&
        std::abs(dq[i] - dq_from[i]) <= kick[i] * elapsed + kNoiseSpeed;
    if (is_near) continue;
    joint_ = i;
    return false;
  }
  return true;
}

/// Whether an arm that was reset here can be there now, at that speed.
bool StateCheck::is_first(const Vec7& q, const Vec7& dq,
                          double elapsed) const noexcept {
  if (q == q_ && dq == dq_) return true;
  const Vec7 fastest = kSpeedShare * dq_max_;
  const Vec7 farthest = (elapsed * fastest).array() + kNoisePosition;
  return ((q - q_).cwiseAbs() - farthest).maxCoeff() <= 0.0 &&
         (dq.cwiseAbs() - fastest).maxCoeff() <= 0.0;
}

void StateCheck::take(const Vec7& q, const Vec7& dq, const Vec7& a, const Vec7& inertia,
                      double elapsed) noexcept {
  const Vec7 q_next = q_ + elapsed * dq_ + (0.5 * elapsed * elapsed) * a;
  const Vec7 dq_next = (dq_ + elapsed * a).cwiseMax(-dq_max_).cwiseMin(dq_max_);
  const bool is_number = is_configuration(q) && is_speed(dq);
  // The first sample after a reset that is where the reset said: it may be in motion.
  const bool is_start = is_fresh_ && is_number && is_first(q, dq, elapsed);
  is_fresh_ = false;
  if (is_start) {
    q_ = q_seen_ = q;
    dq_ = dq_seen_ = dq;
    return;
  }
  // An old sample, until too many say the same: then the arm does stand there.
  const bool is_repeated = is_number && q == q_seen_ && repeated_ < kAgreed &&
                           elapsed * dq_.cwiseAbs().maxCoeff() > kStill;
  repeated_ = is_number && q == q_seen_ ? repeated_ + 1 : 0;
  const Vec7 kick = kKickShare * tau_max_.cwiseQuotient(inertia);
  since_ += elapsed;
  if (is_repeated) {
    q_ = q_next;
    dq_ = dq_next;
    return;
  }
  const bool is_plausible = is_number && is_reachable(q, dq, q_, dq_next, kick, since_);
  // Not where it was expected: does it agree with the sample before?
  const bool agrees =
      is_number && is_reachable(q, dq, q_seen_, dq_seen_, kick, elapsed);
  if (is_number) {
    q_seen_ = q;
    dq_seen_ = dq;
  }
  agreed_ = agrees && !is_plausible ? agreed_ + 1 : 0;
  if (agreed_ >= kAgreed) {
    reset(q, dq);
    return;
  }
  if (!is_plausible) {
    ++implausible_;
    q_ = q_next;
    dq_ = dq_next;
    return;
  }
  implausible_ = 0;
  since_ = 0.0;
  for (int i = 0; i < kNumJoints; ++i) {
    const double speed = std::max(kTorque / (kQuickest * inertia[i]), kLeastSpeed);
    const double way = std::max(kTorque / (kStiffest * inertia[i]), kLeastPosition);
    q_[i] = q_next[i] + std::clamp(q[i] - q_next[i], -way, way);
    dq_[i] = dq_next[i] + std::clamp(dq[i] - dq_next[i], -speed, speed);
  }
}

}  // namespace dovetail
