#include "dovetail/thread_pool.hpp"

#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

namespace dovetail {

namespace {

std::size_t require_positive(const char* what, int count) {
  if (count < 1) {
    throw std::invalid_argument("thread pool with " + std::to_string(count) + " " +
                                what + "; allowed: 1 and more");
  }
  return static_cast<std::size_t>(count);
}

/// Waits a while for what another thread is about to bring, without going to sleep: to
/// wake up a core that sleeps takes as long as half a job.
template <typename Condition>
void stay_awake_for(const Condition& is_so) {
  constexpr auto kPatience = std::chrono::microseconds(300);
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (!is_so() && std::chrono::steady_clock::now() < end) std::this_thread::yield();
}

}  // namespace

ThreadPool::ThreadPool(int slots, int threads)
    : slots_(require_positive("slots", slots)) {
  const std::size_t others = require_positive("threads", threads) - 1;
  try {
    for (std::size_t i = 0; i < others; ++i) threads_.emplace_back([this] { work(); });
  } catch (...) {
    close();
    throw;
  }
}

void ThreadPool::begin(int slot, Job job, int parts) {
  require_positive("parts", parts);
  {
    const std::lock_guard lock(mutex_);
    Slot& place = slots_.at(static_cast<std::size_t>(slot));
    if (is_closed_) throw std::logic_error("thread pool is closed");
    if (place.stage != Stage::kIdle) {
      throw std::logic_error("slot " + std::to_string(slot) +
                             " has a job that is not finished");
    }
    place.job = std::move(job);
    place.part = 0;
    place.parts = parts;
    place.stage = Stage::kWaiting;
    waiting_.push_back(slot);
    has_waiting_ = true;
  }
  some_waiting_.notify_one();
}

/// Takes the next waiting job and runs a part of it, the lock open meanwhile.
void ThreadPool::run_next(std::unique_lock<std::mutex>& lock) {
  const int slot = waiting_.front();
  Slot& place = slots_[static_cast<std::size_t>(slot)];
  waiting_.pop_front();
  has_waiting_ = !waiting_.empty();
  place.stage = Stage::kRunning;
  lock.unlock();
  std::exception_ptr error;
  try {
    place.job(place.part);
  } catch (...) {
    error = std::current_exception();
  }
  lock.lock();
  if (!error && !is_closed_ && ++place.part < place.parts) {
    place.stage = Stage::kWaiting;
    waiting_.push_front(slot);
    has_waiting_ = true;
    some_waiting_.notify_one();  // this thread may have something else to do
    return;
  }
  place.error = std::move(error);
  place.stage = Stage::kDone;
  some_done_.notify_all();
}

void ThreadPool::work() {
  while (true) {
    stay_awake_for([this] { return is_closed_ || has_waiting_; });
    std::unique_lock lock(mutex_);
    some_waiting_.wait(lock, [this] { return is_closed_ || !waiting_.empty(); });
    if (is_closed_) return;
    run_next(lock);
  }
}

void ThreadPool::finish(int slot) {
  std::unique_lock lock(mutex_);
  Slot& place = slots_.at(static_cast<std::size_t>(slot));
  while (place.stage != Stage::kDone) {
    if (place.stage == Stage::kIdle) {
      throw std::logic_error("slot " + std::to_string(slot) + " has no job");
    }
    if (!waiting_.empty()) {
      run_next(lock);
      continue;
    }
    const auto is_done = [&place] { return place.stage == Stage::kDone; };
    lock.unlock();
    stay_awake_for(is_done);
    lock.lock();
    some_done_.wait(lock, is_done);
  }
  place.stage = Stage::kIdle;
  place.job = nullptr;
  if (const std::exception_ptr error = std::exchange(place.error, nullptr)) {
    std::rethrow_exception(error);
  }
}

void ThreadPool::close() noexcept {
  {
    const std::lock_guard lock(mutex_);
    is_closed_ = true;
    for (const int slot : waiting_) {
      slots_[static_cast<std::size_t>(slot)].stage = Stage::kIdle;
    }
    waiting_.clear();
    has_waiting_ = false;
  }
  some_waiting_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

}  // namespace dovetail
