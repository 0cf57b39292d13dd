#include <cstdio>

#include "dovetail/fri_packet.hpp"

namespace dovetail::fri {

namespace {

std::string hexadecimal(std::uint64_t value) {
  char text[19];
  std::snprintf(text, sizeof text, "0x%llx", static_cast<unsigned long long>(value));
  return text;
}

std::string identifier_reason(std::uint64_t value) {
  const std::string text = "messageIdentifier is " + hexadecimal(value);
  if (value == kMonitoringIdentifier)
    return text + ": a monitoring message, not a command";
  if (value == kCommandIdentifier)
    return text + ": a command, not a monitoring message";
  return text + ", which is none of FRI's: another program sends to this port";
}

std::string reason(const DecodeResult& result) {
  const std::string field = result.field;
  const std::string value = std::to_string(result.value);
  switch (result.status) {
    case DecodeStatus::kOk:
      return "ok";
    case DecodeStatus::kEmpty:
      return "an empty datagram";
    case DecodeStatus::kTooLong:
      return "a datagram of " + value + " bytes, at most 1500 are allowed";
    case DecodeStatus::kFrame:
      return "the length in front does not fit the datagram (" + value + " bytes)";
    case DecodeStatus::kChecksum:
      return "the CRC does not match";
    case DecodeStatus::kTruncated:
      return field + " reaches past the end of its bytes";
    case DecodeStatus::kVarint:
      return field + " has a number that is too large";
    case DecodeStatus::kTag:
      return field + " has a field without a valid number and type";
    case DecodeStatus::kGroup:
      return field + " has a group, which FRI never uses";
    case DecodeStatus::kWireType:
      return field + " has the wrong wire type " + value;
    case DecodeStatus::kTwice:
      return field + " is there twice";
    case DecodeStatus::kCount:
      if (result.value > result.allowed)
        return field + " has more than " + std::to_string(result.allowed) + " values";
      return field + " has " + value + " values, " + std::to_string(result.allowed) +
             " are needed";
    case DecodeStatus::kName:
      return field + " has " + value + " bytes, at most 63 without NUL are allowed";
    case DecodeStatus::kEnum:
      return field + " has the unknown value " + value;
    case DecodeStatus::kNotFinite:
      if (result.value == 0) return field + " has a value that is not finite";
      return field + " of A" + value + " is not a finite number";
    case DecodeStatus::kMissing:
      return field + " is missing";
    case DecodeStatus::kIdentifier:
      return identifier_reason(result.value);
  }
  return "unknown";
}

}  // namespace

const char* name(Version version) noexcept {
  switch (version) {
    case Version::k1_15:
      return "1.15";
    case Version::k2_5:
      return "2.5";
    case Version::k2_7:
      return "2.7";
  }
  return "unknown";
}

std::optional<Version> parse_version(std::string_view text) noexcept {
  if (text == "1.11" || text == "1.14" || text == "1.15" || text == "1.16")
    return Version::k1_15;
  if (text == "2.5") return Version::k2_5;
  if (text == "2.7") return Version::k2_7;
  return std::nullopt;
}

std::string describe(const DecodeResult& result) {
  std::string text = reason(result);
  if (!result.likely_version) return text;
  const bool is_framed = *result.likely_version == Version::k2_7;
  return text + "; looks like FRI " + (is_framed ? "2.7" : "1.15 or 2.5") +
         ": configure the same version on both sides";
}

}  // namespace dovetail::fri
