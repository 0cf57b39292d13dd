/// The smallest cabinet: it makes the messages of a session, and reads the answers.
#pragma once

#include <optional>

#include "arm.hpp"
#include "dovetail/fri_packet.hpp"

namespace dovetail::testing {

class FakeCabinet {
 public:
  explicit FakeCabinet(fri::Version version = fri::Version::k1_15)
      : version_(version) {}

  Vec7 q = tool_down_posture();
  Vec7 tau_external = Vec7::Zero();
  bool sends_external = true;
  fri::SessionState state = fri::SessionState::kMonitoringWait;
  std::uint32_t send_period = 5;
  std::uint32_t multiplier = 1;
  std::uint32_t sequence = 0;
  std::int32_t num_joints = 7;
  bool sends_measured = true, sends_ipo = true;
  std::optional<fri::SafetyState> safety;
  std::optional<fri::DriveState> drives;
  fri::CommandMode mode = fri::CommandMode::kTorque;

  /// The next message as bytes; size() says how many.
  const std::uint8_t* message() {
    fri::MonitoringMessage m;
    m.header = {sequence++, 0};
    m.num_joints = num_joints;
    m.safety = safety;
    for (int i = 0; drives && i < kNumJoints; ++i) m.drive_states.push_back(*drives);
    if (sends_measured) m.q_measured = joints(q);
    m.q_commanded = joints(q);
    m.tau_measured = fri::Joints{};
    if (sends_external) m.tau_external = joints(tau_external);
    m.connection =
        fri::ConnectionInfo{state, fri::Quality::kGood, send_period, multiplier};
    if (state >= fri::SessionState::kCommandingWait) {
      if (sends_ipo) m.q_ipo = joints(q);
      m.command_mode = mode;
      m.overlay = fri::Overlay::kJoint;
    }
    size_ = fri::encode_monitoring(m, version_, bytes_.data());
    return bytes_.data();
  }
  std::size_t size() const { return size_; }

  /// What a client has answered; nothing where it cannot be read.
  std::optional<fri::CommandMessage> read(const std::uint8_t* bytes, std::size_t size) {
    fri::CommandMessage command;
    if (!fri::decode_command(bytes, size, version_, command).ok()) return {};
    return command;
  }

  static fri::Joints joints(const Vec7& v) {
    fri::Joints joints;
    Eigen::Map<Vec7>(joints.data()) = v;
    return joints;
  }

 private:
  fri::Version version_;
  std::array<std::uint8_t, fri::kMaxDatagram> bytes_{};
  std::size_t size_ = 0;
};

inline Vec7 vector(const fri::Joints& joints) {
  return Eigen::Map<const Vec7>(joints.data());
}

}  // namespace dovetail::testing
