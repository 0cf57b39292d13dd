#include <boost/test/unit_test.hpp>
#include <functional>
#include <limits>
#include <vector>

#include "arm.hpp"
#include "dovetail/controller.hpp"
#include "dovetail/input.hpp"
#include "dovetail/rigid_plant.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPeriod = 0.001;
constexpr std::array<double, 5> kBad = {kNaN, kInfinity, -kInfinity, 1e300, -1e300};

/// Holds a pose with every axis, so that a spoilt one is used; or goes to q_d.
struct Arm : RestingArm {
  OscParams osc;
  TaskSpec task;

  Arm() {
    target.position_d = p;
    target.q_d = q;
    task.fill(AxisMode::kHold);
  }

  LimitParams limits(Scheme scheme) const {
    LimitParams limits = limits_for(kPeriod);
    limits.scheme = scheme;
    return limits;
  }

  Controller controller(Scheme scheme) const {
    Controller controller(chain, osc, limits(scheme), task, kPeriod);
    controller.reset(q, p, quat);
    return controller;
  }

  void require_hold(const Controller& controller, const StepResult& result) const {
    BOOST_TEST_REQUIRE(result.flags.bad_input);
    BOOST_TEST_REQUIRE(result.tau.allFinite());
    BOOST_TEST_REQUIRE(result.a.allFinite());
    BOOST_TEST_REQUIRE(std::isfinite(result.flags.displaced));
    const Vec7 motor = result.tau + controller.chain().gravity(q);
    BOOST_TEST_REQUIRE((motor.cwiseAbs() - limits(Scheme::kQp).tau_max).maxCoeff() <
                       1e-9);
  }

  /// A cycle with this input is a damped hold, and the next good one is as if it had
  /// not been.
  void require_one_hold(Controller& controller, const Vec7& at, const Vec7& dq,
                        const Target& command, double elapsed = kPeriod) const {
    require_hold(controller, controller.step(at, dq, command, elapsed));
    const StepResult next = controller.step(q, Vec7::Zero(), target);
    BOOST_TEST_REQUIRE(pack_flags(next.flags) == 0);
    BOOST_TEST_REQUIRE(next.tau.norm() < 1e-6);
  }
};

constexpr std::array<Scheme, 2> kSchemes = {Scheme::kQp, Scheme::kPaper};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(one_cycle, Arm)

BOOST_AUTO_TEST_CASE(a_bad_measurement_is_a_damped_hold) {
  for (const Scheme scheme : kSchemes) {
    Controller at_rest = controller(scheme);
    for (const double bad : kBad) {
      for (int i = 0; i < kNumJoints; ++i) {
        Vec7 wrong = q;
        wrong[i] = bad;
        require_one_hold(at_rest, wrong, Vec7::Zero(), target);
        require_one_hold(at_rest, q, wrong, target);
      }
    }
    for (const double bad :
         {kNaN, kInfinity, -kInfinity, 1e300, kLongestTime, -1.0, -1e-9}) {
      require_one_hold(at_rest, q, Vec7::Zero(), target, bad);
    }
  }
}

BOOST_AUTO_TEST_CASE(a_bad_element_of_a_target_is_a_damped_hold) {
  const auto spoil = [&](Controller& at_rest, auto member, bool is_joint) {
    for (const double bad : kBad) {
      for (int i = 0; i < (target.*member).size(); ++i) {
        const bool is_plane_offset = (target.*member).size() == 4 && i == 3;
        if (is_plane_offset && bad == -kInfinity) continue;  // nowhere
        Target wrong = target;
        wrong.joint_mode = is_joint;
        (wrong.*member)[i] = bad;
        require_one_hold(at_rest, q, Vec7::Zero(), wrong);
      }
    }
  };
  for (const Scheme scheme : kSchemes) {
    Controller at_rest = controller(scheme);
    for (const bool is_joint : {false, true}) {
      spoil(at_rest, &Target::f_star, is_joint);
      spoil(at_rest, &Target::position_d, is_joint);
      spoil(at_rest, &Target::velocity_d, is_joint);
      spoil(at_rest, &Target::acceleration_d, is_joint);
      spoil(at_rest, &Target::q_d, is_joint);
      spoil(at_rest, &Target::near_plane, is_joint);
      spoil(at_rest, &Target::quat_wxyz_d, is_joint);
    }
  }
}

