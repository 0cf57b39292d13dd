#include "bind_mujoco.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <tuple>

#include "dovetail/contact_judge.hpp"
#include "dovetail/mujoco_loop.hpp"
#include "new_array.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using namespace dovetail;

namespace {

void bind_judge(nb::module_& m) {
  nb::class_<WorstLook>(m, "WorstLook", "A limit over one try.")
      .def_ro("value", &WorstLook::value, "Of the worst look.")
      .def_ro("time", &WorstLook::time, "Of the worst look [s].")
      .def_ro("axis", &WorstLook::axis, "Joint or TCP axis of the worst look, from 0.")
      .def_ro("count", &WorstLook::count, "Looks beyond the limit.");
  nb::class_<ContactJudge>(m, "ContactJudge",
                           "Spring at the TCP, and judge of every physics step.")
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

}  // namespace

void bind_mujoco(nb::module_& m) {
  bind_judge(m);
  using State = std::tuple<Vec7, Vec7>;
  using Log =
      nb::ndarray<double, nb::shape<-1, kCycleColumns>, nb::c_contig, nb::device::cpu>;

  using Faults =
      nb::ndarray<const std::int8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

  nb::class_<Channel>(m, "Channel",
                      "Delay and noise between a controller and a twin's joints.")
      .def(
          "__init__",
          [](Channel* self, double delay, double torque_noise, double position_noise,
             double velocity_noise, std::uint64_t seed) {
            new (self)
                Channel({delay, torque_noise, position_noise, velocity_noise, seed});
          },
          nb::kw_only(), "delay"_a = 0.0, "torque_noise"_a = 0.0,
          "position_noise"_a = 0.0, "velocity_noise"_a = 0.0, "seed"_a = 0)
      .def_prop_ro("delay", [](const Channel& self) { return self.params().delay; })
      .def("reset", &Channel::reset)
      .def("seed", &Channel::seed, "seed"_a)
      .def("send", &Channel::send, "tau"_a)
      .def("receive", &Channel::receive, "sent"_a, "h"_a)
      .def(
          "measure",
          [](Channel& self, Vec7 q, Vec7 dq) {
            self.measure(q, dq);
            return State(q, dq);
          },
          "q"_a, "dq"_a);

  nb::class_<MujocoLoop>(m, "MujocoLoop",
                         "Controller and MuJoCo in one loop, without Python.")
      .def(nb::init<const std::string&, std::uintptr_t, std::uintptr_t, const Chain&,
                    const Channel&, bool>(),
           "library"_a, "model_address"_a, "data_address"_a, "nominal"_a, "channel"_a,
           "compensate_gravity"_a)
      .def("reset", &MujocoLoop::reset)
      .def(
          "apply",
          [](MujocoLoop& self, const Vec7& tau, int steps, const Vec7& drive) {
            const nb::gil_scoped_release release;
            self.apply(tau, steps, drive);
          },
          "tau"_a, "steps"_a, "drive"_a = Vec7(Vec7::Zero()))
      .def("drop_commands", &MujocoLoop::drop_commands)
      .def(
          "run",
          [](MujocoLoop& self, Controller& controller, const Target& target, int steps,
             Log log) {
            double* rows = log.data();
            const int cycles = static_cast<int>(log.shape(0));
            nb::gil_scoped_release release;
            self.run(controller, target, cycles, steps, rows);
          },
          "controller"_a, "target"_a, "steps"_a, "log"_a.noconvert())
      .def(
          "run_faulty",
          [](MujocoLoop& self, Controller& controller, const Target& target, int steps,
             Faults faults, Log log) {
            if (faults.shape(0) != log.shape(0)) {
              throw nb::value_error("faults and log differ in their number of cycles");
            }
            double* rows = log.data();
            const std::int8_t* what = faults.data();
            const int cycles = static_cast<int>(log.shape(0));
            nb::gil_scoped_release release;
            self.run_faulty(controller, target, cycles, steps, what, rows);
          },
          "controller"_a, "target"_a, "steps"_a, "faults"_a, "log"_a.noconvert(),
          "run with one fault per cycle: 0 none, 1 to 7 the state of so many cycles "
          "ago, -1 lost and told, -2 lost untold.")
      .def(
          "attach_judge",
          [](MujocoLoop& self, ContactJudge* judge, int body) {
            self.attach_probe(judge, body);
          },
          "judge"_a.none(), "body"_a, nb::keep_alive<1, 2>(),
          "Let a judge pull and look in every physics step; body: whose centre of "
          "mass is the TCP.")
      .def(
          "read",
          [](const MujocoLoop& self) {
            NewArray array(2 * kNumJoints);
            Eigen::Map<Vec7>(array.data()) = self.q();
            Eigen::Map<Vec7>(array.data() + kNumJoints) = self.dq();
            return nb::make_tuple(array.piece(0, kNumJoints),
                                  array.piece(kNumJoints, 2 * kNumJoints));
          },
          nb::sig("def read(self) -> tuple[numpy.typing.NDArray[numpy.float64], "
                  "numpy.typing.NDArray[numpy.float64]]"))
      .def("contact_force", &MujocoLoop::contact_force)
      .def("contact_force_peak", &MujocoLoop::contact_force_peak)
      .def("set_channel", &MujocoLoop::set_channel, "channel"_a)
      .def("seed", &MujocoLoop::seed, "seed"_a);
}
