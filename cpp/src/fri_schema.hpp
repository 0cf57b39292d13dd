/// The tables of FRI's messages: numbers, names and members, once for both directions.
///
/// A visitor's field() takes a member by its type: a plain one is required, a
/// std::optional may be absent, a List repeats. section() is a nested message whose
/// members lie flat in ours.
#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "dovetail/fri_message.hpp"

namespace dovetail::fri {

template <class E>
concept Enum = std::is_enum_v<E>;

template <std::size_t N>
bool is_finite(const std::array<double, N>& values) noexcept {
  return std::all_of(values.begin(), values.end(),
                     [](double x) { return std::isfinite(x); });
}

}  // namespace dovetail::fri

namespace dovetail::fri::schema {

/// T or const T: reading fills what writing leaves alone.
template <class M, class T>
concept Is = std::is_same_v<std::remove_const_t<M>, T>;

template <class V>
void visit(V& v, Is<TimeStamp> auto& m) noexcept {
  v.field(1, "sec", m.sec);
  v.field(2, "nanosec", m.nanosec);
}

template <class V>
void visit(V& v, Is<ConnectionInfo> auto& m) noexcept {
  v.field(1, "sessionState", m.state);
  v.field(2, "quality", m.quality);
  v.field(3, "sendPeriod", m.send_period);
  v.field(4, "receiveMultiplier", m.receive_multiplier);
}

template <class V>
void visit(V& v, Is<Transformation> auto& m) noexcept {
  v.field(1, "name", m.name);
  v.doubles(2, v.is_1x() ? "matrix" : "element", m.values, v.is_1x() ? 12 : 7);
  v.field(3, "timestamp", m.stamp);
}

template <class V>
void visit(V& v, Is<Redundancy> auto& m) noexcept {
  v.field(1, "strategy", m.strategy);
  v.field(2, "value", m.value);
}

template <class V>
void visit(V& v, Is<IoValue> auto& m) noexcept {
  v.field(1, "name", m.name);
  v.field(2, "type", m.type);
  v.field(3, "direction", m.direction);
  v.field(4, "digitalValue", m.digital);
  v.field(5, "analogValue", m.analog);
}

template <class V>
void visit_header(V& v, auto& identifier, auto& header) noexcept {
  v.field(1, "messageIdentifier", identifier);
  v.field(2, "sequenceCounter", header.sequence);
  v.field(3, "reflectedSequenceCounter", header.reflected);
}

template <class V>
void visit_robot_info(V& v, auto& m) noexcept {
  v.field(1, "numberOfJoints", m.num_joints);
  v.field(2, "safetyState", m.safety);
  v.enums(5, "driveState", m.drive_states);
  v.field(6, "operationMode", m.operation_mode);
  v.field(7, "controlMode", m.control_mode);
}

template <class V>
void visit_monitor_data(V& v, auto& m) noexcept {
  v.field(1, "measuredJointPosition", m.q_measured);
  v.field(2, "measuredTorque", m.tau_measured);
  if (v.is_1x()) v.field(3, "commandedJointPosition", m.q_commanded);
  v.field(4, "commandedTorque", m.tau_commanded);
  v.field(5, "externalTorque", m.tau_external);
  if (v.version() == Version::k2_7) v.field(6, "externalForce", m.force_external);
  v.field(8, "readIORequest", m.io);
  if (!v.is_1x()) {
    v.field(9, "measuredCartesianPose", m.pose_measured);
    v.field(10, "measuredRedundancyInformation", m.redundancy_measured);
  }
  v.field(15, "timestamp", m.stamp);
}

template <class V>
void visit_ipo_data(V& v, auto& m) noexcept {
  v.field(1, "jointPosition", m.q_ipo);
  if (!v.is_1x()) {
    v.field(2, "cartesianPose", m.pose_ipo);
    v.field(3, "redundancyInformation", m.redundancy_ipo);
  }
  v.field(10, "clientCommandMode", m.command_mode);
  v.field(11, "overlayType", m.overlay);
  v.field(12, "trackingPerformance", m.tracking);
}

template <class V>
void visit_command_data(V& v, auto& m) noexcept {
  v.field(1, "jointPosition", m.q);
  v.field(2, "cartesianWrenchFeedForward", m.wrench);
  v.field(3, "jointTorque", m.tau);
  v.field(4, "commandedTransformations", m.transformations);
  v.field(5, "writeIORequest", m.io);
  if (!v.is_1x()) {
    v.field(6, "cartesianPose", m.pose);
    v.field(7, "redundancyInformation", m.redundancy);
  }
}

// endOfMessageData (15) is neither read nor written: its content says nothing.
template <class V>
void visit_message(V& v, auto& identifier, Is<MonitoringMessage> auto& m) noexcept {
  v.required_section(1, "header",
                     [&](auto& w) { visit_header(w, identifier, m.header); });
  v.section(2, "robotInfo", [&](auto& w) { visit_robot_info(w, m); });
  v.section(3, "monitorData", [&](auto& w) { visit_monitor_data(w, m); });
  v.field(4, "connectionInfo", m.connection);
  v.section(5, "ipoData", [&](auto& w) { visit_ipo_data(w, m); });
  v.field(6, "requestedTransformations", m.requested_transformations);
}

template <class V>
void visit_message(V& v, auto& identifier, Is<CommandMessage> auto& m) noexcept {
  v.required_section(1, "header",
                     [&](auto& w) { visit_header(w, identifier, m.header); });
  v.section(2, "commandData", [&](auto& w) { visit_command_data(w, m); });
}

}  // namespace dovetail::fri::schema
