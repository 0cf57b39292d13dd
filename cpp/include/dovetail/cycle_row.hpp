/// One control cycle in a log: these structs say its columns, their units and order.
#pragma once

#include <array>
#include <cstddef>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "dovetail/types.hpp"

namespace dovetail {

/// A vector that needs no alignment, so that a row has no gaps.
template <int N>
using Numbers = Eigen::Matrix<double, N, 1, Eigen::DontAlign>;

/// What every arm logs of a cycle; SI, world axes.
struct CycleRow {
  double time;                  ///< since reset [s]
  Numbers<7> q, dq;             ///< as measured, noise included [rad, rad/s]
  Numbers<7> tau;               ///< overlay sent, without gravity [Nm]
  Numbers<3> position;          ///< TCP by the model at the measured state [m]
  Numbers<4> quat_wxyz;         ///< its rotation
  Numbers<3> velocity;          ///< its speed [m/s]
  Numbers<3> angular_velocity;  ///< [rad/s]
  Numbers<3> contact_force;     ///< true force on the tool [N], of
                                ///< the physics step where it was largest; kUnset where
                                ///< nothing measures it
  Numbers<3> f_star;            ///< of the Target [m/s2]
  double flags;                 ///< pack_flags
  Numbers<3> wrench_force;      ///< estimated, of the world on the tool at the TCP [N]
  Numbers<3> wrench_moment;  ///< and its moment about the TCP [Nm]; both kUnset where
                             ///< nothing estimates them
};

/// What a servo loop logs of a cycle.
struct ServoRow {
  CycleRow cycle;
  Numbers<7> tau_measured, tau_external;  ///< on the joint [Nm]
  double sequence;                        ///< of the cabinet's message
  double motion;                          ///< how often commanding began
  double elapsed;                         ///< since the last cycle [s]
  double reason;                          ///< StopReason
};

/// Neighbouring columns: where they begin in the row, their names, their common unit.
struct ColumnGroup {
  std::size_t offset;      ///< [bytes]
  std::string_view names;  ///< separated by single spaces
  std::string_view unit;

  constexpr std::size_t count() const noexcept {
    std::size_t words = 1;
    for (const char c : names) words += c == ' ';
    return words;
  }
};

constexpr std::array kCycleGroups{
    ColumnGroup{offsetof(CycleRow, time), "time", "s"},
    ColumnGroup{offsetof(CycleRow, q), "q1 q2 q3 q4 q5 q6 q7", "rad"},
    ColumnGroup{offsetof(CycleRow, dq), "dq1 dq2 dq3 dq4 dq5 dq6 dq7", "rad/s"},
    ColumnGroup{offsetof(CycleRow, tau), "tau1 tau2 tau3 tau4 tau5 tau6 tau7", "Nm"},
    ColumnGroup{offsetof(CycleRow, position), "x y z", "m"},
    ColumnGroup{offsetof(CycleRow, quat_wxyz), "qw qx qy qz", "1"},
    ColumnGroup{offsetof(CycleRow, velocity), "vx vy vz", "m/s"},
    ColumnGroup{offsetof(CycleRow, angular_velocity), "wx wy wz", "rad/s"},
    ColumnGroup{offsetof(CycleRow, contact_force), "fx fy fz", "N"},
    ColumnGroup{offsetof(CycleRow, f_star), "fsx fsy fsz", "m/s2"},
    ColumnGroup{offsetof(CycleRow, flags), "flags", "1"},
    ColumnGroup{offsetof(CycleRow, wrench_force), "wrench_fx wrench_fy wrench_fz", "N"},
    ColumnGroup{offsetof(CycleRow, wrench_moment), "wrench_mx wrench_my wrench_mz",
                "Nm"},
};

/// Beyond those of `cycle`.
constexpr std::array kServoGroups{
    ColumnGroup{offsetof(ServoRow, tau_measured),
                "tau_measured1 tau_measured2 tau_measured3 tau_measured4 tau_measured5 "
                "tau_measured6 tau_measured7",
                "Nm"},
    ColumnGroup{offsetof(ServoRow, tau_external),
                "tau_external1 tau_external2 tau_external3 tau_external4 tau_external5 "
                "tau_external6 tau_external7",
                "Nm"},
    ColumnGroup{offsetof(ServoRow, sequence), "sequence", "1"},
    ColumnGroup{offsetof(ServoRow, motion), "motion", "1"},
    ColumnGroup{offsetof(ServoRow, elapsed), "elapsed", "s"},
    ColumnGroup{offsetof(ServoRow, reason), "reason", "1"},
};

/// Whether groups name every number from `begin` to `end` [bytes], in order.
template <std::size_t N>
constexpr bool is_gapless(const std::array<ColumnGroup, N>& groups, std::size_t begin,
                          std::size_t end) noexcept {
  for (const ColumnGroup& group : groups) {
    if (group.offset != begin) return false;
    begin += group.count() * sizeof(double);
  }
  return begin == end;
}
static_assert(is_gapless(kCycleGroups, 0, sizeof(CycleRow)));
static_assert(is_gapless(kServoGroups, sizeof(CycleRow), sizeof(ServoRow)));

/// Index of a row's column by its place in the struct [bytes].
constexpr int column_at(std::size_t offset) noexcept {
  return static_cast<int>(offset / sizeof(double));
}

/// Numbers in a CycleRow.
constexpr int kCycleColumns = column_at(sizeof(CycleRow));

/// Copies a row to where a log has room for it.
template <typename Row>
void write_row(const Row& row, double* to) noexcept {
  static_assert(sizeof(Row) % sizeof(double) == 0);
  std::memcpy(to, &row, sizeof(Row));
}

/// A column of a log.
struct Column {
  std::string name, unit;
};

/// The columns of groups, in order.
std::vector<Column> columns_of(std::span<const ColumnGroup> groups);

/// Names of a ServoRow's columns: those of every control cycle first.
const std::vector<std::string>& servo_columns();

}  // namespace dovetail
