#include "dovetail/osc.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace dovetail {
namespace {

using Eigen::Quaterniond;

constexpr double kLargestPosture = 2.0;  // way back to a posture that is used [rad]
// From half a turn, on either side of it: the way that was begun is gone on with [rad].
constexpr double kNearHalfTurn = 0.5;
constexpr TaskSpec kNoFreeAxis{AxisMode::kForce, AxisMode::kForce, AxisMode::kForce,
                               AxisMode::kForce, AxisMode::kForce, AxisMode::kForce};

/// delta = swing * twist, the twist about world z, the swing's axis level.
struct SwingTwist {
  Quaterniond twist = Quaterniond::Identity();
  Vec3 swing = Vec3::Zero();  // rotation vector [rad], z component zero
};

Quaterniond quaternion(const Vec4& wxyz) noexcept {
  return Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
}

Vec3 rotation_vector(Quaterniond quat) noexcept {
  if (quat.w() < 0.0) quat.coeffs() = -quat.coeffs();
  const double length = quat.vec().norm();
  if (length < 1e-12) return 2.0 * quat.vec();
  return (2.0 * std::atan2(length, quat.w()) / length) * quat.vec();
}

Quaterniond rotation_from_vector(const Vec3& v) noexcept {
  const double angle = v.norm();
  if (angle < 1e-12) return Quaterniond(1.0, 0.5 * v.x(), 0.5 * v.y(), 0.5 * v.z());
  const Vec3 axis = v * (std::sin(0.5 * angle) / angle);
  return Quaterniond(std::cos(0.5 * angle), axis.x(), axis.y(), axis.z());
}

SwingTwist split_about_z(const Quaterniond& delta) noexcept {
  SwingTwist parts;
  const double length = std::hypot(delta.w(), delta.z());
  if (length > 1e-9) {  // below: upside down, the twist is undefined, identity taken
    parts.twist = Quaterniond(delta.w() / length, 0.0, 0.0, delta.z() / length);
  }
  parts.swing = rotation_vector(delta * parts.twist.conjugate());
  parts.swing.z() = 0.0;
  return parts;
}

bool is_impedance(AxisMode mode) noexcept {
  return mode == AxisMode::kPose || mode == AxisMode::kHold;
}

/// Shortens v to at most `limit`, direction kept.
template <typename Vector>
void clamp_norm(Vector&& v, double limit) noexcept {
  const double length = v.norm();
  if (length > limit) v *= limit / length;
}

/// Near half a turn both ways are about as long, and noise would turn one round: the
/// way that was begun is gone on with, until the other one is clearly shorter (Mayhew
/// et al. 2011). Both are rotation vectors [rad].
Vec3 gone_on_with(const Vec3& way, const Vec3& begun) noexcept {
  const double angle = way.norm();
  const double near = M_PI - kNearHalfTurn;
  const bool is_other = angle > near && begun.norm() > near && way.dot(begun) < 0.0;
  return is_other ? Vec3(way * (1.0 - 2.0 * M_PI / angle)) : way;
}

/// U diag(w(s)/s) U^T of A, w fading from 1 to 0 below s0.
Mat6 faded_inverse(const Mat6& A, double s0) noexcept {
  const Eigen::SelfAdjointEigenSolver<Mat6> eigen(A);
  Vec6 weight;
  for (int i = 0; i < 6; ++i) {
    const double s = eigen.eigenvalues()[i];
    const double t = std::clamp(s / s0, 0.0, 1.0);
    // (3 t^2 - 2 t^3) / s, written so that it is finite at s = 0
    weight[i] = s >= s0 ? 1.0 / s : t * (3.0 - 2.0 * t) / s0;
  }
  return eigen.eigenvectors() * weight.asDiagonal() * eigen.eigenvectors().transpose();
}

}  // namespace

Vec3 rotation_vector(const Mat3& R) noexcept { return rotation_vector(Quaterniond(R)); }

double twist_about_z(const Mat3& R) noexcept {
  const Quaterniond quat(R);
  return std::remainder(2.0 * std::atan2(quat.z(), quat.w()), 2.0 * M_PI);
}

