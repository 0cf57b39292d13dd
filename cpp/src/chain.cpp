#include "dovetail/chain.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace dovetail {

/// Axes and origins of the joint frames, tool in the last lane, world axes.
struct Chain::Frames {
  Lanes3 X, Y, Z;
  Lanes3 p;
};

Chain::Chain(const ChainParams& params) noexcept : params_(params) {
  mass_.setZero();
  inertia_ = {mass_, mass_, mass_, mass_, mass_, mass_};
  for (int i = 0; i < kNumJoints; ++i) {
    mass_[i] = params.mass[i];
    com_.set(i, params.com[i]);
    const Mat3& I = params.inertia[i];
    inertia_.xx[i] = I(0, 0);
    inertia_.yy[i] = I(1, 1);
    inertia_.zz[i] = I(2, 2);
    inertia_.xy[i] = I(0, 1);
    inertia_.xz[i] = I(0, 2);
    inertia_.yz[i] = I(1, 2);
  }
  mass_beyond_ = mass_;
  sum_inward(mass_beyond_);
}

void Chain::place(const Vec7& q, Frames& frames) const noexcept {
  Mat3 R = Mat3::Identity();
  Vec3 p = Vec3::Zero();
  for (int i = 0; i < kNumJoints; ++i) {
    p += R * params_.origin_position[i];
    const Mat3& O = params_.origin_rotation[i];
    const double s = std::sin(q[i]);
    const double c = std::cos(q[i]);
    const Vec3 X = R * O.col(0);
    const Vec3 Y = R * O.col(1);
    const Vec3 Z = R * O.col(2);
    R.col(0) = c * X + s * Y;
    R.col(1) = c * Y - s * X;
    R.col(2) = Z;
    frames.X.set(i, R.col(0));
    frames.Y.set(i, R.col(1));
    frames.Z.set(i, Z);
    frames.p.set(i, p);
  }
  const Mat3 R_tool = R * params_.tool_rotation;
  frames.X.set(kTool, R_tool.col(0));
  frames.Y.set(kTool, R_tool.col(1));
  frames.Z.set(kTool, R_tool.col(2));
  frames.p.set(kTool, p + R * params_.tool_position);
}

Vec3 Chain::tool_of(const Frames& frames, Mat3& R) noexcept {
  R.col(0) = frames.X.get(kTool);
  R.col(1) = frames.Y.get(kTool);
  R.col(2) = frames.Z.get(kTool);
  return frames.p.get(kTool);
}

namespace {

/// From the link's axes to world's.
Lanes3 to_world(const Lanes3& X, const Lanes3& Y, const Lanes3& Z,
                const Lanes3& v) noexcept {
  return X * v.x + Y * v.y + Z * v.z;
}

/// R I R^T with R = [X Y Z].
LanesSymmetric to_world(const Lanes3& X, const Lanes3& Y, const Lanes3& Z,
                        const LanesSymmetric& I) noexcept {
  const Lanes3 A = X * I.xx + Y * I.xy + Z * I.xz;
  const Lanes3 B = X * I.xy + Y * I.yy + Z * I.yz;
  const Lanes3 C = X * I.xz + Y * I.yz + Z * I.zz;
  return {A.x * X.x + B.x * Y.x + C.x * Z.x, A.y * X.y + B.y * Y.y + C.y * Z.y,
          A.z * X.z + B.z * Y.z + C.z * Z.z, A.x * X.y + B.x * Y.y + C.x * Z.y,
          A.x * X.z + B.x * Y.z + C.x * Z.z, A.y * X.z + B.y * Y.z + C.y * Z.z};
}

/// Adds the inertia of point masses m at c, about world's origin.
void add_point_mass(LanesSymmetric& I, const Lanes& m, const Lanes3& c) noexcept {
  const Lanes3 mc = c * m;
  I.xx += mc.y * c.y + mc.z * c.z;
  I.yy += mc.x * c.x + mc.z * c.z;
  I.zz += mc.x * c.x + mc.y * c.y;
  I.xy -= mc.x * c.y;
  I.xz -= mc.x * c.z;
  I.yz -= mc.y * c.z;
}

/// Acceleration of a point at r from a frame that turns with w and alpha.
Lanes3 turning(const Lanes3& w, const Lanes3& alpha, const Lanes3& r) noexcept {
  return cross(alpha, r) + cross(w, cross(w, r));
}

/// Velocity and bias acceleration (at ddq = 0) of every frame.
struct Motion {
  Lanes3 w, alpha, a;

