/// Fixed-size data that crosses borders: no behaviour, SI units, no allocation.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>

#include "dovetail/flags.hpp"

namespace dovetail {

using Vec3 = Eigen::Matrix<double, 3, 1>;
using Vec4 = Eigen::Matrix<double, 4, 1>;
using Vec6 = Eigen::Matrix<double, 6, 1>;
using Vec7 = Eigen::Matrix<double, 7, 1>;
using Mat3 = Eigen::Matrix<double, 3, 3>;
using Mat6 = Eigen::Matrix<double, 6, 6>;
using Mat7 = Eigen::Matrix<double, 7, 7>;
using Mat37 = Eigen::Matrix<double, 3, 7>;
using Mat67 = Eigen::Matrix<double, 6, 7>;

constexpr int kNumJoints = 7;

/// Value of a setting that has no default: a controller refuses to start with it.
constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

constexpr double kInfinite = std::numeric_limits<double>::infinity();

/// How one task axis is driven (docs/control.md, Law).
enum class AxisMode : std::uint8_t {
  kFree = 0,   ///< row dropped, left to the null space
  kForce = 1,  ///< f* given by the action
  kPose = 2,   ///< impedance law towards the Target's coordinate
  kHold = 3,   ///< impedance law towards the pose latched at reset
};

/// Modes in twist order: X Y Z, then rotations about x (C), y (B), z (A).
using TaskSpec = std::array<AxisMode, 6>;

enum class Scheme : std::uint8_t {
  kQp = 0,     ///< joint box hard, walls soft below it, torque rows inside
  kPaper = 1,  ///< SCS then SJS, corrected, then the torque stage by blending
};

/// Formula of the acceleration bounds (docs/control.md, Limits).
enum class BoundsKind : std::uint8_t {
  kViability = 0,       ///< robust viability, the default
  kPaperCorrected = 1,  ///< the paper's bound, velocity typo fixed, clipped to +-A
  kPaperPrinted = 2,    ///< the paper's bound as printed, for comparison only
};

/// A serial chain of seven revolute joints about their local z axes.
struct ChainParams {
  std::array<Vec3, 7> origin_position;  ///< joint origin in the parent link [m]
  std::array<Mat3, 7> origin_rotation;  ///< joint frame in the parent link
  std::array<double, 7> mass;           ///< link mass [kg], payload in link 7
  std::array<Vec3, 7> com;              ///< centre of mass in the link frame [m]
  std::array<Mat3, 7> inertia;          ///< about the com, link axes [kg m2]
  Vec3 tool_position;                   ///< TCP in the link-7 frame [m]
  Mat3 tool_rotation;                   ///< TCP axes in the link-7 frame
  Vec3 gravity{0.0, 0.0, -9.81};        ///< world axes [m/s2]
};

/// Operational-space law (docs/control.md, Law).
struct OscParams {
  Vec6 stiffness = Vec6::Constant(400.0);    ///< K per axis [1/s2]
  Vec6 damping_ratio = Vec6::Constant(1.0);  ///< zeta, D = 2 zeta sqrt(K)
  Vec6 force_damping = Vec6::Zero();         ///< D on force axes [1/s]; 0 is the paper
  double error_clamp_rotation = 0.09;        ///< [rad]
  double move_speed = 0.25;  ///< of the desired position, where a Target's jumps [m/s]
  double turn_speed = 0.8;  ///< of the desired rotation, where a Target's jumps [rad/s]
  double integral_time = 0.1;  ///< of the integral term of pose and hold axes [s]
  double integral_clamp_linear = 0.3;   ///< largest of it, K times an offset [m/s2]
  double integral_clamp_angular = 0.3;  ///< the same of a rotation [rad/s2]
  double error_clamp_position = 0.1;    ///< [m]
  double f_clamp_linear = 30.0;         ///< largest |f*| per linear axis [m/s2]
  double f_clamp_angular = 200.0;       ///< largest |f*| per rotation axis [rad/s2]
  double k_null = 10.0;                 ///< null-space damping k [1/s]
  /// Null-space stiffness towards the configuration where the task began [1/s2].
  double posture_stiffness = 50.0;
  double length_scale = 0.15;        ///< L, scales rotation rows [m/rad]
  double s0 = 0.005;                 ///< eigenvalue fade threshold [1/kg]
  double joint_stiffness = 100.0;    ///< K of joint targets [1/s2]
  double joint_damping_ratio = 1.0;  ///< zeta of joint targets
  bool use_jdot = false;             ///< subtract dJ dq in the task
  bool use_coriolis = false;         ///< add c to u0
};

/// Every limit; each one is enforced and has a flag (docs/control.md).
struct LimitParams {
  Vec7 q_min = Vec7::Constant(kUnset);    ///< lower joint position limits [rad]
  Vec7 q_max = Vec7::Constant(kUnset);    ///< upper joint position limits [rad]
  Vec7 dq_max = Vec7::Constant(kUnset);   ///< joint speed limits [rad/s]
  Vec7 tau_max = Vec7::Constant(kUnset);  ///< motor torques, gravity included [Nm]
  Vec7 ddq_max =
      Vec7::Constant(kUnset);  ///< A, what the motors can always give [rad/s2]
  /// Speed limit that falls towards a position limit, sqrt(o^2 + 2 D d) - o at the
  /// distance d, with D = taper_brake [rad/s2], o = taper_offset [rad/s]; infinity:
  /// none.
  Vec7 taper_brake = Vec7::Constant(kInfinite);
  Vec7 taper_offset = Vec7::Zero();
  /// Most that the commanded torque changes [Nm/s], and what of that is left for each
  /// joint's acceleration [rad/s3]: the limits brake in time for it.
  Vec7 dtau_max = Vec7::Constant(kInfinite);
  Vec7 jerk_max = Vec7::Constant(kInfinite);
  double eta = 0.6;                     ///< share of A planned for braking
  double kappa = 5.0;                   ///< bound interval over the period
  double delta_q = 0.002;               ///< joint position margin [rad]
  double delta_v = 0.01;                ///< speed margin, as a share
  bool walls = true;                    ///< Cartesian limits on the TCP, all of them
  Vec3 x_min = Vec3::Constant(kUnset);  ///< lower TCP walls, world [m]
  Vec3 x_max = Vec3::Constant(kUnset);  ///< upper TCP walls, world [m]
  Vec3 dx_max = Vec3::Constant(0.5);    ///< TCP speed per axis [m/s]
  /// TCP speed per axis below a Target's near plane [m/s]: of force, pose and hold
  /// axes, with walls on. Free axes and joint targets do not know it.
  double near_speed = 0.5;
  /// Largest f* there against the plane's normal, `f_tare` not counted [m/s2]: times
  /// the effective mass the force of standing on something. With walls on.
  double near_press = 1000.0;
  Vec3 ddx_max = Vec3::Constant(5.0);  ///< TCP acceleration per axis [m/s2]
  double eta_wall = 0.5;               ///< share of ddx_max planned for braking
  double delta_x = 0.005;              ///< wall margin [m]
  double jerk_wall = kInfinite;        ///< what `dtau_max` leaves the TCP [m/s3]
  double s0_wall = 1e-3;               ///< eigenvalue fade threshold of SCS [1/kg]
  double rho = 1e6;                    ///< weight of the wall slack in the QP
  double estimate_rate = 60.0;         ///< of the disturbance estimate [1/s], 0 is off
  /// Limiters brake against what the estimate says, and do no more; without, a contact
  /// is a feedback (docs/control.md, Passive limits). Off only to show that.
  bool passive = true;
  double brake_rate = 60.0;  ///< of that braking [1/s]
  double authority = 4.0;    ///< most braking beyond a limit, over ddq_max
  /// Ends a motion that no Target explains (last_line.hpp).
  bool last_line = true;
  Vec7 damping = Vec7::Zero();   ///< D_hat in the prediction [Nms/rad]
  Vec7 armature = Vec7::Zero();  ///< rotor inertia in the prediction [kg m2]
  bool mid_interval = true;      ///< evaluate the model at q + v dt / 2
  bool exact_sjs = false;        ///< paper scheme: continue SJS to the QP's answer
  Scheme scheme = Scheme::kQp;
  BoundsKind bounds = BoundsKind::kViability;
};

/// One command, held until the next one: of the task, or of the joints.
struct Target {
  /// Acceleration [m/s2, rad/s2], world axes: what force axes do, and what pose and
  /// hold axes do beside their impedance law.
  Vec6 f_star = Vec6::Zero();
  Vec3 position_d = Vec3::Zero();        ///< pose axes: desired TCP position [m]
  Vec4 quat_wxyz_d{1.0, 0.0, 0.0, 0.0};  ///< pose axes: desired TCP rotation, unit
  /// Feed-forward, world axes [m/s, rad/s] and [m/s2, rad/s2]: how the desired pose
  /// moves on while the Target is held, for `kPathTime` from its making; then that pose
  /// stands still. On force axes what damping pulls towards, such as a surface that
  /// moves: the tool may be faster by it than `near_speed`, by up to 0.1 m/s; and a
  /// further f*. Hold and free axes have none.
  Vec6 velocity_d = Vec6::Zero();
  Vec6 acceleration_d = Vec6::Zero();
  double age = 0.0;  ///< time since it was made [s]: whoever holds it counts
  /// Where contact is near: at TCP positions p with n . p < d `near_speed` and
  /// `near_press` hold (which say for what). Unit normal n, then d [m], world axes;
  /// d = -infinity: nowhere.
  Vec4 near_plane{0.0, 0.0, 0.0, -std::numeric_limits<double>::infinity()};
  /// How much of `f_star` holds the tool's weight, see envs/tare.py.
  Vec6 f_tare = Vec6::Zero();
  /// Force axes X Y Z (bits 0 to 2) on which nothing is asked: held where they are.
  std::uint8_t stay = 0;
  bool joint_mode = false;  ///< go to q_d; the task axes are not used
  Vec7 q_d = Vec7::Zero();  ///< desired configuration [rad]
};

struct StepResult {
  Vec7 tau;  ///< overlay torque, gravity excluded [Nm]
  Vec7 a;    ///< commanded joint acceleration [rad/s2]
  Vec7 a0;   ///< acceleration that the task asked for [rad/s2]
  Flags flags;
};

}  // namespace dovetail
