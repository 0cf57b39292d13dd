/// The settings of an arm with the margins that a robot is given, and its rotors.
#pragma once

#include "arm.hpp"
#include "dovetail/rigid_plant.hpp"

namespace dovetail::testing {

/// `LimitConfig.for_period` of a robot, and the rotors and friction of the nominal arm.
inline LimitParams declared_limits(double period) {
  LimitParams limits = limits_for(period);
  const bool is_fast = period < 0.003;
  limits.kappa = is_fast ? 27.5 : 7.5;
  limits.delta_q = is_fast ? 0.012 : 0.045;
  limits.delta_v = is_fast ? 0.15 : 0.30;
  limits.delta_x = is_fast ? 0.015 : 0.020;
  limits.estimate_rate = limits.brake_rate = is_fast ? 60.0 : 50.0;
  limits.armature.setConstant(0.1);
  limits.damping.setConstant(0.5);
  return limits;
}

inline OscParams declared_law() {
  OscParams osc;
  osc.stiffness.tail<3>().setConstant(200.0);
  return osc;
}

inline PlantParams nominal_rotors() {
  PlantParams params;
  params.armature.setConstant(0.1);
  params.damping.setConstant(0.5);
  return params;
}

}  // namespace dovetail::testing
