#include "dovetail/fri_packet.hpp"

#include "fri_reader.hpp"
#include "fri_writer.hpp"

namespace dovetail::fri {

namespace {

constexpr std::size_t kLengthSize = 4;
constexpr std::size_t kChecksumSize = 4;
constexpr std::size_t kFrameSize = kLengthSize + kChecksumSize;
constexpr std::uint8_t kHeaderTag = 0x0A;

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit)
      crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xEDB88320u : 0u);
    table[i] = crc;
  }
  return table;
}

constexpr std::array<std::uint32_t, 256> kCrcTable = make_crc_table();

/// CRC-32 of IEEE 802.3.
std::uint32_t crc32(const std::uint8_t* bytes, std::size_t size) noexcept {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (std::size_t i = 0; i < size; ++i)
    crc = (crc >> 8) ^ kCrcTable[(crc ^ bytes[i]) & 0xFF];
  return crc ^ 0xFFFFFFFFu;
}

std::uint32_t little_endian(const std::uint8_t* bytes) noexcept {
  std::uint32_t value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

/// The message inside a 2.7 datagram, nothing of it read yet.
wire::Reader unframe(const std::uint8_t* bytes, std::size_t size,
                     DecodeResult& result) noexcept {
  const std::uint32_t length = size < kFrameSize ? 0 : little_endian(bytes);
  if (size < kFrameSize || length > size - kFrameSize) {
    result = {DecodeStatus::kFrame, "", length, 0, {}};
    return {};
  }
  const std::uint8_t* message = bytes + kLengthSize;
  if (crc32(message, length) != little_endian(message + length)) {
    result = {DecodeStatus::kChecksum, "", length, 0, {}};
    return {};
  }
  return {message, length};
}

template <class Message>
void decode_message(wire::Reader in, Version version, std::uint32_t expected,
                    Message& out, DecodeResult& result) noexcept {
  std::uint32_t identifier = 0;
  FieldReader reader(version, in, "the message", result);
  reader.read_all([&](auto& v) { schema::visit_message(v, identifier, out); });
  // A message of the other direction fails in its fields first, but this is why.
  const bool is_other =
      identifier == kMonitoringIdentifier || identifier == kCommandIdentifier;
  if (identifier != expected && (result.ok() || is_other))
    result = {DecodeStatus::kIdentifier, "messageIdentifier", identifier, 0, {}};
}

/// Whether a datagram without frame starts with an FRI header.
bool starts_with_header(const std::uint8_t* bytes, std::size_t size) noexcept {
  if (bytes[0] != kHeaderTag) return false;
  wire::Reader in(bytes, size);
  in.tag();
  const wire::Reader header = in.bytes();
  if (!in.ok()) return false;
  DecodeResult result;
  std::uint32_t identifier = 0;
  Header content;
  FieldReader reader(Version::k1_15, header, "header", result);
  reader.read_all([&](auto& v) { schema::visit_header(v, identifier, content); });
  return result.ok() &&
         (identifier == kMonitoringIdentifier || identifier == kCommandIdentifier);
}

std::optional<Version> recognise(const std::uint8_t* bytes, std::size_t size,
                                 Version version) noexcept {
  DecodeResult frame;
  unframe(bytes, size, frame);
  if (version == Version::k2_7)
    return !frame.ok() && starts_with_header(bytes, size)
               ? std::optional(Version::k1_15)
               : std::nullopt;
  return frame.ok() ? std::optional(Version::k2_7) : std::nullopt;
}

template <class Message>
DecodeResult decode(const std::uint8_t* bytes, std::size_t size, Version version,
                    std::uint32_t identifier, Message& out) noexcept {
  if (size == 0) return {DecodeStatus::kEmpty, "", 0, 0, {}};
  if (size > kMaxDatagram) return {DecodeStatus::kTooLong, "", size, 0, {}};
  out = {};
  DecodeResult result;
  const wire::Reader in = version == Version::k2_7 ? unframe(bytes, size, result)
                                                   : wire::Reader(bytes, size);
  if (result.ok()) decode_message(in, version, identifier, out, result);
  if (!result.ok()) result.likely_version = recognise(bytes, size, version);
  return result;
}

template <class Message>
std::size_t encode(const Message& message, Version version, std::uint32_t identifier,
                   std::uint8_t* out) noexcept {
  const bool is_framed = version == Version::k2_7;
  const std::size_t before = is_framed ? kLengthSize : 0;
  const std::size_t around = is_framed ? kFrameSize : 0;
  wire::Writer writer(out + before, kMaxDatagram - around);
  FieldWriter fields(version, writer);
  schema::visit_message(fields, identifier, message);
  if (writer.failed()) return 0;
  if (!is_framed) return writer.size();
  wire::Writer(out, kLengthSize).fixed32(static_cast<std::uint32_t>(writer.size()));
  std::uint8_t* end = out + before + writer.size();
  wire::Writer(end, kChecksumSize).fixed32(crc32(out + before, writer.size()));
  return writer.size() + around;
}

}  // namespace

DecodeResult decode_monitoring(const std::uint8_t* bytes, std::size_t size,
                               Version version, MonitoringMessage& out) noexcept {
  return decode(bytes, size, version, kMonitoringIdentifier, out);
}

DecodeResult decode_command(const std::uint8_t* bytes, std::size_t size,
                            Version version, CommandMessage& out) noexcept {
  DecodeResult result = decode(bytes, size, version, kCommandIdentifier, out);
  if (result.ok() && out.wrench && !is_finite(*out.wrench))
    result = {DecodeStatus::kNotFinite, "cartesianWrenchFeedForward", 0, 0, {}};
  return result;
}

std::size_t encode_monitoring(const MonitoringMessage& message, Version version,
                              std::uint8_t* out) noexcept {
  return encode(message, version, kMonitoringIdentifier, out);
}

std::size_t encode_command(const CommandMessage& message, Version version,
                           std::uint8_t* out) noexcept {
  if (message.wrench && !is_finite(*message.wrench)) return 0;
  return encode(message, version, kCommandIdentifier, out);
}

}  // namespace dovetail::fri
