#include <Eigen/Dense>
#include <bit>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "dovetail/saturation.hpp"

using namespace dovetail;

namespace {

constexpr int kSamples = 100000;

struct Case {
  Mat7 M, Minv;
  Vec7 a0, lb, ub;
};

double normal(std::mt19937_64& rng) { return std::normal_distribution<double>()(rng); }
double uniform(std::mt19937_64& rng, double a, double b) {
  return std::uniform_real_distribution<double>(a, b)(rng);
}

template <typename Matrix>
Matrix random_matrix(std::mt19937_64& rng) {
  return Matrix::NullaryExpr([&] { return normal(rng); });
}

/// Inertia of condition up to 3e3, bounds of which every tenth leaves no choice.
Case random_case(std::mt19937_64& rng) {
  Case c;
  const Eigen::HouseholderQR<Mat7> qr(random_matrix<Mat7>(rng));
  const Mat7 Q = qr.householderQ();
  const Vec7 s = Vec7::NullaryExpr([&] { return std::exp(uniform(rng, -6.2, 1.8)); });
  c.M = Q * s.asDiagonal() * Q.transpose();
  c.M = (0.5 * (c.M + c.M.transpose())).eval();
  c.Minv = c.M.inverse();
  c.Minv = (0.5 * (c.Minv + c.Minv.transpose())).eval();
  c.a0 = std::exp(uniform(rng, -1.0, 5.0)) * random_matrix<Vec7>(rng);
  for (int i = 0; i < 7; ++i) {
    const double a = uniform(rng, -15, 15);
    const double b = uniform(rng, 0, 1) < 0.1 ? a : uniform(rng, -15, 15);
    c.lb[i] = std::min(a, b);
    c.ub[i] = std::max(a, b);
  }
  return c;
}

bool in_box(const Case& c, const Vec7& a) {
  return (a.array() >= c.lb.array()).all() && (a.array() <= c.ub.array()).all();
}

/// Largest torque that pulls a held joint towards its limit: 0 at the projection.
double wrong_pull(const Case& c, const SaturationResult& result) {
  const Vec7 added = c.M * (result.a - c.a0);
  double worst = 0.0;
  for (int i = 0; i < 7; ++i) {
    if (result.upper >> i & 1) worst = std::max(worst, added[i]);
    if (result.lower >> i & 1) worst = std::max(worst, -added[i]);
  }
  return worst;
}

}  // namespace

