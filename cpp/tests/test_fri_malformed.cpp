#include <boost/test/unit_test.hpp>
#include <limits>

#include "fri_fixtures.hpp"

using namespace dovetail::fri;
using namespace dovetail::fri::testing;

BOOST_AUTO_TEST_CASE(counts_of_values_are_checked) {
  using enum DecodeStatus;
  const std::string value = "09 000000000000f03f";
  const auto joints = [&](const char* lengths, int count) {
    return status_of<CommandMessage>(kHeaderOnly + lengths + repeat(value, count));
  };
  BOOST_TEST((joints("1238 0a36", 6) == kCount));
  BOOST_TEST((joints("1241 0a3f", 7) == kOk));
  BOOST_TEST((joints("124a 0a48", 8) == kCount));
  BOOST_TEST((joints("1202 0a00", 0) == kCount));
  BOOST_TEST((joints("1202 1200", 0) == kOk));  // an empty wrench is none
  BOOST_TEST((joints("122f 122d", 5) == kCount));
  BOOST_TEST((joints("1241 123f", 7) == kCount));
  CommandMessage m;
  const DecodeResult six =
      decode(hex(kHeaderOnly + "1238 0a36" + repeat(value, 6)), Version::k1_15, m);
  BOOST_TEST(describe(six) == "jointPosition has 6 values, 7 are needed");

  // Eight drive states, six transformations, eleven signals, thirteen matrix values.
  const std::string drives = kMonitoringHeader + "120a 2a08" + repeat("02", 8);
  BOOST_TEST((status_of<MonitoringMessage>(drives) == kCount));
  const std::string requests = repeat("3203 0a0141", 6);
  BOOST_TEST((status_of<MonitoringMessage>(kMonitoringHeader + requests) == kCount));
  BOOST_TEST((status_of<MonitoringMessage>(kMonitoringHeader +
                                           repeat("3203 0a0141", 5)) == kOk));
  const std::string signal = "2a07 0a0141 1000 1801";
  BOOST_TEST(
      (status_of<CommandMessage>(kHeaderOnly + "1263" + repeat(signal, 11)) == kCount));
  BOOST_TEST(
      (status_of<CommandMessage>(kHeaderOnly + "125a" + repeat(signal, 10)) == kOk));
  const std::string matrix = "0a0141 1268" + repeat("000000000000f03f", 13);
  BOOST_TEST((status_of<CommandMessage>(kHeaderOnly + "126f 226d" + matrix) == kCount));
}

BOOST_AUTO_TEST_CASE(names_are_bounded) {
  using enum DecodeStatus;
  BOOST_TEST((status_of<MonitoringMessage>(kMonitoringHeader + "3241 0a3f" +
                                           repeat("41", 63)) == kOk));
  BOOST_TEST((status_of<MonitoringMessage>(kMonitoringHeader + "3242 0a40" +
                                           repeat("41", 64)) == kName));
  BOOST_TEST(
      (status_of<MonitoringMessage>(kMonitoringHeader + "3204 0a02 4100") == kName));
  Name name;
  BOOST_TEST(name.assign("Group.Signal"));
  BOOST_TEST(!name.assign(std::string(64, 'x')));
  BOOST_TEST(name.view() == "Group.Signal");
}

