#include <Eigen/Dense>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "dovetail/qp.hpp"
#include "dovetail/saturation.hpp"

using namespace dovetail;

namespace {

struct Problem {
  Mat7 M, Minv;
  Vec7 a0, lb, ub, h, lo, hi;
  Mat37 Jc;
  Vec3 djc, cl, cu;
  double rho = 1e6;
  int max_iter = 100;

  [[nodiscard]] QpProblem view() const {
    return {M, Minv, a0, lb, ub, Jc, djc, cl, cu, h, lo, hi, rho, max_iter};
  }
};

double normal(std::mt19937_64& rng) { return std::normal_distribution<double>()(rng); }
double uniform(std::mt19937_64& rng, double a, double b) {
  return std::uniform_real_distribution<double>(a, b)(rng);
}

template <typename Matrix>
Matrix random_matrix(std::mt19937_64& rng) {
  return Matrix::NullaryExpr([&] { return normal(rng); });
}

/// Inertia with the spread of an arm's: eigenvalues from 0.002 to 6 kg m2.
Mat7 random_inertia(std::mt19937_64& rng) {
  const Eigen::HouseholderQR<Mat7> qr(random_matrix<Mat7>(rng));
  const Mat7 Q = qr.householderQ();
  const Vec7 s = Vec7::NullaryExpr([&] { return std::exp(uniform(rng, -6.2, 1.8)); });
  const Mat7 M = Q * s.asDiagonal() * Q.transpose();
  return 0.5 * (M + M.transpose());
}

/// `tightness` 0: torque rows wide; 1: they cut; they contain a box point either way.
Problem random_problem(std::mt19937_64& rng, double tightness) {
  Problem p;
  p.M = random_inertia(rng);
  p.Minv = p.M.inverse();
  p.Minv = (0.5 * (p.Minv + p.Minv.transpose())).eval();
  const double reach = std::exp(uniform(rng, -1.0, 5.0));
  p.a0 = reach * random_matrix<Vec7>(rng);
  p.Jc = 0.5 * random_matrix<Mat37>(rng);
  p.djc = random_matrix<Vec3>(rng);
  p.h = 5.0 * random_matrix<Vec7>(rng);
  for (int i = 0; i < 7; ++i) {
    const double a = uniform(rng, -15.0, 15.0);
    const double b = uniform(rng, 0, 1) < 0.1 ? a : uniform(rng, -15.0, 15.0);
    p.lb[i] = std::min(a, b);
    p.ub[i] = std::max(a, b);
  }
  for (int i = 0; i < 3; ++i) {
    const double a = uniform(rng, -8, 5), b = uniform(rng, -8, 5);
    p.cl[i] = std::min(a, b);
    p.cu[i] = uniform(rng, 0, 1) < 0.1 ? std::numeric_limits<double>::infinity()
                                       : std::max(a, b);
  }
  Vec7 inside;
  for (int i = 0; i < 7; ++i) inside[i] = uniform(rng, p.lb[i], p.ub[i] + 1e-300);
  const Vec7 tau = p.M * inside + p.h;
  for (int i = 0; i < 7; ++i) {
    const double width = tightness > 0 ? std::exp(uniform(rng, -6, 3)) : 1e3;
    p.lo[i] = tau[i] - width;
    p.hi[i] = tau[i] + std::exp(uniform(rng, -6, 3)) + (tightness > 0 ? 0 : 1e3);
  }
  return p;
}

struct Row {
  Eigen::RowVectorXd normal;  // over (a, s)
  double bound;
  double side;  // +1 upper, -1 lower
};

/// Worst failure of the optimality conditions, from the reported active set alone, over
/// the tolerance 1e-5 + 1e-10 times the multipliers (1e8 where walls and box conflict).
/// Multipliers and point come from an independent dense solve of the KKT system.
double kkt_failure(const Problem& p, const QpResult& result) {
  std::vector<Row> rows;
  const auto push = [&](const Eigen::RowVectorXd& g, int slack, double b, double side) {
    Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(10);
    row.head(7) = g;
    if (slack >= 0) row[7 + slack] = -side / std::sqrt(p.rho);
    rows.push_back({row, b, side});
  };
  const Vec7 tau = p.M * result.a + p.h;
  for (int i = 0; i < 7; ++i) {
    const Eigen::RowVectorXd e = Vec7::Unit(i).transpose();
    if (result.upper >> i & 1) push(e, -1, p.ub[i], 1);
    if (result.lower >> i & 1) push(e, -1, p.lb[i], -1);
    if (result.torque >> i & 1) {
      const bool is_upper = std::abs(tau[i] - p.hi[i]) < std::abs(tau[i] - p.lo[i]);
      push(p.M.row(i), -1, (is_upper ? p.hi[i] : p.lo[i]) - p.h[i], is_upper ? 1 : -1);
    }
  }
  for (int i = 0; i < 3; ++i) {
    if (result.wall_upper >> i & 1) push(p.Jc.row(i), i, p.cu[i] - p.djc[i], 1);
    if (result.wall_lower >> i & 1) push(p.Jc.row(i), i, p.cl[i] - p.djc[i], -1);
  }
  const int count = static_cast<int>(rows.size());
  Eigen::MatrixXd kkt = Eigen::MatrixXd::Zero(10 + count, 10 + count);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(10 + count);
  kkt.topLeftCorner<7, 7>() = p.M;
  kkt.block<3, 3>(7, 7).setIdentity();  // over s sqrt(rho)
  right.head<7>() = p.M * p.a0;
  for (int i = 0; i < count; ++i) {
    kkt.row(10 + i).head(10) = rows[i].normal;
    kkt.col(10 + i).head(10) = rows[i].normal.transpose();
    right[10 + i] = rows[i].bound;
  }
  Eigen::FullPivLU<Eigen::MatrixXd> lu(kkt);
  lu.setThreshold(1e-15);
  const Eigen::VectorXd solution = lu.solve(right);
  const double scale = 1.0 + solution.tail(count).cwiseAbs().sum();
  double failure = (solution.head<7>() - result.a).cwiseAbs().maxCoeff();
  for (int i = 0; i < count; ++i) {
    failure = std::max(failure, -rows[i].side * solution[10 + i] / scale);
  }
  const Vec3 slack = solution.segment<3>(7).cwiseAbs() / std::sqrt(p.rho);
  const Vec3 wall = p.Jc * result.a + p.djc;
  failure =
      std::max({failure, (result.a - p.ub).maxCoeff(), (p.lb - result.a).maxCoeff(),
                (tau - p.hi).maxCoeff(), (p.lo - tau).maxCoeff(),
                (wall - p.cu - slack).maxCoeff(), (p.cl - wall - slack).maxCoeff()});
  return failure / (1e-5 + 1e-10 * scale);
}

bool in_box(const Problem& p, const Vec7& a) {
  return (a.array() >= p.lb.array()).all() && (a.array() <= p.ub.array()).all();
}

}  // namespace

