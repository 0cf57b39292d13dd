#include "dovetail/parameters.hpp"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "dovetail/input.hpp"

namespace dovetail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Allowed values, with the words that the message uses for them.
struct Range {
  double low;
  double high;
  bool low_open;  // the low end itself is not allowed
  std::string_view words;
};

constexpr Range kAnyFinite{-kInfinity, kInfinity, true, "a finite number"};
constexpr Range kPositive{0.0, kInfinity, true, "a finite number above 0"};
constexpr Range kNotNegative{0.0, kInfinity, false, "a finite number, 0 or above"};
constexpr Range kShare{0.0, 1.0, true, "above 0 and at most 1"};
constexpr Range kRate{0.0, 1e3, false, "0 to 1000"};
constexpr Range kAngle{-kLargestAngle, kLargestAngle, false, "-1000 to 1000 rad"};
constexpr Range kSpeed{-kLargestSpeed, kLargestSpeed, false, "-1000 to 1000 rad/s"};
constexpr Range kTarget{-kLargestTarget, kLargestTarget, false, "-1e9 to 1e9"};

[[noreturn]] void refuse(const std::string& element, double value,
                         std::string_view unit, std::string_view allowed) {
  std::ostringstream message;
  message << element << " is " << value;
  if (!unit.empty()) message << ' ' << unit;
  message << "; allowed: " << allowed;
  throw std::invalid_argument(message.str());
}

void require(const std::string& element, double value, std::string_view unit,
             const Range& range) {
  const bool is_inside = std::isfinite(value) && value <= range.high &&
                         (range.low_open ? value > range.low : value >= range.low);
  if (!is_inside) refuse(element, value, unit, range.words);
}

std::string indexed(std::string_view name, int i) {
  return std::string(name) + "[" + std::to_string(i) + "]";
}

template <typename Vector>
void require_each(std::string_view name, const Vector& values, std::string_view unit,
                  const Range& range) {
  for (int i = 0; i < values.size(); ++i) {
    require(indexed(name, i), values[i], unit, range);
  }
}

/// A limit that may be infinite, which is none.
void require_above(const std::string& name, double value, std::string_view unit) {
  if (value > 0.0) return;
  refuse(name, value, unit, "above 0; infinity for no such limit");
}

void require_each_above(std::string_view name, const Vec7& values,
                        std::string_view unit) {
  for (int i = 0; i < kNumJoints; ++i) require_above(indexed(name, i), values[i], unit);
}

void require_each(const std::string& name, const Mat3& values, std::string_view unit) {
  for (int i = 0; i < 3; ++i) {
    require_each(indexed(name, i), Vec3(values.row(i)), unit, kAnyFinite);
  }
}

void require_rotation(const std::string& name, const Mat3& R) {
  require_each(name, R, "");
  const double skew = (R.transpose() * R - Mat3::Identity()).norm();
  if (!(skew < 1e-6) || R.determinant() < 0.0) {
    refuse(name + " (|R^T R - I|)", skew, "", "a right-handed rotation matrix");
  }
}

template <typename Vector>
void require_unit(const std::string& name, const Vector& v) {
  require_each(name, v, "", kAnyFinite);
  if (!is_unit(v)) refuse(name + " (length)", v.norm(), "", "1, to within 0.001");
}

template <typename Vector>
void require_order(std::string_view low_name, const Vector& low,
                   std::string_view high_name, const Vector& high, double margin,
                   std::string_view unit) {
  for (int i = 0; i < low.size(); ++i) {
    if (low[i] + 2.0 * margin < high[i]) continue;
    std::ostringstream allowed;
    allowed << "below " << indexed(high_name, i) << " = " << high[i]
            << " by more than twice the margin " << margin;
    refuse(indexed(low_name, i), low[i], unit, allowed.str());
  }
}

}  // namespace

void check_chain(const ChainParams& chain) {
  for (int i = 0; i < kNumJoints; ++i) {
    require_each(indexed("origin_position", i), chain.origin_position[i], "m",
                 kAnyFinite);
    require_each(indexed("com", i), chain.com[i], "m", kAnyFinite);
    require(indexed("mass", i), chain.mass[i], "kg", kNotNegative);
    require_rotation(indexed("origin_rotation", i), chain.origin_rotation[i]);
    const Mat3& I = chain.inertia[i];
    require_each(indexed("inertia", i), I, "kg m2");
    for (int k = 0; k < 3; ++k) {
      require(indexed(indexed("inertia", i), k) + " (diagonal)", I(k, k), "kg m2",
              kNotNegative);
    }
    if (!((I - I.transpose()).norm() <= 1e-9 + 1e-6 * I.norm())) {
      refuse(indexed("inertia", i) + " (|I - I^T|)", (I - I.transpose()).norm(),
             "kg m2", "a symmetric matrix");
    }
  }
  require_each("tool_position", chain.tool_position, "m", kAnyFinite);
  require_rotation("tool_rotation", chain.tool_rotation);
  require_each("gravity", chain.gravity, "m/s2", kAnyFinite);
}

