/// How often which duration occurred: bins of equal ratio, 1 us to 10 s.
#pragma once

#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>

namespace dovetail {

/// One thread adds, any thread reads. Does not allocate or throw.
class Histogram {
 public:
  static constexpr int kPerDecade = 20;  // neighbours differ by 12 %
  static constexpr int kBins = 7 * kPerDecade + 2;
  static constexpr double kSmallest = 1e-6;  // [s], upper edge of the first bin

  void add(double seconds) noexcept {
    auto& bin = bins_[static_cast<std::size_t>(index_of(seconds))];
    bin.store(bin.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    if (seconds > largest_.load(std::memory_order_relaxed)) {
      largest_.store(seconds, std::memory_order_relaxed);
    }
  }

  std::uint64_t count() const noexcept {
    std::uint64_t sum = 0;
    for (const auto& bin : bins_) sum += bin.load(std::memory_order_relaxed);
    return sum;
  }

  /// How often a duration was in the bin that ends at upper_edge(i).
  std::uint64_t count(int i) const noexcept {
    return bins_[static_cast<std::size_t>(i)].load(std::memory_order_relaxed);
  }

  /// The upper edge [s] of the bin below which a share of all durations lies, at most
  /// the largest seen; 0 where there is none.
  double quantile(double share) const noexcept {
    const std::uint64_t total = count();
    if (total == 0) return 0.0;
    const double wanted = share * static_cast<double>(total);
    std::uint64_t below = 0;
    for (int i = 0; i < kBins; ++i) {
      below += count(i);
      if (below > 0 && static_cast<double>(below) >= wanted) {
        return std::fmin(upper_edge(i), largest());
      }
    }
    return largest();
  }

  double largest() const noexcept { return largest_.load(std::memory_order_relaxed); }

  void clear() noexcept {
    for (auto& bin : bins_) bin.store(0, std::memory_order_relaxed);
    largest_.store(0.0, std::memory_order_relaxed);
  }

  /// [s]; the last bin has none.
  static double upper_edge(int i) noexcept {
    return kSmallest * std::pow(10.0, static_cast<double>(i) / kPerDecade);
  }

 private:
  static int index_of(double seconds) noexcept {
    if (!(seconds > kSmallest)) return 0;  // and what is no number
    const double place = std::ceil(kPerDecade * std::log10(seconds / kSmallest));
    return place < kBins - 1 ? static_cast<int>(place) : kBins - 1;
  }

  std::array<std::atomic<std::uint64_t>, kBins> bins_{};
  std::atomic<double> largest_{0.0};
};

}  // namespace dovetail
