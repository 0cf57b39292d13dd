/// Cholesky factor of the kernel of an active set: rows are appended one at a time.
#pragma once

#include <array>
#include <cmath>

namespace dovetail {

/// Lower factor L of a positive definite matrix of at most `kMax` rows.
template <int kMax>
class GrowingCholesky {
 public:
  using Row = std::array<double, kMax>;

  [[nodiscard]] int size() const noexcept { return size_; }

  /// Drops all rows from `size` on.
  void truncate(int size) noexcept { size_ = size; }

  /// y := L^-1 k. Returns the pivot k_new - y'y that appending k would give.
  double forward(const Row& k, double k_new, Row& y) const noexcept {
    for (int i = 0; i < size_; ++i) {
      double sum = k[i];
      for (int j = 0; j < i; ++j) sum -= rows_[i][j] * y[j];
      y[i] = sum * inverse_diagonal_[i];
      k_new -= y[i] * y[i];
    }
    return k_new;
  }

  /// r := L^-T y.
  void backward(const Row& y, Row& r) const noexcept {
    for (int i = size_ - 1; i >= 0; --i) {
      double sum = y[i];
      for (int j = i + 1; j < size_; ++j) sum -= rows_[j][i] * r[j];
      r[i] = sum * inverse_diagonal_[i];
    }
  }

  /// Appends the row whose `y` and pivot came from `forward`.
  void append(const Row& y, double pivot) noexcept {
    rows_[size_] = y;
    inverse_diagonal_[size_] = 1.0 / std::sqrt(pivot);
    ++size_;
  }

 private:
  std::array<Row, kMax> rows_;
  Row inverse_diagonal_;
  int size_ = 0;
};

}  // namespace dovetail
