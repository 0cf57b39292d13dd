#include "dovetail/saturation.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>

#include "growing_cholesky.hpp"

namespace dovetail {
namespace {

constexpr double kTolerance = 1e-9;  // [rad/s2] and [m/s2]
constexpr int kExactPasses = 60;

double clamp_to(double value, double lower, double upper) noexcept {
  return std::min(std::max(value, lower), upper);
}

/// Joints held at a bound, and the factor of their block of Minv.
struct HeldJoints {
  std::array<int, kNumJoints> index{};
  std::array<double, kNumJoints> bound{};
  std::array<bool, kNumJoints> is_held{};
  std::array<bool, kNumJoints> is_upper{};  // by joint
  GrowingCholesky<kNumJoints> factor;
  GrowingCholesky<kNumJoints>::Row force{};  // (M (a - a0))_W
  int count = 0;

  void add(int joint, double value, bool upper) noexcept {
    index[count] = joint;
    bound[count] = value;
    is_held[joint] = true;
    is_upper[joint] = upper;
    ++count;
  }

  void drop(int position) noexcept {
    is_held[index[position]] = false;
    for (int i = position; i + 1 < count; ++i) {
      index[i] = index[i + 1];
      bound[i] = bound[i + 1];
    }
    --count;
    factor.truncate(std::min(position, factor.size()));
  }

  /// a0 + Minv_:W force, the point nearest to a0 with the held joints on their bounds.
  Vec7 solve(const Vec7& a0, const Mat7& Minv) noexcept {
    GrowingCholesky<kNumJoints>::Row k{}, y{};
    for (int i = factor.size(); i < count; ++i) {
      for (int j = 0; j < i; ++j) k[j] = Minv(index[i], index[j]);
      const double pivot = factor.forward(k, Minv(index[i], index[i]), y);
      factor.append(y, pivot);
    }
    for (int i = 0; i < count; ++i) k[i] = bound[i] - a0[index[i]];
    factor.forward(k, 0.0, y);
    factor.backward(y, force);
    Vec7 a = a0;
    for (int i = 0; i < count; ++i) a += force[i] * Minv.col(index[i]);
    for (int i = 0; i < count; ++i) a[index[i]] = bound[i];
    return a;
  }

