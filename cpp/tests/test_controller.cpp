#include <Eigen/Eigenvalues>
#include <boost/test/unit_test.hpp>
#include <cstdlib>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>

#include "adversary.hpp"
#include "dovetail/controller.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kPeriod = 0.001;

/// Cycles of each closed-loop run; DOVETAIL_CYCLES asks for longer ones.
long closed_loop_cycles() {
  const char* text = std::getenv("DOVETAIL_CYCLES");
  return text != nullptr ? std::atol(text) : 20000;
}

Controller make_controller(const LimitParams& limits, const OscParams& osc = {}) {
  return {iiwa14_with_tool(), osc, limits, kUsualTask, kPeriod};
}

/// At rest, with its limits.
struct Resting : RestingArm {
  LimitParams limits = limits_for(kPeriod);

  StepResult first_step(const LimitParams& with, const Vec7& dq = Vec7::Zero()) {
    Controller controller = make_controller(with);
    controller.reset(q, p, quat, dq);
    return controller.step(q, dq, target);
  }

  LimitParams free_limits() const {
    LimitParams wide = limits;
    wide.q_min.setConstant(-100.0);
    wide.q_max.setConstant(100.0);
    wide.dq_max.setConstant(900.0);
    wide.ddq_max.setConstant(1e6);
    wide.tau_max.setConstant(1e6);
    wide.walls = false;
    return wide;
  }
};