Vec6 desired_velocity(const Target& target) noexcept {
  if (target.age >= kPathTime) return Vec6::Zero();
  return target.velocity_d + target.age * target.acceleration_d;
}

DesiredMotion desired_motion(const Target& target) noexcept {
  const double t = std::min(target.age, kPathTime);
  const Vec6 way = t * target.velocity_d + (0.5 * t * t) * target.acceleration_d;
  const Quaterniond quat =
      rotation_from_vector(way.tail<3>()) * quaternion(target.quat_wxyz_d);
  DesiredMotion motion{target.position_d + way.head<3>(),
                       Vec4(quat.w(), quat.x(), quat.y(), quat.z()),
                       desired_velocity(target), Vec6::Zero()};
  if (target.age < kPathTime) motion.acceleration = target.acceleration_d;
  return motion;
}

OperationalSpace::OperationalSpace(const OscParams& params, const TaskSpec& task,
                                   double period) noexcept
    : params_(params),
      task_(task),
      period_(period),
      integral_share_(1.0 - std::exp(-period / params.integral_time)) {
  for (int i = 0; i < 6; ++i) {
    const bool is_linear = i < 3;
    scale_[i] =
        task[i] == AxisMode::kFree ? 0.0 : (is_linear ? 1.0 : params.length_scale);
    damping_[i] = is_impedance(task[i])
                      ? 2.0 * params.damping_ratio[i] * std::sqrt(params.stiffness[i])
                      : params.force_damping[i];
    has_free_ = has_free_ || task[i] == AxisMode::kFree;
    follows_measured_ = follows_measured_ || !(is_linear || is_impedance(task[i]));
  }
}

void OperationalSpace::reset(const Vec3& p_hold, const Vec4& quat_hold) noexcept {
  p_hold_ = p_hold;
  error_.setZero();
  forget_way();
  const Quaterniond hold(quaternion(quat_hold).normalized().toRotationMatrix());
  quat_hold_ = Vec4(hold.w(), hold.x(), hold.y(), hold.z());
}

Mat3 OperationalSpace::desired_rotation(const Mat3& R,
                                        const Vec4& quat_wxyz) const noexcept {
  const Quaterniond quat_d = quaternion(quat_wxyz).normalized();
  const Quaterniond quat_hold = quaternion(quat_hold_);
  const SwingTwist wanted = split_about_z(quat_d * quat_hold.conjugate());
  SwingTwist measured;  // what no axis follows need not be known
  if (follows_measured_) {
    measured = split_about_z(Quaterniond(R) * quat_hold.conjugate());
  }
  Vec3 swing = Vec3::Zero();
  for (int i = 0; i < 2; ++i) {
    const AxisMode mode = task_[3 + i];
    if (mode == AxisMode::kPose) swing[i] = wanted.swing[i];
    if (!is_impedance(mode)) swing[i] = measured.swing[i];
  }
  Quaterniond twist = Quaterniond::Identity();
  if (task_[5] == AxisMode::kPose) twist = wanted.twist;
  if (!is_impedance(task_[5])) twist = measured.twist;
  return (rotation_from_vector(swing) * twist * quat_hold).toRotationMatrix();
}

/// Where the desired position is on its way to the Target's. A pose that jumped would
/// ask for more than the joints can give, and what they lack is missed elsewhere.
Vec3 OperationalSpace::moved_to(const DesiredMotion& wanted) noexcept {
  Vec3 way = wanted.position - p_way_;
  for (int i = 0; i < 3; ++i) {
    if (task_[i] != AxisMode::kPose) way[i] = 0.0;
  }
  const double own = wanted.velocity.head<3>().norm();
  const double speed = params_.move_speed + own;
  const double most = std::max(pace_ * speed, own) * period_;
  const double length = way.norm();
  p_way_ = length > most ? Vec3(p_way_ + way * (most / length)) : wanted.position;
  v_way_.head<3>() = way * (speed / std::max(length, speed * period_));
  way_.head<3>() = way;
  return p_way_;
}

