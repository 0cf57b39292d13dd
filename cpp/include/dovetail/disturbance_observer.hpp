/// Disturbance observer: the joint torque that the model does not explain, as a
/// first-order filter of the model's residual (docs/control.md, Disturbance estimate).
#pragma once

#include "dovetail/decay.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// The interval between two cycles, and the model that held in it.
struct ObservedInterval {
  const Mat7& M;    ///< joint inertia [kg m2]
  const Vec7& h;    ///< c + D dq at its start [Nm]
  const Vec7& tau;  ///< overlay torque that acted [Nm]
  Vec7 change;      ///< of the joint speeds [rad/s]
  double elapsed;   ///< its length [s]
  bool is_jump;     ///< it ends in the first surprise of a while (state_check.hpp)
  bool is_ended;    ///< the last line has ended the motion
};

/// One thread. Nothing allocates or throws.
class DisturbanceObserver {
 public:
  explicit DisturbanceObserver(const LimitParams& limits) noexcept
      : tau_max_(limits.tau_max),
        damping_(limits.damping),
        rate_(limits.estimate_rate) {}

  /// Forgets the disturbance.
  void reset() noexcept { r_ = of_jump_ = steady_ = slow_ = Vec7::Zero(); }

  /// Learns from the interval that has just ended.
  void update(const ObservedInterval& interval) noexcept;

  /// A surprise begins: what it adds to the estimate is not known yet.
  void begin_jump() noexcept { of_jump_.setZero(); }
  /// The last surprise was a wrong sample: takes back what it added. The other
  /// prediction of the state check is then the one that has it.
  void take_back_jump() noexcept {
    r_ -= of_jump_;
    of_jump_ = -of_jump_;
  }
  /// Drops the estimate where it may be what made a torque not finite.
  void drop() noexcept { r_ = of_jump_ = Vec7::Zero(); }
  /// Keeps the slow part, and in joints of `whole` (bits) all of it. A loop with delay
  /// lives in the quick part.
  void keep_slow_part(unsigned whole) noexcept;

  bool is_on() const noexcept { return rate_ != 0.0; }
  const Vec7& torque() const noexcept { return r_; }  ///< estimated r [Nm]
  /// r without its noise, for a joint target [Nm].
  const Vec7& steady() const noexcept { return steady_; }
  /// Share of r caused by the last surprise [Nm].
  const Vec7& of_jump() const noexcept { return of_jump_; }

  /// The part of a disturbance [Nm] that a standstill or a joint target acts against:
  /// the same share of it in all joints. Cut joint by joint, the rest would drive the
  /// joints around a tool that something holds.
  Vec7 opposed(const Vec7& r) const noexcept;

 private:
  Vec7 tau_max_, damping_;
  double rate_;  // [1/s]
  Decay decay_;
  Vec7 r_ = Vec7::Zero();
  Vec7 of_jump_ = Vec7::Zero();
  Vec7 steady_ = Vec7::Zero();
  Vec7 slow_ = Vec7::Zero();  // weight, mostly
};

}  // namespace dovetail
