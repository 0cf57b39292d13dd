#include "dovetail/qp.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dovetail {
namespace {

// Rows: the box (a itself), the walls, the torques, padding to whole SIMD packets.
constexpr int kWall = 7;
constexpr int kTorque = 10;
constexpr int kRows = 17;
constexpr int kPadded = 20;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTolerance = 1e-9;   // of a row [rad/s2, m/s2, Nm]
constexpr double kDependent = 1e-20;  // squared share of a row outside the active ones
constexpr double kRhoTorque = 1e6;    // weight of the torque slack, second attempt only
constexpr double kWallYields = 1e-2;  // then walls weigh less, by this factor

using Rows = Eigen::Matrix<double, kPadded, 1>;

enum class Outcome { kSolved, kInfeasible, kStopped };

/// Row values at a0, and the rows' bounds.
struct RowSet {
  Rows value, lower, upper;
  double tolerance;

  explicit RowSet(const QpProblem& problem) noexcept {
    value << problem.a0, problem.Jc * problem.a0 + problem.djc,
        problem.M * problem.a0 + problem.h, Vec3::Zero();
    lower << problem.lb, problem.cl, problem.lo, Vec3::Constant(-kInfinity);
    upper << problem.ub, problem.cu, problem.hi, Vec3::Constant(kInfinity);
    tolerance = kTolerance + 1e-12 * problem.a0.cwiseAbs().maxCoeff();
  }

  /// False where a row or a bound is NaN: it compares false, and would count as met.
  [[nodiscard]] bool is_comparable() const noexcept {
    return !(value.hasNaN() || lower.hasNaN() || upper.hasNaN());
  }

  [[nodiscard]] bool is_inside() const noexcept {
    return ((value - upper).array() <= tolerance).all() &&
           ((lower - value).array() <= tolerance).all();
  }
};

/// The dual active set over y, where a = a0 + L^-T y_a (M = L L'), wall slacks scaled
/// to unit weight behind it: the goal is |y|^2, a row's value is its value at a0 plus
/// gradient * y. `kDim` 12: torque rows are hard; 20: they have a slack, too.
template <int kDim>
class DualActiveSet {
 public:
  DualActiveSet(const QpProblem& problem, const RowSet& rows) noexcept
      : rows_(rows), value_(rows.value), max_iter_(problem.max_iter) {
    const Eigen::LLT<Mat7> factor(problem.M);
    const Mat7 L = factor.matrixL();
    const Mat7 L_inverse =
        L.template triangularView<Eigen::Lower>().solve(Mat7::Identity());
    gradient_.template rightCols<kDim - 7>().setZero();
    gradient_.template bottomLeftCorner<kPadded - kRows, 7>().setZero();
    gradient_.template block<7, 7>(0, 0) = L_inverse.transpose();
    gradient_.template block<3, 7>(kWall, 0) = problem.Jc * L_inverse.transpose();
    gradient_.template block<7, 7>(kTorque, 0) = L;
    const double rho = kIsTorqueSoft ? kWallYields * problem.rho : problem.rho;
    for (int i = 0; i < 3; ++i) gradient_(kWall + i, 7 + i) = -1.0 / std::sqrt(rho);
    if constexpr (kIsTorqueSoft) {
      for (int i = 0; i < 7; ++i) {
        gradient_(kTorque + i, 10 + i) = -1.0 / std::sqrt(kRhoTorque);
      }
    }
    scale_ =
        gradient_.rowwise().squaredNorm().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  }

  /// Runs until every row is met, `iterations` is used up or no point meets the rows.
  Outcome solve(int& iterations) noexcept {
    for (;;) {
      const int row = most_violated();
      if (row < 0) return Outcome::kSolved;
      if (iterations >= max_iter_) return Outcome::kStopped;
      const double sign = value_[row] > rows_.upper[row] ? 1.0 : -1.0;
      const Outcome outcome = add(row, sign, iterations);
      if (outcome != Outcome::kSolved) return outcome;
    }
  }

  [[nodiscard]] Vec7 acceleration() const noexcept { return value_.template head<7>(); }

  void write_masks(QpResult& result) const noexcept {
    for (int i = 0; i < count_; ++i) {
      const bool is_upper = sign_[i] > 0.0;
      const int row = index_[i];
      const int bit = row < kWall ? row : row < kTorque ? row - kWall : row - kTorque;
      auto& mask = row < kWall     ? (is_upper ? result.upper : result.lower)
                   : row < kTorque ? (is_upper ? result.wall_upper : result.wall_lower)
                                   : result.torque;
      mask = static_cast<std::uint8_t>(mask | (1U << bit));
    }
  }

