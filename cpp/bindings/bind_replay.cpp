#include "bind_replay.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/pair.h>
#include <time.h>

#include <stdexcept>

#include "dovetail/controller.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;

namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using InputRows = nb::DRef<const Rows>;

double seconds_of(clockid_t clock) noexcept {
  timespec now;
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Steps through recorded cycles; torques (n, 7) and the time of each step (n, 1).
std::pair<Rows, Rows> replay(Controller& controller, InputRows q, InputRows dq,
                             InputRows f_star, InputRows quat) {
  const Eigen::Index count = q.rows();
  if (q.cols() != 7 || dq.cols() != 7 || f_star.cols() != 6 || quat.cols() != 4 ||
      dq.rows() != count || f_star.rows() != count || quat.rows() != count) {
    throw std::invalid_argument(
        "replay wants q (n, 7), dq (n, 7), f_star (n, 6), quat_wxyz_d (n, 4) with the "
        "same n");
  }
  Rows tau(count, 7), seconds(count, 1);
  Target target;
  for (Eigen::Index k = 0; k < count; ++k) {
    const Vec7 q_k = q.row(k).transpose();
    const Vec7 dq_k = dq.row(k).transpose();
    target.f_star = f_star.row(k).transpose();
    target.quat_wxyz_d = quat.row(k).transpose();
    const double begin = seconds_of(CLOCK_MONOTONIC);
    const StepResult result = controller.step(q_k, dq_k, target);
    seconds(k, 0) = seconds_of(CLOCK_MONOTONIC) - begin;
    tau.row(k) = result.tau.transpose();
  }
  return {tau, seconds};
}

}  // namespace

void bind_replay(nb::module_& m) {
  m.def("replay", &replay, "controller"_a, "q"_a, "dq"_a, "f_star"_a, "quat_wxyz_d"_a,
        "Step a controller through recorded cycles (one row each): torques [Nm], shape "
        "(n, 7), and what each step took [s], shape (n, 1). Reset it before.");
}
