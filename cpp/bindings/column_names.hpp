/// Columns of a log as Python sees them.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "dovetail/cycle_row.hpp"

namespace dovetail {

inline std::vector<std::pair<std::string, std::string>> names_and_units(
    std::span<const ColumnGroup> groups) {
  std::vector<std::pair<std::string, std::string>> pairs;
  for (const Column& column : columns_of(groups)) {
    pairs.emplace_back(column.name, column.unit);
  }
  return pairs;
}

}  // namespace dovetail