 private:
  static constexpr bool kIsTorqueSoft = kDim > 12;
  static constexpr int kMaxActive = kIsTorqueSoft ? kRows : 10;
  using Point = Eigen::Matrix<double, kDim, 1>;
  using Multipliers = std::array<double, kMaxActive>;

  [[nodiscard]] int most_violated() const noexcept {
    const Rows excess = (value_ - rows_.upper).cwiseMax(rows_.lower - value_);
    const Rows scaled = excess.cwiseProduct(scale_);
    int worst = -1;
    double worst_scaled = 0.0;
    for (int i = 0; i < kRows; ++i) {
      if (scaled[i] > worst_scaled && excess[i] > rows_.tolerance && !is_active_[i]) {
        worst_scaled = scaled[i];
        worst = i;
      }
    }
    return worst;
  }

  /// Part z of the normal outside the active rows, and its coordinates d inside them.
  void split(const Point& normal, Point& z, Multipliers& d) const noexcept {
    z = normal;
    for (int i = 0; i < count_; ++i) {
      d[i] = basis_[i].dot(normal);
      z -= d[i] * basis_[i];
    }
    if (z.squaredNorm() > 0.01 * normal.squaredNorm()) return;
    // Cancellation: once more makes z orthogonal to rounding.
    for (int i = 0; i < count_; ++i) {
      const double correction = basis_[i].dot(z);
      d[i] += correction;
      z -= correction * basis_[i];
    }
  }

  /// Change of the active multipliers per unit of the new one: R r = d.
  void back_substitute(const Multipliers& d, Multipliers& r) const noexcept {
    for (int i = count_ - 1; i >= 0; --i) {
      double sum = d[i];
      for (int j = i + 1; j < count_; ++j) sum -= triangle_[j][i] * r[j];
      r[i] = sum / triangle_[i][i];
    }
  }

  /// Raises the multiplier of `row` until it is met, dropping active rows whose
  /// multiplier reaches zero.
  Outcome add(int row, double sign, int& iterations) noexcept {
    const Point normal = sign * gradient_.row(row).transpose();
    const double bound = sign > 0.0 ? rows_.upper[row] : rows_.lower[row];
    double multiplier = 0.0;
    while (iterations < max_iter_) {
      ++iterations;
      Point z;
      Multipliers d, r;
      split(normal, z, d);
      back_substitute(d, r);
      double step = kInfinity;
      int blocking = -1;
      for (int i = 0; i < count_; ++i) {
        if (r[i] > 1e-12 && multiplier_[i] < step * r[i]) {
          step = multiplier_[i] / r[i];
          blocking = i;
        }
      }
      const double pivot = z.squaredNorm();
      if (pivot > kDependent * normal.squaredNorm()) {
        const double full = std::max(sign * (value_[row] - bound) / pivot, 0.0);
        if (full <= step) {
          step = full;
          blocking = -1;
        }
        value_.noalias() -= gradient_ * (step * z);
      } else if (blocking < 0) {
        return Outcome::kInfeasible;
      }
      multiplier += step;
      for (int i = 0; i < count_; ++i) {
        multiplier_[i] = std::max(multiplier_[i] - step * r[i], 0.0);
      }
      if (blocking < 0) {
        append(row, sign, multiplier, z, d);
        return Outcome::kSolved;
      }
      drop(blocking);
    }
    return Outcome::kStopped;
  }

  void append(int row, double sign, double multiplier, const Point& z,
              const Multipliers& d) noexcept {
    index_[count_] = row;
    sign_[count_] = sign;
    multiplier_[count_] = multiplier;
    is_active_[row] = true;
    push_basis(z, d);
  }

  void push_basis(const Point& z, const Multipliers& d) noexcept {
    const double length = z.norm();
    basis_[count_] = z / length;
    triangle_[count_] = d;
    triangle_[count_][count_] = length;
    ++count_;
  }

  void drop(int position) noexcept {
    is_active_[index_[position]] = false;
    const int count_after = count_ - 1;
    for (int i = position; i < count_after; ++i) {
      index_[i] = index_[i + 1];
      sign_[i] = sign_[i + 1];
      multiplier_[i] = multiplier_[i + 1];
    }
    count_ = position;
    while (count_ < count_after) {
      Point z;
      Multipliers d;
      split(sign_[count_] * gradient_.row(index_[count_]).transpose(), z, d);
      push_basis(z, d);
    }
  }

