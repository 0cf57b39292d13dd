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

// A joint that became faster went farther, by half of it times the period if the push
// was even. Of a blow at the end of the interval so much can be [rad/s]: the next
// sample shows its way, too.
constexpr double kBlowWay = 2.5;
constexpr double kBlowSpeed = 0.2;

// What one plausible sample may change, as a torque [Nm], under the stiffest laws that
// act on position [1/s2] and on speed [1/s].
constexpr double kTorque = 10.0;
constexpr double kStiffest = 3000.0;
constexpr double kQuickest = 60.0;
constexpr double kLeastPosition = 2e-4;  // ... and never less than noise [rad]
constexpr double kLeastSpeed = 0.05;     // [rad/s]
// ... and never more than this: a wrist moves the tool, and with it the whole arm.
constexpr double kMostPosition = 1e-3;
constexpr double kMostSpeed = 0.2;

// A sample that is believed, but beside what was expected by what this acceleration is
// over the interval of the limits, is remarked [rad/s2]: noise is less.
constexpr double kRemarkable = 0.8;

// A way that shows that more time went by [rad]: no sample is believed that far off.
constexpr double kShown = 2.0 * kMostPosition;

// Motion below which a repeated sample says nothing [rad].
constexpr double kStill = 1e-6;

}  // namespace

StateCheck::StateCheck(const LimitParams& limits, double period) noexcept
    : dq_max_(limits.dq_max),
      tau_max_(limits.tau_max),
      period_(period),
      remarkable_speed_(0.5 * kRemarkable * limits.kappa * period),
      remarkable_way_(remarkable_speed_ * limits.kappa * period) {
  seen_.fill(Vec7::Zero());
}

void StateCheck::reset(const Vec7& q, const Vec7& dq) noexcept {
  q_ = q;
  dq_ = dq_seen_ = dq;
  seen_.fill(q);
  since_ = since_seen_ = missed_ = 0.0;
  implausible_ = agreed_ = repeated_ = in_doubt_ = without_ = 0;
  is_surprised_ = is_jump_ = is_return_ = is_remarked_ = is_refused_ = false;
  is_fresh_ = true;
}

/// Whether what was not expected is worth a torque that may come at once.
bool StateCheck::is_within(const Vec7& farther, const Vec7& faster,
                           const Vec7& inertia) const noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    const double way =
        std::clamp(kTorque / (kStiffest * inertia[i]), kLeastPosition, kMostPosition);
    const double speed =
        std::clamp(kTorque / (kQuickest * inertia[i]), kLeastSpeed, kMostSpeed);
    if (std::abs(farther[i]) > way || std::abs(faster[i]) > speed) return false;
  }
  return true;
}

/// Whether the limits, which divide by their interval, make much of it.
bool StateCheck::is_remarkable(const Vec7& farther, const Vec7& faster) const noexcept {
  return farther.cwiseAbs().maxCoeff() > remarkable_way_ ||
         faster.cwiseAbs().maxCoeff() > remarkable_speed_;
}

/// Whether the way of this sample is the one without the surprise that was believed,
/// rather than the one with it. Then it is taken.
bool StateCheck::returns(const Vec7& q, const Vec7& dq, const Vec7& q_next,
                         const Vec7& inertia) noexcept {
  if (without_ == 0 || !is_within(q - q_without_, Vec7::Zero(), inertia)) return false;
  if ((q - q_without_).squaredNorm() >= (q - q_next).squaredNorm()) return false;
  const bool is_speed_too = is_within(Vec7::Zero(), dq - dq_without_, inertia);
  q_ = q;
  dq_ = is_speed_too ? dq : dq_without_;
  without_ = implausible_ = agreed_ = 0;
  since_ = 0.0;
  is_surprised_ = false;
  is_return_ = true;
  in_doubt_ = kDoubt;
  return true;
}

/// The prediction stands for this sample.
void StateCheck::refuse(const Vec7& q_next, const Vec7& dq_next) noexcept {
  q_ = q_next;
  dq_ = dq_next;
  in_doubt_ = kDoubt;
}

void StateCheck::remember(const Vec7& q, const Vec7& dq) noexcept {
  newest_ = (newest_ + 1) % kRemembered;
  seen_[newest_] = q;
  dq_seen_ = dq;
  since_seen_ = 0.0;
}

/// Whether this very sample has come before.
bool StateCheck::is_old(const Vec7& q) const noexcept {
  return std::any_of(seen_.begin(), seen_.end(),
                     [&](const Vec7& seen) { return q == seen; });
}

/// Whether what a joint did beyond what was expected can be motion: no more than the
/// kick allows, and as far as the speed that came of it goes. Notes the joint that
/// cannot.
bool StateCheck::is_near(const Vec7& q, const Vec7& dq, const Vec7& q_expected,
                         const Vec7& dq_expected, const Vec7& kick, double blow,
                         double time) noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    const double farther = std::abs(q[i] - q_expected[i]);
    const double faster = std::abs(dq[i] - dq_expected[i]);
    if (std::abs(dq[i]) <= 2.0 * dq_max_[i] + kNoiseSpeed &&
        faster <= kick[i] * time + kNoiseSpeed &&
        faster <= kBlowWay * farther / time + blow + kNoiseSpeed &&
        farther <= (faster + kNoiseSpeed) * time + kNoisePosition) {
      continue;
    }
    joint_ = i;
    return false;
  }
  return true;
}

