#include <algorithm>
#include <boost/test/unit_test.hpp>

#include "fri_fixtures.hpp"

using namespace dovetail::fri;
using namespace dovetail::fri::testing;

namespace {

constexpr Version kVersions[] = {Version::k1_15, Version::k2_5, Version::k2_7};

CommandMessage golden_command(std::uint32_t count) {
  CommandMessage message;
  message.header = {count, count};
  message.q = kGoldenQ;
  return message;
}

/// Ours gives the bytes, and reads them as the same message.
void check_both_ways(const CommandMessage& message, Version version,
                     const std::string& text) {
  const Bytes bytes = hex(text);
  BOOST_TEST(encoded(message, version) == bytes, boost::test_tools::per_element());
  CommandMessage read;
  BOOST_TEST(describe(decode(bytes, version, read)) == "ok");
  BOOST_TEST((read == message));
}

static_assert(noexcept(decode_monitoring(nullptr, 0, Version::k1_15,
                                         std::declval<MonitoringMessage&>())));
static_assert(noexcept(decode_command(nullptr, 0, Version::k1_15,
                                      std::declval<CommandMessage&>())));
static_assert(noexcept(encode_command(std::declval<const CommandMessage&>(),
                                      Version::k1_15, nullptr)));
static_assert(noexcept(encode_monitoring(std::declval<const MonitoringMessage&>(),
                                         Version::k1_15, nullptr)));

}  // namespace

BOOST_AUTO_TEST_CASE(commands_are_those_of_kukas_client) {
  CommandMessage header_only;
  check_both_ways(header_only, Version::k1_15, kHeaderOnly);
  check_both_ways(header_only, Version::k2_5, kHeaderOnly);
  check_both_ways(header_only, Version::k2_7, kHeaderOnly27);
  header_only.header = {80, 80};
  check_both_ways(header_only, Version::k2_7, kHeaderOnly27At80);

  check_both_ways(golden_command(0), Version::k1_15, kEcho);
  CommandMessage torque = golden_command(131);
  torque.tau = Joints{};
  check_both_ways(torque, Version::k1_15, kTorque);
  check_both_ways(torque, Version::k2_5, kTorque);
  check_both_ways(torque, Version::k2_7, kTorque27);
  CommandMessage wrench = golden_command(131);
  wrench.wrench = Wrench{};
  check_both_ways(wrench, Version::k1_15, kWrench);
}

BOOST_AUTO_TEST_CASE(signals_are_written_as_kukas_client_writes_them) {
  CommandMessage message;
  IoValue analog, digital;
  analog.name.assign("FRI.Out_Analog_Deci_Seconds");
  analog.type = IoType::kAnalog;
  analog.direction = IoDirection::kOutput;
  analog.analog = 1.0;
  digital.name.assign("FRI.Out_Integer_Seconds");
  digital.type = IoType::kDigital;
  digital.direction = IoDirection::kOutput;
  digital.digital = 60;
  message.io.push_back(analog);
  message.io.push_back(digital);
  check_both_ways(message, Version::k1_15, kIo);
}

BOOST_AUTO_TEST_CASE(the_monitoring_message_is_that_of_the_specification) {
  const Bytes bytes = hex(kMonitoring);
  BOOST_TEST(bytes.size() == 402u);
  MonitoringMessage m;
  m.num_joints = 7;
  m.safety = SafetyState::kNormal;
  for (int i = 0; i < 7; ++i) m.drive_states.push_back(DriveState::kOff);
  m.operation_mode = OperationMode::kAut;
  m.control_mode = ControlMode::kNoControl;
  m.q_measured = m.q_commanded = kGoldenQ;
  m.tau_measured = m.tau_commanded = m.tau_external = Joints{};
  m.stamp = TimeStamp{1795222279, 887014627};
  m.connection = ConnectionInfo{SessionState::kMonitoringWait, Quality::kPoor, 5u, 1u};
  m.command_mode = CommandMode::kNone;
  m.overlay = Overlay::kNone;
  m.tracking = 0.0;
  BOOST_TEST(encoded(m, Version::k1_15) == bytes, boost::test_tools::per_element());
  MonitoringMessage read;
  BOOST_TEST(describe(decode(bytes, Version::k1_15, read)) == "ok");
  BOOST_TEST((read == m));
  BOOST_TEST((read.state() == SessionState::kMonitoringWait));

  // 2.x has no commandedJointPosition: 65 bytes less, and reading skips it.
  BOOST_TEST(encoded(m, Version::k2_5).size() == 402u - 65u);
  BOOST_TEST(decode(bytes, Version::k2_5, read).ok());
  BOOST_TEST(!read.q_commanded);
}

