#include "bind_attack.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <string>
#include <tuple>

#include "dovetail/attack_loop.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;

namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using InputRows = nb::DRef<const Rows>;
using Wrong = std::tuple<int, int, double>;

std::vector<Target> targets_of(InputRows f_star, InputRows quat) {
  if (f_star.cols() != 6 || quat.cols() != 4 || f_star.rows() != quat.rows() ||
      f_star.rows() == 0) {
    throw std::invalid_argument(
        "run_attack wants f_star (n, 6) and quat_wxyz_d (n, 4) with the same n > 0");
  }
  std::vector<Target> targets(static_cast<std::size_t>(f_star.rows()));
  for (Eigen::Index k = 0; k < f_star.rows(); ++k) {
    Target& target = targets[static_cast<std::size_t>(k)];
    target.f_star = f_star.row(k).transpose();
    target.quat_wxyz_d = quat.row(k).transpose();
  }
  return targets;
}

std::vector<WrongNumber> wrong_of(const std::vector<Wrong>& numbers) {
  std::vector<WrongNumber> wrong;
  int last = 0;
  for (const auto& [cycle, element, error] : numbers) {
    if (element < 0 || element > 13 || cycle < last) {
      throw std::invalid_argument("wrong number " + std::to_string(wrong.size()) +
                                  " has cycle " + std::to_string(cycle) + ", element " +
                                  std::to_string(element) +
                                  "; allowed: cycles that do not fall, elements 0 to "
                                  "13 (q of A1 to A7, then dq)");
    }
    last = cycle;
    wrong.push_back({cycle, element, error});
  }
  return wrong;
}

nb::tuple tuple_of(const Largest& worst) {
  return nb::make_tuple(worst.value, worst.cycle, worst.element);
}

nb::dict dict_of(const AttackResult& result) {
  nb::dict found;
  found["position"] = tuple_of(result.position);
  found["speed"] = tuple_of(result.speed);
  found["wall"] = tuple_of(result.wall);
  found["tool_speed"] = tuple_of(result.tool_speed);
  found["torque"] = tuple_of(result.torque);
  found["step"] = tuple_of(result.step);
  found["step_after_bad"] = tuple_of(result.step_after_bad);
  found["step_by_bad"] = tuple_of(result.step_by_bad);
  found["reach"] = tuple_of(result.reach);
  found["bad_cycles"] = result.bad_cycles;
  return found;
}

}  // namespace

void bind_attack(nb::module_& m) {
  m.def(
      "run_attack",
      [](const Controller& controller, const RigidPlant& plant, InputRows f_star,
         InputRows quat, int cycles_per_target, const std::vector<int>& age,
         const std::vector<Wrong>& wrong, double observer_gain, int looks, bool trace) {
        if (cycles_per_target < 1 || looks < 1) {
          throw std::invalid_argument("cycles_per_target and looks must be at least 1");
        }
        const Attack attack{targets_of(f_star, quat), cycles_per_target, age,
                            wrong_of(wrong), observer_gain};
        Rows rows = Rows::Zero(trace ? static_cast<Eigen::Index>(age.size()) : 0,
                               column_at(sizeof(AttackRow)));
        AttackResult result;
        {
          nb::gil_scoped_release release;
          result = run_attack(controller, plant, attack, looks,
                              trace ? rows.data() : nullptr);
        }
        return std::pair(dict_of(result), rows);
      },
      "controller"_a, "plant"_a, "f_star"_a, "quat_wxyz_d"_a, "cycles_per_target"_a,
      "age"_a, "wrong"_a = std::vector<Wrong>{}, "observer_gain"_a = 0.0, "looks"_a = 1,
      "trace"_a = false,
      "One episode from the plant's state under an adversary, on copies: targets (n, "
      "6) "
      "and (n, 4), each held for cycles_per_target; per cycle the age of the state "
      "that "
      "arrives in cycles (-1: none arrives); wrong numbers (cycle, element, error) "
      "added to q (0 to 6) or dq (7 to 13). Returns the worst of each limit as (value, "
      "cycle, element), margins not taken off, and with trace one row per cycle.");
  m.def(
      "copy_controller", [](const Controller& controller) { return controller; },
      "controller"_a, "A controller that goes on from the same state.");
}
