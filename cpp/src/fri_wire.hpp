/// The few rules of protobuf's wire format that FRI needs, bounded on both sides.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "dovetail/fri_packet.hpp"

namespace dovetail::fri::wire {

static_assert(std::endian::native == std::endian::little,
              "the wire is little-endian, and so must the machine be");

enum WireType : std::uint32_t { kVarint = 0, kFixed64 = 1, kBytes = 2, kFixed32 = 5 };

struct Tag {
  std::uint32_t number = 0;
  std::uint32_t type = 0;
};

/// Reads from a span that it never leaves. The first failure stays.
class Reader {
 public:
  Reader() noexcept = default;
  Reader(const std::uint8_t* bytes, std::size_t size) noexcept
      : next_(bytes), end_(bytes + size) {}

  bool ok() const noexcept { return status_ == DecodeStatus::kOk; }
  DecodeStatus status() const noexcept { return status_; }
  bool at_end() const noexcept { return next_ == end_; }
  std::size_t left() const noexcept { return static_cast<std::size_t>(end_ - next_); }
  const std::uint8_t* data() const noexcept { return next_; }

  std::uint64_t varint() noexcept {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 70; shift += 7) {
      if (at_end()) return fail(DecodeStatus::kTruncated);
      const std::uint8_t byte = *next_++;
      if (shift == 63 && byte > 1) break;
      value |= static_cast<std::uint64_t>(byte & 0x7f) << shift;
      if (byte < 0x80) return value;
    }
    return fail(DecodeStatus::kVarint);
  }

  double fixed64() noexcept {
    double value = 0.0;
    if (left() < sizeof value)
      return static_cast<double>(fail(DecodeStatus::kTruncated));
    std::memcpy(&value, next_, sizeof value);
    next_ += sizeof value;
    return value;
  }

  /// The span of a length-delimited field.
  Reader bytes() noexcept {
    const std::uint64_t size = varint();
    if (!ok()) return {};
    if (size > left()) {
      fail(DecodeStatus::kTruncated);
      return {};
    }
    const Reader span(next_, static_cast<std::size_t>(size));
    next_ += size;
    return span;
  }

  Tag tag() noexcept {
    const std::uint64_t key = varint();
    if (!ok()) return {};
    const Tag tag{static_cast<std::uint32_t>(key >> 3),
                  static_cast<std::uint32_t>(key & 7)};
    if (key > UINT32_MAX || tag.number == 0 || tag.type > kFixed32)
      fail(DecodeStatus::kTag);
    else if (tag.type == 3 || tag.type == 4)
      fail(DecodeStatus::kGroup);
    return tag;
  }

  void skip(std::uint32_t type) noexcept {
    if (type == kVarint)
      varint();
    else if (type == kBytes)
      bytes();
    else
      advance(type == kFixed64 ? 8 : 4);
  }

 private:
  std::uint64_t fail(DecodeStatus status) noexcept {
    if (ok()) status_ = status;
    next_ = end_;
    return 0;
  }
  void advance(std::size_t count) noexcept {
    if (count > left())
      fail(DecodeStatus::kTruncated);
    else
      next_ += count;
  }

  const std::uint8_t* next_ = nullptr;
  const std::uint8_t* end_ = nullptr;
  DecodeStatus status_ = DecodeStatus::kOk;
};

/// Writes up to a capacity; what is too long sets failed() and writes nothing more.
class Writer {
 public:
  Writer(std::uint8_t* bytes, std::size_t capacity) noexcept
      : bytes_(bytes), capacity_(capacity) {}

  bool failed() const noexcept { return failed_; }
  std::size_t size() const noexcept { return size_; }
  void fail() noexcept { failed_ = true; }

  void varint(std::uint64_t value) noexcept {
    std::uint8_t digits[10];
    std::size_t count = 0;
    do {
      const bool is_last = value < 0x80;
      digits[count++] =
          static_cast<std::uint8_t>((value & 0x7f) | (is_last ? 0 : 0x80));
      value >>= 7;
    } while (value != 0);
    raw(digits, count);
  }
  void tag(std::uint32_t number, WireType type) noexcept { varint(number << 3 | type); }
  void fixed64(double value) noexcept { raw(&value, sizeof value); }
  void fixed32(std::uint32_t value) noexcept { raw(&value, sizeof value); }
  void raw(const void* data, std::size_t count) noexcept {
    if (count > capacity_ - size_) failed_ = true;
    if (failed_ || count == 0) return;
    std::memcpy(bytes_ + size_, data, count);
    size_ += count;
  }

  /// Puts the length of what was written since `start` in front of it.
  void close(std::size_t start) noexcept {
    std::uint8_t digits[10];
    Writer length(digits, sizeof digits);
    length.varint(size_ - start);
    if (length.size() > capacity_ - size_) failed_ = true;
    if (failed_) return;
    std::memmove(bytes_ + start + length.size(), bytes_ + start, size_ - start);
    std::memcpy(bytes_ + start, digits, length.size());
    size_ += length.size();
  }
  /// Forgets what was written since `start`.
  void rewind(std::size_t start) noexcept { size_ = start; }

 private:
  std::uint8_t* bytes_;
  std::size_t capacity_;
  std::size_t size_ = 0;
  bool failed_ = false;
};

}  // namespace dovetail::fri::wire
