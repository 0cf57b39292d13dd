/// Threads that run one job at a time for each of several slots: many simulations at
/// once.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace dovetail {

/// Jobs of different slots run at the same time and must share nothing that changes.
/// One thread calls begin, finish and close; the pool's own threads call nothing else
/// than the jobs.
class ThreadPool {
 public:
  /// Does one part of a job, counted from 0. Parts run one after the other, not always
  /// on the same thread.
  using Job = std::function<void(int part)>;

  /// \param slots  how many jobs there can be at once, at least 1
  /// \param threads  that work in all, at least 1: one is the thread that waits in
  /// `finish`, the others are started here
  /// Throws std::invalid_argument; std::system_error: no thread to be had.
  ThreadPool(int slots, int threads);
  ~ThreadPool() { close(); }
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Lets a thread run a job of `parts` parts as soon as one is free; returns at once.
  /// Throws std::logic_error: the slot's last job is not finished, or the pool is
  /// closed; std::out_of_range.
  void begin(int slot, Job job, int parts = 1);

  /// Returns when the slot's job is done; until then works on what still waits, a part
  /// at a time: whoever waits goes on soon after the job is done. Not as soon as it is
  /// done while more waits than the other threads can do before the caller comes to the
  /// last slot, by the times that jobs, and the caller between two slots, took so far.
  /// Rethrows what the job threw. Throws std::logic_error: none was begun.
  void finish(int slot);

  /// Ends the threads. Parts that run are waited for, what waits is dropped.
  /// Harmless when repeated.
  void close() noexcept;

 private:
  using Clock = std::chrono::steady_clock;
  enum class Stage { kIdle, kWaiting, kRunning, kDone };
  struct Slot {
    Job job;
    int part = 0, parts = 1;
    double spent = 0.0;  // on its parts [s]
    std::atomic<Stage> stage = Stage::kIdle;
    std::exception_ptr error;
  };

  void work();
  template <typename Condition>
  void run_next(std::unique_lock<std::mutex>& lock, const Condition& may_leave);
  bool is_behind() const noexcept;

  std::vector<Slot> slots_;
  std::deque<int> waiting_;           // slots, in the order in which they were begun
  int unfinished_ = 0;                // slots begun and not finished
  double job_ = 0.0, between_ = 0.0;  // means: of a job, between two slots [s]
  Clock::time_point finished_{};      // the last slot; none since a begin: 0
  std::atomic<bool> is_closed_ = false, has_waiting_ = false;
  std::mutex mutex_;  // held by whoever changes any of the above
  std::condition_variable some_waiting_, some_done_;
  std::vector<std::thread> threads_;
};

}  // namespace dovetail