BOOST_AUTO_TEST_CASE(answer_meets_the_optimality_conditions) {
  std::mt19937_64 rng(1);
  double worst = 0.0;
  int iterations_max = 0;
  for (int k = 0; k < 40000; ++k) {
    const Problem p = random_problem(rng, k % 2);
    const QpResult result = solve_qp(p.view());
    BOOST_REQUIRE_MESSAGE(result.ok, "problem " << k);
    BOOST_REQUIRE_MESSAGE(!result.unsafe, "problem " << k);
    BOOST_REQUIRE(in_box(p, result.a));
    const double failure = kkt_failure(p, result);
    worst = std::max(worst, failure);
    BOOST_REQUIRE_MESSAGE(failure < 1.0, "problem " << k << " by " << failure);
    iterations_max = std::max(iterations_max, result.iterations);
  }
  BOOST_TEST_MESSAGE("worst " << worst << ", iterations " << iterations_max);
}

BOOST_AUTO_TEST_CASE(identity_when_nothing_is_in_the_way) {
  std::mt19937_64 rng(2);
  Problem p = random_problem(rng, 0);
  p.a0 = 0.5 * (p.lb + p.ub);
  p.cl.setConstant(-1e3);
  p.cu.setConstant(1e3);
  const QpResult result = solve_qp(p.view());
  BOOST_TEST(result.ok);
  BOOST_TEST(result.iterations == 0);
  BOOST_TEST((result.a.array() == p.a0.array()).all());
}

BOOST_AUTO_TEST_CASE(equals_the_exact_saturation_when_only_the_box_acts) {
  std::mt19937_64 rng(3);
  for (int k = 0; k < 20000; ++k) {
    Problem p = random_problem(rng, 0);
    p.cl.setConstant(-std::numeric_limits<double>::infinity());
    p.cu = -p.cl;
    const QpResult result = solve_qp(p.view());
    const SaturationResult exact = sjs_exact(p.a0, p.Minv, p.lb, p.ub);
    BOOST_REQUIRE(result.ok && exact.ok);
    BOOST_REQUIRE_SMALL((result.a - exact.a).cwiseAbs().maxCoeff(), 1e-7);
  }
}

BOOST_AUTO_TEST_CASE(box_wins_over_walls_and_the_conflict_is_reported) {
  std::mt19937_64 rng(4);
  for (int k = 0; k < 5000; ++k) {
    Problem p = random_problem(rng, 0);
    p.cu = p.djc.array() +
           (p.Jc.cwiseAbs() * p.lb.cwiseAbs().cwiseMax(p.ub.cwiseAbs())).array() + 1.0;
    p.cu = -p.cu;  // beyond what the box can reach
    p.cu += 2.0 * p.djc;
    p.cl.setConstant(-1e9);
    const QpResult result = solve_qp(p.view());
    BOOST_REQUIRE(result.ok);
    BOOST_REQUIRE(in_box(p, result.a));
    BOOST_REQUIRE_EQUAL(int(result.wall_displaced), 7);
    BOOST_REQUIRE_SMALL(kkt_failure(p, result), 1.0);
  }
}