BOOST_AUTO_TEST_CASE(no_connection_data_reads_as_idle) {
  MonitoringMessage m;
  BOOST_TEST(decode(hex(kMonitoringHeader), Version::k1_15, m).ok());
  BOOST_TEST((m.state() == SessionState::kIdle));
}

BOOST_AUTO_TEST_CASE(a_datagram_cut_short_is_refused_or_loses_whole_parts_only) {
  const Bytes whole = hex(kMonitoring);
  const std::size_t parts[] = {11, 35, 377, 387, 402};  // ends of the top-level fields
  BOOST_TEST(hex(kMonitoringHeader + kRobotInfo + kMonitorData).size() == parts[2]);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    // An own copy of exactly this size: a sanitizer sees every byte read too many.
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    MonitoringMessage m;
    const bool is_end =
        std::find(std::begin(parts), std::end(parts), size) != std::end(parts);
    BOOST_TEST(decode(cut, Version::k1_15, m).ok() == is_end, "at " << size);
  }
  for (const std::string& text : {kTorque27, kHeaderOnly27}) {
    const Bytes framed = hex(text);
    for (std::size_t size = 0; size < framed.size(); ++size) {
      const Bytes cut(framed.begin(),
                      framed.begin() + static_cast<std::ptrdiff_t>(size));
      CommandMessage m;
      BOOST_TEST(!decode(cut, Version::k2_7, m).ok(), "at " << size);
    }
  }
}

BOOST_AUTO_TEST_CASE(every_flipped_bit_of_2_7_is_refused) {
  MonitoringMessage m;
  BOOST_TEST(decode(hex(kMonitoring), Version::k1_15, m).ok());
  const Bytes monitoring = encoded(m, Version::k2_7);
  for (Bytes bytes : {hex(kTorque27), monitoring}) {
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
      CommandMessage command;
      const DecodeStatus first = decode(bytes, Version::k2_7, command).status;
      const DecodeStatus second = decode(bytes, Version::k2_7, m).status;
      const DecodeStatus expected = bit < 32 && first != DecodeStatus::kChecksum
                                        ? DecodeStatus::kFrame
                                        : DecodeStatus::kChecksum;
      BOOST_TEST((first == expected && second == expected), "bit " << bit);
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
    }
  }
}

BOOST_AUTO_TEST_CASE(lengths_of_2_7_stay_inside_the_datagram) {
  using enum DecodeStatus;
  constexpr Version v = Version::k2_7;
  BOOST_TEST(
      (status_of<CommandMessage>("ffffffff" + kHeaderOnly + "fbbfd686", v) == kFrame));
  BOOST_TEST(
      (status_of<CommandMessage>("0b000000" + kHeaderOnly + "fbbfd686", v) == kFrame));
  BOOST_TEST((status_of<CommandMessage>("f8ffffff 00000000", v) == kFrame));
  BOOST_TEST((status_of<CommandMessage>("00000000 000000", v) == kFrame));
  // An empty message has CRC 0 and is well framed, but has no header.
  BOOST_TEST((status_of<CommandMessage>("00000000 00000000", v) == kMissing));
  // Bytes behind the CRC are ignored, as KUKA's client does.
  BOOST_TEST((status_of<CommandMessage>(kTorque27 + "0011223344", v) == kOk));
}

