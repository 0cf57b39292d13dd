#include "bind_mujoco.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <tuple>

#include "dovetail/mujoco_loop.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using namespace dovetail;

void bind_mujoco(nb::module_& m) {
  using State = std::tuple<Vec7, Vec7>;
  using Log =
      nb::ndarray<double, nb::shape<-1, kCycleColumns>, nb::c_contig, nb::device::cpu>;

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
      .def("read", [](const MujocoLoop& self) { return State(self.q(), self.dq()); })
      .def("contact_force", &MujocoLoop::contact_force)
      .def("contact_force_peak", &MujocoLoop::contact_force_peak)
      .def("set_channel", &MujocoLoop::set_channel, "channel"_a)
      .def("seed", &MujocoLoop::seed, "seed"_a);
}
