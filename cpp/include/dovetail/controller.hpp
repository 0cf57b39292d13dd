/// The one road from a Target to a torque: input check, model, disturbance estimate,
/// task acceleration, bounds, limits, torque, flags. Every limit lies on it.
#pragma once

#include <optional>

#include "dovetail/axis_anchor.hpp"
#include "dovetail/chain.hpp"
#include "dovetail/contact_approach.hpp"
#include "dovetail/cycle_bounds.hpp"
#include "dovetail/cycle_model.hpp"
#include "dovetail/disturbance_observer.hpp"
#include "dovetail/last_line.hpp"
#include "dovetail/osc.hpp"
#include "dovetail/standstill.hpp"
#include "dovetail/state_check.hpp"
#include "dovetail/torque_slew.hpp"
#include "dovetail/types.hpp"
#include "dovetail/walls.hpp"

namespace dovetail {

/// Not thread-safe: one thread calls reset and step. Neither allocates or throws.
class Controller {
 public:
  /// \param period  control period [s]
  /// Throws std::invalid_argument naming the element that is out of range.
  Controller(const ChainParams& chain, const OscParams& osc, const LimitParams& limits,
             const TaskSpec& task, double period);

  /// Starts afresh at q [rad], moving at dq [rad/s]: forgets what the last line saw,
  /// and the disturbance, unless a dq that is not zero says that the arm goes on from
  /// where it was; latches the pose that hold axes keep: TCP position [m] and rotation
  /// (wxyz). With a q or a pose that is none (see input.hpp) every cycle is a damped
  /// hold and `bad_input`, until a good one.
  void reset(const Vec7& q, const Vec3& p_hold, const Vec4& quat_hold,
             const Vec7& dq = Vec7::Zero()) noexcept;

  /// Lets the arm go on after the last line ended a motion.
  void resume() noexcept;

  /// Takes a state for true whatever was before, and changes nothing else.
  void believe(const Vec7& q, const Vec7& dq) noexcept { check_.reset(q, dq); }

  /// Takes a torque for the one that the arm last had: `dtau_max` counts from it. An
  /// arm that lost a message has an older one than was returned here.
  void had(const Vec7& tau) noexcept { sent_ = tau; }

  /// One cycle. The torque is the overlay u: the lowest level adds gravity, and
  /// |u + g(q)| <= tau_max always. Input that is none (see input.hpp), or a torque that
  /// would not be finite: a damped hold and `bad_input`.
  [[nodiscard]] StepResult step(const Vec7& q, const Vec7& dq,
                                const Target& target) noexcept {
    return step(q, dq, target, period_);
  }

  /// The same where `elapsed` [s] have passed since the last cycle: its torque acted
  /// that long. A time below 1 us counts as one period. One below 0, from 10 s on, or
  /// that is no number is bad input.
  [[nodiscard]] StepResult step(const Vec7& q, const Vec7& dq, const Target& target,
                                double elapsed) noexcept {
    take(q, dq, elapsed);
    return act(target);
  }

  /// The first half of a cycle: what is measured `elapsed` [s] after the last time.
  /// `state` then says what is believed. More than one may precede `act`.
  void take(const Vec7& q, const Vec7& dq, double elapsed) noexcept;

  /// The second half: the torque, from what was taken.
  [[nodiscard]] StepResult act(const Target& target) noexcept;

  /// Latches another pose for hold axes: TCP position [m] and rotation (wxyz). What is
  /// no pose acts as in `reset`.
  void hold_at(const Vec3& p_hold, const Vec4& quat_hold) noexcept;