/// As moved_to, the desired rotation.
Vec4 OperationalSpace::turned_to(const DesiredMotion& wanted) noexcept {
  const Quaterniond to = quaternion(wanted.quat_wxyz).normalized();
  Quaterniond turn = quaternion(quat_way_);
  const Vec3 way = gone_on_with(rotation_vector(to * turn.conjugate()), way_.tail<3>());
  const double own = wanted.velocity.tail<3>().norm();
  const double speed = params_.turn_speed + own;
  const double most = std::max(pace_ * speed, own) * period_;
  const double angle = way.norm();
  v_way_.tail<3>() = way * (speed / std::max(angle, speed * period_));
  turn = angle > most ? rotation_from_vector(way * (most / angle)) * turn : to;
  turn.normalize();
  way_.tail<3>() = way;
  return quat_way_ = Vec4(turn.w(), turn.x(), turn.y(), turn.z());
}

void OperationalSpace::integrate(const Vec6& pull) noexcept {
  for (int i = 0; i < 6; ++i) {
    const double most =
        i < 3 ? params_.integral_clamp_linear : params_.integral_clamp_angular;
    integral_[i] += integral_share_ * (pull[i] - integral_[i]);
    integral_[i] = std::clamp(integral_[i], -most, most);
    if (!is_impedance(task_[i])) integral_[i] = 0.0;
  }
}

Vec6 OperationalSpace::desired_acceleration(const Vec3& p, const Mat3& R,
                                            const Vec6& twist,
                                            const Target& target) noexcept {
  const DesiredMotion wanted = desired_motion(target);
  if (!has_way_) {
    const Quaterniond now(R);
    p_way_ = p;
    quat_way_ = Vec4(now.w(), now.x(), now.y(), now.z());
    way_.setZero();
    has_way_ = true;
  }
  const Vec3 p_d = moved_to(wanted);
  Vec6 error = Vec6::Zero();
  for (int i = 0; i < 3; ++i) {
    if (task_[i] == AxisMode::kPose) error[i] = p_d[i] - p[i];
    if (task_[i] == AxisMode::kHold) error[i] = p_hold_[i] - p[i];
  }
  if (is_impedance(task_[3]) || is_impedance(task_[4]) || is_impedance(task_[5])) {
    const Mat3 R_d = desired_rotation(R, turned_to(wanted));
    error_ = gone_on_with(rotation_vector(R_d * R.transpose()), error_);
    for (int i = 0; i < 3; ++i) {
      if (is_impedance(task_[3 + i])) error[3 + i] = error_[i];
    }
  }
  clamp_norm(error.head<3>(), params_.error_clamp_position);
  clamp_norm(error.tail<3>(), params_.error_clamp_rotation);

  Vec6 f = Vec6::Zero();
  for (int i = 0; i < 6; ++i) {
    if (task_[i] == AxisMode::kFree) continue;
    const double limit = i < 3 ? params_.f_clamp_linear : params_.f_clamp_angular;
    const bool is_path = task_[i] != AxisMode::kHold;  // what is held stands still
    const double velocity = is_path ? wanted.velocity[i] : 0.0;
    const double acceleration = is_path ? wanted.acceleration[i] : 0.0;
    const double drive = params_.stiffness[i] * error[i] +  // error 0 on force axes
                         std::clamp(target.f_star[i], -limit, limit) + acceleration -
                         integral_[i];
    f[i] = std::clamp(drive - damping_[i] * (twist[i] - velocity), -limit, limit);
  }
  return f;
}

Vec6 OperationalSpace::way_to_come() const noexcept {
  Vec6 way = way_;
  clamp_norm(way.head<3>(), params_.error_clamp_position);
  clamp_norm(way.tail<3>(), params_.error_clamp_rotation);
  Vec6 f = Vec6::Zero();
  for (int i = 0; i < 6; ++i) {
    if (task_[i] == AxisMode::kPose) f[i] = scale_[i] * params_.stiffness[i] * way[i];
  }
  return f;
}