BOOST_AUTO_TEST_CASE(sjs_is_in_the_box_after_at_most_eight_passes) {
  std::mt19937_64 rng(1);
  for (int k = 0; k < kSamples; ++k) {
    const Case c = random_case(rng);
    const SaturationResult result = sjs(c.a0, c.Minv, c.lb, c.ub);
    BOOST_REQUIRE(in_box(c, result.a));
    BOOST_REQUIRE(result.passes <= 8);
    const double scale = 1.0 + (c.M * (result.a - c.a0)).cwiseAbs().maxCoeff();
    for (int i = 0; i < 7; ++i) {
      if (result.upper >> i & 1) {
        BOOST_REQUIRE_EQUAL(result.a[i], c.ub[i]);
      } else if (result.lower >> i & 1) {
        BOOST_REQUIRE_EQUAL(result.a[i], c.lb[i]);
      } else {  // keeps its torque
        BOOST_REQUIRE_SMALL((c.M * (result.a - c.a0))[i] / scale, 1e-7);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(sjs_changes_no_bit_where_nothing_saturates_and_is_idempotent) {
  std::mt19937_64 rng(2);
  for (int k = 0; k < kSamples; ++k) {
    Case c = random_case(rng);
    const SaturationResult first = sjs(c.a0, c.Minv, c.lb, c.ub);
    const SaturationResult second = sjs(first.a, c.Minv, c.lb, c.ub);
    BOOST_REQUIRE((second.a.array() == first.a.array()).all());
    BOOST_REQUIRE_EQUAL(second.passes, 0);
  }
}

BOOST_AUTO_TEST_CASE(sjs_holds_all_joints_when_there_is_no_choice) {
  std::mt19937_64 rng(3);
  for (int k = 0; k < kSamples / 10; ++k) {
    Case c = random_case(rng);
    c.ub = c.lb;
    for (const auto& result :
         {sjs(c.a0, c.Minv, c.lb, c.ub), sjs_exact(c.a0, c.Minv, c.lb, c.ub)}) {
      BOOST_REQUIRE(result.ok);
      BOOST_REQUIRE((result.a.array() == c.lb.array()).all());
    }
  }
}

BOOST_AUTO_TEST_CASE(exact_is_the_projection_and_does_not_expand) {
  std::mt19937_64 rng(4);
  for (int k = 0; k < kSamples; ++k) {
    Case c = random_case(rng);
    const SaturationResult first = sjs_exact(c.a0, c.Minv, c.lb, c.ub);
    BOOST_REQUIRE(first.ok);
    BOOST_REQUIRE(in_box(c, first.a));
    const double scale = 1.0 + (c.M * (first.a - c.a0)).cwiseAbs().maxCoeff();
    BOOST_REQUIRE_SMALL(wrong_pull(c, first) / scale, 1e-7);
    const Vec7 change = std::exp(uniform(rng, -8, 3)) * random_matrix<Vec7>(rng);
    c.a0 += change;
    const Vec7 moved = sjs_exact(c.a0, c.Minv, c.lb, c.ub).a - first.a;
    BOOST_REQUIRE(moved.dot(c.M * moved) <=
                  change.dot(c.M * change) * (1.0 + 1e-6) + 1e-9);
  }
}

BOOST_AUTO_TEST_CASE(sjs_equals_exact_iff_every_added_torque_points_away) {
  std::mt19937_64 rng(5);
  int equal_count = 0, single_count = 0;
  for (int k = 0; k < kSamples; ++k) {
    Case c = random_case(rng);
    c.ub.array() += 1e-3;  // a joint without a choice serves both limits
    const SaturationResult greedy = sjs(c.a0, c.Minv, c.lb, c.ub);
    const Vec7 exact = sjs_exact(c.a0, c.Minv, c.lb, c.ub).a;
    const double distance = (greedy.a - exact).cwiseAbs().maxCoeff();
    const double wrong = wrong_pull(c, greedy);
    const int held = std::popcount(unsigned(greedy.upper | greedy.lower));
    if (held == 1) {
      BOOST_REQUIRE_SMALL(distance, 1e-6);
      ++single_count;
    }
    if (distance < 1e-9) {
      BOOST_REQUIRE_SMALL(wrong, 1e-5);
      ++equal_count;
    }
    if (wrong == 0.0) BOOST_REQUIRE_SMALL(distance, 1e-6);
  }
  BOOST_TEST(single_count > 100);
  BOOST_TEST(equal_count < kSamples);
}

BOOST_AUTO_TEST_CASE(scs_meets_its_rows_away_from_singularities) {
  std::mt19937_64 rng(6);
  for (int k = 0; k < kSamples; ++k) {
    const Case c = random_case(rng);
    const Mat37 Jc = 0.5 * random_matrix<Mat37>(rng);
    const Vec3 djc = random_matrix<Vec3>(rng);
    const Vec3 cl = -5.0 * random_matrix<Vec3>(rng).cwiseAbs();
    const Vec3 cu = 5.0 * random_matrix<Vec3>(rng).cwiseAbs();
    const SaturationResult result = scs(c.a0, c.Minv, Jc, djc, cl, cu, 1e-3);
    BOOST_REQUIRE(result.passes <= 3);
    const Mat3 mobility = Jc * c.Minv * Jc.transpose();
    if (Eigen::SelfAdjointEigenSolver<Mat3>(mobility).eigenvalues()[0] < 2e-3) continue;
    const Vec3 row = Jc * result.a + djc;
    for (int i = 0; i < 3; ++i) {
      BOOST_REQUIRE_SMALL(std::max({row[i] - cu[i], cl[i] - row[i], 0.0}), 1e-6);
      if (result.upper >> i & 1) BOOST_REQUIRE_SMALL(row[i] - cu[i], 1e-6);
    }
    if (result.passes == 0) BOOST_REQUIRE((result.a.array() == c.a0.array()).all());
  }
}

BOOST_AUTO_TEST_CASE(scs_stays_bounded_at_singularities) {
  std::mt19937_64 rng(7);
  for (int k = 0; k < kSamples / 10; ++k) {
    const Case c = random_case(rng);
    Mat37 Jc = 0.5 * random_matrix<Mat37>(rng);
    Jc.row(2) = Jc.row(0) * uniform(rng, -1, 1) + 1e-6 * Jc.row(2);
    if (k % 2) Jc.row(1).setZero();
    const Vec3 cu = Vec3::Constant(-1.0);
    const SaturationResult result =
        scs(c.a0, c.Minv, Jc, Vec3::Zero(), Vec3::Constant(-9.0), cu, 1e-3);
    BOOST_REQUIRE(result.a.allFinite());
    // Faded inverse: at most |error| 1.2 / s0 of force.
    const double force = 1.2e3 * 2.0 * (Jc * c.a0 - cu).norm();
    const double gain = (c.Minv * Jc.transpose()).norm();
    BOOST_REQUIRE((result.a - c.a0).norm() <= gain * force);
  }
}

BOOST_AUTO_TEST_CASE(torque_and_box_hold_together_where_the_safe_action_is_feasible) {
  std::mt19937_64 rng(8);
  for (int k = 0; k < kSamples; ++k) {
    const Case c = random_case(rng);
    const Vec7 a_safe = Vec7::Zero().cwiseMax(c.lb).cwiseMin(c.ub);
    const SaturationResult box = sjs(c.a0, c.Minv, c.lb, c.ub);
    const Vec7 h = 5.0 * random_matrix<Vec7>(rng);
    const Vec7 tau_safe = c.M * a_safe + h;
    Vec7 lo, hi;
    for (int i = 0; i < 7; ++i) {
      lo[i] = tau_safe[i] - std::exp(uniform(rng, -3, 4));
      hi[i] = tau_safe[i] + std::exp(uniform(rng, -3, 4));
    }
    const TorqueBlend blend = blend_torque(box.a, a_safe, c.M, h, lo, hi);
    BOOST_REQUIRE(!blend.unsafe);
    BOOST_REQUIRE(((blend.a - c.ub).array() <= 1e-12).all());
    BOOST_REQUIRE(((c.lb - blend.a).array() <= 1e-12).all());
    BOOST_REQUIRE((blend.tau.array() <= hi.array()).all());
    BOOST_REQUIRE((blend.tau.array() >= lo.array()).all());
    // The torque sent is the one of the acceleration reported.
    BOOST_REQUIRE_SMALL((c.M * blend.a + h - blend.tau).cwiseAbs().maxCoeff(), 1e-8);
    const Vec7 end = c.M * box.a + h;
    const bool is_free =
        (end.array() <= hi.array()).all() && (end.array() >= lo.array()).all();
    BOOST_REQUIRE_EQUAL(is_free, blend.share == 1.0 && blend.limited == 0);
    if (!is_free) {  // as far as it goes: one joint is at its limit
      const double room =
          std::min((hi - blend.tau).minCoeff(), (blend.tau - lo).minCoeff());
      BOOST_REQUIRE_SMALL(room, 1e-8);
    }
  }
}

BOOST_AUTO_TEST_CASE(an_infeasible_safe_action_is_clipped_and_reported) {
  std::mt19937_64 rng(9);
  const Case c = random_case(rng);
  const Vec7 lo = Vec7::Constant(10.0), hi = Vec7::Constant(20.0);
  const TorqueBlend blend = blend_torque(c.a0, Vec7::Zero(), c.M, Vec7::Zero(), lo, hi);
  BOOST_TEST(blend.unsafe);
  BOOST_TEST((blend.tau.array() >= 10.0).all());
  BOOST_TEST((blend.tau.array() <= 20.0).all());
}
