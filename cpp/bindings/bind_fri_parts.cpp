#include "bind_fri_parts.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;
using namespace dovetail::binding;

namespace {

void bind_enums(nb::module_& m) {
  nb::enum_<fri::Version>(m, "FriVersion", "Wire format: V1_15 is 1.11 to 1.16.")
      .value("V1_15", fri::Version::k1_15)
      .value("V2_5", fri::Version::k2_5)
      .value("V2_7", fri::Version::k2_7);
  nb::enum_<fri::SessionState>(m, "FriState", nb::is_arithmetic(), "Session state.")
      .value("IDLE", fri::SessionState::kIdle)
      .value("MONITORING_WAIT", fri::SessionState::kMonitoringWait)
      .value("MONITORING_READY", fri::SessionState::kMonitoringReady)
      .value("COMMANDING_WAIT", fri::SessionState::kCommandingWait)
      .value("COMMANDING_ACTIVE", fri::SessionState::kCommandingActive);
  nb::enum_<fri::Quality>(m, "FriQuality", nb::is_arithmetic(), "Connection quality.")
      .value("POOR", fri::Quality::kPoor)
      .value("FAIR", fri::Quality::kFair)
      .value("GOOD", fri::Quality::kGood)
      .value("EXCELLENT", fri::Quality::kExcellent);
  nb::enum_<fri::SafetyState>(m, "FriSafety", nb::is_arithmetic(), "Safety state.")
      .value("NORMAL", fri::SafetyState::kNormal)
      .value("STOP_0", fri::SafetyState::kStop0)
      .value("STOP_1", fri::SafetyState::kStop1)
      .value("STOP_2", fri::SafetyState::kStop2);
  nb::enum_<fri::OperationMode>(m, "FriOperationMode", nb::is_arithmetic())
      .value("T1", fri::OperationMode::kT1)
      .value("T2", fri::OperationMode::kT2)
      .value("AUT", fri::OperationMode::kAut);
  nb::enum_<fri::DriveState>(m, "FriDriveState", nb::is_arithmetic())
      .value("OFF", fri::DriveState::kOff)
      .value("TRANSITIONING", fri::DriveState::kTransitioning)
      .value("ACTIVE", fri::DriveState::kActive);
  nb::enum_<fri::ControlMode>(m, "FriControlMode", nb::is_arithmetic())
      .value("POSITION", fri::ControlMode::kPosition)
      .value("CARTESIAN_IMPEDANCE", fri::ControlMode::kCartesianImpedance)
      .value("JOINT_IMPEDANCE", fri::ControlMode::kJointImpedance)
      .value("NO_CONTROL", fri::ControlMode::kNoControl);
  nb::enum_<fri::CommandMode>(m, "FriCommandMode", nb::is_arithmetic())
      .value("NONE", fri::CommandMode::kNone)
      .value("POSITION", fri::CommandMode::kPosition)
      .value("WRENCH", fri::CommandMode::kWrench)
      .value("TORQUE", fri::CommandMode::kTorque)
      .value("CARTESIAN_POSE", fri::CommandMode::kCartesianPose);
  nb::enum_<fri::Overlay>(m, "FriOverlay", nb::is_arithmetic())
      .value("NONE", fri::Overlay::kNone)
      .value("JOINT", fri::Overlay::kJoint)
      .value("CARTESIAN", fri::Overlay::kCartesian);
  nb::enum_<fri::IoType>(m, "FriIoType", nb::is_arithmetic())
      .value("BOOLEAN", fri::IoType::kBoolean)
      .value("DIGITAL", fri::IoType::kDigital)
      .value("ANALOG", fri::IoType::kAnalog);
  nb::enum_<fri::IoDirection>(m, "FriIoDirection", nb::is_arithmetic())
      .value("INPUT", fri::IoDirection::kInput)
      .value("OUTPUT", fri::IoDirection::kOutput);
  m.def("fri_version", &require_version, "text"_a,
        "The wire format of a version such as '1.15'.");
}

void bind_parts(nb::module_& m) {
  nb::class_<fri::Transformation>(
      m, "FriTransformation",
      "Name, 12 values of a 3x4 matrix by rows (1.x) or tx ty tz qw qx qy qz (2.x), "
      "[mm], and (s, ns) of the cabinet's clock. Without values: a request.")
      .def(
          "__init__",
          [](fri::Transformation* self, const std::string& name,
             const std::vector<double>& values, const Stamp& stamp) {
            const auto list = to_list<fri::List<double, 12>>("values", values);
            new (self) fri::Transformation{to_name(name), list, to_stamp(stamp)};
          },
          "name"_a, "values"_a = std::vector<double>{}, "stamp"_a = nb::none())
      .def_prop_ro("name",
                   [](const fri::Transformation& self) { return from_name(self.name); })
      .def_prop_ro("values",
                   [](const fri::Transformation& self) {
                     return std::vector<double>(self.values.begin(), self.values.end());
                   })
      .def_prop_ro("stamp", [](const fri::Transformation& self) {
        return from_stamp(self.stamp);
      });
  nb::class_<fri::IoValue>(m, "FriIo", "An IO signal 'Group.Signal' and its value.")
      .def(
          "__init__",
          [](fri::IoValue* self, const std::string& name, int type, int direction,
             std::optional<std::uint64_t> digital, std::optional<double> analog) {
            new (self) fri::IoValue{
                to_name(name), to_enum<fri::IoType>("type", type, 2),
                to_enum<fri::IoDirection>("direction", direction, 1), digital, analog};
          },
          "name"_a, "type"_a, "direction"_a, "digital"_a = nb::none(),
          "analog"_a = nb::none())
      .def_prop_ro("name",
                   [](const fri::IoValue& self) { return from_name(self.name); })
      .def_ro("type", &fri::IoValue::type)
      .def_ro("direction", &fri::IoValue::direction)
      .def_ro("digital", &fri::IoValue::digital)
      .def_ro("analog", &fri::IoValue::analog);
}

}  // namespace

void bind_fri_parts(nb::module_& m) {
  bind_enums(m);
  bind_parts(m);
}
