#include "bind_servo.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <system_error>

#include "bind_fri_parts.hpp"
#include "dovetail/parameters.hpp"
#include "dovetail/servo_loop.hpp"
#include "task_from.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;
using namespace dovetail::binding;

namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

nb::dict times_of(const Histogram& histogram) {
  nb::dict times;
  times["count"] = histogram.count();
  times["p50"] = histogram.quantile(0.5);
  times["p99"] = histogram.quantile(0.99);
  times["p999"] = histogram.quantile(0.999);
  times["max"] = histogram.largest();
  nb::list edges, counts;
  for (int i = 0; i < Histogram::kBins; ++i) {
    if (histogram.count(i) == 0) continue;
    edges.append(Histogram::upper_edge(i));
    counts.append(histogram.count(i));
  }
  times["upper_edges"] = edges;
  times["counts"] = counts;
  return times;
}

nb::dict counts_of(const ServoLoop& loop) {
  nb::dict counts;
  for (int i = 0; i < static_cast<int>(Count::kNumber); ++i) {
    const auto count = static_cast<Count>(i);
    counts[name(count)] = loop.count(count);
  }
  return counts;
}

Rows rows_of(const ServoLoop& loop, std::uint64_t from, std::uint64_t to, int columns) {
  const std::uint64_t count = to > from ? to - from : 0;
  Rows rows(static_cast<Eigen::Index>(count), columns);
  if (!loop.log().copy(from, from + count, static_cast<std::size_t>(columns),
                       rows.data())) {
    throw std::out_of_range("rows " + std::to_string(from) + " to " +
                            std::to_string(to) + " are not in the log any more");
  }
  return rows;
}

void bind_parameters(nb::module_& m) {
  nb::class_<WatchdogParams>(m, "WatchdogParams", "When an arm must not follow.")
      .def(nb::init<>())
      .def_rw("target_timeout", &WatchdogParams::target_timeout)
      .def_rw("position_margin", &WatchdogParams::position_margin)
      .def_rw("speed_margin", &WatchdogParams::speed_margin)
      .def_rw("torque_error", &WatchdogParams::torque_error)
      .def_rw("external_torque", &WatchdogParams::external_torque)
      .def_rw("confirm", &WatchdogParams::confirm)
      .def_rw("confirm_tracking", &WatchdogParams::confirm_tracking)
      .def_rw("rest_speed", &WatchdogParams::rest_speed);
  nb::class_<ServoParams>(m, "ServoParams", "One cycle of a servo loop.")
      .def(nb::init<>())
      .def_prop_rw(
          "version", [](const ServoParams& p) { return fri::name(p.version); },
          [](ServoParams& p, const std::string& text) {
            p.version = require_version(text);
          })
      .def_rw("period", &ServoParams::period)
      .def_rw("lockstep", &ServoParams::lockstep)
      .def_rw("position_filter", &ServoParams::position_filter)
      .def_rw("observer_gain", &ServoParams::observer_gain)
      .def_rw("measured_sign", &ServoParams::measured_sign)
      .def_rw("commanded_sign", &ServoParams::commanded_sign)
      .def_rw("external_sign", &ServoParams::external_sign)
      .def_rw("commanded_is_total", &ServoParams::commanded_is_total)
      .def_rw("log_seconds", &ServoParams::log_seconds)
      .def_rw("watchdog", &ServoParams::watchdog);
  nb::class_<LoopParams>(m, "LoopParams", "Socket and thread of a servo loop.")
      .def(nb::init<>())
      .def_rw("address", &LoopParams::address)
      .def_rw("port", &LoopParams::port)
      .def_rw("peer", &LoopParams::peer)
      .def_rw("priority", &LoopParams::priority)
      .def_rw("processor", &LoopParams::processor)
      .def_rw("lock_memory", &LoopParams::lock_memory)
      .def_rw("silence", &LoopParams::silence)
      .def_rw("log_folder", &LoopParams::log_folder);
}

template <class Enum>
auto number(Enum ServoState::* field) {
  return [field](const ServoState& state) { return static_cast<int>(state.*field); };
}

