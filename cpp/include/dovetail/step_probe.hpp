/// What a test puts between two physics steps: a force on the tool, and a look.
#pragma once

#include "dovetail/types.hpp"

namespace dovetail {

class StepProbe {
 public:
  virtual ~StepProbe() = default;

  /// Force on the TCP during the next physics step [N], world axes.
  /// \param q, dq  true state before it [rad, rad/s]
  virtual Vec3 force(const Vec7& q, const Vec7& dq) noexcept = 0;

  /// Called after each physics step of h [s], at the true state that it left.
  /// \param contact  force on the tool in that step [N], world axes
  virtual void look(const Vec7& q, const Vec7& dq, const Vec3& contact,
                    double h) noexcept = 0;

  /// Called with each answer of the controller.
  /// \param motor  its torque with the compensated gravity [Nm]
  virtual void command(const Vec7& motor, const Flags& flags) noexcept = 0;
};

}  // namespace dovetail