Vec6 OperationalSpace::way_speed() const noexcept {
  Vec6 speed = Vec6::Zero();
  for (int i = 0; i < 6; ++i) {
    if (task_[i] == AxisMode::kPose) speed[i] = scale_[i] * v_way_[i];
  }
  return speed;
}

Vec7 OperationalSpace::joint_acceleration(const Vec7& q, const Vec7& dq,
                                          const Vec7& q_d) const noexcept {
  const double K = params_.joint_stiffness;
  const double D = 2.0 * params_.joint_damping_ratio * std::sqrt(K);
  return K * (q_d - q) - D * dq;
}

Vec7 OperationalSpace::posture_acceleration(const Vec7& q,
                                            const Vec7& q_d) const noexcept {
  Vec7 error = q_d - q;
  clamp_norm(error, kLargestPosture);
  return params_.posture_stiffness * error;
}

/// Lambda of J with zero rows for free axes; true where no eigenvalue was faded.
bool OperationalSpace::task_inertia(const Mat67& J, const Cholesky<7>& M_factor,
                                    const TaskSpec& task, Mat6& Lambda) const noexcept {
  // A = Y^T Y with Y = L^-1 J^T. Free rows are zero: a one on the diagonal keeps A
  // regular and decouples them.
  Eigen::Matrix<double, 7, 6> Y = J.transpose();
  M_factor.solve_lower(Y);
  Mat6 A;
  A.noalias() = Y.transpose() * Y;
  double free_rows = 0.0;
  for (int i = 0; i < 6; ++i) {
    if (task[i] != AxisMode::kFree) continue;
    A(i, i) = 1.0;
    free_rows += 1.0;
  }
  Cholesky<6> A_factor;
  bool exact = A_factor.factor(A);
  if (exact) {
    Lambda = A_factor.inverse();
    // |A^-1|_F <= 1/s0: every eigenvalue is at least s0
    exact = (Lambda.squaredNorm() - free_rows) * params_.s0 * params_.s0 <= 1.0;
  }
  if (!exact) Lambda = faded_inverse(A, params_.s0);
  for (int i = 0; i < 6; ++i) {
    if (task[i] == AxisMode::kFree) Lambda(i, i) = 0.0;
  }
  return exact;
}

Vec6 OperationalSpace::wrench(const Mat67& J, const Cholesky<7>& M_factor,
                              const Vec7& tau) const noexcept {
  Mat67 scaled = J;
  scaled.bottomRows<3>() *= params_.length_scale;
  Mat6 Lambda;
  task_inertia(scaled, M_factor, kNoFreeAxis, Lambda);
  Vec7 ddq = tau;
  M_factor.solve(ddq);
  Vec6 wrench = Lambda * (scaled * ddq);
  wrench.tail<3>() *= params_.length_scale;
  return wrench.allFinite() ? wrench : Vec6(Vec6::Constant(kUnset));
}

void OperationalSpace::evaluate(const ChainTerms& terms, const Mat7& M,
                                const Cholesky<7>& M_factor, const Vec7& dq,
                                const Vec6& f_star, const Vec7& posture,
                                OscTerms& out) const noexcept {
  out.J.noalias() = scale_.asDiagonal() * terms.J;
  out.f = scale_.cwiseProduct(f_star);
  if (params_.use_jdot) out.f -= scale_.cwiseProduct(terms.dJdq);
  out.exact = task_inertia(out.J, M_factor, task_, out.Lambda);

  Vec7 null = -params_.k_null * dq;
  if (!has_free_) null += posture;
  const Vec6 task_force = out.Lambda * (out.f - out.J * null);
  out.u0.noalias() = out.J.transpose() * task_force + M * null;
  if (has_free_ && params_.posture_stiffness > 0.0) {
    Mat67 J = terms.J;
    J.bottomRows<3>() *= params_.length_scale;
    Mat6 Lambda;
    task_inertia(J, M_factor, kNoFreeAxis, Lambda);
    out.u0 += M * posture - J.transpose() * (Lambda * (J * posture)).eval();
  }
  if (params_.use_coriolis) out.u0 += terms.c;
}

}  // namespace dovetail
