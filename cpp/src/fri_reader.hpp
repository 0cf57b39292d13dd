/// The visitor of the schema that reads its fields from bytes.
#pragma once

#include <cmath>
#include <type_traits>

#include "fri_schema.hpp"
#include "fri_wire.hpp"

namespace dovetail::fri {

template <class E>
inline constexpr std::uint64_t kLargest = 0;
template <>
inline constexpr std::uint64_t kLargest<SessionState> = 4;
template <>
inline constexpr std::uint64_t kLargest<Quality> = 3;
template <>
inline constexpr std::uint64_t kLargest<SafetyState> = 3;
template <>
inline constexpr std::uint64_t kLargest<OperationMode> = 2;
template <>
inline constexpr std::uint64_t kLargest<DriveState> = 2;
template <>
inline constexpr std::uint64_t kLargest<ControlMode> = 3;
template <>
inline constexpr std::uint64_t kLargest<CommandMode> = 4;
template <>
inline constexpr std::uint64_t kLargest<Overlay> = 2;
template <>
inline constexpr std::uint64_t kLargest<IoType> = 2;
template <>
inline constexpr std::uint64_t kLargest<IoDirection> = 1;

class FieldReader {
 public:
  FieldReader(Version version, wire::Reader in, const char* message,
              DecodeResult& result) noexcept
      : version_(version), in_(in), message_(message), result_(result) {}

  Version version() const noexcept { return version_; }
  bool is_1x() const noexcept { return version_ == Version::k1_15; }

  /// Shows every field of the bytes to `visit`, then asks it what is missing.
  template <class Visit>
  void read_all(Visit&& visit) noexcept {
    while (result_.ok() && !in_.at_end()) {
      tag_ = in_.tag();
      if (!in_.ok()) return fail(in_.status(), message_);
      is_taken_ = false;
      visit(*this);
      if (!is_taken_) {
        in_.skip(tag_.type);
        check(message_);
      }
    }
    is_checking_ = true;
    if (result_.ok()) visit(*this);
  }

  template <class T>
  void field(std::uint32_t number, const char* name, T& member) noexcept {
    if (is_checking_)
      require(number, name);
    else if (takes_once(number, name))
      read(name, member);
  }
  template <class T>
  void field(std::uint32_t number, const char* name,
             std::optional<T>& member) noexcept {
    if (is_checking_ || !takes_once(number, name)) return;
    if constexpr (Enum<T>) {
      read_known(name, member);
    } else {
      read(name, member.emplace());
    }
  }
  void field(std::uint32_t number, const char* name,
             std::optional<Wrench>& member) noexcept {
    if (is_checking_ || !takes_once(number, name)) return;
    Wrench values{};
    const std::size_t count = read_doubles(name, values);
    if (count != 0 && count != values.size())
      fail(DecodeStatus::kCount, name, count, values.size());
    else if (count != 0)
      member = values;
  }
  template <class T, std::size_t N>
  void field(std::uint32_t number, const char* name, List<T, N>& list) noexcept {
    if (is_checking_ || !takes(number)) return;
    T item{};
    read(name, item);
    if (result_.ok() && !list.push_back(item))
      fail(DecodeStatus::kCount, name, N + 1, N);
  }
  void enums(std::uint32_t number, const char* name,
             List<DriveState, 7>& list) noexcept {
    if (is_checking_ || !takes(number)) return;
    wire::Reader values = packed(name, wire::kVarint);
    wire::Reader& in = tag_.type == wire::kBytes ? values : in_;
    do {
      if (tag_.type == wire::kBytes && in.at_end()) return;
      const std::uint64_t value = in.varint();
      if (!result_.ok() || !in.ok()) return fail(in.status(), name);
      if (value > kLargest<DriveState>) return fail(DecodeStatus::kEnum, name, value);
      if (!list.push_back(static_cast<DriveState>(value)))
        return fail(DecodeStatus::kCount, name, 8, 7);
    } while (tag_.type == wire::kBytes);
  }
  void doubles(std::uint32_t number, const char* name, List<double, 12>& list,
               std::size_t max) noexcept {
    if (is_checking_ || !takes(number)) return;
    each_double(name, in_, tag_, [&](double value) {
      if (list.size() == max || !list.push_back(value))
        fail(DecodeStatus::kCount, name, max + 1, max);
    });
  }
  template <class Visit>
  void section(std::uint32_t number, const char* name, Visit&& visit) noexcept {
    if (!is_checking_ && takes_once(number, name)) read_section(name, visit);
  }
  template <class Visit>
  void required_section(std::uint32_t number, const char* name,
                        Visit&& visit) noexcept {
    if (is_checking_)
      require(number, name);
    else
      section(number, name, visit);
  }

 private:
  void fail(DecodeStatus status, const char* name, std::uint64_t value = 0,
            std::uint64_t allowed = 0) noexcept {
    if (!result_.ok() || status == DecodeStatus::kOk) return;
    result_.status = status;
    result_.field = name;
    result_.value = value;
    result_.allowed = allowed;
  }
  void check(const char* name) noexcept { fail(in_.status(), name); }

