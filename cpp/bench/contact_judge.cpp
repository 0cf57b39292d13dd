#include "contact_judge.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace dovetail {

namespace {

constexpr double kVibration = 8.0;   // [Hz] and above
constexpr double kMeanTime = 0.02;   // of the contact force [s]
constexpr double kTouchTime = 0.15;  // in which a first touch is an impact [s]
constexpr double kFree = 0.25;       // without contact: the next touch is a first [s]
constexpr double kRestingFloor = 10.0;  // [N]

}  // namespace

ContactJudge::ContactJudge(const Chain& chain, const LimitParams& limits) noexcept
    : chain_(chain), limits_(limits) {}

void ContactJudge::reset() noexcept { *this = ContactJudge(chain_, limits_); }

void ContactJudge::set_spring(const Vec3& anchor, double stiffness,
                              double damping) noexcept {
  anchor_ = anchor;
  stiffness_ = stiffness;
  damping_ = damping;
}

void ContactJudge::see(const Vec7& q, const Vec7& dq) noexcept {
  chain_.tool_motion(q, dq, tool_);
  is_seen_ = true;
}

Vec3 ContactJudge::force(const Vec7& q, const Vec7& dq) noexcept {
  if (!is_seen_) see(q, dq);
  pull_ = stiffness_ * (anchor_ - tool_.p) - damping_ * tool_.twist.head<3>();
  return push_ + pull_;
}

void ContactJudge::look(const Vec7& q, const Vec7& dq, const Vec3& contact,
                        double h) noexcept {
  time_ += h;
  ++looks_;
  see(q, dq);
  position_.take((q - limits_.q_max).cwiseMax(limits_.q_min - q), 0.0, time_);
  speed_.take(dq.cwiseAbs().cwiseQuotient(limits_.dq_max), 1.0, time_);
  if (limits_.taper_brake.array().isFinite().any()) {
    const Vec7 up = over_taper(limits_.q_max - q, dq);
    tapered_speed_.take(up.cwiseMax(over_taper(q - limits_.q_min, -dq)), 0.0, time_);
  }
  if (limits_.walls) {
    const Vec3 v = tool_.twist.head<3>();
    wall_.take((tool_.p - limits_.x_max).cwiseMax(limits_.x_min - tool_.p), 0.0, time_);
    tcp_speed_.take(v.cwiseAbs() - limits_.dx_max, 0.0, time_);
  }
  // An arm that swings around in a spring stretches it: that is no excuse.
  if (stiffness_ > 0.0 && position_.count + speed_.count == 0) {
    chain_.evaluate(q, dq, terms_);
    const Vec7 torque = terms_.J.topRows<3>().transpose() * pull_;
    load_.take(torque.cwiseAbs().cwiseQuotient(limits_.tau_max), 1.0, time_);
  }
  judge_contact(contact, h);
  filter(dq, h);
}

/// Returns how much faster [rad/s] the joints are than the robot's maker allows them
/// `room` [rad] before the controller's position limit, at which he allows no speed.
Vec7 ContactJudge::over_taper(const Vec7& room, const Vec7& speed) const noexcept {
  const Vec7& offset = limits_.taper_offset;
  const Vec7 braked = 2.0 * limits_.taper_brake.cwiseProduct(room.cwiseMax(0.0));
  return speed - ((offset.cwiseAbs2() + braked).cwiseSqrt() - offset);
}

void ContactJudge::judge_contact(const Vec3& contact, double h) noexcept {
  using Scalar = Eigen::Matrix<double, 1, 1>;
  const double size = contact.norm();
  if (size > 0.0) {
    if (since_contact_ > kFree) {
      since_touch_ = 0.0;
      touch_speed_ = std::max(touch_speed_, tool_.twist.head<3>().norm());
    }
    since_contact_ = 0.0;
  } else {
    since_contact_ += h;
  }
  since_touch_ += h;
  mean_force_ += std::min(h / kMeanTime, 1.0) * (size - mean_force_);
  peak_.take(Scalar(size), std::numeric_limits<double>::infinity(), time_);
  if (since_touch_ < kTouchTime || since_contact_ > kFree) return;
  const double asked = std::max(resting_ + pull_.norm(), kRestingFloor);
  contact_.take(Scalar(mean_force_ / asked), 5.0, time_);
}

void ContactJudge::filter(const Vec7& dq, double h) noexcept {
  if (h != step_) {
    // Butterworth's high pass of second order by the bilinear transform.
    const double k = std::tan(std::numbers::pi * kVibration * h);
    const double norm = 1.0 / (1.0 + std::numbers::sqrt2 * k + k * k);
    b0_ = norm;
    a1_ = 2.0 * (k * k - 1.0) * norm;
    a2_ = (1.0 - std::numbers::sqrt2 * k + k * k) * norm;
    step_ = h;
  }
  const Vec7 out = b0_ * dq + z1_;
  z1_ = -2.0 * b0_ * dq - a1_ * out + z2_;
  z2_ = b0_ * dq - a2_ * out;
  vibration_ += out.squaredNorm();
  ++vibration_looks_;
}

double ContactJudge::take_vibration() noexcept {
  const double mean = vibration_looks_ > 0 ? vibration_ / vibration_looks_ : 0.0;
  vibration_ = 0.0;
  vibration_looks_ = 0;
  return std::sqrt(mean);
}

void ContactJudge::command(const Vec7& motor, const Flags& flags) noexcept {
  torque_.take(motor.cwiseAbs().cwiseQuotient(limits_.tau_max), 1.0, time_);
  flagged_[0] += flags.unsafe;
  flagged_[1] += flags.qp_early;
  flagged_[2] += flags.bad_input;
}

}  // namespace dovetail
