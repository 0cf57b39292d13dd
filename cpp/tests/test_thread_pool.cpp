#include <atomic>
#include <boost/test/unit_test.hpp>
#include <chrono>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "dovetail/thread_pool.hpp"

using dovetail::ThreadPool;

namespace {

/// Waits until `is_so`, which another thread brings about.
template <typename Condition>
void await(const Condition& is_so) {
  while (!is_so()) std::this_thread::yield();
}

}  // namespace

BOOST_AUTO_TEST_CASE(every_job_runs_once_with_any_number_of_threads) {
  for (const int threads : {1, 2, 3, 8}) {
    ThreadPool pool(16, threads);
    std::vector<int> runs(16, 0);  // each slot's own: no two threads touch the same
    for (int round = 1; round <= 200; ++round) {
      for (int slot = 0; slot < 16; ++slot) {
        pool.begin(slot,
                   [&runs, slot](int) { ++runs[static_cast<std::size_t>(slot)]; });
      }
      for (int slot = 15; slot >= 0; --slot) pool.finish(slot);
      for (const int count : runs) BOOST_TEST(count == round);
    }
  }
}

BOOST_AUTO_TEST_CASE(parts_of_a_job_run_in_their_order) {
  for (const int threads : {1, 2, 3}) {
    ThreadPool pool(4, threads);
    std::vector<std::vector<int>> parts(4);
    for (int slot = 0; slot < 4; ++slot) {
      auto& run = parts[static_cast<std::size_t>(slot)];
      pool.begin(slot, [&run](int part) { run.push_back(part); }, slot + 1);
    }
    for (int slot = 3; slot >= 0; --slot) pool.finish(slot);
    for (std::size_t slot = 0; slot < 4; ++slot) {
      std::vector<int> all(slot + 1);
      std::iota(all.begin(), all.end(), 0);
      BOOST_TEST(parts[slot] == all, boost::test_tools::per_element());
    }
  }
}

BOOST_AUTO_TEST_CASE(after_an_error_no_further_part_runs) {
  ThreadPool pool(1, 1);
  int runs = 0;
  const auto job = [&runs](int part) {
    ++runs;
    if (part == 1) throw std::runtime_error("part 1");
  };
  pool.begin(0, job, 5);
  BOOST_CHECK_THROW(pool.finish(0), std::runtime_error);
  BOOST_TEST(runs == 2);
}

BOOST_AUTO_TEST_CASE(who_waits_goes_on_before_a_long_job_of_another_slot_ends) {
  constexpr int kParts = 10000000;
  std::atomic<bool> is_running = false, may_end = false;
  std::atomic<int> runs = 0;
  ThreadPool pool(2, 2);
  pool.begin(0, [&](int) {
    is_running = true;
    await([&] { return may_end.load(); });
  });
  await([&] { return is_running.load(); });
  const auto job = [&](int) {
    may_end = true;
    ++runs;
  };
  pool.begin(1, job, kParts);
  pool.finish(0);
  BOOST_TEST(runs < kParts);
  pool.close();
}

BOOST_AUTO_TEST_CASE(who_has_little_to_do_between_slots_works_on_first) {
  ThreadPool pool(8, 2);
  std::atomic<int> begun = 0;
  const auto job = [&begun](int) {
    ++begun;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  };
  const auto begin_all = [&] {
    for (int slot = 0; slot < 8; ++slot) pool.begin(slot, job);
  };
  begin_all();
  pool.finish(0);
  BOOST_TEST(begun <= 4);  // nothing is known yet of what is between two slots
  for (int slot = 1; slot < 8; ++slot) pool.finish(slot);
  begun = 0;
  begin_all();
  pool.finish(0);
  BOOST_TEST(begun >= 6);
  for (int slot = 1; slot < 8; ++slot) pool.finish(slot);
}

BOOST_AUTO_TEST_CASE(jobs_of_two_slots_run_at_the_same_time) {
  ThreadPool pool(2, 2);
  std::atomic<int> begun = 0;
  const auto meet = [&begun](int) {
    ++begun;
    await([&begun] { return begun == 2; });
  };
  pool.begin(0, meet);
  pool.begin(1, meet);
  pool.finish(0);
  pool.finish(1);
  BOOST_TEST(begun == 2);
}

BOOST_AUTO_TEST_CASE(one_thread_is_the_one_that_waits) {
  ThreadPool pool(1, 1);
  std::thread::id where;
  pool.begin(0, [&where](int) { where = std::this_thread::get_id(); });
  pool.finish(0);
  BOOST_TEST((where == std::this_thread::get_id()));
}

BOOST_AUTO_TEST_CASE(what_a_job_throws_comes_out_of_its_own_slot_once) {
  for (const int threads : {1, 3}) {
    ThreadPool pool(3, threads);
    for (int round = 0; round < 50; ++round) {
      for (int slot = 0; slot < 3; ++slot) {
        pool.begin(slot, [slot](int) {
          if (slot == 1) throw std::runtime_error("job 1");
        });
      }
      pool.finish(0);
      BOOST_CHECK_EXCEPTION(pool.finish(1), std::runtime_error,
                            [](const std::exception& error) {
                              return error.what() == std::string("job 1");
                            });
      pool.finish(2);
    }
  }
}

BOOST_AUTO_TEST_CASE(wrong_order_is_refused) {
  ThreadPool pool(2, 1);
  BOOST_CHECK_THROW(pool.finish(0), std::logic_error);
  BOOST_CHECK_THROW(pool.begin(2, [](int) {}), std::out_of_range);
  BOOST_CHECK_THROW(pool.begin(-1, [](int) {}), std::out_of_range);
  pool.begin(0, [](int) {});
  BOOST_CHECK_THROW(pool.begin(0, [](int) {}), std::logic_error);
  pool.finish(0);
  BOOST_CHECK_THROW(pool.finish(0), std::logic_error);
  BOOST_CHECK_THROW(ThreadPool(0, 1), std::invalid_argument);
  BOOST_CHECK_THROW(ThreadPool(1, 0), std::invalid_argument);
  BOOST_CHECK_THROW(pool.begin(0, [](int) {}, 0), std::invalid_argument);
}

BOOST_AUTO_TEST_CASE(close_waits_for_what_runs_and_drops_what_waits) {
  std::atomic<bool> is_running = false, may_end = false, has_ended = false;
  bool has_second_run = false;
  ThreadPool pool(2, 2);
  pool.begin(0, [&](int) {
    is_running = true;
    await([&] { return may_end.load(); });
    has_ended = true;
  });
  await([&] { return is_running.load(); });
  pool.begin(1, [&](int) { has_second_run = true; });
  std::thread opener([&may_end] {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    may_end = true;
  });
  pool.close();
  BOOST_TEST(has_ended.load());
  BOOST_TEST(!has_second_run);
  BOOST_CHECK_THROW(pool.begin(1, [](int) {}), std::logic_error);
  pool.close();
  opener.join();
}