BOOST_AUTO_TEST_CASE(a_bad_age_of_a_target_is_a_damped_hold) {
  for (const Scheme scheme : kSchemes) {
    Controller at_rest = controller(scheme);
    for (const double bad : {kNaN, kInfinity, -kInfinity, -1e-9, 1e300}) {
      Target wrong = target;
      wrong.age = bad;
      require_one_hold(at_rest, q, Vec7::Zero(), wrong);
    }
  }
}

BOOST_AUTO_TEST_CASE(a_rotation_or_a_normal_of_another_length_is_none) {
  for (const Scheme scheme : kSchemes) {
    Controller at_rest = controller(scheme);
    for (const double length : {0.0, 1e-12, 0.9, 1.1, 1e8}) {
      Target wrong = target;
      wrong.quat_wxyz_d = length * quat;
      require_one_hold(at_rest, q, Vec7::Zero(), wrong);
      wrong = target;
      wrong.near_plane << 0.0, 0.0, length, 0.1;
      require_one_hold(at_rest, q, Vec7::Zero(), wrong);
      at_rest.hold_at(p, length * quat);
      require_hold(at_rest, at_rest.step(q, Vec7::Zero(), target));
      at_rest.hold_at(p, quat);
    }
  }
}

BOOST_AUTO_TEST_CASE(a_bad_start_or_pose_to_hold_is_a_damped_hold_until_a_good_one) {
  using Spoil = std::function<void(Controller&, double)>;
  std::vector<Spoil> doors;
  for (int i = 0; i < 7; ++i) {
    doors.push_back([this, i](Controller& at_rest, double bad) {
      Vec7 wrong = q;
      wrong[i] = bad;
      at_rest.reset(wrong, p, quat);
    });
  }
  for (const bool is_reset : {true, false}) {
    for (int i = 0; i < 7; ++i) {
      doors.push_back([this, i, is_reset](Controller& at_rest, double bad) {
        Vec3 p_wrong = p;
        Vec4 quat_wrong = quat;
        (i < 3 ? p_wrong[i] : quat_wrong[i - 3]) = bad;
        if (is_reset) {
          at_rest.reset(q, p_wrong, quat_wrong);
        } else {
          at_rest.hold_at(p_wrong, quat_wrong);
        }
      });
    }
  }
  for (const Scheme scheme : kSchemes) {
    Controller at_rest = controller(scheme);
    for (const Spoil& door : doors) {
      for (const double bad : kBad) {
        door(at_rest, bad);
        for (int k = 0; k < 3; ++k) {
          require_hold(at_rest, at_rest.step(q, Vec7::Zero(), target));
        }
        at_rest.reset(q, p, quat);
        BOOST_TEST_REQUIRE(!at_rest.step(q, Vec7::Zero(), target).flags.bad_input);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(a_torque_that_would_not_be_finite_does_not_leave) {
  const auto with = [this](const std::function<void(OscParams&, LimitParams&)>& spoil,
                           Scheme scheme) {
    OscParams law = osc;
    LimitParams wide = limits(scheme);
    spoil(law, wide);
    Controller overflowing(chain, law, wide, task, kPeriod);
    overflowing.reset(q, p + Vec3::Constant(5.0), quat);
    return overflowing;
  };
  const Vec7 dq = Vec7::Constant(0.1);
  for (const Scheme scheme : kSchemes) {
    for (const bool is_joint : {false, true}) {
      Controller overflowing = with(
          [](OscParams& law, LimitParams& wide) {
            wide.walls = false;  // they bring a wish that is too large back to size
            law.stiffness.setConstant(1e308);
            law.error_clamp_position = 10.0;
            law.f_clamp_linear = 1e308;
            law.joint_stiffness = 1e308;
            law.joint_damping_ratio = 1e308;
          },
          scheme);
      Target far = target;
      far.joint_mode = is_joint;
      far.q_d = Vec7::Constant(900.0);
      Vec7 moving = dq;
      if (is_joint) moving *= 100.0;
      overflowing.believe(q, moving);
      require_hold(overflowing, overflowing.step(q, moving, far));
    }
    Controller heavy = with(
        [](OscParams&, LimitParams& wide) { wide.damping.setConstant(1e308); }, scheme);
    heavy.believe(q, 100.0 * dq);
    const StepResult result = heavy.step(q, 100.0 * dq, target);
    require_hold(heavy, result);
    BOOST_TEST(result.tau.norm() == 0.0);  // no model to hold by
    heavy.believe(q, Vec7::Zero());
    BOOST_TEST(!heavy.step(q, Vec7::Zero(), target).flags.bad_input);
  }
}

BOOST_AUTO_TEST_CASE(no_time_between_two_cycles_counts_as_a_period) {
  for (const Scheme scheme : kSchemes) {
    for (const double elapsed : {0.0, -0.0, 1e-320, 1e-9}) {
      Controller first = controller(scheme), second = controller(scheme);
      for (int k = 0; k < 3; ++k) {
        const Vec7 dq = Vec7::Constant(0.01 * k);
        const Vec7 at = q + 0.5 * kPeriod * dq;
        const StepResult result = first.step(at, dq, target, elapsed);
        BOOST_TEST(!result.flags.implausible);
        BOOST_TEST((result.tau - second.step(at, dq, target).tau).norm() == 0.0);
      }
    }
  }
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_FIXTURE_TEST_SUITE(closed_loop, Arm)

BOOST_AUTO_TEST_CASE(without_a_measurement_the_arm_comes_to_rest) {
  for (const Scheme scheme : kSchemes) {
    for (const double bad : {kNaN, kInfinity, 1e300}) {
      Controller blind = controller(scheme);
      RigidPlant plant(chain, chain, {});
      plant.reset(q, Vec7::Constant(0.3));
      blind.reset(q, p, quat, plant.dq());
      static_cast<void>(blind.step(q, plant.dq(), target));
      Vec7 wrong = q;
      wrong[2] = bad;
      double energy = plant.kinetic_energy();
      for (int k = 0; k < 1000; ++k) {
        const StepResult result = blind.step(wrong, Vec7::Zero(), target);
        BOOST_REQUIRE(result.flags.bad_input);
        BOOST_REQUIRE(result.tau.allFinite());
        plant.apply(result.tau, kPeriod);
        BOOST_REQUIRE(plant.kinetic_energy() < energy + 1e-3);
        energy = plant.kinetic_energy();
      }
      BOOST_TEST(plant.dq().cwiseAbs().maxCoeff() < 0.05);
      BOOST_TEST(blind.step(wrong, Vec7::Zero(), target).tau.norm() < 1e-3);
      BOOST_TEST(!blind.step(plant.q(), plant.dq(), target).flags.bad_input);
    }
  }
}

BOOST_AUTO_TEST_CASE(an_arm_that_is_measured_is_damped_inside_its_joint_limits) {
  for (const Scheme scheme : kSchemes) {
    for (const bool is_pose : {true, false}) {
      Controller stopped = controller(scheme);
      LimitParams wide = limits(scheme);
      RigidPlant plant(chain, chain, {});
      Vec7 start = q;
      start[3] = wide.q_min[3] + 0.05;  // braking with eta A from 0.6 rad/s: 0.02 rad
      Vec7 speed = Vec7::Constant(0.3);
      speed[3] = -0.6;
      plant.reset(start, speed);
      Target wrong = target;
      if (is_pose) {
        stopped.reset(start, Vec3::Constant(kNaN), quat);
      } else {
        stopped.reset(start, p, quat);
        wrong.f_star[0] = kNaN;
      }
      for (int k = 0; k < 500; ++k) {
        if (k == 250) plant.set_external_force(Vec3(10.0, 0.0, 0.0));
        const StepResult result = stopped.step(plant.q(), plant.dq(), wrong);
        BOOST_REQUIRE(result.flags.bad_input);
        plant.apply(result.tau, kPeriod);
        BOOST_REQUIRE((wide.q_min - plant.q()).maxCoeff() < 0.0);
        if (k == 249) BOOST_TEST(plant.dq().cwiseAbs().maxCoeff() < 1e-3);
      }
      // Without the estimated push A7 would be at 8 rad/s.
      BOOST_TEST(plant.dq().cwiseAbs().maxCoeff() < 0.01);
    }
  }
}

BOOST_AUTO_TEST_CASE(no_motor_is_overloaded_while_a_doubtful_state_is_answered) {
  // A torque at the motor's limit, changed slowly, while gravity changes beneath it.
  LimitParams weak = limits(Scheme::kQp);
  weak.walls = false;
  weak.tau_max[1] = 75.0;  // gravity is 60
  weak.tau_max[3] = 30.0;
  task = kUsualTask;
  std::mt19937_64 random(3);
  int softened = 0;
  double most = 0.0;
  for (int episode = 0; episode < 20; ++episode) {
    Controller loaded(chain, osc, weak, task, kPeriod);
    RigidPlant plant(chain, chain, {});
    plant.reset(q, Vec7::Zero());
    loaded.reset(q, p, quat);
    for (int k = 0; k < 300; ++k) {
      if (k % 20 == 0) target.f_star.head<3>() = random_vector<Vec3>(random, 30.0);
      Vec7 seen = plant.q();
      if (k % 13 < 3) seen[random() % 7] += 0.1;
      const StepResult result = loaded.step(seen, plant.dq(), target);
      softened += loaded.state().is_in_doubt();
      const Vec7 motor = result.tau + loaded.chain().gravity(loaded.state().q());
      most = std::max(most, (motor.cwiseAbs() - weak.tau_max).maxCoeff());
      plant.apply(result.tau, kPeriod);
    }
  }
  BOOST_TEST(softened > 1000);
  BOOST_TEST(most < 1e-9);
  BOOST_TEST(most > -1e-9);  // a motor was at its limit
}

BOOST_AUTO_TEST_CASE(a_hold_brakes_harder_where_a_joint_limit_asks_for_it) {
  const double speed = 0.18;  // softly it would need 3.6 mrad
  for (const Scheme scheme : kSchemes) {
    LimitParams bare = limits(scheme);
    bare.delta_q = 0.0;
    const double way = speed * speed / (2.0 * bare.eta * bare.ddq_max[3]);  // 1.8 mrad
    Vec7 start = q, dq = Vec7::Zero();
    start[3] = bare.q_min[3] + way + 1e-4;
    dq[3] = -speed;
    RigidPlant plant(chain, chain, {});
    plant.reset(start, dq);
    Controller stopped(chain, osc, bare, task, kPeriod);
    stopped.reset(start, p, Vec4::Zero());
    for (int k = 0; k < 200; ++k) {
      plant.apply(stopped.step(plant.q(), plant.dq(), target).tau, kPeriod);
      BOOST_TEST_REQUIRE(plant.q()[3] > bare.q_min[3] - 2e-4);
    }
  }
}

BOOST_AUTO_TEST_CASE(the_disturbance_estimate_outlives_a_bad_cycle) {
  const Vec3 push(6.0, -3.0, 2.0);
  task = kUsualTask;
  for (const Scheme scheme : kSchemes) {
    Controller pushed = controller(scheme);
    RigidPlant plant(chain, chain, {});
    plant.reset(q, Vec7::Zero());
    plant.set_external_force(push);
    Target wrong = target;
    wrong.f_star[0] = kNaN;
    for (int k = 0; k < 250; ++k) {
      Vec7 dq = plant.dq();
      if (k % 10 == 3 && k < 60) dq[k / 10] = kNaN;
      const bool is_bad_target = k % 10 == 7 && k < 60;
      const StepResult result =
          pushed.step(plant.q(), dq, is_bad_target ? wrong : target);
      plant.apply(result.tau, kPeriod);
      BOOST_REQUIRE(pushed.disturbance().allFinite());
    }
    ChainTerms terms;
    Chain(chain).evaluate(plant.q(), plant.dq(), terms);
    const Vec7 expected = terms.J.topRows<3>().transpose() * push;
    BOOST_TEST((pushed.disturbance() - expected).norm() < 0.02 * expected.norm());
  }
}

BOOST_AUTO_TEST_SUITE_END()
