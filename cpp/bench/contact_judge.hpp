/// Pulls the TCP by a stiff spring, and compares the true state with the true limits in
/// every physics step. For adversaries and tests; no controller needs it.
#pragma once

#include "dovetail/chain.hpp"
#include "dovetail/step_probe.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// A limit over one try: the worst look, and how many looks were beyond it.
struct WorstLook {
  double value = -std::numeric_limits<double>::infinity();
  double time = 0.0;  ///< of the worst look [s]
  int axis = -1;      ///< joint or TCP axis of the worst look, from 0
  int count = 0;      ///< looks beyond the limit

  /// Takes the largest element of one look; beyond is above `limit`.
  template <typename Vector>
  void take(const Vector& over, double limit, double now) noexcept {
    Eigen::Index at;
    const double highest = over.maxCoeff(&at);
    count += highest > limit;
    if (highest <= value) return;
    value = highest;
    time = now;
    axis = static_cast<int>(at);
  }
};

/// No allocation, no exception. One thread at a time.
class ContactJudge final : public StepProbe {
 public:
  /// \param chain   kinematics, the same for model and plant
  /// \param limits  compared without the margins
  ContactJudge(const Chain& chain, const LimitParams& limits) noexcept;

  /// Forgets everything, spring and push included; time becomes 0.
  void reset() noexcept;

  /// From now on the TCP is pulled towards `anchor` [m], world axes.
  /// \param stiffness  [N/m]; 0 is no spring
  /// \param damping    [Ns/m]
  void set_spring(const Vec3& anchor, double stiffness, double damping) noexcept;

  /// A force on the TCP until the next one [N], world axes.
  void set_push(const Vec3& push) noexcept { push_ = push; }

  /// The contact force that is asked for [N], to which the true one is compared; the
  /// spring's own pull comes on top here.
  void set_resting(double force) noexcept { resting_ = force; }

  Vec3 force(const Vec7& q, const Vec7& dq) noexcept override;
  void look(const Vec7& q, const Vec7& dq, const Vec3& contact,
            double h) noexcept override;
  void command(const Vec7& motor, const Flags& flags) noexcept override;

  /// Root mean square of the joint velocities above 8 Hz since the last call, norm over
  /// the joints [rad/s].
  double take_vibration() noexcept;

  const WorstLook& position() const noexcept {
    return position_;
  }  ///< past limit [rad]
  const WorstLook& speed() const noexcept { return speed_; }  ///< over limit [1]
  /// Over the speed that falls towards a position limit [rad/s]; where none does,
  /// never.
  const WorstLook& tapered_speed() const noexcept { return tapered_speed_; }
  const WorstLook& wall() const noexcept { return wall_; }            ///< outside [m]
  const WorstLook& tcp_speed() const noexcept { return tcp_speed_; }  ///< over [m/s]
  const WorstLook& torque() const noexcept { return torque_; }  ///< over limit [1]
  /// Contact force, mean of 20 ms, over the resting push [1]; not within 150 ms of a
  /// first touch.
  const WorstLook& contact() const noexcept { return contact_; }
  /// Torque of the spring in a joint, of the motor's [1].
  const WorstLook& load() const noexcept { return load_; }
  /// Largest contact force of any step [N].
  const WorstLook& peak() const noexcept { return peak_; }
  /// TCP speed at the hardest first touch [m/s].
  double touch_speed() const noexcept { return touch_speed_; }
  int looks() const noexcept { return looks_; }
  /// Cycles flagged unsafe, qp_early, bad_input.
  const std::array<int, 3>& flagged() const noexcept { return flagged_; }

 private:
  void see(const Vec7& q, const Vec7& dq) noexcept;
  void filter(const Vec7& dq, double h) noexcept;
  Vec7 over_taper(const Vec7& room, const Vec7& speed) const noexcept;
  void judge_contact(const Vec3& contact, double h) noexcept;

  Chain chain_;
  LimitParams limits_;
  Vec3 anchor_ = Vec3::Zero(), push_ = Vec3::Zero(), pull_ = Vec3::Zero();
  double stiffness_ = 0.0, damping_ = 0.0;
  double resting_ = 0.0;

  ToolMotion tool_;
  ChainTerms terms_;
  bool is_seen_ = false;  // tool_ is of the present state
  double time_ = 0.0;
  int looks_ = 0;
  WorstLook position_, speed_, tapered_speed_, wall_, tcp_speed_, torque_;
  WorstLook contact_, peak_, load_;
  std::array<int, 3> flagged_{};

  double mean_force_ = 0.0;     // [N]
  double since_touch_ = 0.0;    // of the first touch [s]
  double since_contact_ = 1e9;  // without any [s]
  double touch_speed_ = 0.0;

  double b0_ = 0.0, a1_ = 0.0, a2_ = 0.0, step_ = 0.0;  // of the high pass, at step_
  Vec7 z1_ = Vec7::Zero(), z2_ = Vec7::Zero();
  double vibration_ = 0.0;
  int vibration_looks_ = 0;
};

}  // namespace dovetail
