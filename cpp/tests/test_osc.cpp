#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <boost/test/unit_test.hpp>

#include "arm.hpp"
#include "dovetail/osc.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

using enum AxisMode;

constexpr int kStates = 300;
constexpr double kPeriod = 0.005;
constexpr double kAtOnce = 1e9;  // [m/s, rad/s]
constexpr TaskSpec kAllForce = {kForce, kForce, kForce, kForce, kForce, kForce};
constexpr TaskSpec kAllHold = {kHold, kHold, kHold, kHold, kHold, kHold};
constexpr TaskSpec kScrew = {kFree, kFree, kForce, kHold, kHold, kHold};

Mat3 random_rotation(std::mt19937_64& random) {
  const Vec4 v = random_vector<Vec4>(random, 1.0);
  return Eigen::Quaterniond(v[0], v[1], v[2], v[3]).normalized().toRotationMatrix();
}

/// One state with everything that the operational space needs.
struct State {
  ChainTerms terms;
  Cholesky<7> factor;
  Mat7 Minv;
  Vec7 dq;
  OscTerms out;

  State(const ChainParams& params, const Vec7& q, const Vec7& speed) : dq(speed) {
    Chain(params).evaluate(q, dq, terms);
    factor.factor(terms.M);
    Minv = factor.inverse();
  }

  void evaluate(const OperationalSpace& osc, const Vec6& f_star,
                const Vec7& posture = Vec7::Zero()) {
    osc.evaluate(terms, terms.M, factor, dq, f_star, posture, out);
  }

  Mat7 null_space() const {
    return Mat7::Identity() - out.J.transpose() * out.Lambda * out.J * Minv;
  }
};

struct Arm {
  ChainParams params = iiwa14_with_tool();
  std::mt19937_64 random{11};

  State draw() {
    return {params, random_vector(random, 2.9), random_vector(random, 1.0)};
  }
};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(operational_space, Arm)

BOOST_AUTO_TEST_CASE(away_from_singularities_the_task_gets_exactly_f_star) {
  int exact = 0;
  for (const TaskSpec& task : {kAllForce, kUsualTask, kScrew}) {
    const OperationalSpace osc(OscParams{}, task, kPeriod);
    for (int k = 0; k < kStates; ++k) {
      State state = draw();
      const Vec6 f_star = random_vector<Vec6>(random, 5.0);
      state.evaluate(osc, f_star);
      if (!state.out.exact) continue;
      ++exact;
      const Vec6 reached = state.out.J * state.Minv * state.out.u0;
      BOOST_TEST((reached - state.out.f).norm() < 1e-9);
      BOOST_TEST((state.out.J * state.Minv * state.null_space()).norm() < 1e-9);
    }
  }
  BOOST_TEST(exact > kStates);
}

BOOST_AUTO_TEST_CASE(null_space_damping_never_adds_energy_and_eigenvalues_stay_in_0_1) {
  const OperationalSpace osc(OscParams{}, kAllForce, kPeriod);
  int faded = 0;
  for (int k = 0; k < kStates; ++k) {
    const double bend = k % 2 == 0 ? 2.9 : 0.05;  // small: near the stretched arm
    State state(params, random_vector(random, bend), random_vector(random, 1.0));
    state.evaluate(osc, Vec6::Zero());
    faded += !state.out.exact;
    const Mat7 N = state.null_space();
    const Eigen::EigenSolver<Mat7> eigen(N);
    BOOST_TEST(eigen.eigenvalues().real().minCoeff() > -1e-8);
    BOOST_TEST(eigen.eigenvalues().real().maxCoeff() < 1.0 + 1e-8);
    BOOST_TEST(state.dq.dot(N * state.terms.M * state.dq) > -1e-9);
  }
  BOOST_TEST(faded > 10);
}