BOOST_AUTO_TEST_CASE(unknown_fields_are_skipped_and_groups_refused) {
  using enum DecodeStatus;
  const auto with = [](const char* field) {
    return status_of<CommandMessage>(kHeaderOnly + field);
  };
  BOOST_TEST((with("a006 ffffffffffffffffff01") == kOk));  // field 100, varint
  BOOST_TEST((with("a106 0102030405060708") == kOk));      // fixed64
  BOOST_TEST((with("a206 03 010203") == kOk));             // bytes
  BOOST_TEST((with("a506 01020304") == kOk));              // fixed32
  BOOST_TEST((with("7a06 0805 1202 0807") == kOk));        // endOfMessageData
  BOOST_TEST((with("7a03 ffffff") == kOk));                // whatever it holds
  BOOST_TEST((with("a306 a406") == kGroup));
  BOOST_TEST((with("a406") == kGroup));
  BOOST_TEST((with("a606") == kTag));
  BOOST_TEST((with("a706") == kTag));
  BOOST_TEST((with("00") == kTag));
  BOOST_TEST((with("f8ffffffff0f 00") == kTag));  // past 32 bits
  BOOST_TEST((with("a106 01020304050607") == kTruncated));
  BOOST_TEST((with("a506 010203") == kTruncated));
  BOOST_TEST((with("a206 04 010203") == kTruncated));
  BOOST_TEST((with("a206 ffffffffffffffffff01 00") == kTruncated));
  BOOST_TEST((with("a006 ffffffffffffffffff02") == kVarint));
  BOOST_TEST((with("a006 ffffffffffffffffffff01") == kVarint));
  BOOST_TEST((with("a006 ff") == kTruncated));
  // Inside joint values too.
  const std::string inner = "1246 0a44 " + kQ;
  BOOST_TEST((status_of<CommandMessage>(kHeaderOnly + inner + "a206 02 0000") == kOk));
}

BOOST_AUTO_TEST_CASE(fields_of_a_wrong_kind_or_doubled_are_refused) {
  using enum DecodeStatus;
  const std::string header = "0881800d 1000 1800";
  const auto status = [](const std::string& text) {
    return status_of<CommandMessage>(text);
  };
  BOOST_TEST((status("0a04 0881800d") == kMissing));
  BOOST_TEST((status("0a06 0881800d 1000") == kMissing));
  BOOST_TEST((status("1200") == kMissing));
  BOOST_TEST((status("0800") == kWireType));
  BOOST_TEST((status("0a0a" + header + "1000") == kTwice));
  BOOST_TEST((status(kHeaderOnly + kHeaderOnly) == kTwice));
  BOOST_TEST((status(kHeaderOnly + "1200 1200") == kTwice));
  BOOST_TEST((status(kEcho + "1241 0a3f" + kQ) == kTwice));
  BOOST_TEST((status("0a0c 0881800d 108080808010 1800") == kVarint));  // 2^32
  BOOST_TEST((status(kHeaderOnly + "1202 0805") == kWireType));
  BOOST_TEST((status(kHeaderOnly + "1207 0a05 0d00000000") == kWireType));
  BOOST_TEST((status(kHeaderOnly + "1209 0a07 0a05 0000000000") == kTruncated));
  BOOST_TEST((status("0a09 08c2a29101 1000 1800") == kIdentifier));
  BOOST_TEST((status("0a06 0801 1000 1800") == kIdentifier));
  BOOST_TEST((status_of<MonitoringMessage>(kHeaderOnly) == kIdentifier));
  BOOST_TEST((status("") == kEmpty));
  BOOST_TEST((status(kHeaderOnly + repeat("a00600", 600)) == kTooLong));
}

BOOST_AUTO_TEST_CASE(unknown_enum_values_are_refused_where_they_are_required) {
  using enum DecodeStatus;
  const std::string& h = kMonitoringHeader;
  BOOST_TEST((status_of<MonitoringMessage>(h + "2204 0805 1000") == kEnum));
  BOOST_TEST((status_of<MonitoringMessage>(h + "2204 0804 1004") == kEnum));
  BOOST_TEST((status_of<MonitoringMessage>(h + "2202 0804") == kMissing));
  BOOST_TEST((status_of<MonitoringMessage>(h + "1202 2803") == kEnum));
  MonitoringMessage m;
  BOOST_TEST(decode(hex(h + "1204 1009 3807"), Version::k1_15, m).ok());
  BOOST_TEST((!m.safety && !m.control_mode));
  // Negative numbers take ten bytes.
  BOOST_TEST(decode(hex(h + "120b 08ffffffffffffffffff01"), Version::k1_15, m).ok());
  BOOST_TEST(*m.num_joints == -1);
  BOOST_TEST((status_of<MonitoringMessage>(h + "1206 08ffffffff0f") == kVarint));
}

