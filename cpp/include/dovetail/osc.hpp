/// Operational-space control: what acceleration the task asks of the tool, and the
/// joint torque that gives it (Khatib 1987), with damping in the null space.
///
/// Rows are in twist order, [linear; angular] in world axes at the TCP. Rotation rows
/// are scaled by L [m/rad] so that one eigenvalue threshold serves all of them.
#pragma once

#include "dovetail/chain.hpp"
#include "dovetail/cholesky.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// How long the desired pose of a Target moves on by its feed-forward [s]: two policy
/// steps of 50 ms. A Target that is late must not run away.
constexpr double kPathTime = 0.1;

/// Where a Target wants the tool at its age.
struct DesiredMotion {
  Vec3 position;      ///< of pose axes [m]
  Vec4 quat_wxyz;     ///< of pose axes, unit
  Vec6 velocity;      ///< [m/s, rad/s]
  Vec6 acceleration;  ///< [m/s2, rad/s2]
};

/// The Target's path: constant acceleration, ended after `kPathTime`.
[[nodiscard]] DesiredMotion desired_motion(const Target& target) noexcept;

/// How that pose moves now [m/s, rad/s].
[[nodiscard]] Vec6 desired_velocity(const Target& target) noexcept;

/// The task at one state; rows of free axes are zero throughout.
struct OscTerms {
  Mat67 J;      ///< task Jacobian, rotation rows scaled by L
  Mat6 Lambda;  ///< faded task inertia of J [kg]
  Vec6 f;       ///< f*, rotation rows scaled by L [m/s2]
  Vec7 u0;      ///< joint torque that the task asks for, without gravity [Nm]
  bool exact;   ///< true where no eigenvalue was faded
};

/// 2 atan2(|vec|, w) vec/|vec| of the rotation R: the world rotation vector [rad].
[[nodiscard]] Vec3 rotation_vector(const Mat3& R) noexcept;

/// Angle of the twist of R about world z (swing-twist), in (-pi, pi] [rad].
[[nodiscard]] double twist_about_z(const Mat3& R) noexcept;

class OperationalSpace {
 public:
  /// \param period  between two calls of desired_acceleration [s]
  OperationalSpace(const OscParams& params, const TaskSpec& task,
                   double period) noexcept;

  /// Latches the pose that `hold` axes keep and that `pose` rotations refer to.
  void reset(const Vec3& p_hold, const Vec4& quat_hold) noexcept;

  /// The next desired pose is gone to from where the tool is then.
  void forget_way() noexcept {
    has_way_ = false;
    pace_ = 1.0;
  }

  /// The speed at which the desired pose would go its way at full pace, in rows as
  /// OscTerms::f has them.
  [[nodiscard]] Vec6 way_speed() const noexcept;

  /// Share of that speed at which it goes on, in (0, 1].
  void set_pace(double pace) noexcept { pace_ = pace; }

  /// Integral term: follows what pulls at pose and hold axes and no tare takes off,
  /// within bounds. They would stand off by that over K.
  /// \param pull  [m/s2, rad/s2], what the tare takes off not counted
  void integrate(const Vec6& pull) noexcept;
  void reset_integral() noexcept { integral_.setZero(); }

  /// f* per axis [m/s2, rad/s2], unscaled, zero on free axes. The desired pose goes to
  /// the Target's at `move_speed` and `turn_speed` more than the Target's own speeds.
  /// \param p, R, twist  measured TCP position [m], axes and velocity
  [[nodiscard]] Vec6 desired_acceleration(const Vec3& p, const Mat3& R,
                                          const Vec6& twist,
                                          const Target& target) noexcept;

  /// What the way that is left will ask for, in rows as OscTerms::f has them: beside
  /// what is asked at once it is what a Target changes.
  [[nodiscard]] Vec6 way_to_come() const noexcept;

  /// u0 = J^T Lambda (f* - dJ dq) + N M (posture - k dq) and what it is made of. The
  /// posture acts where no row of the whole tool is moved, those of free axes included.
  /// \param terms   chain at the model's configuration
  /// \param M, M_factor  joint inertia with armature, and its Cholesky factor
  /// \param posture  what the redundant joint is asked for [rad/s2]
  void evaluate(const ChainTerms& terms, const Mat7& M, const Cholesky<7>& M_factor,
                const Vec7& dq, const Vec6& f_star, const Vec7& posture,
                OscTerms& out) const noexcept;

  /// The wrench on the tool at the TCP [N, Nm], world axes, that gives these joint
  /// torques [Nm]: Lambda J M^-1 tau, without directions in which the arm can hardly
  /// move; kUnset where they are no numbers.
  [[nodiscard]] Vec6 wrench(const Mat67& J, const Cholesky<7>& M_factor,
                            const Vec7& tau) const noexcept;

  /// Stiffness times the way back to q_d, which is shortened [rad/s2].
  [[nodiscard]] Vec7 posture_acceleration(const Vec7& q,
                                          const Vec7& q_d) const noexcept;

  /// K (q_d - q) - 2 zeta sqrt(K) dq [rad/s2], for joint targets.
  [[nodiscard]] Vec7 joint_acceleration(const Vec7& q, const Vec7& dq,
                                        const Vec7& q_d) const noexcept;

  const OscParams& params() const noexcept { return params_; }
  const TaskSpec& task() const noexcept { return task_; }

 private:
  Vec3 moved_to(const DesiredMotion& wanted) noexcept;
  Vec4 turned_to(const DesiredMotion& wanted) noexcept;
  Mat3 desired_rotation(const Mat3& R, const Vec4& quat_wxyz) const noexcept;
  bool task_inertia(const Mat67& J, const Cholesky<7>& M_factor, const TaskSpec& task,
                    Mat6& Lambda) const noexcept;

  OscParams params_;
  TaskSpec task_;
  Vec6 scale_;    // per row: 0 free, 1 linear, L angular
  Vec6 damping_;  // D per row [1/s]
  double period_;
  bool has_free_ = false;
  bool follows_measured_ = false;  // a rotation axis without impedance
  Vec3 p_hold_ = Vec3::Zero();
  Vec4 quat_hold_{1.0, 0.0, 0.0, 0.0};
  Vec3 error_ = Vec3::Zero();     // the last rotation error [rad]
  Vec6 integral_ = Vec6::Zero();  // [m/s2, rad/s2]
  double integral_share_;         // of a change of what pulls, per cycle
  double pace_ = 1.0;
  Vec6 v_way_ = Vec6::Zero();  // [m/s, rad/s]
  bool has_way_ = false;
  Vec3 p_way_ = Vec3::Zero();  // the desired pose on its way
  Vec4 quat_way_{1.0, 0.0, 0.0, 0.0};
  Vec6 way_ = Vec6::Zero();  // the last way left to the Target's [m, rad]
};

}  // namespace dovetail
