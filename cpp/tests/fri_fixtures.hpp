/// Datagrams as KUKA's client sent or took them, and random messages of our own.
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "dovetail/fri_packet.hpp"

namespace dovetail::fri::testing {

using Bytes = std::vector<std::uint8_t>;

/// Hexadecimal digits, blanks between them ignored.
inline Bytes hex(std::string_view text) {
  Bytes bytes;
  int high = -1;
  for (const char c : text) {
    if (c == ' ') continue;
    const int digit = c <= '9' ? c - '0' : c - 'a' + 10;
    if (high < 0) {
      high = digit;
    } else {
      bytes.push_back(static_cast<std::uint8_t>(high << 4 | digit));
      high = -1;
    }
  }
  return bytes;
}

inline std::string repeat(const std::string& text, int times) {
  std::string all;
  for (int i = 0; i < times; ++i) all += text;
  return all;
}

// Joint position 0.0, 0.1, 0.2, 3 * 0.1, 0.4, 0.5, 2 * (3 * 0.1), and seven zeros.
inline const std::string kQ =
    "09 0000000000000000 09 9a9999999999b93f 09 9a9999999999c93f 09 343333333333d33f"
    "09 9a9999999999d93f 09 000000000000e03f 09 343333333333e33f";
inline const std::string kZ = repeat("09 0000000000000000", 7);
inline const Joints kGoldenQ = {0.0, 0.1, 0.2, 3 * 0.1, 0.4, 0.5, 2 * (3 * 0.1)};

inline const std::string kHeaderOnly = "0a08 0881800d 1000 1800";
inline const std::string kEcho = kHeaderOnly + "1241 0a3f" + kQ;
inline const std::string kTorque =
    "0a0a 0881800d 108301 188301 128201 0a3f" + kQ + "1a3f" + kZ;
inline const std::string kWrench =
    "0a0a 0881800d 108301 188301 1275 0a3f" + kQ + "1232 0a30" + repeat("00", 48);
inline const std::string kHeaderOnly27 = "0a000000" + kHeaderOnly + "fbbfd686";
inline const std::string kHeaderOnly27At80 =
    "0a000000 0a08 0881800d 1050 1850 bfc00181";
inline const std::string kTorque27 = "91000000" + kTorque + "ea09d3bb";
// "FRI.Out_Analog_Deci_Seconds" and "FRI.Out_Integer_Seconds"
inline const std::string kIo =
    kHeaderOnly +
    "124d 2a2a 0a1b 4652492e4f75745f416e616c6f675f446563695f5365636f6e6473"
    "1002 1801 29 000000000000f03f"
    "2a1f 0a17 4652492e4f75745f496e74656765725f5365636f6e6473 1001 1801 203c";

inline const std::string kMonitoringHeader = "0a09 08c2a29101 1000 1800";
inline const std::string kRobotInfo =
    "1216 0807 1000" + repeat("2800", 7) + "3002 3803";
inline const std::string kMonitorData = "1ad302 0a3f" + kQ + "123f" + kZ + "1a3f" + kQ +
                                        "223f" + kZ + "2a3f" + kZ +
                                        "7a0c 0887d683d806 10e389fba603";
inline const std::string kConnection = "2208 0801 1000 1805 2001";
inline const std::string kIpoData = "2a0d 5000 5800 61 0000000000000000";
inline const std::string kMonitoring =
    kMonitoringHeader + kRobotInfo + kMonitorData + kConnection + kIpoData;

template <class Message>
Bytes encoded(const Message& message, Version version) {
  Bytes bytes(kMaxDatagram);
  if constexpr (std::is_same_v<Message, MonitoringMessage>)
    bytes.resize(encode_monitoring(message, version, bytes.data()));
  else
    bytes.resize(encode_command(message, version, bytes.data()));
  return bytes;
}

inline DecodeResult decode(const Bytes& bytes, Version version,
                           MonitoringMessage& message) {
  return decode_monitoring(bytes.data(), bytes.size(), version, message);
}
inline DecodeResult decode(const Bytes& bytes, Version version,
                           CommandMessage& message) {
  return decode_command(bytes.data(), bytes.size(), version, message);
}

template <class Message>
DecodeStatus status_of(const std::string& text, Version version = Version::k1_15) {
  Message message;
  return decode(hex(text), version, message).status;
}

/// Messages with every field there or not, by chance.
class RandomMessages {
 public:
  explicit RandomMessages(std::uint64_t seed) : random_(seed) {}