  /// What the last line saw, if anything.
  const LastLine& end() const noexcept { return last_line_; }
  const StateCheck& state() const noexcept { return check_; }
  /// Estimated external torque r [Nm] (docs/control.md, Disturbance estimate).
  const Vec7& disturbance() const noexcept { return observer_.torque(); }
  /// What the disturbance estimate amounts to as a wrench on the tool at the TCP, world
  /// axes [N, Nm] (docs/control.md, Disturbance estimate); kUnset where it is off.
  Vec6 wrench() const noexcept {
    return observer_.is_on() ? wrench(observer_.torque())
                             : Vec6(Vec6::Constant(kUnset));
  }
  /// The same of torques that act on the joints [Nm], at the last step's state.
  Vec6 wrench(const Vec7& tau) const noexcept {
    return osc_.wrench(model_.terms.J, model_.factor, tau);
  }
  const OscTerms& osc_terms() const noexcept { return task_terms_; }
  const CycleBounds& bounds() const noexcept { return bounds_; }
  const Mat7& inertia() const noexcept { return model_.terms.M; }
  const Mat7& inverse_inertia() const noexcept { return model_.Minv; }
  /// c + D dq - r [Nm]: tau = M a + bias for the `a` of a cycle.
  Vec7 bias() const noexcept { return model_.h - model_.terms.M * model_.push; }
  /// Tool at the last step's measurement, by the model.
  const ToolMotion& tool() const noexcept { return model_.tool; }
  const Chain& chain() const noexcept { return chain_; }
  const LimitParams& limits() const noexcept { return limits_; }
  double period() const noexcept { return period_; }

 private:
  /// What was taken since the last torque.
  struct Taken {
    double elapsed = 0.0;    // [s]
    bool is_time = true;     // the times were some
    bool is_number = true;   // the last state was one
    bool is_return = false;  // a surprise was taken back
  };

  /// What the last cycle left.
  struct LastCycle {
    bool is_valid = false;  // it ended normally
    Vec7 dq = Vec7::Zero();
    Vec7 a0 = Vec7::Zero();
    Vec7 a = Vec7::Zero();  // as the arm should have it, clipping included
    Vec7 tau = Vec7::Zero();
  };

  /// What the limits of f* do to the tool.
  struct LimiterEffort {
    double power = 0.0;  // of what is cut from f* [W]
    double push = 0.0;   // the same where it brakes nothing [N]
  };

  bool is_ended() const noexcept { return last_line_.cause() != EndCause::kNone; }
  bool goes_on(const Vec7& q, const Vec7& dq) const noexcept;
  bool is_usable_cycle(const Target& target, bool is_time) const noexcept;
  void observe(const Vec7& dq, double elapsed) noexcept;
  void update_model(const Vec7& q, const Vec7& dq) noexcept;
  void update_bounds(const Vec7& q, const Vec7& dq) noexcept;
  Vec7 opposing(const Vec7& r) const noexcept;
  StepResult follow(const Target& target, const Vec7& q, const Vec7& dq,
                    double elapsed) noexcept;
  LimiterEffort follow_task(const Vec7& q, const Vec7& dq, const Target& target,
                            StepResult& result) noexcept;
  LimiterEffort follow_joints(const Vec7& q, const Vec7& dq, const Target& target,
                              StepResult& result) noexcept;
  double pace() const noexcept;
  void limit(StepResult& result) noexcept;
  bool is_explained(const Target& target, const Vec7& dq, const StepResult& result,
                    const LimiterEffort& effort, double elapsed) noexcept;
  void end_motion(const Vec7& q, const Vec7& dq) noexcept;
  void stand_still(const Vec7& q, const Vec7& dq, double elapsed,
                   StepResult& result) noexcept;
  StepResult brake(const Vec7& q, const Vec7& dq) noexcept;
  void slow_down(StepResult& result) noexcept;
  void finish(const Vec7& dq, StepResult& result) noexcept;
  void remember(const Vec7& dq, const Vec7& a0, const Vec7& a,
                const Vec7& tau) noexcept;

  Chain chain_;
  OperationalSpace osc_;
  LimitParams limits_;
  double period_;

  // the state of a cycle
  CycleModel model_;
  CycleBounds bounds_;
  OscTerms task_terms_;

  // what is known from the cycles before
  StateCheck check_;
  DisturbanceObserver observer_;
  Walls walls_;
  ContactApproach approach_;
  AxisAnchor anchor_;
  Standstill standstill_;
  LastLine last_line_;
  TorqueSlew slew_;
  Taken taken_;
  LastCycle last_;
  Vec7 sent_ = Vec7::Zero();     // the last torque: `dtau_max` counts from it [Nm]
  Target last_target_;           // that the last line was shown
  bool was_plausible_ = true;    // the state, in the last cycle
  bool has_start_ = false;       // the last reset had a configuration
  bool has_hold_ = false;        // the last pose to hold was one
  std::optional<Vec7> posture_;  // the configuration in which the task began [rad]
};

}  // namespace dovetail