  Motion(const Lanes3& Z, const Lanes3& p, const Vec7& dq) noexcept {
    Lanes speed;
    speed << dq, 0.0;  // the tool frame does not turn by itself
    const Lanes3 spin = Z * speed;
    w = spin;
    sum_outward(w);
    const Lanes3 w_before = previous(w);
    alpha = cross(w_before, spin);
    sum_outward(alpha);
    a = turning(w_before, previous(alpha), p - previous(p));
    sum_outward(a);
  }
};

}  // namespace

Vec7 Chain::gravity_of(const Frames& frames) const noexcept {
  const auto& [X, Y, Z, p] = frames;
  Lanes3 moment = (p + to_world(X, Y, Z, com_)) * mass_;
  sum_inward(moment);
  const Lanes g = -dot(Z, cross(moment - p * mass_beyond_, params_.gravity));
  return g.head<7>();
}

void Chain::evaluate(const Vec7& q, const Vec7& dq, ChainTerms& terms) const noexcept {
  Frames frames;
  place(q, frames);
  const auto& [X, Y, Z, p] = frames;
  terms.p = tool_of(frames, terms.R);
  const Motion motion(Z, p, dq);
  terms.dJdq << motion.a.get(kTool), motion.alpha.get(kTool);

  // links: forces that the motion needs, inertia about world's origin
  const Lanes3 r = to_world(X, Y, Z, com_);
  const Lanes3 com = p + r;
  LanesSymmetric I = to_world(X, Y, Z, inertia_);
  Lanes3 F = (motion.a + turning(motion.w, motion.alpha, r)) * mass_;
  Lanes3 T = I * motion.alpha + cross(motion.w, I * motion.w) + cross(com, F);
  Lanes3 moment = com * mass_;
  add_point_mass(I, mass_, com);

  // joints: sums over everything that a joint carries
  sum_inward(F);
  sum_inward(T);
  sum_inward(moment);
  for (Lanes* part : {&I.xx, &I.yy, &I.zz, &I.xy, &I.xz, &I.yz}) sum_inward(*part);
  const Lanes3 lever = cross(p, Z);  // z . (p x F) = -lever . F
  const Lanes3 momentum = lever * mass_beyond_ + cross(Z, moment);
  const Lanes3 spin = I * Z + cross(moment, lever);
  const Lanes3 weight_moment = cross(moment - p * mass_beyond_, params_.gravity);
  const Lanes c = dot(Z, T) + dot(lever, F);
  const Lanes g = -dot(Z, weight_moment);
  terms.c = c.head<7>();
  terms.g = g.head<7>();

  Lanes3 arm;
  arm.x = p.x[kTool] - p.x;
  arm.y = p.y[kTool] - p.y;
  arm.z = p.z[kTool] - p.z;
  const Lanes3 linear = cross(Z, arm);
  for (int i = 0; i < kNumJoints; ++i) {
    terms.J.col(i) << linear.get(i), Z.get(i);
    const Lanes column = Z.x * spin.x[i] + Z.y * spin.y[i] + Z.z * spin.z[i] +
                         lever.x * momentum.x[i] + lever.y * momentum.y[i] +
                         lever.z * momentum.z[i];
    for (int j = 0; j <= i; ++j) {
      terms.M(j, i) = column[j];
      terms.M(i, j) = column[j];
    }
  }
}

void Chain::tool_motion(const Vec7& q, const Vec7& dq,
                        ToolMotion& motion) const noexcept {
  Frames frames;
  place(q, frames);
  motion.p = tool_of(frames, motion.R);
  motion.twist.setZero();
  for (int i = 0; i < kNumJoints; ++i) {
    const Vec3 spin = frames.Z.get(i) * dq[i];
    motion.twist.head<3>() += spin.cross(motion.p - frames.p.get(i));
    motion.twist.tail<3>() += spin;
  }
  motion.g = gravity_of(frames);
}

Vec7 Chain::gravity(const Vec7& q) const noexcept {
  Frames frames;
  place(q, frames);
  return gravity_of(frames);
}

void Chain::pose(const Vec7& q, Vec3& p, Mat3& R) const noexcept {
  Frames frames;
  place(q, frames);
  p = tool_of(frames, R);
}

}  // namespace dovetail
