/// The fuzzing entry of the FRI decoders and of the client session, for libFuzzer's
/// main or for fuzz_driver.cpp's.
///
/// The first byte chooses the version (bits 0-1), whether a 2.7 message gets a right
/// frame around it (bit 2: no mutation would ever guess a CRC), and whether the session
/// hears the message as the next one (bit 3), some having been lost (bits 4-7). The
/// others are the datagram.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "dovetail/fri_session.hpp"

namespace {

using namespace dovetail::fri;
using Bytes = std::vector<std::uint8_t>;

// Written anew, values are unpacked: a message near the limit may grow past it.
constexpr std::size_t kGrowth = 64;

void require(bool is_true, const char* what) {
  if (is_true) return;
  std::fprintf(stderr, "property violated: %s\n", what);
  std::abort();
}

std::uint32_t bitwise_crc32(const std::uint8_t* bytes, std::size_t size) {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (std::size_t i = 0; i < size; ++i) {
    crc ^= bytes[i];
    for (int bit = 0; bit < 8; ++bit)
      crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xEDB88320u : 0u);
  }
  return ~crc;
}

void append(Bytes& bytes, std::uint32_t value) {
  for (int i = 0; i < 4; ++i)
    bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

/// Exactly the bytes of the datagram: a sanitizer sees any other that is read.
Bytes datagram(const std::uint8_t* data, std::size_t size, bool is_framed) {
  if (!is_framed) return Bytes(data, data + size);
  Bytes bytes;
  append(bytes, static_cast<std::uint32_t>(size));
  bytes.insert(bytes.end(), data, data + size);
  append(bytes, bitwise_crc32(data, size));
  return bytes;
}

/// What was read, written and read again, is the same.
template <class Message, class Decode, class Encode>
void check_codec(const Bytes& bytes, Version version, Decode decode, Encode encode) {
  Message message;
  const DecodeResult result = decode(bytes.data(), bytes.size(), version, message);
  if (!result.ok()) return require(!describe(result).empty(), "a reason in words");
  std::uint8_t first[kMaxDatagram], second[kMaxDatagram];
  const std::size_t size = encode(message, version, first);
  if (size == 0) return require(bytes.size() + kGrowth > kMaxDatagram, "encodes");
  Message again;
  require(decode(first, size, version, again).ok(), "decodes what it encodes");
  require(encode(again, version, second) == size, "the same size again");
  require(std::memcmp(first, second, size) == 0, "the same bytes again");
}

SessionStep hear(FriSession& session, const Bytes& bytes, std::uint8_t selector) {
  MonitoringMessage message;
  const bool is_next = (selector & 8) != 0;
  if (!is_next ||
      !decode_monitoring(bytes.data(), bytes.size(), session.version(), message).ok())
    return session.receive(bytes.data(), bytes.size());
  message.header.sequence = session.message().header.sequence + 1 + (selector >> 4);
  return session.receive(message);
}

/// One session per version hears all datagrams: what it cannot read changes nothing.
void check_session(const Bytes& bytes, Version version, std::uint8_t selector) {
  static FriSession sessions[] = {FriSession(Version::k1_15), FriSession(Version::k2_5),
                                  FriSession(Version::k2_7)};
  FriSession& session = sessions[static_cast<std::size_t>(version)];
  const SessionState before = session.state();
  const std::uint32_t sequence = session.message().header.sequence;
  const std::uint64_t sent = session.counters().sent;
  const SessionStep step = hear(session, bytes, selector);
  const SessionCounters& counters = session.counters();
  require(counters.received == counters.accepted + counters.duplicates +
                                   counters.older + counters.undecodable +
                                   counters.wrong_identifier,
          "every datagram is counted once");
  require(session.state() <= SessionState::kCommandingActive, "a known state");
  if (!step.is_new) {
    require(session.state() == before, "a foreign datagram leaves the state");
    require(session.message().header.sequence == sequence, "and the message");
    require(step.reply == Reply::kNothing, "and is not answered");
  }
  if (step.reply == Reply::kNothing) return;
  require(session.state() != SessionState::kIdle, "no answer in IDLE");
  require(step.reply != Reply::kActive ||
              session.state() == SessionState::kCommandingActive,
          "torque in COMMANDING_ACTIVE only");
  std::uint8_t out[kMaxDatagram];
  const std::size_t size = session.answer(Joints{1.0}, Joints{2.0}, out);
  CommandMessage command;
  require(size > 0 && decode_command(out, size, version, command).ok(), "an answer");
  require(command.header.reflected == session.message().header.sequence, "reflects");
  require(!command.q || session.state() >= SessionState::kCommandingWait,
          "a position in the commanding states only");
  require(step.reply == Reply::kActive || !command.tau || *command.tau == Joints{},
          "no torque but where the caller's is due");
  require(counters.sent == sent + 1, "counts what it sends");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const Version version = static_cast<Version>((data[0] & 3) % 3);
  const bool is_framed = version == Version::k2_7 && (data[0] & 4) != 0;
  const Bytes bytes = datagram(data + 1, size - 1, is_framed);
  check_codec<MonitoringMessage>(bytes, version, decode_monitoring, encode_monitoring);
  check_codec<CommandMessage>(bytes, version, decode_command, encode_command);
  check_session(bytes, version, data[0]);
  return 0;
}
