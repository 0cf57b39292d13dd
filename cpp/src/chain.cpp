#include "dovetail/chain.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace dovetail {

/// Joint frames and the tool frame in world axes.
struct Chain::Frames {
  std::array<Mat3, 7> R;
  std::array<Vec3, 7> p;
  std::array<Vec3, 7> z;
  Mat3 R_tool;
  Vec3 p_tool;
};

namespace {

/// Velocity and bias acceleration (at ddq = 0) of one body-fixed frame.
struct BodyMotion {
  Vec3 w = Vec3::Zero();      // angular velocity
  Vec3 alpha = Vec3::Zero();  // angular acceleration
  Vec3 a = Vec3::Zero();      // acceleration of the frame's origin

  Vec3 acceleration_at(const Vec3& r) const noexcept {
    return a + alpha.cross(r) + w.cross(w.cross(r));
  }
};

/// Mass, first moment and inertia of everything beyond a joint, about world's origin.
struct CompositeBody {
  double mass = 0.0;
  Vec3 moment = Vec3::Zero();
  Mat3 inertia = Mat3::Zero();

  void add(double m, const Vec3& c, const Mat3& I_com) noexcept {
    mass += m;
    moment += m * c;
    inertia += I_com;
    inertia.diagonal().array() += m * c.squaredNorm();
    inertia -= m * c * c.transpose();
  }
};

}  // namespace

Chain::Chain(const ChainParams& params) noexcept : params_(params) {}

void Chain::place(const Vec7& q, Frames& frames) const noexcept {
  Mat3 R = Mat3::Identity();
  Vec3 p = Vec3::Zero();
  for (int i = 0; i < kNumJoints; ++i) {
    p += R * params_.origin_position[i];
    const Mat3 R_origin = R * params_.origin_rotation[i];
    const double s = std::sin(q[i]);
    const double c = std::cos(q[i]);
    R.col(0) = c * R_origin.col(0) + s * R_origin.col(1);
    R.col(1) = c * R_origin.col(1) - s * R_origin.col(0);
    R.col(2) = R_origin.col(2);
    frames.R[i] = R;
    frames.p[i] = p;
    frames.z[i] = R.col(2);
  }
  frames.p_tool = p + R * params_.tool_position;
  frames.R_tool.noalias() = R * params_.tool_rotation;
}

void Chain::evaluate(const Vec7& q, const Vec7& dq, ChainTerms& terms) const noexcept {
  Frames frames;
  place(q, frames);
  terms.p = frames.p_tool;
  terms.R = frames.R_tool;

  std::array<Vec3, 7> com, force, torque;
  std::array<Mat3, 7> inertia;
  BodyMotion body;
  Vec3 p_previous = Vec3::Zero();
  for (int i = 0; i < kNumJoints; ++i) {
    const Vec3& z = frames.z[i];
    terms.J.col(i).head<3>() = z.cross(terms.p - frames.p[i]);
    terms.J.col(i).tail<3>() = z;
    body.a = body.acceleration_at(frames.p[i] - p_previous);
    body.alpha += body.w.cross(z) * dq[i];
    body.w += z * dq[i];
    p_previous = frames.p[i];

    const Vec3 r = frames.R[i] * params_.com[i];
    com[i] = frames.p[i] + r;
    const Mat3 R_I = frames.R[i] * params_.inertia[i];
    inertia[i].noalias() = R_I * frames.R[i].transpose();
    force[i] = params_.mass[i] * body.acceleration_at(r);
    torque[i] = inertia[i] * body.alpha + body.w.cross(inertia[i] * body.w);
  }
  terms.dJdq.head<3>() = body.acceleration_at(terms.p - p_previous);
  terms.dJdq.tail<3>() = body.alpha;

  CompositeBody beyond;
  Vec3 F = Vec3::Zero();
  Vec3 T = Vec3::Zero();  // about world's origin
  for (int i = kNumJoints - 1; i >= 0; --i) {
    beyond.add(params_.mass[i], com[i], inertia[i]);
    F += force[i];
    T += torque[i] + com[i].cross(force[i]);
    const Vec3& z = frames.z[i];
    const Vec3 lever = frames.p[i].cross(z);  // z . (p x F) = -F . (p x z)
    terms.c[i] = z.dot(T) + lever.dot(F);
    const Vec3 weight = beyond.mass * params_.gravity;
    terms.g[i] = -z.dot(beyond.moment.cross(params_.gravity)) - lever.dot(weight);
    const Vec3 momentum = beyond.mass * lever + z.cross(beyond.moment);
    const Vec3 spin = beyond.inertia * z + beyond.moment.cross(lever);
    for (int j = 0; j <= i; ++j) {
      const double m =
          frames.z[j].dot(spin) + frames.p[j].cross(frames.z[j]).dot(momentum);
      terms.M(i, j) = m;
      terms.M(j, i) = m;
    }
  }
}

void Chain::tool_motion(const Vec7& q, const Vec7& dq,
                        ToolMotion& motion) const noexcept {
  Frames frames;
  place(q, frames);
  motion.p = frames.p_tool;
  motion.R = frames.R_tool;
  motion.twist.setZero();
  double mass = 0.0;
  Vec3 moment = Vec3::Zero();
  for (int i = kNumJoints - 1; i >= 0; --i) {
    const Vec3& z = frames.z[i];
    const Vec3 spin = z * dq[i];
    motion.twist.head<3>() += spin.cross(motion.p - frames.p[i]);
    motion.twist.tail<3>() += spin;
    mass += params_.mass[i];
    moment += params_.mass[i] * (frames.p[i] + frames.R[i] * params_.com[i]);
    motion.g[i] = -z.dot((moment - mass * frames.p[i]).cross(params_.gravity));
  }
}

void Chain::pose(const Vec7& q, Vec3& p, Mat3& R) const noexcept {
  Frames frames;
  place(q, frames);
  p = frames.p_tool;
  R = frames.R_tool;
}

}  // namespace dovetail
