/// The Python module dovetail._bench: loops and judges of the benchmarks and tests. It
/// is not in the wheel.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <string>
#include <tuple>

#include "attack_loop.hpp"
#include "column_names.hpp"
#include "contact_judge.hpp"

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

void bind_judge(nb::module_& m) {
  nb::class_<WorstLook>(m, "WorstLook", "A limit over one try.")
      .def_ro("value", &WorstLook::value, "Of the worst look.")
      .def_ro("time", &WorstLook::time, "Of the worst look [s].")
      .def_ro("axis", &WorstLook::axis, "Joint or TCP axis of the worst look, from 0.")
      .def_ro("count", &WorstLook::count, "Looks beyond the limit.");
  nb::class_<ContactJudge, StepProbe>(
      m, "ContactJudge", "Spring at the TCP, and judge of every physics step.")
      .def(nb::init<const Chain&, const LimitParams&>(), "chain"_a, "limits"_a)
      .def("reset", &ContactJudge::reset)
      .def("set_spring", &ContactJudge::set_spring, "anchor"_a, "stiffness"_a,
           "damping"_a, "Anchor [m], stiffness [N/m], damping [Ns/m].")
      .def("set_push", &ContactJudge::set_push, "push"_a, "Force on the TCP [N].")
      .def("set_resting", &ContactJudge::set_resting, "force"_a,
           "The contact force that is asked for [N].")
      .def("force", &ContactJudge::force, "q"_a, "dq"_a,
           "Push and spring at a true state [N].")
      .def("look", &ContactJudge::look, "q"_a, "dq"_a, "contact"_a, "h"_a,
           "Judge a true state, the contact force [N] and h [s] that led to it.")
      .def("take_vibration", &ContactJudge::take_vibration,
           "RMS joint velocity above 8 Hz since the last call [rad/s].")
      .def_prop_ro("position", &ContactJudge::position, "Past a joint limit [rad].")
      .def_prop_ro("speed", &ContactJudge::speed, "Over the joint's speed limit [1].")
      .def_prop_ro("tapered_speed", &ContactJudge::tapered_speed,
                   "Over the speed that falls towards a position limit [rad/s].")
      .def_prop_ro("wall", &ContactJudge::wall, "Outside a wall [m].")
      .def_prop_ro("tcp_speed", &ContactJudge::tcp_speed, "Over the limit [m/s].")
      .def_prop_ro("torque", &ContactJudge::torque, "Over the motor's limit [1].")
      .def_prop_ro("contact", &ContactJudge::contact,
                   "20 ms mean of the contact force over the resting push [1].")
      .def_prop_ro("load", &ContactJudge::load, "The spring's torque, of the motor's.")
      .def_prop_ro("peak", &ContactJudge::peak, "Largest contact force [N].")
      .def_prop_ro("touch_speed", &ContactJudge::touch_speed, "[m/s]")
      .def_prop_ro("looks", &ContactJudge::looks)
      .def_prop_ro("flagged", &ContactJudge::flagged,
                   "Cycles flagged unsafe, qp_early, bad_input.");
}

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
      "6) and (n, 4), each held for cycles_per_target; per cycle the age of the state "
      "that "
      "arrives in cycles (-1: none arrives); wrong numbers (cycle, element, error) "
      "added to q (0 to 6) or dq (7 to 13). Returns the worst of each limit as (value, "
      "cycle, element), margins not taken off, and with trace one row per cycle.");
  m.def(
      "attack_columns", [] { return names_and_units(kAttackGroups); },
      "Name and unit of each column of run_attack's trace.");
}

}  // namespace

NB_MODULE(_bench, m) {
  m.doc() =
      "Attacks on the controller and a judge of contact, for benchmarks and tests.";
  nb::module_::import_("dovetail._core");  // its types are used here
  bind_judge(m);
  bind_attack(m);
}
