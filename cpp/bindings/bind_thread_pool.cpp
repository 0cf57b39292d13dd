#include "bind_thread_pool.hpp"

#include <nanobind/ndarray.h>

#include <algorithm>
#include <cstddef>
#include <vector>

#include "dovetail/mujoco_loop.hpp"
#include "dovetail/thread_pool.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using namespace dovetail;

namespace {

using Log =
    nb::ndarray<double, nb::shape<-1, kCycleColumns>, nb::c_contig, nb::device::cpu>;

/// Control cycles that a thread runs before it looks what else there is: about as long
/// as what Python does with the state of one arm.
constexpr int kPart = 5;

/// What a job works on. It is Python's, and must stay while the job runs.
struct Kept {
  nb::object loop, controller;
  Log log;
};

class RunPool {
 public:
  RunPool(int slots, int threads)
      : kept_(static_cast<std::size_t>(slots > 0 ? slots : 0)), pool_(slots, threads) {}

  void begin_run(int slot, MujocoLoop& loop, Controller& controller,
                 const Target& target, int steps, Log log) {
    double* rows = log.data();
    const int cycles = static_cast<int>(log.shape(0));
    const auto run = [&loop, &controller, held = target, cycles, steps,
                      rows](int part) mutable {
      const int begin = part * kPart, count = std::min(kPart, cycles - begin);
      loop.run(controller, held, count, steps, rows + begin * kCycleColumns);
      for (int i = 0; i < count; ++i) held.age += controller.period();
    };
    pool_.begin(slot, run, (cycles + kPart - 1) / kPart);
    kept_[static_cast<std::size_t>(slot)] = {nb::find(loop), nb::find(controller), log};
  }

  void finish(int slot) {
    const nb::gil_scoped_release release;
    pool_.finish(slot);
  }

  void close() {
    const nb::gil_scoped_release release;
    pool_.close();
  }

 private:
  std::vector<Kept> kept_;  // of the last job of each slot; outlives the threads
  ThreadPool pool_;
};

}  // namespace

void bind_thread_pool(nb::module_& m) {
  nb::class_<RunPool>(m, "ThreadPool",
                      "Threads that run the control cycles of many simulations.")
      .def(nb::init<int, int>(), "slots"_a, "threads"_a,
           "threads: that work in all, the one that waits in finish among them.")
      .def("begin_run", &RunPool::begin_run, "slot"_a, "loop"_a, "controller"_a,
           "target"_a, "steps"_a, "log"_a.noconvert(),
           "MujocoLoop.run on a thread of the pool; returns at once.")
      .def("finish", &RunPool::finish, "slot"_a,
           "Wait for what begin_run has begun; raises what it raised.")
      .def("close", &RunPool::close, "End the threads; harmless when repeated.");
}
