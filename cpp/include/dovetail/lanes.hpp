/// Eight bodies side by side: lane i holds joint or link A(i+1), lane 7 the tool.
///
/// What is the same for every link is written once and computed for all of them
/// together, one processor register wide where the processor has such registers.
#pragma once

#include <Eigen/Core>

namespace dovetail {

constexpr int kTool = 7;  // the lane of the tool frame

using Lanes = Eigen::Array<double, 8, 1>;

/// A vector in world axes per lane.
struct Lanes3 {
  Lanes x = Lanes::Zero();
  Lanes y = Lanes::Zero();
  Lanes z = Lanes::Zero();

  void set(int lane, const Eigen::Vector3d& v) noexcept {
    x[lane] = v.x();
    y[lane] = v.y();
    z[lane] = v.z();
  }
  Eigen::Vector3d get(int lane) const noexcept { return {x[lane], y[lane], z[lane]}; }
};

inline Lanes3 operator+(const Lanes3& a, const Lanes3& b) noexcept {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Lanes3 operator-(const Lanes3& a, const Lanes3& b) noexcept {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Lanes3 operator*(const Lanes3& a, const Lanes& s) noexcept {
  return {a.x * s, a.y * s, a.z * s};
}
inline Lanes dot(const Lanes3& a, const Lanes3& b) noexcept {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Lanes3 cross(const Lanes3& a, const Lanes3& b) noexcept {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Lanes3 cross(const Lanes3& a, const Eigen::Vector3d& b) noexcept {
  return {a.y * b.z() - a.z * b.y(), a.z * b.x() - a.x * b.z(),
          a.x * b.y() - a.y * b.x()};
}

/// A symmetric matrix in world axes per lane.
struct LanesSymmetric {
  Lanes xx, yy, zz, xy, xz, yz;
};

inline Lanes3 operator*(const LanesSymmetric& I, const Lanes3& v) noexcept {
  return {I.xx * v.x + I.xy * v.y + I.xz * v.z, I.xy * v.x + I.yy * v.y + I.yz * v.z,
          I.xz * v.x + I.yz * v.y + I.zz * v.z};
}

/// Lane i becomes the sum of lanes 0..i: what a link inherits from those before it.
inline void sum_outward(Lanes& v) noexcept {
  for (int i = 1; i < 8; ++i) v[i] += v[i - 1];
}
inline void sum_outward(Lanes3& v) noexcept {
  for (int i = 1; i < 8; ++i) {
    v.x[i] += v.x[i - 1];
    v.y[i] += v.y[i - 1];
    v.z[i] += v.z[i - 1];
  }
}

/// Lane i becomes the sum of lanes i..7: what a joint carries.
inline void sum_inward(Lanes& v) noexcept {
  for (int i = 6; i >= 0; --i) v[i] += v[i + 1];
}
inline void sum_inward(Lanes3& v) noexcept {
  for (int i = 6; i >= 0; --i) {
    v.x[i] += v.x[i + 1];
    v.y[i] += v.y[i + 1];
    v.z[i] += v.z[i + 1];
  }
}

/// Lane i becomes lane i-1, lane 0 zero.
inline Lanes3 previous(const Lanes3& v) noexcept {
  Lanes3 shifted;
  for (int i = 1; i < 8; ++i) {
    shifted.x[i] = v.x[i - 1];
    shifted.y[i] = v.y[i - 1];
    shifted.z[i] = v.z[i - 1];
  }
  return shifted;
}

}  // namespace dovetail