BOOST_AUTO_TEST_CASE(packed_and_unpacked_values_are_the_same) {
  const std::string plain =
      "0000000000000000 9a9999999999b93f 9a9999999999c93f"
      "343333333333d33f 9a9999999999d93f 000000000000e03f"
      "343333333333e33f";
  const std::string mixed =
      "0a10 0000000000000000 9a9999999999b93f 09 9a9999999999c93f"
      "0a20 343333333333d33f 9a9999999999d93f 000000000000e03f"
      "343333333333e33f";
  CommandMessage a, b, c;
  BOOST_TEST(decode(hex(kEcho), Version::k1_15, a).ok());
  BOOST_TEST(
      decode(hex(kHeaderOnly + "123c 0a3a 0a38" + plain), Version::k1_15, b).ok());
  BOOST_TEST(decode(hex(kHeaderOnly + "123f 0a3d" + mixed), Version::k1_15, c).ok());
  BOOST_TEST((a == b && b == c));

  MonitoringMessage drives, packed;
  BOOST_TEST(decode(hex(kMonitoring), Version::k1_15, drives).ok());
  const std::string info = "1211 0807 1000 2a07 00000000000000 3002 3803";
  BOOST_TEST(
      decode(hex(kMonitoringHeader + info + kMonitorData + kConnection + kIpoData),
             Version::k1_15, packed)
          .ok());
  BOOST_TEST((drives == packed));

  // A wrench in six single values.
  CommandMessage wrench;
  const std::string single = "1238 1236" + repeat("09 000000000000f03f", 6);
  BOOST_TEST(decode(hex(kHeaderOnly + single), Version::k1_15, wrench).ok());
  BOOST_TEST((wrench.wrench == Wrench{1, 1, 1, 1, 1, 1}));
}

BOOST_AUTO_TEST_CASE(another_versions_framing_is_recognised) {
  CommandMessage m;
  const DecodeResult framed = decode(hex(kTorque27), Version::k1_15, m);
  BOOST_TEST(!framed.ok());
  BOOST_TEST((framed.likely_version == Version::k2_7));
  BOOST_TEST(describe(framed).ends_with(
      "; looks like FRI 2.7: configure the same version on both sides"));
  // A length of 10 starts like a raw header.
  BOOST_TEST(
      (decode(hex(kHeaderOnly27), Version::k2_5, m).likely_version == Version::k2_7));
  const DecodeResult raw = decode(hex(kTorque), Version::k2_7, m);
  BOOST_TEST((raw.likely_version == Version::k1_15));
  BOOST_TEST(describe(raw).find("looks like FRI 1.15 or 2.5") != std::string::npos);
  BOOST_TEST(!decode(hex("00010203"), Version::k2_7, m).likely_version);
  BOOST_TEST(!decode(hex("00010203"), Version::k1_15, m).likely_version);
  BOOST_TEST(!decode(hex(kTorque), Version::k1_15, m).likely_version);
}

BOOST_AUTO_TEST_CASE(a_message_of_the_other_direction_is_named) {
  MonitoringMessage monitoring;
  CommandMessage command;
  const DecodeResult ours = decode(hex(kTorque), Version::k1_15, monitoring);
  BOOST_TEST(describe(ours) ==
             "messageIdentifier is 0x34001: a command, not a monitoring message");
  const DecodeResult theirs = decode(hex(kMonitoring), Version::k1_15, command);
  BOOST_TEST(describe(theirs) ==
             "messageIdentifier is 0x245142: a monitoring message, not a command");
}

BOOST_AUTO_TEST_CASE(versions_have_names) {
  for (const Version version : kVersions)
    BOOST_TEST((parse_version(name(version)) == version));
  BOOST_TEST((parse_version("1.11") == Version::k1_15));
  BOOST_TEST(!parse_version("3.0"));
}

BOOST_AUTO_TEST_CASE(random_messages_come_back_as_they_were) {
  for (const Version version : kVersions) {
    RandomMessages random(7);
    int too_long = 0;
    for (int k = 0; k < 20000; ++k) {
      const CommandMessage command = random.command(version);
      const MonitoringMessage monitoring = random.monitoring(version);
      const Bytes first = encoded(command, version),
                  second = encoded(monitoring, version);
      if (first.empty() || second.empty()) {
        ++too_long;
        continue;
      }
      CommandMessage command_read;
      MonitoringMessage monitoring_read;
      BOOST_REQUIRE_EQUAL(describe(decode(first, version, command_read)), "ok");
      BOOST_REQUIRE_EQUAL(describe(decode(second, version, monitoring_read)), "ok");
      BOOST_REQUIRE((command == command_read && monitoring == monitoring_read));
    }
    BOOST_TEST(too_long < 2000);
  }
}