std::string message_of(const std::function<void()>& build) {
  try {
    build();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// Whether braking with eta A stops joint i inside its margins.
bool can_stop(const LimitParams& limits, int i, double q, double dq) {
  const double room = dq > 0.0 ? limits.q_max[i] - q : q - limits.q_min[i];
  const double way = dq * dq / (2.0 * limits.eta * limits.ddq_max[i]);
  const double behind = std::min(limits.q_max[i] - q, q - limits.q_min[i]);
  return std::min(room - way, behind) >= limits.delta_q &&
         std::abs(dq) <= (1.0 - limits.delta_v) * limits.dq_max[i];
}

void require_no_violation(const Violations& result) {
  BOOST_TEST(result.joint_position_count == 0);
  BOOST_TEST(result.joint_speed_count == 0);
  BOOST_TEST(result.joint_position == 0.0);
  BOOST_TEST(result.joint_speed == 0.0);
  BOOST_TEST(result.torque < 1e-9);
  BOOST_TEST(result.unsafe == 0);
  BOOST_TEST(result.implausible == 0);  // and an arm can do it
  BOOST_TEST(result.early == 0);
}

}  // namespace

BOOST_FIXTURE_TEST_SUITE(one_cycle, Resting)

BOOST_AUTO_TEST_CASE(at_rest_on_the_target_the_overlay_torque_is_zero) {
  const StepResult result = first_step(limits);
  BOOST_TEST(result.tau.norm() < 1e-9);
  BOOST_TEST(pack_flags(result.flags) == 0);
}

BOOST_AUTO_TEST_CASE(below_the_limits_the_task_torque_is_unchanged) {
  target.f_star << 1.0, -0.5, 0.5, 0, 0, 0;
  Controller controller = make_controller(limits);
  controller.reset(q, p, quat);
  const StepResult result = controller.step(q, Vec7::Zero(), target);
  BOOST_TEST(pack_flags(result.flags) == 0);
  BOOST_TEST((result.tau - controller.osc_terms().u0).norm() < 1e-9);
  BOOST_TEST((result.a - result.a0).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(each_limit_shows_its_flag_when_it_alone_is_tightened) {
  target.f_star << 0, 0, 5.0, 0, 0, 0;  // upwards
  const LimitParams wide = free_limits();
  BOOST_TEST(pack_flags(first_step(wide).flags) == 0);

  LimitParams one = wide;
  one.ddq_max.setConstant(1.0);
  BOOST_TEST(first_step(one).flags.joint_acceleration != 0);
  BOOST_TEST(first_step(one).a.cwiseAbs().maxCoeff() <= 1.0);

  one = wide;
  one.dq_max.setConstant(0.005);
  BOOST_TEST(first_step(one).flags.joint_velocity != 0);

  one = wide;
  one.q_min = q - Vec7::Constant(one.delta_q + 1e-6);
  one.q_max = q + Vec7::Constant(one.delta_q + 1e-6);
  one.ddq_max.setConstant(15.0);
  BOOST_TEST(first_step(one).flags.joint_position != 0);

  one = wide;
  one.tau_max = Vec7::Constant(60.0);
  BOOST_TEST(first_step(one).flags.torque != 0);

  one = wide;
  one.walls = true;
  one.x_max.z() = p.z() + one.delta_x + 1e-6;
  BOOST_TEST(first_step(one).flags.wall_position == 4);

  one = wide;
  one.walls = true;
  one.ddx_max.setConstant(1.0);
  BOOST_TEST((first_step(one).flags.wall_acceleration & 4) == 4);

  one = wide;
  one.walls = true;
  one.dx_max.setConstant(0.01);
  BOOST_TEST(first_step(one).flags.wall_velocity == 4);
}

BOOST_AUTO_TEST_CASE(acceleration_and_torque_stay_inside_whatever_the_input) {
  std::mt19937_64 random(3);
  for (const Scheme scheme : {Scheme::kQp, Scheme::kPaper}) {
    limits.scheme = scheme;
    int harder = 0;
    Controller controller = make_controller(limits);
    for (int k = 0; k < 20000; ++k) {
      const Vec7 at = random_posture(random, limits, -0.1);
      const Vec7 dq = random_vector(random, 2.5);
      target.f_star = random_vector<Vec6>(random, 100.0);
      // without memory: jumps of the state are not the plant's doing
      controller.reset(at, p, quat, dq);
      const StepResult result = controller.step(at, dq, target);
      ToolMotion motion;
      controller.chain().tool_motion(at, dq, motion);
      const Vec7 motor = (result.tau + motion.g).cwiseAbs();
      BOOST_REQUIRE((motor - limits.tau_max).maxCoeff() < 1e-9);
      for (int i = 0; i < kNumJoints; ++i) {
        const double most = can_stop(limits, i, at[i], dq[i]) ? 1.0 : limits.authority;
        const bool is_braking = result.flags.ended && result.a[i] * dq[i] < 0.0;
        BOOST_REQUIRE(
            (is_braking || std::abs(result.a[i]) < most * limits.ddq_max[i] + 1e-9));
        harder += std::abs(result.a[i]) > limits.ddq_max[i] + 1e-9;
      }
      BOOST_REQUIRE((result.a - controller.bounds().ub).maxCoeff() < 1e-9);
      BOOST_REQUIRE((controller.bounds().lb - result.a).maxCoeff() < 1e-9);
      if (result.flags.unsafe) continue;
      const Vec7 expected = controller.inertia() * result.a + controller.bias();
      BOOST_REQUIRE((result.tau - expected).norm() < 1e-5);
    }
    BOOST_TEST(harder > 1000);
  }
}

BOOST_AUTO_TEST_CASE(one_cycle_of_a_jump_moves_the_estimate_by_a_bounded_amount) {
  Controller controller = make_controller(free_limits());
  controller.reset(q, p, quat);
  static_cast<void>(controller.step(q, Vec7::Zero(), target));
  Vec7 kicked = Vec7::Zero();
  kicked[1] = 0.045;  // [rad/s] in 1 ms: what a state check just believes
  static_cast<void>(controller.step(q, kicked, target));
  const double share = 1.0 - std::exp(-limits.estimate_rate * kPeriod);
  const double most = share * 0.25 * free_limits().tau_max[1];
  BOOST_TEST(controller.disturbance().norm() > 0.0);
  BOOST_TEST(controller.disturbance().cwiseAbs().maxCoeff() <= most * (1.0 + 1e-12));
}

BOOST_AUTO_TEST_CASE(disturbance_estimate_finds_an_outside_force) {
  Controller controller = make_controller(limits);
  controller.reset(q, p, quat);
  RigidPlant plant(chain, chain, {});
  plant.reset(q, Vec7::Zero());
  const Vec3 push(6.0, -3.0, 2.0);
  plant.set_external_force(push);
  for (int k = 0; k < 150; ++k) {  // 9 time constants
    const StepResult result = controller.step(plant.q(), plant.dq(), target);
    plant.apply(result.tau, kPeriod);
  }
  ChainTerms terms;
  Chain(chain).evaluate(plant.q(), plant.dq(), terms);
  const Vec7 expected = terms.J.topRows<3>().transpose() * push;
  BOOST_TEST((controller.disturbance() - expected).norm() < 0.02 * expected.norm());
  Vec6 wrench = Vec6::Zero();
  wrench.head<3>() = push;
  BOOST_TEST((controller.wrench() - wrench).norm() < 0.05 * wrench.norm());
}

BOOST_AUTO_TEST_CASE(
    a_reset_forgets_the_load_unless_the_arm_goes_on_from_where_it_was) {
  const Vec7 moving = Vec7::Constant(0.2);
  const auto loaded = [&] {
    Controller controller = make_controller(limits);
    controller.reset(q, p, quat);
    for (int k = 0; k < 20; ++k) {  // at rest, though the torque moves it
      static_cast<void>(controller.step(q, Vec7::Zero(), target));
      target.f_star[2] = 1.0;
    }
    BOOST_REQUIRE(controller.disturbance().norm() > 0.1);
    return controller;
  };
  Controller at_rest = loaded();
  at_rest.reset(q, p, quat);
  BOOST_TEST(at_rest.disturbance().norm() == 0.0);
  Controller elsewhere = loaded();
  elsewhere.reset(q + Vec7::Constant(0.1), p, quat, moving);
  BOOST_TEST(elsewhere.disturbance().norm() == 0.0);
  for (const double share : {1.0, 1e-3}) {  // held, it moves by its noise
    Controller goes_on = loaded();
    const Vec7 load = goes_on.disturbance();
    goes_on.reset(q + kPeriod * share * moving, p, quat, share * moving);
    BOOST_TEST((goes_on.disturbance() - load).norm() == 0.0);
  }
}

BOOST_AUTO_TEST_CASE(wrong_settings_are_refused_by_name_value_and_range) {
  const auto refuse = [&](const std::function<void(LimitParams&)>& spoil) {
    LimitParams spoiled = limits;
    spoil(spoiled);
    return message_of([&] { make_controller(spoiled); });
  };
  BOOST_TEST(refuse([](auto& l) { l.q_min[2] = l.q_max[2]; }).find("q_min[2]") == 0U);
  BOOST_TEST(refuse([](auto& l) { l.ddq_max[6] = -1.0; }) ==
             "ddq_max[6] is -1 rad/s2; allowed: a finite number above 0");
  BOOST_TEST(refuse([](auto& l) { l.tau_max[0] = kNaN; }).find("tau_max[0]") == 0U);
  BOOST_TEST(refuse([](auto& l) { l.eta = 1.5; }).find("eta is 1.5") == 0U);
  BOOST_TEST(refuse([](auto& l) { l.kappa = 0.5; }).find("kappa is 0.5") == 0U);
  BOOST_TEST(refuse([](auto& l) { l.x_max[1] = -1.0; }).find("x_min[1]") == 0U);
  BOOST_TEST(message_of([] {
               Controller(iiwa14_with_tool(), {}, {}, kUsualTask, 1e-3);
             }).find("q_min[0] is nan") == 0U);
  BOOST_TEST(message_of([&] {
               Controller(iiwa14_with_tool(), {}, limits, kUsualTask, 0.0);
             }).find("period is 0 s") == 0U);
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_AUTO_TEST_SUITE(closed_loop)

BOOST_AUTO_TEST_CASE(adversary_never_breaks_joint_limits_or_walls) {
  for (const double period : {0.001, 0.005}) {
    AdversarySettings settings;
    settings.episode = 2.0;
    const Violations result =
        Adversary(limits_for(period), period, settings, 1).run(closed_loop_cycles());
    require_no_violation(result);
    BOOST_TEST(result.wall_count == 0);
  }
}

BOOST_AUTO_TEST_CASE(adversary_never_breaks_walls_from_the_working_posture) {
  for (const double period : {0.001, 0.005}) {
    AdversarySettings settings;
    settings.is_random_start = false;
    const Violations result =
        Adversary(limits_for(period), period, settings, 2).run(closed_loop_cycles());
    require_no_violation(result);
    BOOST_TEST(result.wall == 0.0);
    BOOST_TEST(result.wall_speed == 0.0);
  }
}

BOOST_AUTO_TEST_CASE(adversary_never_breaks_joint_limits_under_the_paper_cascade) {
  for (const bool is_exact : {false, true}) {
    LimitParams limits = limits_for(0.001);
    limits.scheme = Scheme::kPaper;
    limits.exact_sjs = is_exact;
    limits.walls = false;
    AdversarySettings settings;
    settings.episode = 2.0;
    require_no_violation(
        Adversary(limits, 0.001, settings, 3).run(closed_loop_cycles()));
  }
}

BOOST_AUTO_TEST_CASE(weak_motors_keep_torque_and_joint_limits_together) {
  for (const Scheme scheme : {Scheme::kQp, Scheme::kPaper}) {
    LimitParams limits = limits_for(0.001);
    limits.tau_max *= 0.5;
    limits.ddq_max *= 0.5;
    limits.scheme = scheme;
    limits.walls = false;
    AdversarySettings settings;
    settings.episode = 2.0;
    settings.is_random_start = false;
    require_no_violation(
        Adversary(limits, 0.001, settings, 4).run(closed_loop_cycles()));
  }
}

BOOST_AUTO_TEST_CASE(joint_targets_are_reached_and_obey_every_limit) {
  const ChainParams chain = iiwa14_with_tool();
  for (const double period : {0.001, 0.005}) {
    LimitParams limits = limits_for(period);
    limits.walls = false;
    Controller controller(chain, {}, limits, kUsualTask, period);
    RigidPlant plant(chain, chain, {});
    plant.reset(tool_down_posture(), Vec7::Zero());
    controller.reset(plant.q(), Vec3::Zero(), Vec4(1, 0, 0, 0));
    std::mt19937_64 random(7);
    Target target;
    target.joint_mode = true;
    for (int move = 0; move < 5; ++move) {
      target.q_d = random_posture(random, limits, 0.05);
      if (move == 4) target.q_d[2] = limits.q_max[2] + 1.0;  // out of reach
      for (double t = 0.0; t < 6.0; t += period) {
        const StepResult result = controller.step(plant.q(), plant.dq(), target);
        plant.apply(result.tau, period);
        BOOST_REQUIRE((plant.q() - limits.q_max).maxCoeff() <= 0.0);
        BOOST_REQUIRE((limits.q_min - plant.q()).maxCoeff() <= 0.0);
        BOOST_REQUIRE((plant.dq().cwiseAbs() - limits.dq_max).maxCoeff() <= 0.0);
      }
      const Vec7 reached = target.q_d.cwiseMin(limits.q_max);
      BOOST_TEST((plant.q() - reached).cwiseAbs().maxCoeff() < 0.01);
      BOOST_TEST(plant.dq().cwiseAbs().maxCoeff() < 0.01);
    }
  }
}

BOOST_AUTO_TEST_CASE(a_joint_target_becomes_a_damped_spring_in_each_joint) {
  Resting arm;
  OscParams osc;
  osc.joint_stiffness = 49.0;
  osc.joint_damping_ratio = 0.5;
  Controller controller = make_controller(arm.limits, osc);
  const Vec7 dq = Vec7::Constant(0.1);
  controller.reset(arm.q, arm.p, arm.quat, dq);
  arm.target.joint_mode = true;
  arm.target.q_d = arm.q + Vec7::Constant(0.05);
  const StepResult result = controller.step(arm.q, dq, arm.target);
  BOOST_TEST((result.a0 - Vec7::Constant(49.0 * 0.05 - 7.0 * 0.1)).norm() < 1e-12);
  BOOST_TEST((result.a - result.a0).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(time_that_has_passed_divides_the_change_of_speed) {
  Resting arm;
  for (const double elapsed : {0.001, 0.003}) {
    Controller controller = make_controller(arm.limits);
    controller.reset(arm.q, arm.p, arm.quat);
    RigidPlant plant(arm.chain, arm.chain, {});
    plant.reset(arm.q, Vec7::Zero());
    plant.set_external_force(Vec3(5.0, 0.0, 0.0));
    double time = 0.0;
    while (time < 0.2) {
      const StepResult result =
          controller.step(plant.q(), plant.dq(), arm.target, elapsed);
      plant.apply(result.tau, elapsed);
      time += elapsed;
    }
    ChainTerms terms;
    Chain(arm.chain).evaluate(plant.q(), plant.dq(), terms);
    const Vec7 expected = terms.J.topRows<3>().transpose() * Vec3(5.0, 0.0, 0.0);
    BOOST_TEST((controller.disturbance() - expected).norm() < 0.1 * expected.norm());
  }
}

BOOST_AUTO_TEST_CASE(friction_and_rotors_that_the_model_knows_change_nothing) {
  LimitParams limits = limits_for(0.001);
  AdversarySettings settings;
  settings.episode = 2.0;
  settings.plant.damping.setConstant(0.5);
  settings.plant.armature.setConstant(0.1);
  limits.damping = settings.plant.damping;
  limits.armature = settings.plant.armature;
  const Violations result =
      Adversary(limits, 0.001, settings, 5).run(closed_loop_cycles());
  require_no_violation(result);
  BOOST_TEST(result.wall_count == 0);
}

BOOST_AUTO_TEST_SUITE_END()
