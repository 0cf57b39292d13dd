/// Spring, damper and detents of a hinge, slide or screw of a part:
/// `workcell/joints.py`.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace dovetail {

struct Detent {
  double position;    // of its middle [rad, m]
  double force;       // largest [Nm, N]
  double half_width;  // [rad, m]
};

struct PartJoint {
  double stiffness = 0.0;  // [Nm/rad, N/m]
  double rest = 0.0;       // position without a spring's force [rad, m]
  double damping = 0.0;    // [Nms/rad, Ns/m]
  double armature = 0.0;   // inertia beside that of its shapes [kg m2, kg]
  std::vector<Detent> detents;

  /// Force of spring and detents at a position [Nm, N].
  double force(double q) const noexcept {
    double sum = -stiffness * (q - rest);
    for (const Detent& d : detents) {
      if (std::abs(q - d.position) >= d.half_width) continue;
      sum -= d.force * std::sin(std::numbers::pi * (q - d.position) / d.half_width);
    }
    return sum;
  }

  /// Damping of a step h [s] that is linearly implicit: the spring's is in it.
  double implicit_damping(double q, double h) const noexcept {
    return damping + h * slope(q);
  }

  /// Stiffness of both at a position [Nm/rad, N/m]; 0 where they drive away.
  double slope(double q) const noexcept {
    double sum = stiffness;
    for (const Detent& d : detents) {
      if (std::abs(q - d.position) >= d.half_width) continue;
      const double steepest = d.force * std::numbers::pi / d.half_width;
      sum += steepest * std::cos(std::numbers::pi * (q - d.position) / d.half_width);
    }
    return std::max(0.0, sum);
  }
};

}  // namespace dovetail
