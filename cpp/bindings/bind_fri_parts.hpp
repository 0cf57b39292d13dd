/// What the bindings of FRI's messages share: conversions, enums and small parts.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "dovetail/fri_packet.hpp"

namespace dovetail::binding {

using Stamp = std::optional<std::pair<std::uint32_t, std::uint32_t>>;

inline Stamp from_stamp(const std::optional<fri::TimeStamp>& stamp) {
  if (!stamp) return std::nullopt;
  return std::pair(stamp->sec, stamp->nanosec);
}

inline std::optional<fri::TimeStamp> to_stamp(const Stamp& stamp) {
  if (!stamp) return std::nullopt;
  return fri::TimeStamp{stamp->first, stamp->second};
}

/// \throws std::invalid_argument that lists the known versions
inline fri::Version require_version(const std::string& text) {
  const auto version = fri::parse_version(text);
  if (!version)
    throw std::invalid_argument("FRI version '" + text +
                                "' is unknown: 1.11, 1.14, 1.15, 1.16, 2.5 and 2.7 "
                                "are known; the cabinet's Sunrise project names its "
                                "version");
  return *version;
}

inline fri::Name to_name(const std::string& text) {
  fri::Name name;
  if (!name.assign(text))
    throw std::invalid_argument("the name has " + std::to_string(text.size()) +
                                " bytes, at most 63 without NUL are allowed: " + text);
  return name;
}

/// A name that is not UTF-8 still becomes a string, and the same bytes again.
inline nanobind::str from_name(const fri::Name& name) {
  const std::string_view text = name.view();
  return nanobind::steal<nanobind::str>(PyUnicode_DecodeUTF8(
      text.data(), static_cast<Py_ssize_t>(text.size()), "surrogateescape"));
}

template <std::size_t N>
std::array<double, N> to_array(const char* attribute, nanobind::handle values) {
  std::array<double, N> array{};
  std::size_t count = 0;
  for (const nanobind::handle value : values) {
    if (count < N) array[count] = nanobind::cast<double>(nanobind::float_(value));
    ++count;
  }
  if (count != N)
    throw std::invalid_argument(std::string(attribute) + " has " +
                                std::to_string(count) + " values, " +
                                std::to_string(N) + " are needed");
  return array;
}

template <class List, class T>
List to_list(const char* attribute, const std::vector<T>& items) {
  List list;
  for (const T& item : items)
    if (!list.push_back(item))
      throw std::invalid_argument(std::string(attribute) + " has " +
                                  std::to_string(items.size()) + " elements, at most " +
                                  std::to_string(List::kCapacity) + " are allowed");
  return list;
}

template <class E>
E to_enum(const char* attribute, int value, int largest) {
  if (value < 0 || value > largest)
    throw std::invalid_argument(std::string(attribute) + " is " +
                                std::to_string(value) + ", allowed is 0 to " +
                                std::to_string(largest));
  return static_cast<E>(value);
}

}  // namespace dovetail::binding

void bind_fri_parts(nanobind::module_& m);