  CommandMessage command(Version version) {
    CommandMessage m;
    m.header = {number(), number()};
    maybe([&] { m.q = numbers<7>(); });
    maybe([&] { m.tau = numbers<7>(); });
    maybe([&] { m.wrench = numbers<6>(); });
    fill(m.transformations, 3, [&] { return transformation(version); });
    fill(m.io, 5, [&] { return io(); });
    if (version == Version::k1_15) return m;
    maybe([&] { m.pose = transformation(version); });
    maybe([&] { m.redundancy = Redundancy{chance() ? 0 : 4, real()}; });
    return m;
  }

  MonitoringMessage monitoring(Version version) {
    MonitoringMessage m;
    m.header = {number(), number()};
    robot_info(m);
    monitor_data(m, version);
    maybe([&] { m.connection = connection(); });
    maybe([&] { m.q_ipo = numbers<7>(); });
    maybe([&] { m.command_mode = static_cast<CommandMode>(number() % 5); });
    maybe([&] { m.overlay = static_cast<Overlay>(number() % 3); });
    maybe([&] { m.tracking = real(); });
    fill(m.requested_transformations, 2, [&] { return transformation(version); });
    if (version == Version::k1_15) return m;
    maybe([&] { m.pose_ipo = transformation(version); });
    maybe([&] { m.redundancy_ipo = Redundancy{4, real()}; });
    return m;
  }

  std::uint32_t number() {
    return static_cast<std::uint32_t>(random_() >> (32 + random_() % 32));
  }
  bool chance() { return random_() % 2 == 0; }

 private:
  void robot_info(MonitoringMessage& m) {
    maybe([&] { m.num_joints = static_cast<std::int32_t>(number()); });
    maybe([&] { m.safety = static_cast<SafetyState>(number() % 4); });
    fill(m.drive_states, 7, [&] { return static_cast<DriveState>(number() % 3); });
    maybe([&] { m.operation_mode = static_cast<OperationMode>(number() % 3); });
    maybe([&] { m.control_mode = static_cast<ControlMode>(number() % 4); });
  }
  void monitor_data(MonitoringMessage& m, Version version) {
    maybe([&] { m.q_measured = numbers<7>(); });
    maybe([&] { m.tau_measured = numbers<7>(); });
    maybe([&] { m.tau_commanded = numbers<7>(); });
    maybe([&] { m.tau_external = numbers<7>(); });
    fill(m.io, 4, [&] { return io(); });
    maybe([&] { m.stamp = TimeStamp{number(), number()}; });
    if (version == Version::k1_15) return maybe([&] { m.q_commanded = numbers<7>(); });
    maybe([&] { m.pose_measured = transformation(version); });
    maybe([&] { m.redundancy_measured = Redundancy{0, real()}; });
    if (version == Version::k2_7) maybe([&] { m.force_external = numbers<6>(); });
  }
  ConnectionInfo connection() {
    ConnectionInfo info;
    info.state = static_cast<SessionState>(number() % 5);
    info.quality = static_cast<Quality>(number() % 4);
    maybe([&] { info.send_period = number(); });
    maybe([&] { info.receive_multiplier = number(); });
    return info;
  }
  Transformation transformation(Version version) {
    Transformation t;
    t.name = name();
    if (chance())
      for (int i = 0; i < (version == Version::k1_15 ? 12 : 7); ++i)
        t.values.push_back(real());
    maybe([&] { t.stamp = TimeStamp{number(), number()}; });
    return t;
  }
  IoValue io() {
    IoValue value;
    value.name = name();
    value.type = static_cast<IoType>(number() % 3);
    value.direction = static_cast<IoDirection>(number() % 2);
    maybe([&] { value.digital = random_(); });
    maybe([&] { value.analog = real(); });
    return value;
  }
  Name name() {
    std::string text(random_() % (kMaxName + 1), 'x');
    for (char& c : text) c = static_cast<char>(random_() % 255 + 1);
    Name result;
    result.assign(text);
    return result;
  }
  double real() {
    return std::ldexp(std::uniform_real_distribution(-1.0, 1.0)(random_),
                      static_cast<int>(random_() % 40) - 20);
  }
  template <std::size_t N>
  std::array<double, N> numbers() {
    std::array<double, N> values;
    for (double& x : values) x = real();
    return values;
  }
  template <class List, class Make>
  void fill(List& list, std::size_t max, Make make) {
    for (std::size_t left = random_() % (max + 1); left > 0; --left)
      list.push_back(make());
  }
  template <class Set>
  void maybe(Set set) {
    if (chance()) set();
  }

  std::mt19937_64 random_;
};

}  // namespace dovetail::fri::testing
