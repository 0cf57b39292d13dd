/// A policy that wants to break the limits, on an exact plant (docs/control.md,
/// Adversary).
#pragma once

#include <algorithm>
#include <random>

#include "arm.hpp"
#include "dovetail/controller.hpp"
#include "dovetail/rigid_plant.hpp"

namespace dovetail::testing {

/// How far beyond the limits the plant went; 0 where it never did.
struct Violations {
  double joint_position = 0.0;  // [rad]
  double joint_speed = 0.0;     // [rad/s]
  double wall = 0.0;            // [m]
  double wall_speed = 0.0;      // [m/s]
  double torque = 0.0;          // gravity included [Nm]
  long joint_position_count = 0;
  long joint_speed_count = 0;
  long wall_count = 0;
  long unsafe = 0;
  long early = 0;
  long displaced = 0;
  long implausible = 0;  // measurements not believed
  long cycles = 0;
};

struct AdversarySettings {
  double f_star = 30.0;           // [m/s2]
  double episode = 5.0;           // [s]
  bool is_random_start = true;    // else tool down, inside the walls
  bool wall_around_start = true;  // walls +-0.25 m around a random start
  bool last_line = false;         // it would end the attack
  PlantParams plant;
};

class Adversary {
 public:
  Adversary(LimitParams limits, double period, AdversarySettings settings,
            std::uint64_t seed)
      : limits_(limits), period_(period), settings_(settings), random_(seed) {
    limits_.last_line = settings.last_line;
  }

  Violations run(long cycles) {
    const long per_episode = std::lround(settings_.episode / period_);
    while (total_.cycles < cycles) run_episode(per_episode);
    return total_;
  }

 private:
  void run_episode(long cycles) {
    const ChainParams params = iiwa14_with_tool();
    const Chain chain(params);
    const Vec7 q0 = settings_.is_random_start ? random_posture(random_, limits_)
                                              : tool_down_posture();
    Vec3 p0;
    Mat3 R0;
    chain.pose(q0, p0, R0);
    LimitParams limits = limits_;
    if (settings_.is_random_start && settings_.wall_around_start) {
      limits.x_min = p0 - Vec3::Constant(0.25);
      limits.x_max = p0 + Vec3::Constant(0.25);
    }
    Controller controller(params, OscParams{}, limits, kUsualTask, period_);
    controller.reset(q0, p0, quat_of(R0));
    RigidPlant plant(params, params, settings_.plant);
    plant.reset(q0, Vec7::Zero());
    const long per_action = std::max(1L, std::lround(0.05 / period_));
    const int kind = static_cast<int>(random_() % 3);
    Target target;
    for (long k = 0; k < cycles; ++k) {
      if (k % per_action == 0) {
        const bool is_new = kind != 1 || k % (20 * per_action) == 0;
        if (is_new) choose(target, kind, chain, plant, quat_of(R0));
      }
      const StepResult result = controller.step(plant.q(), plant.dq(), target);
      ToolMotion motion;
      chain.tool_motion(plant.q(), plant.dq(), motion);
      count(result, motion.g, limits);
      for (int half = 0; half < 2; ++half) {
        plant.apply(result.tau, 0.5 * period_);
        inspect(chain, plant, limits);
      }
    }
  }

  /// kind 0: random bang-bang; 1: the same, held for 1 s; 2: towards a joint's limit.
  void choose(Target& target, int kind, const Chain& chain, const RigidPlant& plant,
              const Vec4& quat_hold) {
    target.f_star.setZero();
    if (kind == 2) {
      ChainTerms terms;
      chain.evaluate(plant.q(), plant.dq(), terms);
      const int joint = static_cast<int>(random_() % 7);
      const double side = plant.q()[joint] > 0.0 ? 1.0 : -1.0;
      for (int i = 0; i < 3; ++i) {
        target.f_star[i] =
            terms.J(i, joint) * side > 0.0 ? settings_.f_star : -settings_.f_star;
      }
    } else {
      for (int i = 0; i < 3; ++i) {
        target.f_star[i] = random_() % 2 == 0 ? settings_.f_star : -settings_.f_star;
      }
    }
    std::uniform_real_distribution<double> angle(-M_PI, M_PI);
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(angle(random_), Vec3::UnitZ()));
    const Eigen::Quaterniond hold(quat_hold[0], quat_hold[1], quat_hold[2],
                                  quat_hold[3]);
    target.quat_wxyz_d = quat_of((turn * hold).toRotationMatrix());
  }

  void count(const StepResult& result, const Vec7& g, const LimitParams& limits) {
    const Vec7 motor = (result.tau + g).cwiseAbs();
    total_.torque = std::max(total_.torque, (motor - limits.tau_max).maxCoeff());
    ++total_.cycles;
    total_.unsafe += result.flags.unsafe;
    total_.early += result.flags.qp_early;
    total_.implausible += result.flags.implausible;
    total_.displaced += result.flags.wall_displaced != 0;
  }

  void inspect(const Chain& chain, const RigidPlant& plant, const LimitParams& limits) {
    const Vec7& q = plant.q();
    const Vec7& dq = plant.dq();
    const double over =
        std::max((q - limits.q_max).maxCoeff(), (limits.q_min - q).maxCoeff());
    const double fast = (dq.cwiseAbs() - limits.dq_max).maxCoeff();
    ToolMotion motion;
    chain.tool_motion(q, dq, motion);
    const double out = std::max((motion.p - limits.x_max).maxCoeff(),
                                (limits.x_min - motion.p).maxCoeff());
    const double speed = (motion.twist.head<3>().cwiseAbs() - limits.dx_max).maxCoeff();
    total_.joint_position = std::max(total_.joint_position, over);
    total_.joint_speed = std::max(total_.joint_speed, fast);
    total_.wall = std::max(total_.wall, out);
    total_.wall_speed = std::max(total_.wall_speed, speed);
    total_.joint_position_count += over > 0.0;
    total_.joint_speed_count += fast > 0.0;
    total_.wall_count += out > 0.0;
  }

  LimitParams limits_;
  double period_;
  AdversarySettings settings_;
  std::mt19937_64 random_;
  Violations total_;
};

}  // namespace dovetail::testing
