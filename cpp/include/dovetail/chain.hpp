/// A serial chain of seven revolute joints: kinematics and dynamics, fixed size.
///
/// All vectors are in world axes; the tool point (TCP) is the reference point of the
/// Jacobian (Pinocchio calls this LOCAL_WORLD_ALIGNED). Nothing here allocates or
/// throws.
#pragma once

#include "dovetail/lanes.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// Every term of the chain at one state.
struct ChainTerms {
  Vec3 p;     ///< TCP position [m]
  Mat3 R;     ///< TCP axes in world
  Mat67 J;    ///< Jacobian of the TCP, rows linear then angular [m, rad per rad]
  Vec6 dJdq;  ///< acceleration of the TCP at zero ddq [m/s2, rad/s2]
  Mat7 M;     ///< joint inertia, without armature [kg m2]
  Vec7 c;     ///< Coriolis and centrifugal torque [Nm]
  Vec7 g;     ///< gravity torque, the torque that holds the arm still [Nm]
};

/// What the measured state says about the tool, without the dynamics.
struct ToolMotion {
  Vec3 p;      ///< TCP position [m]
  Mat3 R;      ///< TCP axes in world
  Vec6 twist;  ///< TCP velocity, linear then angular [m/s, rad/s]
  Vec7 g;      ///< gravity torque [Nm]
};

class Chain {
 public:
  explicit Chain(const ChainParams& params) noexcept;

  /// All terms at (q [rad], dq [rad/s]). Recursive Newton-Euler and composite bodies.
  void evaluate(const Vec7& q, const Vec7& dq, ChainTerms& terms) const noexcept;

  /// TCP position [m], axes, velocity and the gravity torque only; about a third of
  /// the cost of `evaluate`.
  void tool_motion(const Vec7& q, const Vec7& dq, ToolMotion& motion) const noexcept;

  /// Gravity torque only [Nm].
  Vec7 gravity(const Vec7& q) const noexcept;

  /// Forward kinematics: TCP position [m] and axes in world.
  void pose(const Vec7& q, Vec3& p, Mat3& R) const noexcept;

  const ChainParams& params() const noexcept { return params_; }

 private:
  struct Frames;
  void place(const Vec7& q, Frames& frames) const noexcept;
  Vec7 gravity_of(const Frames& frames) const noexcept;
  static Vec3 tool_of(const Frames& frames, Mat3& R) noexcept;

  ChainParams params_;
  // the same numbers per lane; the tool's lane has no mass
  Lanes mass_;
  Lanes mass_beyond_;  // of all links that a joint carries [kg]
  Lanes3 com_;
  LanesSymmetric inertia_;
};

}  // namespace dovetail
