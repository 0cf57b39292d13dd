#include <boost/test/unit_test.hpp>

#include "arm.hpp"
#include "dovetail/rigid_plant.hpp"

using namespace dovetail;
using namespace dovetail::testing;

BOOST_AUTO_TEST_CASE(compensated_arm_without_friction_keeps_its_kinetic_energy) {
  const ChainParams chain = iiwa14_with_tool();
  RigidPlant plant(chain, chain, {});
  std::mt19937_64 random(1);
  plant.reset(random_vector(random, 1.0), random_vector(random, 1.0));
  const double before = plant.kinetic_energy();
  plant.apply(Vec7::Zero(), 1.0);
  BOOST_TEST(std::abs(plant.kinetic_energy() / before - 1.0) < 1e-7);
}

BOOST_AUTO_TEST_CASE(arm_at_rest_stays_at_rest) {
  const ChainParams chain = iiwa14_with_tool();
  RigidPlant plant(chain, chain, {});
  plant.reset(tool_down_posture(), Vec7::Zero());
  plant.apply(Vec7::Zero(), 1.0);
  BOOST_TEST((plant.q() - tool_down_posture()).norm() < 1e-9);
}

BOOST_AUTO_TEST_CASE(torque_does_the_work_that_appears_as_kinetic_energy) {
  const ChainParams chain = iiwa14_with_tool();
  RigidPlant plant(chain, chain, {});
  std::mt19937_64 random(2);
  plant.reset(tool_down_posture(), Vec7::Zero());
  const Vec7 tau = random_vector(random, 3.0);
  plant.apply(tau, 0.3);  // constant torque: work = tau . (q1 - q0)
  const double work = tau.dot(plant.q() - tool_down_posture());
  BOOST_TEST(std::abs(plant.kinetic_energy() / work - 1.0) < 1e-6);
}

BOOST_AUTO_TEST_CASE(friction_brings_the_arm_to_rest) {
  const ChainParams chain = iiwa14_with_tool();
  PlantParams params;
  params.damping.setConstant(2.0);
  params.coulomb.setConstant(0.3);
  params.armature.setConstant(0.1);
  RigidPlant plant(chain, chain, params);
  plant.reset(tool_down_posture(), Vec7::Constant(0.5));
  plant.apply(Vec7::Zero(), 5.0);
  BOOST_TEST(plant.dq().norm() < 1e-3);
}

BOOST_AUTO_TEST_CASE(external_force_acts_through_the_jacobian) {
  const ChainParams params = iiwa14_with_tool();
  RigidPlant plant(params, params, {});
  const Vec7 q = tool_down_posture();
  ChainTerms terms;
  Chain(params).evaluate(q, Vec7::Zero(), terms);
  const Vec3 f(3.0, -2.0, 1.0);
  const Vec7 balance = -terms.J.topRows<3>().transpose() * f;
  plant.set_external_force(f);
  BOOST_TEST(plant.acceleration(q, Vec7::Zero(), balance).norm() < 1e-9);
  BOOST_TEST(plant.acceleration(q, Vec7::Zero(), Vec7::Zero()).norm() > 0.1);
}

BOOST_AUTO_TEST_CASE(uncompensated_mass_makes_the_arm_fall) {
  const ChainParams nominal = iiwa14_with_tool();
  ChainParams heavy = nominal;
  heavy.mass[6] += 1.0;
  RigidPlant plant(nominal, heavy, {});
  plant.reset(tool_down_posture(), Vec7::Zero());
  Vec3 before, after;
  Mat3 R;
  Chain(heavy).pose(plant.q(), before, R);
  plant.apply(Vec7::Zero(), 0.1);
  Chain(heavy).pose(plant.q(), after, R);
  BOOST_TEST(after.z() < before.z() - 1e-3);
}