BOOST_AUTO_TEST_CASE(values_that_are_not_finite_are_refused_both_ways) {
  const double bad[] = {std::numeric_limits<double>::quiet_NaN(),
                        -std::numeric_limits<double>::infinity()};
  for (const double x : bad) {
    CommandMessage q, tau, wrench;
    q.q = tau.tau = kGoldenQ;
    (*q.q)[6] = (*tau.tau)[0] = x;
    wrench.wrench = Wrench{0, 0, 0, x, 0, 0};
    BOOST_TEST(encoded(q, Version::k1_15).empty());
    BOOST_TEST(encoded(tau, Version::k2_7).empty());
    BOOST_TEST(encoded(wrench, Version::k2_5).empty());
  }
  const std::string nan = repeat("09 000000000000f03f", 6) + "09 000000000000f87f";
  CommandMessage m;
  const DecodeResult result =
      decode(hex(kHeaderOnly + "1241 1a3f" + nan), Version::k1_15, m);
  BOOST_TEST(describe(result) == "jointTorque of A7 is not a finite number");
  BOOST_TEST((status_of<CommandMessage>(kHeaderOnly + "1238 1236" +
                                        repeat("09 000000000000f07f", 6)) ==
              DecodeStatus::kNotFinite));
}

BOOST_AUTO_TEST_CASE(what_is_too_long_for_a_datagram_is_not_written) {
  MonitoringMessage m;
  IoValue signal;
  signal.name.assign(std::string(63, 'x'));
  signal.analog = 1.0;
  signal.digital = ~0ULL;
  for (std::size_t i = 0; i < kMaxIo; ++i) m.io.push_back(signal);
  BOOST_TEST(encoded(m, Version::k1_15).size() > 900u);
  Transformation request;
  request.name.assign(std::string(63, 'x'));
  for (int i = 0; i < 12; ++i) request.values.push_back(i);
  for (std::size_t i = 0; i < kMaxTransformations; ++i)
    m.requested_transformations.push_back(request);
  BOOST_TEST(encoded(m, Version::k1_15).empty());
  BOOST_TEST(encoded(m, Version::k2_5).empty());  // twelve values, seven allowed
}

BOOST_AUTO_TEST_CASE(reasons_name_the_field_and_what_is_allowed) {
  const std::string& h = kHeaderOnly;
  const std::pair<std::string, const char*> reasons[] = {
      {"", "an empty datagram"},
      {h + repeat("a00600", 600), "a datagram of 1810 bytes, at most 1500 are allowed"},
      {h + "a206 04 00", "the message reaches past the end of its bytes"},
      {"0a0c 0881800d 108080808010 1800",
       "sequenceCounter has a number that is too large"},
      {h + "00", "the message has a field without a valid number and type"},
      {h + "1201 13", "commandData has a group, which FRI never uses"},
      {h + "1202 0805", "jointPosition has the wrong wire type 0"},
      {h + h, "header is there twice"},
      {h + "1249 1a47 " + repeat("09 000000000000f03f", 7) + "0a06 000000000000",
       "jointTorque reaches past the end of its bytes"},
      {h + "124a 1a48 " + repeat("09 000000000000f03f", 8),
       "jointTorque has more than 7 values"},
      {h + "1209 2a07 0a0141 1003 1801", "type has the unknown value 3"},
      {h + "1205 2203 0a0100", "name has 1 bytes, at most 63 without NUL are allowed"},
      {"0a04 0881800d", "sequenceCounter is missing"},
      {"0a06 0805 1000 1800",
       "messageIdentifier is 0x5, which is none of FRI's: another program sends to "
       "this port"},
  };
  for (const auto& [text, expected] : reasons) {
    CommandMessage m;
    BOOST_TEST(describe(decode(hex(text), Version::k1_15, m)) == expected);
  }
  CommandMessage m;
  BOOST_TEST(describe(decode(hex("00000000 00000001"), Version::k2_7, m)) ==
             "the CRC does not match");
  BOOST_TEST(describe(decode(hex("09000000 00000001"), Version::k2_7, m)) ==
             "the length in front does not fit the datagram (9 bytes)");
}
