/// The one road from a Target to a torque: input check, model, disturbance estimate,
/// task acceleration, bounds, limits, torque, flags. Every limit lies on it.
#pragma once

#include <array>

#include "dovetail/bounds.hpp"
#include "dovetail/chain.hpp"
#include "dovetail/cholesky.hpp"
#include "dovetail/decay.hpp"
#include "dovetail/last_line.hpp"
#include "dovetail/osc.hpp"
#include "dovetail/state_check.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// Intervals of one cycle, of what may be asked for: the push comes on top. The walls'
/// are infinite where walls are off.
struct CycleBounds {
  Vec7 lb, ub;  ///< joints [rad/s2]
  Vec3 cl, cu;  ///< TCP axes [m/s2]
  std::array<BoundCause, 7> lb_cause, ub_cause;
  std::array<BoundCause, 3> cl_cause, cu_cause;
};

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
  void resume() noexcept {
    last_line_.reset();
    is_at_rest_ = has_posture_ = has_walls_ = false;
    joint_params_.passive = wall_params_.passive = limits_.passive;
  }

  /// Takes a state for true whatever was before, and changes nothing else.
  void believe(const Vec7& q, const Vec7& dq) noexcept { check_.reset(q, dq); }

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
  const Vec7& disturbance() const noexcept { return disturbance_; }
  /// What the disturbance estimate amounts to as a wrench on the tool at the TCP, world
  /// axes [N, Nm] (docs/control.md, Disturbance estimate); kUnset where it is off.
  Vec6 wrench() const noexcept {
    const bool is_off = limits_.estimate_rate == 0.0;
    return is_off ? Vec6(Vec6::Constant(kUnset)) : wrench(disturbance_);
  }
  /// The same of torques that act on the joints [Nm], at the last step's state.
  Vec6 wrench(const Vec7& tau) const noexcept {
    return osc_.wrench(terms_.J, factor_, tau);
  }
  const OscTerms& osc_terms() const noexcept { return task_terms_; }
  const CycleBounds& bounds() const noexcept { return bounds_; }
  const Mat7& inertia() const noexcept { return terms_.M; }
  const Mat7& inverse_inertia() const noexcept { return Minv_; }
  /// c + D dq - r [Nm]: tau = M a + bias for the `a` of a cycle.
  Vec7 bias() const noexcept { return h_ - terms_.M * push_; }
  /// Tool at the last step's measurement, by the model.
  const ToolMotion& tool() const noexcept { return tool_; }
  const Chain& chain() const noexcept { return chain_; }
  const LimitParams& limits() const noexcept { return limits_; }
  double period() const noexcept { return period_; }

 private:
  bool goes_on(const Vec7& q, const Vec7& dq) const noexcept;
  void update_disturbance(const Vec7& dq, double elapsed) noexcept;
  bool is_behind(int joint, double q) const noexcept;
  void forget_quick_part(const Vec7& q) noexcept;
  void update_model(const Vec7& q, const Vec7& dq) noexcept;
  void update_walls(double elapsed) noexcept;
  void update_bounds(const Vec7& q, const Vec7& dq) noexcept;
  double below(double limit, double push, double speed) const noexcept;
  double height(const Target& target) const noexcept;
  double braking_room(const Target& target) const noexcept;
  double speed_limit(int axis, double room) const noexcept;
  double excess_press(const Target& target) const noexcept;
  double pace() const noexcept;
  double limiter_push(int axis, double asked, double kept, double tare) const noexcept;
  void keep_inside(const Target& target, Vec6& f_star, StepResult& result,
                   Vec3& push_by_limits) const noexcept;
  void follow_task(const Vec7& q, const Vec7& dq, const Target& target,
                   StepResult& result) noexcept;
  void follow_joints(const Vec7& q, const Vec7& dq, const Target& target,
                     StepResult& result) noexcept;
  void limit_by_qp(StepResult& result) noexcept;
  void limit_by_cascade(StepResult& result) noexcept;
  void mark_joints(unsigned upper, unsigned lower, Flags& flags) const noexcept;
  void mark_walls(unsigned upper, unsigned lower, Flags& flags) const noexcept;
  void stay(const Target& target, Vec6& f_star) noexcept;
  void follow_end(const Vec7& q, const Vec7& dq, double elapsed,
                  StepResult& result) noexcept;
  void limit(StepResult& result) noexcept;
  bool is_explained(const Target& target, const Vec7& dq, const StepResult& result,
                    double elapsed) noexcept;
  void soften(StepResult& result) noexcept;
  StepResult finish(const Vec7& dq, StepResult& result) noexcept;
  Vec7 braking() const noexcept;
  Vec7 held(const Vec7& r) const noexcept;
  StepResult hold(const Vec7& a, const Vec7& h) noexcept;
  StepResult brake(const Vec7& q, const Vec7& dq) noexcept;

  Chain chain_;
  OperationalSpace osc_;
  LimitParams limits_;
  double period_;
  BoundsParams joint_params_;
  BoundsParams wall_params_;

  // the cycle's model, at q + dq period / 2 when mid_interval
  ChainTerms terms_;  // M with armature
  ToolMotion tool_;   // at the measured state
  Cholesky<7> factor_;
  Mat7 Minv_;
  Vec7 h_;           // c + D dq
  Vec7 push_;        // M^-1 r: what pushes, as an acceleration [rad/s2]
  Vec7 push_whole_;  // the same where the estimate is large
  Vec3 push_x_;      // of push_, at the TCP [m/s2]
  Vec7 lo_, hi_;     // overlay torque limits
  OscTerms task_terms_;
  CycleBounds bounds_;

  bool has_start_ = false;  // the last reset had a configuration
  bool has_hold_ = false;   // the last pose to hold was one

  bool has_posture_ = false;  // since the task began
  Vec7 posture_ = Vec7::Zero();

  unsigned staying_ = 0;  // force axes that are held, bits
  Vec3 anchor_ = Vec3::Zero();

  bool has_walls_ = false;  // since the start
  Vec3 x_min_, x_max_;      // the walls as they are now: outside of a tool that was

  StateCheck check_;
  double since_ = 0.0;         // of what was taken since the last torque [s]
  bool is_time_ = true;        // ... the times were some
  bool is_number_ = true;      // ... the last one was one
  bool is_return_ = false;     // ... a surprise was taken back
  bool was_plausible_ = true;  // in the last cycle
  bool is_soft_ = false;       // the last torque was on its way to the wanted one
  double lagged_ = 0.0;        // torques that were of late, fading [cycles]
  LastLine last_line_;
  double limiter_power_ = 0.0;  // of what is cut from f* [W]
  double limiter_push_ = 0.0;   // the same where it brakes nothing [N]
  bool is_at_rest_ = false;     // after the end
  Vec7 q_end_ = Vec7::Zero();
  Vec7 dq_end_ = Vec7::Zero();  // its speed since, without what is too quick to damp

  // what the last cycle left
  bool has_last_ = false;  // the last cycle ended normally
  Decay decay_;            // of what the disturbance was
  Vec7 disturbance_ = Vec7::Zero();
  Vec7 of_jump_ = Vec7::Zero();  // what the last surprise was worth of it [Nm]
  Vec7 steady_ = Vec7::Zero();   // the disturbance without its noise [Nm]
  Vec7 weight_ = Vec7::Zero();   // the disturbance's slow part [Nm]
  Vec7 a_last_ = Vec7::Zero();
  Vec7 a0_last_ = Vec7::Zero();
  Target target_last_;
  Vec7 dq_last_ = Vec7::Zero();
  Vec7 tau_last_ = Vec7::Zero();
};

}  // namespace dovetail
