/// Cholesky factor of a small symmetric positive matrix, sizes known at compile time.
///
/// Eigen's LLT is general and slower at 6 or 7 rows; these loops unroll completely.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace dovetail {

template <int N>
class Cholesky {
 public:
  using Matrix = Eigen::Matrix<double, N, N>;

  /// Factor A = L L^T; reads the lower triangle. False when A is not positive.
  bool factor(const Matrix& A) noexcept {
    for (int j = 0; j < N; ++j) {
      double d = A(j, j);
      for (int k = 0; k < j; ++k) d -= L_(j, k) * L_(j, k);
      if (!(d > 0.0)) return false;
      const double root = std::sqrt(d);
      L_(j, j) = root;
      inverse_diagonal_[j] = 1.0 / root;
      for (int i = j + 1; i < N; ++i) {
        double s = A(i, j);
        for (int k = 0; k < j; ++k) s -= L_(i, k) * L_(j, k);
        L_(i, j) = s * inverse_diagonal_[j];
      }
    }
    return true;
  }

  /// X := L^-1 X, for any number of right-hand sides.
  template <int Columns>
  void solve_lower(Eigen::Matrix<double, N, Columns>& X) const noexcept {
    for (int i = 0; i < N; ++i) {
      for (int k = 0; k < i; ++k) X.row(i) -= L_(i, k) * X.row(k);
      X.row(i) *= inverse_diagonal_[i];
    }
  }

  /// X := L^-T X.
  template <int Columns>
  void solve_upper(Eigen::Matrix<double, N, Columns>& X) const noexcept {
    for (int i = N - 1; i >= 0; --i) {
      for (int k = i + 1; k < N; ++k) X.row(i) -= L_(k, i) * X.row(k);
      X.row(i) *= inverse_diagonal_[i];
    }
  }

  /// X := A^-1 X.
  template <int Columns>
  void solve(Eigen::Matrix<double, N, Columns>& X) const noexcept {
    solve_lower(X);
    solve_upper(X);
  }

  /// A^-1, symmetric.
  Matrix inverse() const noexcept {
    Matrix L_inverse = Matrix::Zero();
    for (int j = 0; j < N; ++j) {
      L_inverse(j, j) = inverse_diagonal_[j];
      for (int i = j + 1; i < N; ++i) {
        double s = 0.0;
        for (int k = j; k < i; ++k) s -= L_(i, k) * L_inverse(k, j);
        L_inverse(i, j) = s * inverse_diagonal_[i];
      }
    }
    Matrix A_inverse;
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j <= i; ++j) {
        double s = 0.0;
        for (int k = i; k < N; ++k) s += L_inverse(k, i) * L_inverse(k, j);
        A_inverse(i, j) = s;
        A_inverse(j, i) = s;
      }
    }
    return A_inverse;
  }

 private:
  Matrix L_ = Matrix::Zero();
  Eigen::Matrix<double, N, 1> inverse_diagonal_ = Eigen::Matrix<double, N, 1>::Ones();
};

}  // namespace dovetail
