#include <boost/test/unit_test.hpp>
#include <cmath>

#include "dovetail/part_joint.hpp"

using dovetail::PartJoint;

namespace {

constexpr double kTiny = 1e-12;

PartJoint sprung() { return {200.0, -0.01, 3.0, 0.5, {{0.02, 5.0, 0.004}}}; }

}  // namespace

BOOST_AUTO_TEST_CASE(a_spring_pulls_to_its_rest) {
  BOOST_TEST(std::abs(sprung().force(0.0) + 2.0) < kTiny);
  BOOST_TEST(std::abs(sprung().force(-0.01)) < kTiny);
  BOOST_TEST(sprung().slope(0.0) == 200.0);
}

BOOST_AUTO_TEST_CASE(a_detent_holds_with_its_force_half_way_to_its_end) {
  const PartJoint joint = sprung();
  BOOST_TEST(std::abs(joint.force(0.022) + 200.0 * 0.032 + 5.0) < kTiny);
  BOOST_TEST(std::abs(joint.force(0.018) + 200.0 * 0.028 - 5.0) < kTiny);
  BOOST_TEST(std::abs(joint.force(0.024) + 200.0 * 0.034) < kTiny);
}

BOOST_AUTO_TEST_CASE(the_slope_is_the_forces_derivative_and_never_negative) {
  const PartJoint joint = sprung();
  const double d = 1e-7;
  for (const double q : {0.01, 0.0195, 0.02, 0.021}) {
    const double slope = (joint.force(q - d) - joint.force(q + d)) / (2.0 * d);
    BOOST_TEST(std::abs(joint.slope(q) - slope) < 1e-4 * std::abs(slope));
  }
  BOOST_TEST(joint.slope(0.0235) == 0.0);
}

BOOST_AUTO_TEST_CASE(implicit_damping_adds_the_stiffness_over_a_step) {
  BOOST_TEST(std::abs(sprung().implicit_damping(0.0, 0.002) - 3.4) < kTiny);
}