  const RowSet& rows_;
  Rows value_, scale_;
  Eigen::Matrix<double, kPadded, kDim> gradient_;
  int max_iter_;
  int count_ = 0;
  std::array<bool, kPadded> is_active_{};
  std::array<int, kMaxActive> index_;
  Multipliers sign_;  // +1 at the upper bound, -1 at the lower
  Multipliers multiplier_;
  std::array<Point, kMaxActive> basis_;           // orthonormal
  std::array<Multipliers, kMaxActive> triangle_;  // by column
};

Vec7 clip(const Vec7& a, const QpProblem& problem) noexcept {
  return a.cwiseMax(problem.lb).cwiseMin(problem.ub);
}

/// clip(0) where a bound that is NaN is none; without that `cwiseMax` may hand it on.
Vec7 rest(const QpProblem& problem) noexcept {
  Vec7 a = Vec7::Zero();
  for (int i = 0; i < kNumJoints; ++i) {
    if (problem.lb[i] > a[i]) a[i] = problem.lb[i];
    if (problem.ub[i] < a[i]) a[i] = problem.ub[i];
  }
  return a;
}

/// The largest step from clip(0) towards `a`, both in the box, inside the torque rows.
Vec7 safe_answer(const Vec7& a, const QpProblem& problem) noexcept {
  const Vec7 a_safe = clip(Vec7::Zero(), problem);
  if (!a.allFinite()) return a_safe;
  const Vec7 step = clip(a, problem) - a_safe;
  const Vec7 tau = problem.M * a_safe + problem.h;
  const Vec7 change = problem.M * step;
  double share = 1.0;
  for (int i = 0; i < kNumJoints; ++i) {
    const double room =
        change[i] > 0.0 ? problem.hi[i] - tau[i] : problem.lo[i] - tau[i];
    if (change[i] != 0.0) share = std::min(share, std::max(room / change[i], 0.0));
  }
  return clip(a_safe + share * step, problem);
}

/// Torque, and what is exceeded, of the final acceleration.
void report(const QpProblem& problem, QpResult& result) noexcept {
  result.tau = problem.M * result.a + problem.h;
  const Vec3 wall = problem.Jc * result.a + problem.djc;
  for (int i = 0; i < 3; ++i) {
    const double excess = std::max(wall[i] - problem.cu[i], problem.cl[i] - wall[i]);
    if (excess > kWallTolerance) {
      result.wall_displaced =
          static_cast<std::uint8_t>(result.wall_displaced | 1U << i);
    }
  }
  result.unsafe = ((result.tau - problem.hi).array() > kTorqueTolerance).any() ||
                  ((problem.lo - result.tau).array() > kTorqueTolerance).any();
}

/// One attempt; fills `result` and returns how it ended.
template <int kDim>
Outcome attempt(const QpProblem& problem, const RowSet& rows,
                QpResult& result) noexcept {
  DualActiveSet<kDim> active(problem, rows);
  Outcome outcome = active.solve(result.iterations);
  const Vec7 a = active.acceleration();
  if (!a.allFinite()) outcome = Outcome::kStopped;
  result.ok = outcome == Outcome::kSolved;
  if (!result.ok) {
    result.a = safe_answer(a, problem);
    return outcome;
  }
  active.write_masks(result);
  result.a = clip(a, problem);
  for (int i = 0; i < kNumJoints; ++i) {
    if (result.upper >> i & 1) result.a[i] = problem.ub[i];
    if (result.lower >> i & 1) result.a[i] = problem.lb[i];
  }
  return outcome;
}

}  // namespace

QpResult solve_qp(const QpProblem& problem) noexcept {
  QpResult result;
  const RowSet rows(problem);
  const bool is_wish = problem.a0.allFinite();
  if (is_wish && rows.is_inside()) {
    result.a = clip(problem.a0, problem);
    result.tau = problem.M * result.a + problem.h;
    return result;
  }
  if (!is_wish || !rows.is_comparable()) {
    result.ok = false;
    result.a = rest(problem);
    report(problem, result);
    return result;
  }
  if (attempt<12>(problem, rows, result) == Outcome::kInfeasible) {
    attempt<20>(problem, rows, result);
  }
  report(problem, result);
  return result;
}

}  // namespace dovetail
