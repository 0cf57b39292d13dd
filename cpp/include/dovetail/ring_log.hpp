/// The last seconds of a servo loop, at the control rate.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

namespace dovetail {

/// One thread writes rows, any thread copies them; neither waits for the other.
class RingLog {
 public:
  /// \param rows     how many can be read back
  /// \param columns  numbers per row
  RingLog(std::size_t rows, std::size_t columns);

  /// Writer: where the next row goes. It counts once committed.
  double* next_row() noexcept;
  void commit() noexcept;

  /// How many rows were ever written; row numbers start at 0.
  std::uint64_t count() const noexcept;

  /// The oldest row that can still be read.
  std::uint64_t oldest() const noexcept;

  /// Copies the first `columns` numbers of the rows [from, to) to `out`.
  /// \returns false where one of them was not written yet, or has been overwritten.
  bool copy(std::uint64_t from, std::uint64_t to, std::size_t columns,
            double* out) const noexcept;

  std::size_t columns() const noexcept { return columns_; }

 private:
  const double* row(std::uint64_t number) const noexcept;

  std::size_t rows_;  // that can be read
  std::size_t columns_;
  std::size_t capacity_;  // with room for those overwritten while being copied
  std::vector<double> numbers_;
  std::atomic<std::uint64_t> count_{0};
};

/// Writes rows as CSV beside `path`, then renames: a reader sees all of it or nothing.
/// `comment` becomes a first line that starts with #. \returns why it failed, or "".
std::string write_csv(const std::string& path, const std::string& comment,
                      const std::vector<std::string>& columns,
                      const std::vector<double>& numbers);

}  // namespace dovetail
