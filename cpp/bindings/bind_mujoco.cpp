#include "bind_mujoco.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>
#include <utility>
#include <vector>

#include "dovetail/mujoco_loop.hpp"
#include "new_array.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using namespace dovetail;

void bind_mujoco(nb::module_& m) {
  using State = std::tuple<Vec7, Vec7>;
  using Log =
      nb::ndarray<double, nb::shape<-1, kCycleColumns>, nb::c_contig, nb::device::cpu>;

  using Faults =
      nb::ndarray<const std::int8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

  using Detents = std::vector<std::array<double, 3>>;
  nb::class_<PartJoint>(m, "PartJoint",
                        "Spring, damper and detents of a part's hinge or slide.")
      .def(
          "__init__",
          [](PartJoint* self, double stiffness, double rest, double damping,
             double armature, const Detents& detents) {
            new (self) PartJoint{stiffness, rest, damping, armature, {}};
            for (const auto& [position, force, half_width] : detents) {
              self->detents.push_back({position, force, half_width});
            }
          },
          nb::kw_only(), "stiffness"_a, "rest"_a, "damping"_a, "armature"_a,
          "detents"_a, "detents: position, largest force, half width of each.")
      .def("implicit_damping", &PartJoint::implicit_damping, "q"_a, "h"_a)
      .def("force", &PartJoint::force, "q"_a)
      .def("slope", &PartJoint::slope, "q"_a);

  nb::class_<StepProbe>(m, "StepProbe", "Force and look between two physics steps.");
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
      .def("attach_probe", &MujocoLoop::attach_probe, "probe"_a.none(), "body"_a,
           nb::keep_alive<1, 2>(),
           "Let a probe pull and look in every physics step; body: whose centre of "
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
      .def("set_part_joints", &MujocoLoop::set_part_joints, "joints"_a,
           "Spring and detents of the joints after the arm's seven.")
      .def("set_channel", &MujocoLoop::set_channel, "channel"_a)
      .def("seed", &MujocoLoop::seed, "seed"_a);
}
