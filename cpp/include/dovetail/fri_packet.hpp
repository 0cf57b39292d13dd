/// Datagrams of KUKA's FRI, both ways: bytes <-> messages. No socket, no clock.
///
/// Nothing here allocates or throws but describe(). Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "dovetail/fri_message.hpp"

namespace dovetail::fri {

inline constexpr std::size_t kMaxDatagram = 1500;
inline constexpr std::uint32_t kMonitoringIdentifier = 0x245142;
inline constexpr std::uint32_t kCommandIdentifier = 0x34001;

enum class DecodeStatus : std::uint8_t {
  kOk,
  kEmpty,       ///< no bytes
  kTooLong,     ///< more than kMaxDatagram
  kFrame,       ///< 2.7: the length does not fit in the datagram
  kChecksum,    ///< 2.7
  kTruncated,   ///< a value or a length reaches past the end
  kVarint,      ///< more than ten bytes, or out of the field's range
  kTag,         ///< field number 0 or an unknown wire type
  kGroup,       ///< a group: nothing in FRI is one
  kWireType,    ///< a known field written as another type
  kTwice,       ///< a field that comes once at most, again
  kCount,       ///< a wrong number of elements
  kName,        ///< too long, or with a NUL
  kEnum,        ///< a required field outside its enum
  kNotFinite,   ///< a joint value or command that is NaN or infinite
  kMissing,     ///< a required field
  kIdentifier,  ///< well formed, but another kind of message
};

struct DecodeResult {
  DecodeStatus status = DecodeStatus::kOk;
  const char* field = "";     ///< where it went wrong, the schema's name; static
  std::uint64_t value = 0;    ///< the count, length or identifier found; kNotFinite:
                              ///< joint, 1 to 7; 0: no joint
  std::uint64_t allowed = 0;  ///< kCount: how many there may or must be
  /// Another version's framing was recognised (k1_15 stands for 1.x and 2.5, which
  /// look the same).
  std::optional<Version> likely_version;

  bool ok() const noexcept { return status == DecodeStatus::kOk; }
};

const char* name(Version version) noexcept;  ///< "1.15", "2.5", "2.7"

/// The wire format of a version by its name, 1.11 to 1.16 being one; nothing for
/// others.
std::optional<Version> parse_version(std::string_view text) noexcept;

/// The reason in words: what, which field, value, what is allowed. Allocates.
std::string describe(const DecodeResult& result);

/// Reads a datagram into `out`, which is only of use where the result is ok.
/// Unknown fields and those of other versions are skipped.
DecodeResult decode_monitoring(const std::uint8_t* bytes, std::size_t size,
                               Version version, MonitoringMessage& out) noexcept;
DecodeResult decode_command(const std::uint8_t* bytes, std::size_t size,
                            Version version, CommandMessage& out) noexcept;

/// Writes at most kMaxDatagram bytes and returns how many. Fields the version does not
/// have are left out. 0: the message is longer than that, or holds joint values, a
/// wrench or a count of transformation values that decode_* would refuse.
std::size_t encode_monitoring(const MonitoringMessage& message, Version version,
                              std::uint8_t* out) noexcept;
std::size_t encode_command(const CommandMessage& message, Version version,
                           std::uint8_t* out) noexcept;

}  // namespace dovetail::fri