/// For how long before this sample messages were lost, not told [s]; 0 where none were.
/// All joints must have come as far as in the longer time, at speeds between the last
/// and this one, which became what it is as a surprise's may; and one of them must show
/// it by its way, whatever its speed was.
double StateCheck::missed(const Vec7& q, const Vec7& dq, const Vec7& kick,
                          double elapsed) const noexcept {
  if ((dq.cwiseAbs() - kSpeedShare * dq_max_).maxCoeff() > 0.0) return 0.0;
  const Vec7 mean = 0.5 * (dq_ + dq), half = 0.5 * (dq - dq_).cwiseAbs();
  for (int lost = 1; lost < kRemembered; ++lost) {
    const double more = lost * period_, time = elapsed + more;
    if ((more * mean.cwiseAbs() - time * half).maxCoeff() < kShown) continue;
    const Vec7 beside = (q - q_ - time * mean).cwiseAbs() - time * half;
    const Vec7 shown = (kBlowWay / time) * (q - q_ - time * dq_).cwiseAbs();
    const Vec7 most = (shown.array() + kBlowSpeed).min(time * kick.array());
    const bool is_motion = (2.0 * half - most).maxCoeff() <= kNoiseSpeed;
    if (is_motion && beside.maxCoeff() <= kNoisePosition) return more;
  }
  return 0.0;
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

void StateCheck::take(const Vec7& q, const Vec7& dq, const Vec7& a, const Vec7& of_jump,
                      const Vec7& inertia, double elapsed) noexcept {
  const Vec7 q_next = q_ + elapsed * dq_ + (0.5 * elapsed * elapsed) * a;
  // Nothing that is expected makes a joint too fast; one that is slows down from there.
  const Vec7 fastest = dq_max_.cwiseMax(dq_.cwiseAbs());
  const Vec7 dq_next = (dq_ + elapsed * a).cwiseMax(-fastest).cwiseMin(fastest);
  const bool is_number = is_configuration(q) && is_speed(dq);
  // The first sample after a reset that is where the reset said: it may be in motion.
  const bool is_start = is_fresh_ && is_number && is_first(q, dq, elapsed);
  is_fresh_ = false;
  if (is_start) {
    q_ = q;
    dq_ = dq_seen_ = dq;
    seen_.fill(q);
    return;
  }
  is_jump_ = is_return_ = is_remarked_ = is_refused_ = false;
  missed_ = 0.0;
  since_ += elapsed;
  since_seen_ += elapsed;
  in_doubt_ = std::max(in_doubt_ - 1, 0);
  if (without_ > 0) {
    --without_;
    const Vec7 a_without = a - of_jump;
    q_without_ += elapsed * dq_without_ + (0.5 * elapsed * elapsed) * a_without;
    dq_without_ += elapsed * a_without;
  }
  // An old sample, until too many say the same: then the arm does stand there.
  const bool was_seen = is_number && is_old(q);
  const bool is_late =
      was_seen && repeated_ < kAgreed && elapsed * dq_.cwiseAbs().maxCoeff() > kStill;
  repeated_ = was_seen ? repeated_ + 1 : 0;
  if (is_late) {
    is_refused_ = true;
    refuse(q_next, dq_next);
    return;
  }
  const Vec7 kick = kKickShare * tau_max_.cwiseQuotient(inertia);
  const bool is_plausible =
      is_number &&
      is_near(q, dq, q_next, dq_next, kick, is_surprised_ ? 0.0 : kBlowSpeed, since_);
  const bool is_expected = is_plausible && is_within(q - q_next, dq - dq_next, inertia);
  if (is_number && !is_expected && returns(q, dq, q_next, inertia)) {
    remember(q, dq_);
    return;
  }
  // Implausible; but after one that was believed it may be later than was told.
  const bool may_miss = is_number && !is_plausible && since_ == elapsed;
  if (may_miss) missed_ = missed(q, dq, kick, elapsed);
  // Not where it was expected: does it agree with the sample before?
  const bool agrees =
      is_number && is_near(q, dq, seen_[newest_] + since_seen_ * dq_seen_, dq_seen_,
                           kick, kBlowSpeed, since_seen_);
  if (is_number) remember(q, dq);
  agreed_ = agrees && !is_expected ? agreed_ + 1 : 0;
  const bool was_surprised = is_surprised_;
  // After a time without samples the prediction is worth less than the first of them.
  const bool was_blind = implausible_ > kRemembered;
  const bool is_confirmed =
      missed_ > 0.0 || (is_plausible && !is_expected && (agrees || was_blind));
  is_surprised_ = is_plausible && !is_expected && !is_confirmed;
  if (agreed_ >= kAgreed) {
    reset(q, dq);
    in_doubt_ = kDoubt;
  } else if (is_expected || is_confirmed) {
    // The surprise that was taken off was none: this sample does not fit it, either.
    if (implausible_ > 0) without_ = 0;
    implausible_ = 0;
    since_ = 0.0;
    is_remarked_ = is_remarkable(q - q_next, dq - dq_next);
    q_ = q_next + (q - q_next);
    dq_ = dq_next + (dq - dq_next);
    if (is_confirmed) {
      in_doubt_ = kDoubt;
      // A late sample has way enough to be a wrong one: it must be what is taken back.
      if (without_ == 0 || missed_ > 0.0) {
        is_jump_ = true;
        q_without_ = q_next;
        dq_without_ = dq_next;
        without_ = kRemembered;
      }
    }
  } else {
    is_refused_ = !is_surprised_ || was_surprised;
    if (is_refused_) ++implausible_;
    refuse(q_next, dq_next);
    // One of two samples is wrong, then: it may be the surprise that was believed.
    if (is_refused_ && implausible_ == 1 && without_ > 0) {
      q_.swap(q_without_);
      dq_.swap(dq_without_);
      is_return_ = true;
    }
  }
}

}  // namespace dovetail