void bind_end(nb::module_& m) {
  nb::class_<MotionEnd>(m, "MotionEnd", "The message that ended a motion.")
      .def_prop_ro(
          "cause", [](const MotionEnd& end) { return name(end.cause); },
          "none, session, period, problem or silence.")
      .def_prop_ro(
          "what", [](const MotionEnd& end) { return change_of(end).what; },
          "What changed; empty where only the session's state did.")
      .def_prop_ro("before", [](const MotionEnd& end) { return change_of(end).before; })
      .def_prop_ro("after", [](const MotionEnd& end) { return change_of(end).after; })
      .def_prop_ro("session_name",
                   [](const MotionEnd& end) { return fri::name(end.session); })
      .def_ro("safety", &MotionEnd::safety, "0 normal, else the stop level + 1.")
      .def_ro("operation_mode", &MotionEnd::operation_mode, "0 T1, 1 T2, 2 AUT.")
      .def_ro("implausible", &MotionEnd::implausible,
              "Messages of that motion whose position was not believed.")
      .def_ro("joint", &MotionEnd::joint, "Of the last of them, 0 to 6; -1 for none.")
      .def_ro("since_implausible", &MotionEnd::since_implausible,
              "From that one to the end [s].");
}

void bind_state(nb::module_& m) {
  nb::class_<ServoState>(m, "ServoState", "What a servo loop last knew.")
      .def_ro("tick", &ServoState::tick, "Control periods while active.")
      .def_ro("motion", &ServoState::motion, "Times COMMANDING_ACTIVE was entered.")
      .def_ro("first", &ServoState::first, "Sequence of that motion's first message.")
      .def_ro("rows", &ServoState::rows, "Rows of the log so far.")
      .def_ro("time", &ServoState::time, "Since the motion began [s].")
      .def_ro("q", &ServoState::q,
              "Configuration [rad]: measured, or predicted where that is not believed.")
      .def_ro("dq", &ServoState::dq, "Velocity [rad/s], the same.")
      .def_ro("is_plausible", &ServoState::is_plausible,
              "The last one is as measured, and can be.")
      .def_ro("implausible", &ServoState::implausible,
              "Messages of this motion whose position was not believed.")
      .def_ro("tau_measured", &ServoState::tau_measured, "On the joint [Nm].")
      .def_ro("tau_external", &ServoState::tau_external, "On the joint [Nm].")
      .def_ro("tau_commanded", &ServoState::tau_commanded, "On the joint [Nm].")
      .def_prop_ro("session", number(&ServoState::session), "0 IDLE to 4 ACTIVE.")
      .def_prop_ro("session_name",
                   [](const ServoState& s) { return fri::name(s.session); })
      .def_prop_ro("last_session_name",
                   [](const ServoState& s) { return fri::name(s.last_session); })
      .def_prop_ro("last_session", number(&ServoState::last_session),
                   "Of the last message, whatever silence there was since.")
      .def_prop_ro("quality", number(&ServoState::quality), "0 POOR to 3 EXCELLENT.")
      .def_ro("safety", &ServoState::safety, "0 normal, else the stop level + 1.")
      .def_ro("operation_mode", &ServoState::operation_mode, "0 T1, 1 T2, 2 AUT.")
      .def_ro("control_mode", &ServoState::control_mode,
              "0 position, 1 Cartesian impedance, 2 joint impedance, 3 none.")
      .def_ro("drives", &ServoState::drives, "0 off, 1 transitioning, 2 active.")
      .def_ro("send_period", &ServoState::send_period, "[ms]")
      .def_ro("multiplier", &ServoState::multiplier)
      .def_ro("tracking", &ServoState::tracking)
      .def_prop_ro("refusal", number(&ServoState::refusal),
                   "0 none, 1 period, 2 problem of the session, 3 start.")
      .def_ro("end", &ServoState::end, "How the last motion ended.")
      .def_ro("is_waiting", &ServoState::is_waiting)
      .def_ro("is_held", &ServoState::is_held, "No Target is followed.")
      .def_ro("is_stopped", &ServoState::is_stopped, "A controlled stop.")
      .def_ro("is_at_rest", &ServoState::is_at_rest, "Held or stopped, and at rest.")
      .def_prop_ro("stop_reason",
                   [](const ServoState& s) { return name(s.facts.reason); })
      .def_prop_ro("stop_text", [](const ServoState& s) { return describe(s.facts); });
}

/// std::system_error as OSError, whose errno says what it was.
void raise_os_error(const std::exception_ptr& thrown, void* /*payload*/) {
  try {
    std::rethrow_exception(thrown);
  } catch (const std::system_error& error) {
    const nb::object facts = nb::make_tuple(error.code().value(), error.what());
    PyErr_SetObject(PyExc_OSError, facts.ptr());
  }
}