BOOST_AUTO_TEST_CASE(the_posture_moves_no_axis_of_the_tool_free_ones_included) {
  int exact = 0;
  for (const TaskSpec& task : {kAllForce, kUsualTask, kScrew}) {
    const OperationalSpace osc(OscParams{}, task, kPeriod);
    for (int k = 0; k < kStates; ++k) {
      State state = draw();
      const Vec7 posture = random_vector(random, 20.0);
      const Vec6 f_star = random_vector<Vec6>(random, 5.0);
      state.evaluate(osc, f_star);
      const Vec7 without = state.out.u0;
      state.evaluate(osc, f_star, posture);
      const Vec7 added = state.out.u0 - without;
      // Towards the posture, never from it: posture . N M posture >= 0.
      BOOST_TEST(added.dot(posture) > -1e-9);
      OperationalSpace whole(OscParams{}, kAllForce, kPeriod);
      State all = state;
      all.evaluate(whole, Vec6::Zero());
      if (!all.out.exact) continue;
      ++exact;
      BOOST_TEST((state.terms.J * state.Minv * added).norm() < 1e-8);
      BOOST_TEST(added.norm() > 1e-3);  // one joint is left
    }
  }
  BOOST_TEST(exact > kStates);
}

BOOST_AUTO_TEST_CASE(the_way_back_to_a_posture_is_shortened) {
  const OperationalSpace osc(OscParams{}, kAllForce, kPeriod);
  const Vec7 near = random_vector(random, 0.1);
  BOOST_TEST((osc.posture_acceleration(-near, near) - 100.0 * near).norm() < 1e-12);
  const Vec7 far = Vec7::Constant(3.0);
  const Vec7 back = osc.posture_acceleration(Vec7::Zero(), far);
  BOOST_TEST((back - 50.0 * 2.0 * far.normalized()).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(task_inertia_is_symmetric_positive_and_bounded) {
  const OscParams params_osc;
  const OperationalSpace osc(params_osc, kAllForce, kPeriod);
  for (int k = 0; k < kStates; ++k) {
    State state(params, random_vector(random, k % 2 == 0 ? 2.9 : 0.05), Vec7::Zero());
    state.evaluate(osc, Vec6::Zero());
    const Mat6& Lambda = state.out.Lambda;
    const Eigen::SelfAdjointEigenSolver<Mat6> eigen(Lambda);
    BOOST_TEST((Lambda - Lambda.transpose()).norm() < 1e-9);
    BOOST_TEST(eigen.eigenvalues()[0] > -1e-9);
    BOOST_TEST(eigen.eigenvalues()[5] < 1.13 / params_osc.s0);
  }
}

BOOST_AUTO_TEST_CASE(fast_and_slow_inverse_meet_at_the_threshold) {
  // The fade must not make the torque jump: sweep the elbow through a singularity.
  const OperationalSpace osc(OscParams{}, kAllForce, kPeriod);
  const Vec6 f_star = Vec6::Constant(1.0);
  Vec7 q = tool_down_posture();
  Vec7 before = Vec7::Zero();
  double largest = 0.0;
  for (int k = 0; k <= 20000; ++k) {
    q[3] = -1.0 + 2.0 * k / 20000.0;
    State state(params, q, Vec7::Zero());
    state.evaluate(osc, f_star);
    if (k > 0) largest = std::max(largest, (state.out.u0 - before).norm());
    before = state.out.u0;
  }
  BOOST_TEST(largest < 0.1);  // [Nm] per 0.1 mrad
}

BOOST_AUTO_TEST_CASE(rotation_error_of_a_turn_about_z_is_that_turn) {
  constexpr TaskSpec turn_only = {kFree, kFree, kFree, kHold, kHold, kPose};
  OperationalSpace osc(turns_at_once(), turn_only, kPeriod);
  for (int k = 0; k < kStates; ++k) {
    const Mat3 R = random_rotation(random);
    const double angle = random_vector<Vec3>(random, 3.1)[0];
    osc.reset(Vec3::Zero(), quat_of(R));
    Target target;
    target.quat_wxyz_d = quat_of(about_z(angle) * R);
    const Vec6 f = osc.desired_acceleration(Vec3::Zero(), R, Vec6::Zero(), target);
    BOOST_TEST((f.tail<3>() / 400.0 - Vec3(0, 0, angle)).norm() < 1e-9);
    BOOST_TEST(std::abs(twist_about_z(about_z(angle)) - angle) < 1e-12);
    target.quat_wxyz_d = -target.quat_wxyz_d;
    const Vec6 other = osc.desired_acceleration(Vec3::Zero(), R, Vec6::Zero(), target);
    BOOST_TEST((f - other).norm() < 1e-9);
  }
}

BOOST_AUTO_TEST_CASE(tilt_is_held_about_both_axes_while_the_turn_is_free) {
  constexpr TaskSpec tilt = {kFree, kFree, kFree, kHold, kHold, kFree};
  OscParams osc_params;
  osc_params.error_clamp_rotation = 4.0;
  osc_params.turn_speed = kAtOnce;
  osc_params.f_clamp_angular = 1e4;
  OperationalSpace osc(osc_params, tilt, kPeriod);
  for (int k = 0; k < kStates; ++k) {
    const Mat3 R = random_rotation(random);
    osc.reset(Vec3::Zero(), quat_of(R));
    const double turn = random_vector<Vec3>(random, 3.0)[0];
    Vec3 swing = random_vector(random, 0.5).head<3>();
    swing.z() = 0.0;
    const Mat3 tilted =
        Eigen::AngleAxisd(swing.norm(), swing.normalized()).toRotationMatrix();
    const Mat3 now = tilted * about_z(turn) * R;
    const Vec6 f = osc.desired_acceleration(Vec3::Zero(), now, Vec6::Zero(), Target{});
    BOOST_TEST((f.tail<3>() / 400.0 + swing).norm() < 1e-9);
  }
}

BOOST_AUTO_TEST_CASE(pose_axes_follow_the_target_and_hold_axes_the_latched_pose) {
  constexpr TaskSpec mixed = {kPose, kHold, kForce, kFree, kFree, kFree};
  OscParams osc_params;
  osc_params.move_speed = kAtOnce;
  OperationalSpace osc(osc_params, mixed, kPeriod);
  osc.reset(Vec3(1.0, 2.0, 3.0), Vec4(1, 0, 0, 0));
  Target target;
  target.position_d = Vec3(1.01, 7.0, 7.0);
  target.f_star << 0.5, -0.5, 2.0, 9.0, 9.0, 9.0;  // added to both, not to free axes
  const Vec6 f = osc.desired_acceleration(Vec3(1.0, 1.98, 0.0), Mat3::Identity(),
                                          Vec6::Zero(), target);
  Vec6 expected;
  expected << 4.5, 7.5, 2.0, 0.0, 0.0, 0.0;
  BOOST_TEST((f - expected).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(errors_and_f_star_are_clamped) {
  const OscParams osc_params;
  OperationalSpace hold(osc_params, kAllHold, kPeriod);
  hold.reset(Vec3(9.0, 0.0, 0.0), quat_of(about_z(3.0)));
  const Vec6 f =
      hold.desired_acceleration(Vec3::Zero(), Mat3::Identity(), Vec6::Zero(), Target{});
  BOOST_TEST(f[0] == osc_params.f_clamp_linear);
  BOOST_TEST(std::abs(f[5] - 400.0 * osc_params.error_clamp_rotation) < 1e-9);
  OperationalSpace force(osc_params, kAllForce, kPeriod);
  Target target;
  target.f_star.setConstant(-1e4);
  const Vec6 g =
      force.desired_acceleration(Vec3::Zero(), Mat3::Identity(), Vec6::Zero(), target);
  BOOST_TEST(g.head<3>().minCoeff() == -osc_params.f_clamp_linear);
  BOOST_TEST(g.tail<3>().minCoeff() == -osc_params.f_clamp_angular);
}

BOOST_AUTO_TEST_CASE(force_damping_opposes_the_motion) {
  OscParams osc_params;
  osc_params.force_damping.setConstant(8.0);
  OperationalSpace osc(osc_params, kAllForce, kPeriod);
  const Vec6 twist = random_vector<Vec6>(random, 0.3);
  const Vec6 f =
      osc.desired_acceleration(Vec3::Zero(), Mat3::Identity(), twist, Target{});
  BOOST_TEST((f + 8.0 * twist).norm() < 1e-12);
}

BOOST_AUTO_TEST_CASE(torque_depends_on_the_action_affinely) {
  const OperationalSpace osc(OscParams{}, kAllForce, kPeriod);
  for (int k = 0; k < kStates; ++k) {
    State state = draw();
    const Vec6 a = random_vector<Vec6>(random, 5.0);
    const Vec6 b = random_vector<Vec6>(random, 5.0);
    state.evaluate(osc, a);
    const Vec7 u_a = state.out.u0;
    state.evaluate(osc, b);
    const Vec7 u_b = state.out.u0;
    state.evaluate(osc, 0.5 * (a + b));
    BOOST_TEST((state.out.u0 - 0.5 * (u_a + u_b)).norm() < 1e-8);
  }
}

BOOST_AUTO_TEST_CASE(turning_the_base_turns_f_star_and_leaves_the_torques) {
  const OperationalSpace osc(OscParams{}, kAllForce, kPeriod);
  for (int k = 0; k < kStates; ++k) {
    const Vec7 q = random_vector(random, 2.9);
    const Vec7 dq = random_vector(random, 1.0);
    const Mat3 turn = about_z(random_vector<Vec3>(random, 3.0)[0]);
    ChainParams turned = params;
    turned.origin_position[0] = turn * params.origin_position[0];
    turned.origin_rotation[0] = turn * params.origin_rotation[0];
    const Vec6 f = random_vector<Vec6>(random, 5.0);
    Vec6 f_turned;
    f_turned << turn * f.head<3>(), turn * f.tail<3>();
    State here(params, q, dq), there(turned, q, dq);
    here.evaluate(osc, f);
    there.evaluate(osc, f_turned);
    BOOST_TEST((here.out.u0 - there.out.u0).norm() < 1e-7);
  }
}

BOOST_AUTO_TEST_CASE(scaling_all_masses_scales_the_torque) {
  const OperationalSpace osc(OscParams{}, kAllForce, kPeriod);
  ChainParams heavy = params;
  for (int i = 0; i < 7; ++i) {
    heavy.mass[i] *= 1.5;
    heavy.inertia[i] *= 1.5;
  }
  for (int k = 0; k < kStates; ++k) {
    const Vec7 q = random_vector(random, 2.9);
    State light(params, q, Vec7::Ones()), other(heavy, q, Vec7::Ones());
    light.evaluate(osc, Vec6::Ones());
    other.evaluate(osc, Vec6::Ones());
    if (!light.out.exact || !other.out.exact) continue;
    BOOST_TEST((other.out.u0 - 1.5 * light.out.u0).norm() < 1e-8);
  }
}

BOOST_AUTO_TEST_CASE(without_f_star_force_axes_never_add_power) {
  for (const TaskSpec& task : {kAllForce, kUsualTask}) {
    TaskSpec force_only = task;
    for (int i = 3; i < 6; ++i) {
      if (task[i] != kForce) force_only[i] = kFree;
    }
    const OperationalSpace osc(OscParams{}, force_only, kPeriod);
    for (int k = 0; k < kStates; ++k) {
      State state(params, random_vector(random, k % 2 ? 2.9 : 0.05),
                  random_vector(random, 1.0));
      state.evaluate(osc, Vec6::Zero());
      BOOST_TEST(state.dq.dot(state.out.u0) < 1e-9);
    }
  }
}

BOOST_AUTO_TEST_SUITE_END()