  bool takes(std::uint32_t number) noexcept {
    if (is_taken_ || tag_.number != number) return false;
    return is_taken_ = true;
  }
  bool takes_once(std::uint32_t number, const char* name) noexcept {
    if (!takes(number)) return false;
    if ((seen_ >> number & 1) != 0) {
      fail(DecodeStatus::kTwice, name);
      return false;
    }
    seen_ |= 1u << number;
    return true;
  }
  void require(std::uint32_t number, const char* name) noexcept {
    if ((seen_ >> number & 1) == 0) fail(DecodeStatus::kMissing, name);
  }
  bool has_type(wire::WireType type, const char* name) noexcept {
    if (tag_.type == type) return true;
    fail(DecodeStatus::kWireType, name, tag_.type);
    return false;
  }

  std::uint64_t read_varint(const char* name) noexcept {
    if (!has_type(wire::kVarint, name)) return 0;
    const std::uint64_t value = in_.varint();
    check(name);
    return value;
  }
  void read(const char* name, std::uint64_t& member) noexcept {
    member = read_varint(name);
  }
  void read(const char* name, std::uint32_t& member) noexcept {
    const std::uint64_t value = read_varint(name);
    if (value > UINT32_MAX) fail(DecodeStatus::kVarint, name, value);
    member = static_cast<std::uint32_t>(value);
  }
  void read(const char* name, std::int32_t& member) noexcept {
    const auto value = static_cast<std::int64_t>(read_varint(name));
    member = static_cast<std::int32_t>(value);
    if (member != value)
      fail(DecodeStatus::kVarint, name, static_cast<std::uint64_t>(value));
  }
  template <Enum E>
  void read(const char* name, E& member) noexcept {
    const std::uint64_t value = read_varint(name);
    if (value > kLargest<E>) fail(DecodeStatus::kEnum, name, value);
    if (result_.ok()) member = static_cast<E>(value);
  }
  /// As proto2 does, an optional enum's unknown value counts as an unknown field.
  template <Enum E>
  void read_known(const char* name, std::optional<E>& member) noexcept {
    const std::uint64_t value = read_varint(name);
    if (value <= kLargest<E>) member = static_cast<E>(value);
  }
  void read(const char* name, double& member) noexcept {
    if (!has_type(wire::kFixed64, name)) return;
    member = in_.fixed64();
    check(name);
  }
  void read(const char* name, Name& member) noexcept {
    if (!has_type(wire::kBytes, name)) return;
    const wire::Reader text = in_.bytes();
    check(name);
    if (!result_.ok()) return;
    if (!member.assign({reinterpret_cast<const char*>(text.data()), text.left()}))
      fail(DecodeStatus::kName, name, text.left());
  }
  void read(const char* name, Joints& member) noexcept {
    const std::size_t count = read_doubles(name, member);
    if (count != member.size()) fail(DecodeStatus::kCount, name, count, member.size());
    for (std::size_t i = 0; i < member.size(); ++i) {
      if (!std::isfinite(member[i])) fail(DecodeStatus::kNotFinite, name, i + 1);
    }
  }
  template <class M>
    requires std::is_class_v<M>
  void read(const char* name, M& member) noexcept {
    read_section(name, [&member](auto& v) { schema::visit(v, member); });
  }
  template <class Visit>
  void read_section(const char* name, Visit&& visit) noexcept {
    if (!has_type(wire::kBytes, name)) return;
    const wire::Reader span = in_.bytes();
    check(name);
    if (!result_.ok()) return;
    FieldReader inner(version_, span, name, result_);
    inner.read_all(visit);
  }

  /// The elements of a packed field; for an unpacked one checks the type only.
  wire::Reader packed(const char* name, wire::WireType unpacked) noexcept {
    if (tag_.type != wire::kBytes) {
      has_type(unpacked, name);
      return {};
    }
    const wire::Reader values = in_.bytes();
    check(name);
    return values;
  }
  template <class Take>
  void each_double(const char* name, wire::Reader& in, wire::Tag tag,
                   Take&& take) noexcept {
    if (tag.type == wire::kFixed64) {
      const double value = in.fixed64();
      fail(in.status(), name);
      if (result_.ok()) take(value);
      return;
    }
    if (tag.type != wire::kBytes) return fail(DecodeStatus::kWireType, name, tag.type);
    wire::Reader values = in.bytes();
    fail(in.status(), name);
    while (result_.ok() && !values.at_end()) {
      const double value = values.fixed64();
      fail(values.status(), name);
      if (result_.ok()) take(value);
    }
  }
  /// JointValues and CartesianVector: a message of one repeated double. Returns how
  /// many there were; those past the end of `values` are only counted.
  template <std::size_t N>
  std::size_t read_doubles(const char* name, std::array<double, N>& values) noexcept {
    std::size_t count = 0;
    if (!has_type(wire::kBytes, name)) return count;
    wire::Reader span = in_.bytes();
    check(name);
    while (result_.ok() && !span.at_end()) {
      const wire::Tag tag = span.tag();
      if (span.ok() && tag.number != 1) span.skip(tag.type);
      fail(span.status(), name);
      if (!result_.ok() || tag.number != 1) continue;
      each_double(name, span, tag, [&](double value) {
        if (count < N) values[count] = value;
        ++count;
      });
    }
    return count;
  }

  Version version_;
  wire::Reader in_;
  const char* message_;
  DecodeResult& result_;
  wire::Tag tag_;
  std::uint32_t seen_ = 0;
  bool is_taken_ = false;
  bool is_checking_ = false;
};

}  // namespace dovetail::fri
