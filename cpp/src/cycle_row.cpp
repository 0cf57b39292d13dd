#include "dovetail/cycle_row.hpp"

#include <algorithm>

namespace dovetail {

std::vector<Column> columns_of(std::span<const ColumnGroup> groups) {
  std::vector<Column> columns;
  for (const ColumnGroup& group : groups) {
    std::string_view rest = group.names;
    while (!rest.empty()) {
      const std::string_view name = rest.substr(0, rest.find(' '));
      columns.push_back({std::string(name), std::string(group.unit)});
      rest.remove_prefix(std::min(name.size() + 1, rest.size()));
    }
  }
  return columns;
}

const std::vector<std::string>& servo_columns() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Column& column : columns_of(kCycleGroups)) all.push_back(column.name);
    for (const Column& column : columns_of(kServoGroups)) all.push_back(column.name);
    return all;
  }();
  return names;
}

}  // namespace dovetail