void check_osc(const OscParams& osc) {
  require_each("stiffness", osc.stiffness, "1/s2", kNotNegative);
  require_each("damping_ratio", osc.damping_ratio, "", kNotNegative);
  require_each("force_damping", osc.force_damping, "1/s", kNotNegative);
  require("error_clamp_rotation", osc.error_clamp_rotation, "rad", kPositive);
  require("move_speed", osc.move_speed, "m/s", kPositive);
  require("turn_speed", osc.turn_speed, "rad/s", kPositive);
  require("integral_time", osc.integral_time, "s", kPositive);
  require("integral_clamp_linear", osc.integral_clamp_linear, "m/s2", kNotNegative);
  require("integral_clamp_angular", osc.integral_clamp_angular, "rad/s2", kNotNegative);
  require("error_clamp_position", osc.error_clamp_position, "m", kPositive);
  require("f_clamp_linear", osc.f_clamp_linear, "m/s2", kPositive);
  require("f_clamp_angular", osc.f_clamp_angular, "rad/s2", kPositive);
  require("k_null", osc.k_null, "1/s", kNotNegative);
  require("posture_stiffness", osc.posture_stiffness, "1/s2", kNotNegative);
  require("length_scale", osc.length_scale, "m/rad", kPositive);
  require("s0", osc.s0, "1/kg", kPositive);
  require("joint_stiffness", osc.joint_stiffness, "1/s2", kNotNegative);
  require("joint_damping_ratio", osc.joint_damping_ratio, "", kNotNegative);
}

void check_limits(const LimitParams& limits) {
  require_each("q_min", limits.q_min, "rad", kAnyFinite);
  require_each("q_max", limits.q_max, "rad", kAnyFinite);
  require_each("dq_max", limits.dq_max, "rad/s", kPositive);
  require_each("tau_max", limits.tau_max, "Nm", kPositive);
  require_each("ddq_max", limits.ddq_max, "rad/s2", kPositive);
  require_each_above("taper_brake", limits.taper_brake, "rad/s2");
  require_each("taper_offset", limits.taper_offset, "rad/s", kNotNegative);
  require_each_above("dtau_max", limits.dtau_max, "Nm/s");
  require_each_above("jerk_max", limits.jerk_max, "rad/s3");
  require("eta", limits.eta, "", kShare);
  require("kappa", limits.kappa, "", {1.0, 1e3, false, "1 to 1000"});
  require("delta_q", limits.delta_q, "rad", kNotNegative);
  require("delta_v", limits.delta_v, "", {0.0, 0.99, false, "0 to 0.99"});
  require_order("q_min", limits.q_min, "q_max", limits.q_max, limits.delta_q, "rad");
  require("estimate_rate", limits.estimate_rate, "1/s", kRate);
  require("brake_rate", limits.brake_rate, "1/s", kRate);
  require("authority", limits.authority, "", {1.0, 100.0, false, "1 to 100"});
  require_each("damping", limits.damping, "Nms/rad", kNotNegative);
  require_each("armature", limits.armature, "kg m2", kNotNegative);
  require("s0_wall", limits.s0_wall, "1/kg", kPositive);
  require("rho", limits.rho, "", kPositive);
  if (!limits.walls) return;
  require_each("x_min", limits.x_min, "m", kAnyFinite);
  require_each("x_max", limits.x_max, "m", kAnyFinite);
  require_each("dx_max", limits.dx_max, "m/s", kPositive);
  require("near_speed", limits.near_speed, "m/s", kPositive);
  require("near_press", limits.near_press, "m/s2", kPositive);
  require_each("ddx_max", limits.ddx_max, "m/s2", kPositive);
  require("eta_wall", limits.eta_wall, "", kShare);
  require("delta_x", limits.delta_x, "m", kNotNegative);
  require_above("jerk_wall", limits.jerk_wall, "m/s3");
  require_order("x_min", limits.x_min, "x_max", limits.x_max, limits.delta_x, "m");
}

void check_task(const TaskSpec& task) {
  for (int i = 0; i < 6; ++i) {
    const int mode = static_cast<int>(task[i]);
    if (mode > static_cast<int>(AxisMode::kHold)) {
      refuse(indexed("task", i), mode, "", "0 free, 1 force, 2 pose, 3 hold");
    }
  }
}

void check_period(double period) {
  require("period", period, "s", {0.0, 0.1, true, "above 0 and at most 0.1 s"});
}

void check_configuration(const Vec7& q) { require_each("q", q, "rad", kAngle); }

void check_state(const Vec7& q, const Vec7& dq) {
  check_configuration(q);
  require_each("dq", dq, "rad/s", kSpeed);
}

void check_hold(const Vec3& p_hold, const Vec4& quat_hold) {
  require_each("position_hold", p_hold, "m", kTarget);
  require_unit("quat_hold", quat_hold);
}

void check_target(const Target& target) {
  require_each("f_star", target.f_star, "m/s2 or rad/s2", kTarget);
  require_each("f_tare", target.f_tare, "m/s2 or rad/s2", kTarget);
  require_each("position_d", target.position_d, "m", kTarget);
  require_unit("quat_wxyz_d", target.quat_wxyz_d);
  require_each("velocity_d", target.velocity_d, "m/s or rad/s", kTarget);
  require_each("acceleration_d", target.acceleration_d, "m/s2 or rad/s2", kTarget);
  require("age", target.age, "s", {0.0, kLargestTarget, false, "0 to 1e9 s"});
  require_each("q_d", target.q_d, "rad", kAngle);
  require_each("near_plane", Vec3(target.near_plane.head<3>()), "", kTarget);
  if (is_plane(target.near_plane)) return;
  require("near_plane[3]", target.near_plane[3], "m", kTarget);
  require_unit("near_plane normal", Vec3(target.near_plane.head<3>()));
}

}  // namespace dovetail
