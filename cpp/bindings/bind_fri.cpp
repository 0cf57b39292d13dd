#include "bind_fri.hpp"

#include <nanobind/eigen/dense.h>

#include "bind_fri_parts.hpp"
#include "dovetail/types.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;
using namespace dovetail::binding;

namespace {

/// A member of N numbers: an array, or None.
template <class C, std::size_t N>
void add_vector(nb::class_<C>& cls, const char* name,
                std::optional<std::array<double, N>> C::* member, const char* doc) {
  using Vec = Eigen::Matrix<double, static_cast<int>(N), 1>;
  cls.def_prop_rw(
      name,
      [member](const C& self) -> std::optional<Vec> {
        const auto& values = self.*member;
        if (!values) return std::nullopt;
        return Vec(Eigen::Map<const Vec>(values->data()));
      },
      [member, name](C& self, nb::object values) {
        if (values.is_none())
          self.*member = std::nullopt;
        else
          self.*member = to_array<N>(name, values);
      },
      nb::for_setter(nb::arg("value").none()), doc);
}

template <class C, class E>
void add_enum(nb::class_<C>& cls, const char* name, std::optional<E> C::* member,
              int largest, const char* doc) {
  cls.def_prop_rw(
      name, [member](const C& self) { return self.*member; },
      [member, name, largest](C& self, std::optional<int> value) {
        if (value)
          self.*member = to_enum<E>(name, *value, largest);
        else
          self.*member = std::nullopt;
      },
      nb::for_setter(nb::arg("value").none()), doc);
}

template <class C, class T, std::size_t N>
void add_list(nb::class_<C>& cls, const char* name, fri::List<T, N> C::* member,
              const char* doc) {
  cls.def_prop_rw(
      name,
      [member](const C& self) {
        const auto& list = self.*member;
        return std::vector<T>(list.begin(), list.end());
      },
      [member, name](C& self, const std::vector<T>& items) {
        self.*member = to_list<fri::List<T, N>>(name, items);
      },
      doc);
}

template <class C>
void add_header(nb::class_<C>& cls) {
  cls.def_prop_rw(
         "sequence", [](const C& self) { return self.header.sequence; },
         [](C& self, std::uint32_t value) { self.header.sequence = value; },
         "Sequence counter: grows by one per message sent.")
      .def_prop_rw(
          "reflected", [](const C& self) { return self.header.reflected; },
          [](C& self, std::uint32_t value) { self.header.reflected = value; },
          "Reflected counter: the other side's last sequence.")
      .def(
          "__eq__", [](const C& self, const C& other) { return self == other; },
          nb::is_operator(), nb::sig("def __eq__(self, other: object, /) -> bool"));
}

template <class C, class Encode, class Decode>
void add_codec(nb::class_<C>& cls, Encode encode, Decode decode) {
  cls.def(
         "encode",
         [encode](const C& self, fri::Version version) {
           std::uint8_t bytes[fri::kMaxDatagram];
           const std::size_t size = encode(self, version, bytes);
           if (size == 0)
             throw std::invalid_argument(
                 "the message does not fit in a datagram of 1500 bytes, has a joint "
                 "value or wrench that is not finite, or too many values in a "
                 "transformation");
           return nb::bytes(reinterpret_cast<const char*>(bytes), size);
         },
         "version"_a, "The datagram. Raises ValueError where it cannot be sent.")
      .def_static(
          "decode",
          [decode](fri::Version version, nb::bytes data) {
            C message;
            const fri::DecodeResult result =
                decode(reinterpret_cast<const std::uint8_t*>(data.c_str()), data.size(),
                       version, message);
            if (!result.ok()) throw std::invalid_argument(fri::describe(result));
            return message;
          },
          "version"_a, "data"_a,
          "The message in a datagram. Raises ValueError with the reason.");
}

/// The four attributes that are absent together: setting one makes them present.
void add_connection(nb::class_<fri::MonitoringMessage>& cls) {
  using M = fri::MonitoringMessage;
  const auto connection = [](M& self) -> fri::ConnectionInfo& {
    if (!self.connection) self.connection.emplace();
    return *self.connection;
  };
  cls.def_prop_rw(
         "state",
         [](const M& self) -> std::optional<fri::SessionState> {
           if (!self.connection) return std::nullopt;
           return self.connection->state;
         },
         [connection](M& self, std::optional<int> value) {
           if (value)
             connection(self).state = to_enum<fri::SessionState>("state", *value, 4);
           else
             self.connection = std::nullopt;
         },
         nb::for_setter(nb::arg("value").none()),
         "Session state. None: no connection data, to be read as IDLE; setting None "
         "removes quality, send_period_ms and receive_multiplier too.")
      .def_prop_rw(
          "quality",
          [](const M& self) -> std::optional<fri::Quality> {
            if (!self.connection) return std::nullopt;
            return self.connection->quality;
          },
          [connection](M& self, int value) {
            connection(self).quality = to_enum<fri::Quality>("quality", value, 3);
          },
          "Connection quality.")
      .def_prop_rw(
          "send_period_ms",
          [](const M& self) -> std::optional<std::uint32_t> {
            return self.connection ? self.connection->send_period : std::nullopt;
          },
          [connection](M& self, std::optional<std::uint32_t> value) {
            connection(self).send_period = value;
          },
          nb::for_setter(nb::arg("value").none()), "Send period [ms].")
      .def_prop_rw(
          "receive_multiplier",
          [](const M& self) -> std::optional<std::uint32_t> {
            return self.connection ? self.connection->receive_multiplier : std::nullopt;
          },
          [connection](M& self, std::optional<std::uint32_t> value) {
            connection(self).receive_multiplier = value;
          },
          nb::for_setter(nb::arg("value").none()),
          "Every how many messages a command is due; 0 and None mean 1.");
}

void bind_monitoring(nb::module_& m) {
  using M = fri::MonitoringMessage;
  nb::class_<M> cls(m, "FriMonitoring",
                    "A message from the cabinet. None where a field is absent. Torques "
                    "carry the wire's signs.");
  cls.def(nb::init<>());
  add_header(cls);
  add_connection(cls);
  cls.def_rw("num_joints", &M::num_joints, nb::arg("value").none());
  add_enum(cls, "safety", &M::safety, 3, "Safety state.");
  cls.def_prop_rw(
      "drive_states",
      [](const M& self) {
        return std::vector<fri::DriveState>(self.drive_states.begin(),
                                            self.drive_states.end());
      },
      [](M& self, const std::vector<int>& values) {
        std::vector<fri::DriveState> states;
        for (const int value : values)
          states.push_back(to_enum<fri::DriveState>("drive_states", value, 2));
        self.drive_states =
            to_list<fri::List<fri::DriveState, 7>>("drive_states", states);
      },
      "One per joint.");
  add_enum(cls, "operation_mode", &M::operation_mode, 2, "T1, T2 or AUT.");
  add_enum(cls, "control_mode", &M::control_mode, 3, "The robot's control mode.");
  add_vector(cls, "q_measured", &M::q_measured, "[rad]");
  add_vector(cls, "tau_measured", &M::tau_measured, "[Nm], sign inverted.");
  add_vector(cls, "q_commanded", &M::q_commanded, "[rad], 1.x only.");
  add_vector(cls, "tau_commanded", &M::tau_commanded, "[Nm], sign inverted.");
  add_vector(cls, "tau_external", &M::tau_external, "[Nm], as it acts.");
  add_vector(cls, "force_external", &M::force_external, "[N, Nm], 2.7 only.");
  add_list(cls, "io", &M::io, "Signals that may be read, at most 10 FriIo.");
  cls.def_rw("pose_measured", &M::pose_measured, nb::arg("value").none());
  cls.def_prop_rw(
      "stamp", [](const M& self) { return from_stamp(self.stamp); },
      [](M& self, const Stamp& stamp) { self.stamp = to_stamp(stamp); },
      nb::for_setter(nb::arg("value").none()), "(s, ns), the controller's Unix time.");
  add_vector(cls, "ipo_q", &M::q_ipo, "Interpolator's set-point [rad].");
  cls.def_rw("ipo_pose", &M::pose_ipo, nb::arg("value").none());
  add_enum(cls, "command_mode", &M::command_mode, 4, "Client command mode.");
  add_enum(cls, "overlay", &M::overlay, 2, "Overlay type.");
  cls.def_rw("tracking", &M::tracking, nb::arg("value").none(),
             "Tracking performance, 1 is perfect.");
  add_list(cls, "requested_transformations", &M::requested_transformations,
           "At most 5 FriTransformation.");
  add_codec(cls, fri::encode_monitoring, fri::decode_monitoring);
}

void bind_command(nb::module_& m) {
  using M = fri::CommandMessage;
  nb::class_<M> cls(m, "FriCommand",
                    "A message to the cabinet. None where a field is absent.");
  cls.def(nb::init<>());
  add_header(cls);
  add_vector(cls, "q", &M::q, "[rad]");
  add_vector(cls, "tau", &M::tau, "Overlay torque [Nm], gravity excluded.");
  add_vector(cls, "wrench", &M::wrench, "Feed-forward [N, Nm].");
  add_list(cls, "io", &M::io, "Signals to write, at most 10 FriIo.");
  add_list(cls, "transformations", &M::transformations, "At most 5 FriTransformation.");
  cls.def_rw("pose", &M::pose, nb::arg("value").none(), "2.x only.");
  add_codec(cls, fri::encode_command, fri::decode_command);
}

}  // namespace

void bind_fri(nb::module_& m) {
  bind_fri_parts(m);
  bind_monitoring(m);
  bind_command(m);
}
