/// The Python module dovetail._core: borders only, no logic.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include "bind_chain.hpp"
#include "bind_cycle_log.hpp"
#include "bind_fri.hpp"
#include "bind_limits.hpp"
#include "bind_mujoco.hpp"
#include "bind_replay.hpp"
#include "bind_servo.hpp"
#include "bind_thread_pool.hpp"
#include "dovetail/controller.hpp"
#include "dovetail/parameters.hpp"
#include "dovetail/rigid_plant.hpp"
#include "task_from.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;
using dovetail::binding::task_from;

namespace {

void bind_parameters(nb::module_& m) {
  nb::enum_<Scheme>(m, "Scheme", "How the limits act.")
      .value("qp", Scheme::kQp)
      .value("paper", Scheme::kPaper);
  nb::enum_<BoundsKind>(m, "BoundsKind", "Formula of the acceleration bounds.")
      .value("viability", BoundsKind::kViability)
      .value("paper_corrected", BoundsKind::kPaperCorrected)
      .value("paper_printed", BoundsKind::kPaperPrinted);
  nb::class_<OscParams>(m, "OscParams", "Operational-space law.")
      .def(nb::init<>())
      .def_rw("stiffness", &OscParams::stiffness, "K per axis [1/s2].")
      .def_rw("damping_ratio", &OscParams::damping_ratio, "zeta, D = 2 zeta sqrt(K).")
      .def_rw("force_damping", &OscParams::force_damping, "D on force axes [1/s].")
      .def_rw("error_clamp_rotation", &OscParams::error_clamp_rotation, "[rad]")
      .def_rw("move_speed", &OscParams::move_speed, "[m/s]")
      .def_rw("turn_speed", &OscParams::turn_speed, "[rad/s]")
      .def_rw("integral_time", &OscParams::integral_time, "[s]")
      .def_rw("integral_clamp_linear", &OscParams::integral_clamp_linear, "[m/s2]")
      .def_rw("integral_clamp_angular", &OscParams::integral_clamp_angular, "[rad/s2]")
      .def_rw("error_clamp_position", &OscParams::error_clamp_position, "[m]")
      .def_rw("f_clamp_linear", &OscParams::f_clamp_linear, "Largest |f*| [m/s2].")
      .def_rw("f_clamp_angular", &OscParams::f_clamp_angular, "Largest |f*| [rad/s2].")
      .def_rw("k_null", &OscParams::k_null, "Null-space damping [1/s].")
      .def_rw("posture_stiffness", &OscParams::posture_stiffness,
              "Null-space stiffness [1/s2].")
      .def_rw("length_scale", &OscParams::length_scale, "L of rotation rows [m/rad].")
      .def_rw("s0", &OscParams::s0, "Eigenvalue fade threshold [1/kg].")
      .def_rw("joint_stiffness", &OscParams::joint_stiffness, "Joint targets [1/s2].")
      .def_rw("joint_damping_ratio", &OscParams::joint_damping_ratio)
      .def_rw("use_jdot", &OscParams::use_jdot, "Subtract dJ dq in the task.")
      .def_rw("use_coriolis", &OscParams::use_coriolis, "Add c to u0.");
  nb::class_<LimitParams>(m, "LimitParams", "Every limit. NaN means not set yet.")
      .def(nb::init<>())
      .def_rw("q_min", &LimitParams::q_min, "Lower joint limits [rad].")
      .def_rw("q_max", &LimitParams::q_max, "Upper joint limits [rad].")
      .def_rw("dq_max", &LimitParams::dq_max, "Joint speed limits [rad/s].")
      .def_rw("tau_max", &LimitParams::tau_max, "Motor torques, with gravity [Nm].")
      .def_rw("ddq_max", &LimitParams::ddq_max, "Joint acceleration A [rad/s2].")
      .def_rw("taper_brake", &LimitParams::taper_brake, "Of the speed limit [rad/s2].")
      .def_rw("taper_offset", &LimitParams::taper_offset, "Likewise [rad/s].")
      .def_rw("dtau_max", &LimitParams::dtau_max, "Change of the torque [Nm/s].")
      .def_rw("jerk_max", &LimitParams::jerk_max, "Joint jerk planned with [rad/s3].")
      .def_rw("eta", &LimitParams::eta, "Share of A planned for braking.")
      .def_rw("kappa", &LimitParams::kappa, "Bound interval over the period.")
      .def_rw("delta_q", &LimitParams::delta_q, "Joint position margin [rad].")
      .def_rw("delta_v", &LimitParams::delta_v, "Speed margin, as a share.")
      .def_rw("walls", &LimitParams::walls, "Cartesian walls on the TCP.")
      .def_rw("x_min", &LimitParams::x_min, "Lower walls, world [m].")
      .def_rw("x_max", &LimitParams::x_max, "Upper walls, world [m].")
      .def_rw("dx_max", &LimitParams::dx_max, "TCP speed per axis [m/s].")
      .def_rw("near_speed", &LimitParams::near_speed, "TCP speed near contact [m/s].")
      .def_rw("near_press", &LimitParams::near_press, "f* into what is near [m/s2].")
      .def_rw("ddx_max", &LimitParams::ddx_max, "TCP acceleration per axis [m/s2].")
      .def_rw("eta_wall", &LimitParams::eta_wall, "Share of ddx_max for braking.")
      .def_rw("delta_x", &LimitParams::delta_x, "Wall margin [m].")
      .def_rw("jerk_wall", &LimitParams::jerk_wall, "TCP jerk planned with [m/s3].")
      .def_rw("s0_wall", &LimitParams::s0_wall, "Fade threshold of SCS [1/kg].")
      .def_rw("rho", &LimitParams::rho, "Weight of the wall slack.")
      .def_rw("estimate_rate", &LimitParams::estimate_rate,
              "Bandwidth of the disturbance estimate [1/s].")
      .def_rw("passive", &LimitParams::passive, "Limiters brake and do no more.")
      .def_rw("brake_rate", &LimitParams::brake_rate, "Of that braking [1/s].")
      .def_rw("last_line", &LimitParams::last_line, "Ends what no Target explains.")
      .def_rw("authority", &LimitParams::authority, "Most braking over ddq_max.")
      .def_rw("damping", &LimitParams::damping, "Modelled friction [Nms/rad].")
      .def_rw("armature", &LimitParams::armature, "Modelled rotor inertia [kg m2].")
      .def_rw("mid_interval", &LimitParams::mid_interval, "Model at q + dq dt / 2.")
      .def_rw("exact_sjs", &LimitParams::exact_sjs, "Continue SJS to the projection.")
      .def_rw("scheme", &LimitParams::scheme, "qp or paper.")
      .def_rw("bounds", &LimitParams::bounds, "Formula of the bounds.");
}

void bind_data(nb::module_& m) {
  nb::class_<Target>(m, "Target", "One policy command, held until the next one.")
      .def(nb::init<const Target&>(), "other"_a, "A copy.")
      .def(
          "__init__",
          [](Target* self, const Vec6& f_star, const Vec3& position_d,
             const Vec4& quat_wxyz_d, bool joint_mode, const Vec7& q_d) {
            new (self) Target{};
            self->f_star = f_star;
            self->position_d = position_d;
            self->quat_wxyz_d = quat_wxyz_d;
            self->joint_mode = joint_mode;
            self->q_d = q_d;
          },
          "f_star"_a = Vec6(Vec6::Zero()), "position_d"_a = Vec3(Vec3::Zero()),
          "quat_wxyz_d"_a = Vec4(1.0, 0.0, 0.0, 0.0), "joint_mode"_a = false,
          "q_d"_a = Vec7(Vec7::Zero()))
      .def_rw(
          "f_star", &Target::f_star,
          "Force axes, and added to pose and hold axes [m/s2, rad/s2], world, (6,).")
      .def_rw("position_d", &Target::position_d, "Pose axes: TCP position [m], (3,).")
      .def_rw("quat_wxyz_d", &Target::quat_wxyz_d, "Pose axes: TCP rotation, (4,).")
      .def_rw(
          "velocity_d", &Target::velocity_d,
          "Feed-forward of pose and force axes [m/s, rad/s], world, shape (6,): the "
          "desired pose moves on for 0.1 s.")
      .def_rw("acceleration_d", &Target::acceleration_d,
              "Feed-forward of pose and force axes [m/s2, rad/s2], world, shape (6,).")
      .def_rw("age", &Target::age, "Time since it was made [s]; its holder counts.")
      .def_rw(
          "near_plane", &Target::near_plane,
          "Unit normal n and d [m]: where n . p < d, near_speed and near_press hold.")
      .def_rw("f_tare", &Target::f_tare,
              "How much of f_star holds the tool's weight [m/s2, rad/s2], (6,).")
      .def_rw("stay", &Target::stay,
              "Force axes X Y Z (bits 0 to 2) held where they are: nothing is asked.")
      .def_rw("joint_mode", &Target::joint_mode, "Go to q_d; task axes are not used.")
      .def_rw("q_d", &Target::q_d, "Desired configuration [rad], shape (7,).");
  m.def("check_target", &check_target, "target"_a,
        "Raises ValueError naming the element of a Target that is out of range.");
  nb::class_<Flags>(m, "Flags",
                    "What limited a cycle. Masks: bit i is joint A(i+1) or axis XYZ.")
      .def(nb::init<>(), "Nothing limited it.")
      .def_ro("joint_position", &Flags::joint_position)
      .def_ro("joint_velocity", &Flags::joint_velocity)
      .def_ro("joint_acceleration", &Flags::joint_acceleration)
      .def_ro("torque", &Flags::torque)
      .def_ro("wall_position", &Flags::wall_position)
      .def_ro("wall_velocity", &Flags::wall_velocity)
      .def_ro("wall_acceleration", &Flags::wall_acceleration)
      .def_ro("wall_displaced", &Flags::wall_displaced, "A wall could not be met.")
      .def_ro("bad_input", &Flags::bad_input,
              "Input that is none, or a torque that is not finite: damped hold.")
      .def_ro("unsafe", &Flags::unsafe, "The torque had to be clipped.")
      .def_ro("qp_early", &Flags::qp_early, "The QP stopped early: safe answer.")
      .def_ro("target_late", &Flags::target_late, "No fresh Target: held.")
      .def_ro("stopped", &Flags::stopped, "A watchdog's stop: braked, then held.")
      .def_ro("implausible", &Flags::implausible, "A measurement was not believed.")
      .def_ro("ended", &Flags::ended, "The last line ended the motion: damped hold.")
      .def_ro("displaced", &Flags::displaced, "|a - a0| [rad/s2].")
      .def_prop_ro("packed", &pack_flags,
                   "All in one int, as logged: flag_bits says which is which.");
  nb::class_<StepResult>(m, "StepResult", "What one cycle gave.")
      .def_ro("tau", &StepResult::tau, "Overlay torque, gravity excluded [Nm].")
      .def_ro("a", &StepResult::a, "Commanded joint acceleration [rad/s2].")
      .def_ro("a0", &StepResult::a0, "What the task asked for [rad/s2].")
      .def_ro("flags", &StepResult::flags, "What limited the cycle.");
}

nb::dict model_of(const Controller& controller) {
  const OscTerms& osc = controller.osc_terms();
  const CycleBounds& bounds = controller.bounds();
  const Mat7 N = Mat7::Identity() -
                 osc.J.transpose() * osc.Lambda * osc.J * controller.inverse_inertia();
  nb::dict model;
  model["J_task"] = osc.J;
  model["Lambda"] = osc.Lambda;
  model["N"] = N;
  model["M"] = controller.inertia();
  model["Minv"] = controller.inverse_inertia();
  model["h"] = controller.bias();
  model["f"] = osc.f;
  model["u0"] = osc.u0;
  model["exact"] = osc.exact;
  model["lb"] = bounds.lb;
  model["ub"] = bounds.ub;
  model["cl"] = bounds.cl;
  model["cu"] = bounds.cu;
  return model;
}

void bind_controller(nb::module_& m) {
  nb::class_<Controller>(m, "Controller",
                         "The one road from a Target to a torque; one thread only.")
      .def(
          "__init__",
          [](Controller* self, const Chain& chain, const OscParams& osc,
             const LimitParams& limits, const std::array<int, 6>& task, double period) {
            new (self) Controller(chain.params(), osc, limits, task_from(task), period);
          },
          "chain"_a, "osc"_a, "limits"_a, "task"_a, "period"_a,
          "task: modes of X Y Z C B A, 0 free, 1 force, 2 pose, 3 hold. period [s]. "
          "Raises ValueError naming the element that is out of range.")
      .def(
          "reset",
          [](Controller& self, const Vec7& q, const Vec3& position_hold,
             const Vec4& quat_hold, const Vec7& dq) {
            check_state(q, dq);
            check_hold(position_hold, quat_hold);
            self.reset(q, position_hold, quat_hold, dq);
          },
          "q"_a, "position_hold"_a, "quat_hold"_a, "dq"_a = Vec7(Vec7::Zero()),
          "Start afresh at q [rad], moving at dq [rad/s]; hold axes keep this TCP "
          "position [m] and rotation (wxyz). Raises ValueError naming the element that "
          "is out of range.")
      .def("had", &Controller::had, "tau"_a,
           "Take a torque for the one that the arm last had [Nm]: dtau_max counts from "
           "it.")
      .def(
          "believe",
          [](Controller& self, const Vec7& q, const Vec7& dq) {
            check_state(q, dq);
            self.believe(q, dq);
          },
          "q"_a, "dq"_a,
          "Take a state for true whatever was before, and change nothing else. Raises "
          "ValueError naming the element that is out of range.")
      .def(
          "step",
          [](Controller& self, const Vec7& q, const Vec7& dq, const Target& target,
             double elapsed) { return self.step(q, dq, target, elapsed); },
          "q"_a, "dq"_a, "target"_a, "elapsed"_a = 0.0,
          "One cycle from measured q [rad], dq [rad/s]: overlay torque and flags. "
          "elapsed: time since the last cycle [s], 0 to below 10; 0 is one period. "
          "Never raises: bad input is a damped hold and the flag bad_input.")
      .def(
          "hold_at",
          [](Controller& self, const Vec3& position_hold, const Vec4& quat_hold) {
            check_hold(position_hold, quat_hold);
            self.hold_at(position_hold, quat_hold);
          },
          "position_hold"_a, "quat_hold"_a,
          "Latch another TCP pose for hold axes: position [m], rotation (wxyz). Raises "
          "ValueError naming the element that is out of range.")
      .def(
          "osc_terms",
          [](const Controller& self, const Vec7& q, const Vec7& dq,
             const Target* given) {
            const Target target = given != nullptr ? *given : Target{};
            check_state(q, dq);
            check_target(target);
            Controller probe = self;  // a copy: the disturbance estimate stays as it is
            probe.believe(q, dq);
            static_cast<void>(probe.step(q, dq, target));
            return model_of(probe);
          },
          "q"_a, "dq"_a, "target"_a = nb::none(),
          "What a cycle at (q, dq) would use: J_task and Lambda with rotation rows "
          "scaled by length_scale and zero rows for free axes, N, M (with armature), "
          "Minv, h, f (scaled), u0, exact, lb, ub, cl, cu. Changes nothing. Raises "
          "ValueError naming the element that is out of range.")
      .def_prop_ro("limits", &Controller::limits, nb::rv_policy::copy,
                   "A copy of the limits that are enforced.")
      .def_prop_ro(
          "end",
          [](const Controller& self) {
            const LastLine& end = self.end();
            return std::tuple(std::string(name(end.cause())), end.joint(), end.value(),
                              end.limit());
          },
          "What the last line ended the motion for: cause (none, oscillation, energy, "
          "force or speed), joint (0 to 6, or -1), value and what was allowed [SI].")
      .def_prop_ro(
          "end_text",
          [](const Controller& self) {
            const LastLine& end = self.end();
            return describe(end.cause(), end.joint(), end.value(), end.limit());
          },
          "The same in words; empty where it ended nothing.")
      .def_prop_ro(
          "believed",
          [](const Controller& self) {
            return std::pair(self.state().q(), self.state().dq());
          },
          "The state that the last cycle took for true: (q [rad], dq [rad/s]).")
      .def_prop_ro("period", &Controller::period, "Control period [s].")
      .def_prop_ro("disturbance", &Controller::disturbance, nb::rv_policy::copy,
                   "Estimated external torque [Nm], shape (7,).")
      .def_prop_ro(
          "wrench", [](const Controller& self) { return self.wrench(); },
          "The same as a wrench on the tool at the TCP, world axes [N, Nm], shape "
          "(6,); "
          "not-a-number where the estimate is off.");
}

void bind_rigid_plant(nb::module_& m) {
  nb::class_<RigidPlant>(m, "RigidPlant",
                         "Exact rigid arm whose gravity is compensated, RK4.")
      .def(
          "__init__",
          [](RigidPlant* self, const Chain& chain, const Vec7& damping,
             const Vec7& armature, const Vec7& coulomb, double dt_sub,
             const Chain* nominal) {
            new (self) RigidPlant((nominal != nullptr ? *nominal : chain).params(),
                                  chain.params(), {damping, armature, coulomb, dt_sub});
          },
          "chain"_a, "damping"_a = Vec7(Vec7::Zero()),
          "armature"_a = Vec7(Vec7::Zero()), "coulomb"_a = Vec7(Vec7::Zero()),
          "dt_sub"_a = 5e-4, "nominal"_a = nb::none(),
          "chain moves; nominal (the same where None) compensates gravity. damping "
          "[Nms/rad], armature [kg m2], coulomb [Nm], dt_sub [s].")
      .def("reset", &RigidPlant::reset, "q"_a, "dq"_a)
      .def(
          "read",
          [](const RigidPlant& plant) { return std::pair(plant.q(), plant.dq()); },
          "(q [rad], dq [rad/s])")
      .def("apply", &RigidPlant::apply, "tau"_a, "dt"_a,
           "Hold the overlay torque tau [Nm] for dt [s].")
      .def("acceleration", &RigidPlant::acceleration, "q"_a, "dq"_a, "tau"_a,
           "ddq [rad/s2] at a state under tau [Nm].")
      .def("kinetic_energy", &RigidPlant::kinetic_energy, "[J]")
      .def("set_external_force", &RigidPlant::set_external_force, "f"_a,
           "Force on the TCP [N], world axes, until changed.");
}

}  // namespace

NB_MODULE(_core, m) {
  m.doc() = "Fixed-size robot control in C++: SI units, wxyz, [linear; angular].";
  bind_chain(m);
  bind_parameters(m);
  bind_data(m);
  bind_limits(m);
  bind_controller(m);
  bind_rigid_plant(m);
  bind_cycle_log(m);
  bind_mujoco(m);
  bind_thread_pool(m);
  bind_replay(m);
  bind_fri(m);
  bind_servo(m);
}
