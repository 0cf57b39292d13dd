#include <boost/test/unit_test.hpp>

#include "arm.hpp"
#include "dovetail/contact_approach.hpp"
#include "dovetail/walls.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

constexpr double kPeriod = 0.001;  // [s]

/// The arm at rest, tool down, over a near plane.
struct Approach {
  RestingArm arm;
  Chain chain{arm.chain};
  LimitParams limits = limits_for(kPeriod);
  OperationalSpace osc{OscParams{}, kUsualTask, kPeriod};
  CycleModel model;
  CycleBounds bounds{limits, kPeriod};

  Approach() {
    limits.near_speed = 0.02;
    limits.near_press = 2.0;
    model.update(chain, limits, kPeriod, arm.q, Vec7::Zero(), Vec7::Zero());
    put_plane(0.0);
  }

  /// The near plane lies `below` [m] under the tool.
  void put_plane(double below) {
    arm.target.near_plane = Vec4(0.0, 0.0, 1.0, arm.p[2] - below);
  }

  FStarCut cut(Vec6& f_star) {
    Walls walls(limits);
    walls.update(model.tool.p, kPeriod);
    bounds.update(limits, model, walls, arm.q, Vec7::Zero(), false);
    return ContactApproach(limits, kPeriod)
        .cut(arm.target, model, osc, bounds, walls, f_star);
  }
};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(contact_approach, Approach)

BOOST_AUTO_TEST_CASE(a_press_beyond_near_press_is_excess_below_the_plane_alone) {
  const ContactApproach approach(limits, kPeriod);
  arm.target.f_star[2] = -5.0;
  put_plane(-0.001);
  BOOST_TEST(std::abs(approach.excess_press(arm.target, model.tool) - 3.0) < 1e-9);
  put_plane(0.001);  // half of the band
  BOOST_TEST(std::abs(approach.excess_press(arm.target, model.tool) - 1.5) < 1e-9);
  put_plane(0.01);
  BOOST_TEST(approach.excess_press(arm.target, model.tool) == 0.0);
  put_plane(-0.001);
  arm.target.f_tare[2] = -4.0;  // holds weight
  BOOST_TEST(approach.excess_press(arm.target, model.tool) == 0.0);
}

BOOST_AUTO_TEST_CASE(near_contact_f_star_is_cut_to_near_speed_within_50_ms) {
  put_plane(-0.001);
  Vec6 f_star = Vec6::Zero();
  f_star[2] = -4.0;
  const FStarCut cut = this->cut(f_star);
  BOOST_TEST(cut.near == 1U << 2);
  const Vec3 drift = -(model.terms.J.topRows<3>() * (model.Minv * model.h)).eval() +
                     model.terms.dJdq.head<3>();
  BOOST_TEST(std::abs(f_star[2] + drift[2] + limits.near_speed / 0.05) < 1e-9);
  BOOST_TEST(f_star.head<2>().norm() == 0.0);
}

BOOST_AUTO_TEST_CASE(far_from_contact_nothing_is_cut) {
  put_plane(0.15);
  Vec6 f_star = Vec6::Zero();
  f_star[2] = -4.0;
  const FStarCut cut = this->cut(f_star);
  BOOST_TEST((cut.near | cut.upper | cut.lower) == 0U);
  BOOST_TEST(f_star[2] == -4.0);
  BOOST_TEST(cut.push.norm() == 0.0);
}

BOOST_AUTO_TEST_CASE(walls_begin_at_a_tool_outside_and_come_in) {
  limits.x_min[2] = arm.p[2] + 0.01;
  Walls walls(limits);
  walls.update(arm.p, kPeriod);
  BOOST_TEST(walls.is_widened());
  BOOST_TEST(walls.min()[2] == arm.p[2] - limits.delta_x);
  for (int k = 0; k < 1000; ++k) walls.update(arm.p, kPeriod);
  BOOST_TEST(!walls.is_widened());
  BOOST_TEST(walls.min()[2] == limits.x_min[2]);
}

BOOST_AUTO_TEST_SUITE_END()
