/// An exact rigid arm for tests of the limits: nothing in it but the equations of
/// motion.
#pragma once

#include "dovetail/chain.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// Everything in which the plant may differ from the controller's model.
struct PlantParams {
  Vec7 damping = Vec7::Zero();   ///< viscous friction [Nms/rad]
  Vec7 armature = Vec7::Zero();  ///< rotor inertia at the joint [kg m2]
  Vec7 coulomb = Vec7::Zero();   ///< dry friction [Nm], smooth within +-0.01 rad/s
  double dt_sub = 5e-4;          ///< largest integration step [s]
};

/// M(q) a + c + D v + coulomb + g(q) = u + g_hat(q) + J^T f, integrated by RK4 with u
/// held over the period; g_hat is the nominal chain's gravity (the lowest level's
/// work).
class RigidPlant {
 public:
  /// \param nominal  chain that the gravity compensation uses
  /// \param actual   chain that moves
  RigidPlant(const ChainParams& nominal, const ChainParams& actual,
             const PlantParams& params) noexcept;

  void reset(const Vec7& q, const Vec7& dq) noexcept;

  /// Holds the overlay torque tau [Nm] (gravity excluded) for dt [s].
  void apply(const Vec7& tau, double dt) noexcept;

  /// Force on the TCP [N], world axes, until changed.
  void set_external_force(const Vec3& f) noexcept { force_ = f; }

  const Vec7& q() const noexcept { return q_; }
  const Vec7& dq() const noexcept { return dq_; }

  /// ddq [rad/s2] at a state under the overlay torque tau [Nm].
  [[nodiscard]] Vec7 acceleration(const Vec7& q, const Vec7& dq,
                                  const Vec7& tau) const noexcept;

  /// Kinetic energy of the actual chain and its rotors [J].
  [[nodiscard]] double kinetic_energy() const noexcept;

 private:
  void integrate(const Vec7& tau, double dt) noexcept;

  Chain nominal_;
  Chain actual_;
  PlantParams params_;
  Vec3 force_ = Vec3::Zero();
  Vec7 q_ = Vec7::Zero();
  Vec7 dq_ = Vec7::Zero();
};

}  // namespace dovetail