  /// Position of the joint whose force pulls towards its limit most, -1 if none does.
  [[nodiscard]] int worst_pull() const noexcept {
    int worst = -1;
    double pull_max = 1e-10;
    for (int i = 0; i < count; ++i) {
      const double pull = is_upper[index[i]] ? force[i] : -force[i];
      if (pull > pull_max) {
        pull_max = pull;
        worst = i;
      }
    }
    return worst;
  }
};

void write_masks(const HeldJoints& held, SaturationResult& result) noexcept {
  for (int i = 0; i < held.count; ++i) {
    const int joint = held.index[i];
    auto& mask = held.is_upper[joint] ? result.upper : result.lower;
    mask = static_cast<std::uint8_t>(mask | (1U << joint));
  }
}

/// The accumulating loop: every joint found outside is held from then on.
SaturationResult accumulate(const Vec7& a0, const Mat7& Minv, const Vec7& lb,
                            const Vec7& ub, HeldJoints& held) noexcept {
  SaturationResult result{a0};
  for (;;) {
    const int count_before = held.count;
    for (int i = 0; i < kNumJoints; ++i) {
      if (held.is_held[i]) continue;
      if (result.a[i] > ub[i] + kTolerance) {
        held.add(i, ub[i], true);
      } else if (result.a[i] < lb[i] - kTolerance) {
        held.add(i, lb[i], false);
      }
    }
    if (held.count == count_before) return result;
    result.a = held.solve(a0, Minv);
    ++result.passes;
  }
}

/// False where something is NaN: it compares false, and would count as inside.
bool is_comparable(const Vec7& a0, const Vec7& lb, const Vec7& ub) noexcept {
  return !(a0.hasNaN() || lb.hasNaN() || ub.hasNaN());
}

/// What both stages answer then: 0 inside the bounds that are numbers.
SaturationResult rest(const Vec7& lb, const Vec7& ub) noexcept {
  SaturationResult result{Vec7::Zero()};
  result.ok = false;
  for (int i = 0; i < kNumJoints; ++i) {
    if (lb[i] > result.a[i]) result.a[i] = lb[i];
    if (ub[i] < result.a[i]) result.a[i] = ub[i];
  }
  return result;
}

void clamp_result(const Vec7& lb, const Vec7& ub, SaturationResult& result) noexcept {
  for (int i = 0; i < kNumJoints; ++i) {
    result.a[i] = clamp_to(result.a[i], lb[i], ub[i]);
  }
}

/// Moves from a towards `wanted` up to the first bound of a free joint, which is then
/// held. Returns true if nothing was in the way.
bool step_towards(const Vec7& wanted, const Vec7& lb, const Vec7& ub, Vec7& a,
                  HeldJoints& held) noexcept {
  double share = 1.0;
  int blocking = -1;
  for (int i = 0; i < kNumJoints; ++i) {
    if (held.is_held[i]) continue;
    const double limit = wanted[i] > ub[i] + kTolerance   ? ub[i]
                         : wanted[i] < lb[i] - kTolerance ? lb[i]
                                                          : wanted[i];
    if (limit == wanted[i]) continue;
    const double ratio = clamp_to((limit - a[i]) / (wanted[i] - a[i]), 0.0, 1.0);
    if (blocking < 0 || ratio < share) {
      share = ratio;
      blocking = i;
    }
  }
  if (blocking < 0) {
    a = wanted;
    return true;
  }
  const bool upper = wanted[blocking] > ub[blocking];
  a += share * (wanted - a);
  a[blocking] = upper ? ub[blocking] : lb[blocking];
  held.add(blocking, a[blocking], upper);
  return false;
}

/// x := A^# b with the eigenvalues of A below s0 faded out (docs/control.md, Law).
Vec3 faded_solve(const Mat3& A, const Vec3& b, double s0) noexcept {
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(A);
  Vec3 y = eigen.eigenvectors().transpose() * b;
  for (int i = 0; i < 3; ++i) {
    const double s = std::max(eigen.eigenvalues()[i], 0.0);
    const double t = s / s0;
    y[i] *= s >= s0 ? 1.0 / s : (3.0 * t - 2.0 * t * t) / s0;
  }
  return eigen.eigenvectors() * y;
}

/// As faded_solve; where no eigenvalue can be below s0 by Cholesky alone. Rows outside
/// the set have a zero row in A and b, and get zero.
Vec3 wall_force(const Mat3& A, const std::array<int, 3>& side, const Vec3& b,
                double s0) noexcept {
  Mat3 filled = A;
  for (int i = 0; i < 3; ++i) {
    if (side[i] == 0) filled(i, i) = 1.0;
  }
  const Eigen::LLT<Mat3> factor(filled);
  if (factor.info() == Eigen::Success) {
    const Mat3 inverse = factor.solve(Mat3::Identity());
    // The smallest eigenvalue is at least 1 / |A^-1|_F.
    if (inverse.squaredNorm() * s0 * s0 <= 1.0) return inverse * b;
  }
  return faded_solve(A, b, s0);
}

}  // namespace

SaturationResult scs(const Vec7& a0, const Mat7& Minv, const Mat37& Jc, const Vec3& djc,
                     const Vec3& cl, const Vec3& cu, double s0) noexcept {
  SaturationResult result{a0};
  const Vec3 wanted = Jc * a0 + djc;
  const Eigen::Matrix<double, 7, 3> P = Minv * Jc.transpose();
  Vec3 row = wanted;
  std::array<int, 3> side{};  // -1 held at cl, +1 held at cu
  for (;;) {
    bool is_new = false;
    for (int i = 0; i < 3; ++i) {
      if (side[i] != 0) continue;
      side[i] = row[i] > cu[i] + kTolerance ? 1 : row[i] < cl[i] - kTolerance ? -1 : 0;
      is_new = is_new || side[i] != 0;
    }
    if (!is_new) break;
    Mat3 A = Jc * P;
    Vec3 b = Vec3::Zero();
    for (int i = 0; i < 3; ++i) {
      if (side[i] == 0) {
        A.row(i).setZero();
        A.col(i).setZero();
      } else {
        b[i] = (side[i] > 0 ? cu[i] : cl[i]) - wanted[i];
      }
    }
    result.a = a0 + P * wall_force(A, side, b, s0);
    row = Jc * result.a + djc;
    ++result.passes;
  }
  for (int i = 0; i < 3; ++i) {
    if (side[i] > 0) result.upper = static_cast<std::uint8_t>(result.upper | (1U << i));
    if (side[i] < 0) result.lower = static_cast<std::uint8_t>(result.lower | (1U << i));
  }
  return result;
}

SaturationResult sjs(const Vec7& a0, const Mat7& Minv, const Vec7& lb,
                     const Vec7& ub) noexcept {
  if (!is_comparable(a0, lb, ub)) return rest(lb, ub);
  HeldJoints held;
  SaturationResult result = accumulate(a0, Minv, lb, ub, held);
  if (held.count > 0) clamp_result(lb, ub, result);
  write_masks(held, result);
  return result;
}

SaturationResult sjs_exact(const Vec7& a0, const Mat7& Minv, const Vec7& lb,
                           const Vec7& ub) noexcept {
  if (!is_comparable(a0, lb, ub)) return rest(lb, ub);
  HeldJoints held;
  SaturationResult result = accumulate(a0, Minv, lb, ub, held);
  if (held.count == 0) {
    return result;
  }
  clamp_result(lb, ub, result);
  bool is_settled = true;  // result.a solves the equality problem of the held set
  result.ok = false;
  while (result.passes < kExactPasses) {
    if (is_settled) {
      const int released = held.worst_pull();
      if (released < 0) {
        result.ok = true;
        break;
      }
      held.drop(released);
    }
    is_settled = step_towards(held.solve(a0, Minv), lb, ub, result.a, held);
    ++result.passes;
  }
  clamp_result(lb, ub, result);
  write_masks(held, result);
  return result;
}

TorqueBlend blend_torque(const Vec7& a, const Vec7& a_safe, const Mat7& M,
                         const Vec7& h, const Vec7& lo, const Vec7& hi) noexcept {
  TorqueBlend blend;
  const Vec7 tau_safe = M * a_safe + h;
  const Vec7 change = M * (a - a_safe);
  Vec7 share;  // by joint
  for (int i = 0; i < kNumJoints; ++i) {
    const double end = tau_safe[i] + change[i];
    const double limit = clamp_to(end, lo[i], hi[i]);
    const bool is_safe = tau_safe[i] >= lo[i] && tau_safe[i] <= hi[i];
    blend.unsafe = blend.unsafe || !is_safe;
    share[i] = !is_safe       ? 0.0
               : limit == end ? 1.0
                              : clamp_to((limit - tau_safe[i]) / change[i], 0.0, 1.0);
  }
  blend.share = share.minCoeff();
  for (int i = 0; i < kNumJoints; ++i) {
    if (blend.share < 1.0 && share[i] == blend.share) {
      blend.limited = static_cast<std::uint8_t>(blend.limited | (1U << i));
    }
  }
  blend.a = blend.share < 1.0 ? Vec7(a_safe + blend.share * (a - a_safe)) : a;
  const Vec7 tau = tau_safe + blend.share * change;
  for (int i = 0; i < kNumJoints; ++i) blend.tau[i] = clamp_to(tau[i], lo[i], hi[i]);
  return blend;
}

}  // namespace dovetail
