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

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin)
      .count();
}

/// Lets a mean follow what is measured.
void follow(double& mean, double now) {
  constexpr double kShare = 1.0 / 16.0;
  mean += (mean == 0.0 ? 1.0 : kShare) * (now - mean);
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
    place.spent = 0.0;
    place.stage = Stage::kWaiting;
    waiting_.push_back(slot);
    has_waiting_ = true;
    ++unfinished_;
    finished_ = {};
  }
  some_waiting_.notify_one();
}

/// Takes the next waiting job and runs parts of it, the lock open meanwhile: all of
/// them, so that one core's caches keep what a job works on, or until `may_leave`.
template <typename Condition>
void ThreadPool::run_next(std::unique_lock<std::mutex>& lock,
                          const Condition& may_leave) {
  const int slot = waiting_.front();
  Slot& place = slots_[static_cast<std::size_t>(slot)];
  waiting_.pop_front();
  has_waiting_ = !waiting_.empty();
  place.stage = Stage::kRunning;
  lock.unlock();
  std::exception_ptr error;
  bool has_left = false;
  while (!has_left) {
    const Clock::time_point begin = Clock::now();
    try {
      place.job(place.part);
    } catch (...) {
      error = std::current_exception();
    }
    place.spent += seconds_since(begin);
    if (error || is_closed_ || ++place.part == place.parts) break;
    has_left = may_leave();
  }
  lock.lock();
  if (has_left) {
    place.stage = Stage::kWaiting;
    waiting_.push_front(slot);
    has_waiting_ = true;
    some_waiting_.notify_one();  // this thread has something else to do
    return;
  }
  follow(job_, place.spent);
  place.error = std::move(error);
  place.stage = Stage::kDone;
  some_done_.notify_all();
}

/// Says whether the other threads will still be at work when the caller has come to the
/// last slot, so that it had better help. Without others nobody waits for anybody.
bool ThreadPool::is_behind() const noexcept {
  if (threads_.empty() || between_ == 0.0) return false;
  const auto others = static_cast<double>(threads_.size());
  return static_cast<double>(waiting_.size()) * job_ >
         others * static_cast<double>(unfinished_) * between_;
}

void ThreadPool::work() {
  while (true) {
    stay_awake_for([this] { return is_closed_ || has_waiting_; });
    std::unique_lock lock(mutex_);
    some_waiting_.wait(lock, [this] { return is_closed_ || !waiting_.empty(); });
    if (is_closed_) return;
    run_next(lock, [] { return false; });
  }
}

void ThreadPool::finish(int slot) {
  std::unique_lock lock(mutex_);
  Slot& place = slots_.at(static_cast<std::size_t>(slot));
  if (place.stage == Stage::kIdle) {
    throw std::logic_error("slot " + std::to_string(slot) + " has no job");
  }
  if (finished_ != Clock::time_point{}) follow(between_, seconds_since(finished_));
  const auto is_done = [&place] { return place.stage == Stage::kDone; };
  const auto may_leave = [this, &is_done] {
    if (!is_done()) return false;
    const std::lock_guard inner(mutex_);
    return !is_behind();
  };
  while (!is_done() || is_behind()) {
    if (!waiting_.empty()) {
      run_next(lock, may_leave);
      continue;
    }
    lock.unlock();
    stay_awake_for(is_done);
    lock.lock();
    some_done_.wait(lock, is_done);
  }
  place.stage = Stage::kIdle;
  place.job = nullptr;
  --unfinished_;
  finished_ = Clock::now();
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
      --unfinished_;
    }
    waiting_.clear();
    has_waiting_ = false;
  }
  some_waiting_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

}  // namespace dovetail
