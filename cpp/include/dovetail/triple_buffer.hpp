/// The newest value from one thread to another, wait-free on both sides.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace dovetail {

/// One writer, one reader. The reader always sees a whole value, the newest that was
/// published; values in between are skipped.
template <class T>
class TripleBuffer {
  static_assert(std::is_copy_assignable_v<T>);

 public:
  /// Writer's thread.
  void write(const T& value) noexcept {
    slots_[back_] = value;
    // The reader takes what was in the middle, and the writer what was left there.
    back_ = middle_.exchange(back_ | kFresh, std::memory_order_acq_rel) & kIndex;
  }

  /// Reader's thread. \returns whether there was a newer value than the last one read.
  bool update() noexcept {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
    return true;
  }

  /// Reader's thread: the value of the last update.
  const T& value() const noexcept { return slots_[front_]; }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kFresh = 4;

  std::array<T, 3> slots_{};
  std::uint8_t back_ = 0;
  std::uint8_t front_ = 1;
  std::atomic<std::uint8_t> middle_{2};
};

}  // namespace dovetail
