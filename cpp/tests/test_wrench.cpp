#include <Eigen/Eigenvalues>
#include <boost/test/unit_test.hpp>
#include <random>

#include "adversary.hpp"
#include "dovetail/controller.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kPeriod = 0.001;

struct Resting : RestingArm {
  LimitParams limits = limits_for(kPeriod);
};

Controller make_controller(const LimitParams& limits) {
  return {iiwa14_with_tool(), OscParams{}, limits, kUsualTask, kPeriod};
}

}  // namespace

BOOST_FIXTURE_TEST_SUITE(wrench, Resting)

BOOST_AUTO_TEST_CASE(a_wrench_comes_back_from_its_torques_wherever_the_arm_can_move) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> part(-1.0, 1.0);
  Controller controller = make_controller(limits);
  int regular = 0;
  for (int k = 0; k < 500; ++k) {
    Vec7 at = q;
    if (k > 0) {
      for (double& angle : at) angle = 1.5 * part(generator);
    }
    controller.reset(at, p, quat);
    ChainTerms terms;
    Chain(chain).evaluate(at, Vec7::Zero(), terms);
    Vec6 given;
    for (double& number : given) number = 30.0 * part(generator);
    const Vec6 back = controller.wrench(terms.J.transpose() * given);
    // The torques say nothing of a direction in which the arm cannot move.
    Mat67 J = terms.J;
    J.bottomRows<3>() *= 0.15;
    const Mat6 A = J * controller.inverse_inertia() * J.transpose();
    const double least = Eigen::SelfAdjointEigenSolver<Mat6>(A).eigenvalues()[0];
    if (least < 0.01) continue;
    ++regular;
    BOOST_TEST((back - given).norm() < 1e-9);
  }
  BOOST_TEST(regular > 250);
}

BOOST_AUTO_TEST_CASE(a_stretched_arm_has_a_finite_wrench_and_no_estimate_has_none) {
  Controller stretched = make_controller(limits);
  stretched.reset(Vec7::Zero(), p, quat);
  const Vec7 torques = Vec7::Constant(10.0);
  const Vec6 wrench = stretched.wrench(torques);
  BOOST_TEST(wrench.allFinite());
  BOOST_TEST(wrench.norm() < 1e3);
  BOOST_TEST(stretched.wrench(Vec7::Constant(kUnset)).hasNaN());
  LimitParams off = limits;
  off.estimate_rate = 0.0;
  Controller blind = make_controller(off);
  blind.reset(q, p, quat);
  static_cast<void>(blind.step(q, Vec7::Zero(), target));
  BOOST_TEST(blind.wrench().array().isNaN().all());
}

BOOST_AUTO_TEST_SUITE_END()
