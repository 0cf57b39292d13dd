/// The visitor of the schema that writes its fields.
#pragma once

#include "fri_schema.hpp"
#include "fri_wire.hpp"

namespace dovetail::fri {

class FieldWriter {
 public:
  FieldWriter(Version version, wire::Writer& out) noexcept
      : version_(version), out_(out) {}

  Version version() const noexcept { return version_; }
  bool is_1x() const noexcept { return version_ == Version::k1_15; }

  void field(std::uint32_t number, const char*, std::uint64_t value) noexcept {
    out_.tag(number, wire::kVarint);
    out_.varint(value);
  }
  void field(std::uint32_t number, const char* name, std::uint32_t value) noexcept {
    field(number, name, std::uint64_t{value});
  }
  void field(std::uint32_t number, const char* name, std::int32_t value) noexcept {
    field(number, name, static_cast<std::uint64_t>(std::int64_t{value}));
  }
  template <Enum E>
  void field(std::uint32_t number, const char* name, E value) noexcept {
    field(number, name, static_cast<std::uint64_t>(value));
  }
  void field(std::uint32_t number, const char*, double value) noexcept {
    out_.tag(number, wire::kFixed64);
    out_.fixed64(value);
  }
  void field(std::uint32_t number, const char*, const Name& name) noexcept {
    out_.tag(number, wire::kBytes);
    out_.varint(name.view().size());
    out_.raw(name.view().data(), name.view().size());
  }
  /// Unpacked, as KUKA's client writes joint values.
  void field(std::uint32_t number, const char*, const Joints& values) noexcept {
    if (!is_finite(values)) out_.fail();
    out_.tag(number, wire::kBytes);
    const std::size_t start = out_.size();
    for (const double value : values) {
      out_.tag(1, wire::kFixed64);
      out_.fixed64(value);
    }
    out_.close(start);
  }
  /// Packed, as KUKA's client writes everything else.
  void field(std::uint32_t number, const char*, const Wrench& values) noexcept {
    out_.tag(number, wire::kBytes);
    const std::size_t start = out_.size();
    packed(1, values);
    out_.close(start);
  }
  template <class M>
    requires std::is_class_v<M>
  void field(std::uint32_t number, const char* name, const M& message) noexcept {
    required_section(number, name, [&](auto& v) { schema::visit(v, message); });
  }
  template <class T>
  void field(std::uint32_t number, const char* name,
             const std::optional<T>& member) noexcept {
    if (member) field(number, name, *member);
  }
  template <class T, std::size_t N>
  void field(std::uint32_t number, const char* name, const List<T, N>& list) noexcept {
    for (const T& item : list) field(number, name, item);
  }
  void enums(std::uint32_t number, const char* name,
             const List<DriveState, 7>& list) noexcept {
    for (const DriveState state : list) field(number, name, state);
  }
  void doubles(std::uint32_t number, const char*, const List<double, 12>& list,
               std::size_t max) noexcept {
    if (list.size() > max) out_.fail();
    if (!list.empty()) packed(number, list);
  }
  /// Left out where nothing in it is there.
  template <class Visit>
  void section(std::uint32_t number, const char* name, Visit&& visit) noexcept {
    const std::size_t before = out_.size();
    if (required_section(number, name, visit) == 0) out_.rewind(before);
  }
  template <class Visit>
  std::size_t required_section(std::uint32_t number, const char*,
                               Visit&& visit) noexcept {
    out_.tag(number, wire::kBytes);
    const std::size_t start = out_.size();
    visit(*this);
    const std::size_t content = out_.size() - start;
    out_.close(start);
    return content;
  }

 private:
  template <class Values>
  void packed(std::uint32_t number, const Values& values) noexcept {
    out_.tag(number, wire::kBytes);
    out_.varint(values.size() * sizeof(double));
    for (const double value : values) out_.fixed64(value);
  }

  Version version_;
  wire::Writer& out_;
};

}  // namespace dovetail::fri