void bind_loop(nb::module_& m) {
  nb::register_exception_translator(raise_os_error);
  nb::enum_<WaitResult>(m, "WaitResult")
      .value("reached", WaitResult::kReached)
      .value("motion_ended", WaitResult::kMotionEnded)
      .value("time", WaitResult::kTime);
  nb::class_<ServoLoop>(m, "ServoLoop", "A controller behind FRI, on its own thread.")
      .def(
          "__init__",
          [](ServoLoop* self, const LoopParams& loop, const ServoParams& servo,
             const Chain& chain, const OscParams& osc, const LimitParams& limits,
             const std::array<int, 6>& task) {
            new (self)
                ServoLoop(loop, servo, chain.params(), osc, limits, task_from(task));
          },
          "loop"_a, "servo"_a, "chain"_a, "osc"_a, "limits"_a, "task"_a,
          "Raises ValueError naming a number that is out of range, OSError where the "
          "socket cannot be had.")
      .def("command", &ServoLoop::command, "target"_a, "motion"_a, "tick"_a,
           "A Target for one motion. Lockstep: cycles below this tick are answered.")
      .def(
          "hold_at",
          [](ServoLoop& self, const Vec3& position_hold, const Vec4& quat_hold) {
            check_hold(position_hold, quat_hold);
            self.hold_at(position_hold, quat_hold);
          },
          "position_hold"_a, "quat_hold"_a,
          "Raises ValueError naming the element that is out of range.")
      .def("lean", &ServoLoop::lean, "q"_a,
           "Lean the sent position by this [rad], 0.05 at most; zero ends it.")
      .def("wait", &ServoLoop::wait, "tick"_a, "motion"_a, "seconds"_a,
           nb::call_guard<nb::gil_scoped_release>())
      .def("wait_for_motion", &ServoLoop::wait_for_motion, "motion"_a, "seconds"_a,
           nb::call_guard<nb::gil_scoped_release>())
      .def("stop", &ServoLoop::stop)
      .def("clear", &ServoLoop::clear)
      .def("expect_end", &ServoLoop::expect_end)
      .def("close", &ServoLoop::close, nb::call_guard<nb::gil_scoped_release>())
      .def("state", &ServoLoop::state)
      .def("rows", &rows_of, "begin"_a, "end"_a, "columns"_a,
           "Copy rows [begin, end) of the log, their first columns.")
      .def("oldest_row", [](const ServoLoop& loop) { return loop.log().oldest(); })
      .def("counts", &counts_of)
      .def("times",
           [](const ServoLoop& loop) {
             nb::dict times;
             times["cycle_time"] = times_of(loop.cycle_time());
             times["reply_time"] = times_of(loop.reply_time());
             times["arrival_jitter"] = times_of(loop.arrival_jitter());
             return times;
           })
      .def("diagnose", &ServoLoop::diagnose, nb::call_guard<nb::gil_scoped_release>())
      .def("since_datagram", &ServoLoop::since_datagram,
           "Since the cabinet's last datagram [s]; inf where none came.")
      .def("since_message", &ServoLoop::since_message,
           "Since its last one that could be read [s]; inf where none came.")
      .def("last_undecodable", &ServoLoop::last_undecodable)
      .def("last_not_finite", &ServoLoop::last_not_finite,
           "Its field, and joint, that is not a finite number; empty where none is.")
      .def("notes", &ServoLoop::notes)
      .def_prop_ro("peer", [](const ServoLoop& loop) { return describe(loop.peer()); })
      .def_prop_ro("last_stranger",
                   [](const ServoLoop& loop) { return describe(loop.last_stranger()); })
      .def_prop_ro("port", &ServoLoop::port);
}

void bind_observer(nb::module_& m) {
  nb::class_<VelocityObserver>(m, "VelocityObserver",
                               "Joint velocity from positions and the commanded "
                               "acceleration.")
      .def(nb::init<double, double>(), "period"_a, "gain"_a = 1.0)
      .def(
          "reset",
          [](VelocityObserver& self, const Vec7& q) {
            check_configuration(q);
            self.reset(q);
          },
          "q"_a, "Start at rest at q [rad].")
      .def(
          "update",
          [](VelocityObserver& self, const Vec7& q, const Vec7& a, double elapsed) {
            return Vec7(self.update(q, a, elapsed));
          },
          "q"_a, "a"_a, "elapsed"_a = 0.0,
          "Measured q [rad] after elapsed [s] (0: one period) under a [rad/s2]: dq. "
          "What is not finite is not taken.")
      .def("doubt", &VelocityObserver::doubt,
           "The last position was not believed: forgotten if the next is where it was "
           "expected before.")
      .def_prop_ro("dq", &VelocityObserver::dq, nb::rv_policy::copy, "[rad/s]");
}

}  // namespace

void bind_servo(nb::module_& m) {
  bind_observer(m);
  bind_parameters(m);
  bind_end(m);
  bind_state(m);
  bind_loop(m);
}