BOOST_AUTO_TEST_CASE(infeasible_torque_rows_leave_the_box_and_are_unsafe) {
  std::mt19937_64 rng(5);
  for (int k = 0; k < 20000; ++k) {
    Problem p = random_problem(rng, 0);
    const int joint = k % 7;
    // Beyond the largest torque that the box can give this joint.
    double reach = p.h[joint];
    for (int i = 0; i < 7; ++i) {
      reach += std::max(p.M(joint, i) * p.lb[i], p.M(joint, i) * p.ub[i]);
    }
    p.cl.setConstant(-std::numeric_limits<double>::infinity());
    p.cu = -p.cl;
    p.lo[joint] = reach + uniform(rng, 0.01, 5.0);
    p.hi[joint] = p.lo[joint] + 1.0;
    const QpResult result = solve_qp(p.view());
    BOOST_REQUIRE_MESSAGE(result.ok, "problem " << k);
    BOOST_REQUIRE(result.unsafe);
    BOOST_REQUIRE(in_box(p, result.a));
    // As near as the box allows, up to the weight of the other goals.
    BOOST_REQUIRE_SMALL(reach - result.tau[joint], 1e-2 * (1.0 + p.a0.norm()));
  }
}

BOOST_AUTO_TEST_CASE(torque_rows_wholly_random_never_leave_the_box) {
  std::mt19937_64 rng(6);
  int unsafe = 0, stopped = 0;
  for (int k = 0; k < 40000; ++k) {
    Problem p = random_problem(rng, 1);
    for (int i = 0; i < 7; ++i) {
      p.lo[i] = uniform(rng, -20, 15);
      p.hi[i] = p.lo[i] + (i % 3 == 0 ? 0.0 : uniform(rng, 0, 10));
    }
    const QpResult result = solve_qp(p.view());
    BOOST_REQUIRE(in_box(p, result.a));
    unsafe += result.unsafe;
    stopped += !result.ok;
  }
  BOOST_TEST(unsafe > 1000);
  BOOST_TEST(stopped == 0);
}

BOOST_AUTO_TEST_CASE(stopped_early_the_answer_is_in_the_box_and_flagged) {
  std::mt19937_64 rng(7);
  int stopped = 0;
  for (int k = 0; k < 40000; ++k) {
    Problem p = random_problem(rng, k % 2);
    p.max_iter = k % 5;
    const QpResult result = solve_qp(p.view());
    BOOST_REQUIRE(result.iterations <= p.max_iter);
    BOOST_REQUIRE(in_box(p, result.a));
    stopped += !result.ok;
    // clip(0) inside the torque rows: the safe answer is, too.
    const Vec7 tau_zero = p.M * Vec7(Vec7::Zero().cwiseMax(p.lb).cwiseMin(p.ub)) + p.h;
    const bool is_zero_safe = (tau_zero.array() <= p.hi.array()).all() &&
                              (tau_zero.array() >= p.lo.array()).all();
    if (is_zero_safe) BOOST_REQUIRE(!result.unsafe);
  }
  BOOST_TEST(stopped > 1000);
}

BOOST_AUTO_TEST_CASE(non_finite_input_gives_the_safe_answer) {
  std::mt19937_64 rng(8);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (int joint = 0; joint < 7; ++joint) {
      Problem p = random_problem(rng, 1);
      p.a0[joint] = bad;
      const QpResult result = solve_qp(p.view());
      BOOST_TEST(!result.ok);
      BOOST_TEST(in_box(p, result.a));
    }
  }
}

BOOST_AUTO_TEST_CASE(locked_joints_and_torque_rows_at_the_only_point) {
  std::mt19937_64 rng(9);
  for (int k = 0; k < 5000; ++k) {
    Problem p = random_problem(rng, 0);
    p.ub = p.lb;  // one point left
    p.lo = p.M * p.lb + p.h;
    p.hi = p.lo;
    const QpResult result = solve_qp(p.view());
    BOOST_REQUIRE(result.ok);
    BOOST_REQUIRE(!result.unsafe);
    BOOST_REQUIRE((result.a.array() == p.lb.array()).all());
  }
}

BOOST_AUTO_TEST_CASE(answer_does_not_expand_distances_in_the_inertia_norm) {
  std::mt19937_64 rng(10);
  for (int k = 0; k < 20000; ++k) {
    Problem p = random_problem(rng, k % 2);
    const QpResult first = solve_qp(p.view());
    const Vec7 change = std::exp(uniform(rng, -6, 3)) * random_matrix<Vec7>(rng);
    p.a0 += change;
    const QpResult second = solve_qp(p.view());
    const Vec7 moved = second.a - first.a;
    BOOST_REQUIRE(moved.dot(p.M * moved) <=
                  change.dot(p.M * change) * (1 + 1e-6) + 1e-9);
  }
}
