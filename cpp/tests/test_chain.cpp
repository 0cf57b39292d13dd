#include <boost/test/unit_test.hpp>

#include "arm.hpp"
#include "dovetail/chain.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr int kStates = 50;
constexpr double kStep = 1e-6;  // of the finite differences [rad]

Eigen::Isometry3d link_pose(const ChainParams& params, const Vec7& q, int link) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (int i = 0; i <= link; ++i) {
    T.translate(params.origin_position[i]);
    T.rotate(params.origin_rotation[i]);
    T.rotate(Eigen::AngleAxisd(q[i], Vec3::UnitZ()));
  }
  return T;
}

/// Jacobians of a link's centre of mass by central differences.
void com_jacobians(const ChainParams& params, const Vec7& q, int link, Mat37& Jv,
                   Mat37& Jw) {
  for (int j = 0; j < 7; ++j) {
    Vec7 step = Vec7::Zero();
    step[j] = kStep;
    const auto ahead = link_pose(params, q + step, link);
    const auto behind = link_pose(params, q - step, link);
    Jv.col(j) = (ahead * params.com[link] - behind * params.com[link]) / (2 * kStep);
    const Eigen::AngleAxisd turn(Mat3(ahead.linear() * behind.linear().transpose()));
    Jw.col(j) = turn.axis() * turn.angle() / (2 * kStep);
  }
}

Mat7 inertia_from_energy(const ChainParams& params, const Vec7& q) {
  Mat7 M = Mat7::Zero();
  for (int link = 0; link < 7; ++link) {
    Mat37 Jv, Jw;
    com_jacobians(params, q, link, Jv, Jw);
    const Mat3 R = link_pose(params, q, link).linear();
    M += params.mass[link] * Jv.transpose() * Jv;
    M += Jw.transpose() * R * params.inertia[link] * R.transpose() * Jw;
  }
  return M;
}

double potential_energy(const ChainParams& params, const Vec7& q) {
  double energy = 0.0;
  for (int link = 0; link < 7; ++link) {
    energy -= params.mass[link] *
              params.gravity.dot(link_pose(params, q, link) * params.com[link]);
  }
  return energy;
}

ChainTerms at(const Chain& chain, const Vec7& q, const Vec7& dq) {
  ChainTerms terms;
  chain.evaluate(q, dq, terms);
  return terms;
}

struct RandomStates {
  ChainParams params = iiwa14_with_tool();
  Chain chain{params};
  std::mt19937_64 random{7};
  Vec7 q, dq;

  void draw() {
    q = random_vector(random, 2.9);
    dq = random_vector(random, 2.0);
  }
};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(the_chain, RandomStates)

BOOST_AUTO_TEST_CASE(pose_is_the_product_of_the_joint_transforms) {
  for (int k = 0; k < kStates; ++k) {
    draw();
    const Eigen::Isometry3d T = link_pose(params, q, 6);
    Vec3 p;
    Mat3 R;
    chain.pose(q, p, R);
    BOOST_TEST((p - T * params.tool_position).norm() < 1e-12);
    BOOST_TEST((R - T.linear() * params.tool_rotation).norm() < 1e-12);
    const ChainTerms terms = at(chain, q, dq);
    BOOST_TEST((terms.p - p).norm() < 1e-12);
    BOOST_TEST((terms.R - R).norm() < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(jacobian_matches_finite_differences) {
  for (int k = 0; k < kStates; ++k) {
    draw();
    const Mat67 J = at(chain, q, dq).J;
    for (int j = 0; j < 7; ++j) {
      Vec7 step = Vec7::Zero();
      step[j] = kStep;
      const ChainTerms ahead = at(chain, q + step, dq);
      const ChainTerms behind = at(chain, q - step, dq);
      const Eigen::AngleAxisd turn(Mat3(ahead.R * behind.R.transpose()));
      Vec6 column;
      column << (ahead.p - behind.p), turn.axis() * turn.angle();
      BOOST_TEST((J.col(j) - column / (2 * kStep)).norm() < 1e-7);
    }
  }
}

BOOST_AUTO_TEST_CASE(bias_acceleration_matches_finite_differences) {
  for (int k = 0; k < kStates; ++k) {
    draw();
    const Vec6 ahead = at(chain, q + kStep * dq, dq).J * dq;
    const Vec6 behind = at(chain, q - kStep * dq, dq).J * dq;
    const Vec6 expected = (ahead - behind) / (2 * kStep);
    BOOST_TEST((at(chain, q, dq).dJdq - expected).norm() < 1e-6);
  }
}

BOOST_AUTO_TEST_CASE(inertia_matches_the_kinetic_energy_of_the_links) {
  for (int k = 0; k < kStates; ++k) {
    draw();
    const Mat7 M = at(chain, q, dq).M;
    BOOST_TEST((M - inertia_from_energy(params, q)).norm() < 1e-6);
    BOOST_TEST((M - M.transpose()).norm() == 0.0);
  }
}

BOOST_AUTO_TEST_CASE(gravity_is_the_gradient_of_the_potential_energy) {
  for (int k = 0; k < kStates; ++k) {
    draw();
    const Vec7 g = at(chain, q, dq).g;
    for (int j = 0; j < 7; ++j) {
      Vec7 step = Vec7::Zero();
      step[j] = 1e-5;
      const double rise =
          potential_energy(params, q + step) - potential_energy(params, q - step);
      BOOST_TEST(std::abs(g[j] - rise / 2e-5) < 1e-6);
    }
  }
}

BOOST_AUTO_TEST_CASE(coriolis_torque_matches_the_christoffel_symbols) {
  for (int k = 0; k < kStates; ++k) {
    draw();
    // c = dM/dt dq - 1/2 d(dq^T M dq)/dq
    const auto inertia = [&](const Vec7& at_q) { return at(chain, at_q, dq).M; };
    Vec7 c = (inertia(q + kStep * dq) - inertia(q - kStep * dq)) * dq / (2 * kStep);
    for (int j = 0; j < 7; ++j) {
      Vec7 step = Vec7::Zero();
      step[j] = kStep;
      c[j] -= dq.dot((inertia(q + step) - inertia(q - step)) * dq) / (4 * kStep);
    }
    BOOST_TEST((at(chain, q, dq).c - c).norm() < 1e-6);
  }
}

BOOST_AUTO_TEST_CASE(tool_motion_agrees_with_all_terms) {
  for (int k = 0; k < kStates; ++k) {
    draw();
    const ChainTerms terms = at(chain, q, dq);
    ToolMotion motion;
    chain.tool_motion(q, dq, motion);
    BOOST_TEST((motion.p - terms.p).norm() < 1e-12);
    BOOST_TEST((motion.R - terms.R).norm() < 1e-12);
    BOOST_TEST((motion.twist - terms.J * dq).norm() < 1e-12);
    BOOST_TEST((motion.g - terms.g).norm() < 1e-11);
  }
}

BOOST_AUTO_TEST_SUITE_END()
