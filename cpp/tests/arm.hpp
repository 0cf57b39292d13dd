/// The arm of the tests: LBR iiwa 14 (Drake's inertia set) with a tool of
/// 1.3 kg.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <random>

#include "dovetail/controller.hpp"

namespace dovetail::testing {

constexpr double kDegree = 0.017453292519943295;  // [rad]

inline ChainParams iiwa14_with_tool() {
  ChainParams chain;
  const Mat3 straight = Mat3::Identity();
  Mat3 up, down;
  up << -1, 0, 0, 0, 0, 1, 0, 1, 0;
  down << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  chain.origin_rotation = {straight, up, up, down, up, down, up};
  chain.origin_position = {Vec3(0, 0, 0.1575), Vec3(0, 0, 0.2025), Vec3(0, 0.2045, 0),
                           Vec3(0, 0, 0.2155), Vec3(0, 0.1845, 0), Vec3(0, 0, 0.2155),
                           Vec3(0, 0.081, 0)};
  chain.mass = {5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2};
  chain.com = {Vec3(0, -0.03, 0.12),  Vec3(0.0003, 0.059, 0.042), Vec3(0, 0.03, 0.13),
               Vec3(0, 0.067, 0.034), Vec3(1e-4, 0.021, 0.076),   Vec3(0, 6e-4, 4e-4),
               Vec3(0, 0, 0.02)};
  const std::array<Vec3, 7> moments = {
      Vec3(0.033, 0.0333, 0.0123), Vec3(0.0305, 0.011, 0.0304),
      Vec3(0.025, 0.0238, 0.0076), Vec3(0.017, 0.006, 0.0164),
      Vec3(0.01, 0.0087, 0.00449), Vec3(0.0049, 0.0047, 0.0036),
      Vec3(0.001, 0.001, 0.001)};
  for (int i = 0; i < 7; ++i) chain.inertia[i] = moments[i].asDiagonal();

  // the gripper joins link 7: parallel axes along z
  const double gripper = 1.3;
  const double gripper_z = 0.125;
  const double total = chain.mass[6] + gripper;
  const double z = (chain.mass[6] * 0.02 + gripper * gripper_z) / total;
  const double spread = chain.mass[6] * gripper * std::pow(gripper_z - 0.02, 2) / total;
  chain.inertia[6].diagonal() += Vec3(0.004 + spread, 0.004 + spread, 0.001);
  chain.mass[6] = total;
  chain.com[6] = Vec3(0, 0, z);
  chain.tool_position = Vec3(0, 0, 0.225);
  chain.tool_rotation = Mat3::Identity();
  return chain;
}

/// docs/control.md, Discrete time and margins: 1 ms and 5 ms, exact model.
inline LimitParams limits_for(double period) {
  LimitParams limits;
  limits.q_max << 170, 120, 170, 120, 170, 120, 175;
  limits.q_max *= kDegree;
  limits.q_min = -limits.q_max;
  limits.dq_max << 85, 85, 100, 75, 130, 135, 135;
  limits.dq_max *= kDegree;
  limits.tau_max << 320, 320, 176, 176, 110, 40, 40;
  limits.ddq_max << 15, 15, 15, 15, 20, 20, 20;
  const bool is_fast = period < 0.003;
  limits.kappa = is_fast ? 5.0 : 2.0;
  limits.delta_q = is_fast ? 0.002 : 0.005;
  limits.delta_v = is_fast ? 0.01 : 0.05;
  limits.x_min = Vec3(0.40, -0.20, 0.02);
  limits.x_max = Vec3(0.80, 0.20, 0.40);
  return limits;
}

/// The tool points down at about (0.6, 0, 0.2).
inline Vec7 tool_down_posture() {
  Vec7 q;
  q << 0.0, 0.55, 0.0, -1.75, 0.0, 0.8415926535897931, 0.0;
  return q;
}

inline Mat3 about_z(double angle) {
  return Eigen::AngleAxisd(angle, Vec3::UnitZ()).toRotationMatrix();
}

/// A law that answers any rotation error with K times it, in the first cycle.
inline OscParams turns_at_once() {
  OscParams law;
  law.damping_ratio.setZero();
  law.error_clamp_rotation = 4.0;
  law.turn_speed = 1e9;
  law.f_clamp_angular = 1e4;
  return law;
}

inline Vec4 quat_of(const Mat3& R) {
  const Eigen::Quaterniond quat(R);
  return {quat.w(), quat.x(), quat.y(), quat.z()};
}

/// At rest, tool down, and the target that holds the pose that it has.
struct RestingArm {
  ChainParams chain = iiwa14_with_tool();
  Vec7 q = tool_down_posture();
  Vec3 p;
  Vec4 quat;
  Target target;

  RestingArm() {
    Mat3 R;
    Chain(chain).pose(q, p, R);
    quat = quat_of(R);
    target.quat_wxyz_d = quat;
  }
};

template <typename Vector = Vec7>
Vector random_vector(std::mt19937_64& random, double scale) {
  std::uniform_real_distribution<double> uniform(-scale, scale);
  Vector v;
  for (int i = 0; i < v.size(); ++i) v[i] = uniform(random);
  return v;
}

/// Uniform inside the joint limits, `margin` [rad] away from them.
inline Vec7 random_posture(std::mt19937_64& random, const LimitParams& limits,
                           double margin = 0.1) {
  const Vec7 share = 0.5 * (random_vector(random, 1.0) + Vec7::Ones());
  const Vec7 width = limits.q_max - limits.q_min - Vec7::Constant(2.0 * margin);
  return limits.q_min + Vec7::Constant(margin) + share.cwiseProduct(width);
}

constexpr TaskSpec kUsualTask = {AxisMode::kForce, AxisMode::kForce, AxisMode::kForce,
                                 AxisMode::kHold,  AxisMode::kHold,  AxisMode::kPose};

}  // namespace dovetail::testing
