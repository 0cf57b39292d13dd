#include "bind_cycle_log.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "column_names.hpp"
#include "dovetail/cycle_log.hpp"
#include "new_array.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using namespace dovetail;

namespace {

nb::dict flag_bits() {
  nb::dict bits;
  for (const FlagMask& flag : kFlagMasks) {
    bits[nb::str(flag.name.data(), flag.name.size())] =
        nb::make_tuple(flag.bit, flag.width);
  }
  for (const FlagSwitch& flag : kFlagSwitches) {
    bits[nb::str(flag.name.data(), flag.name.size())] = nb::make_tuple(flag.bit, 1);
  }
  return bits;
}

void bind_layout(nb::module_& m) {
  m.def(
      "cycle_columns", [] { return names_and_units(kCycleGroups); },
      "Name and unit of each column of a cycle log.");
  m.def("servo_columns", &servo_columns, "Columns of a servo loop's log.");
  m.def("flag_bits", &flag_bits,
        "Of each flag in the column `flags`: its lowest bit, and how many it has.");
  m.def(
      "cycle_row",
      [](double time, const Vec7& q, const Vec7& dq, const Vec7& tau,
         const Vec3& position, const Vec4& quat_wxyz, const Vec6& twist,
         const Vec3& contact_force, const Vec3& f_star, const Flags& flags,
         const Vec6& wrench) {
        const CycleRow row{time,
                           q,
                           dq,
                           tau,
                           position,
                           quat_wxyz,
                           twist.head<3>(),
                           twist.tail<3>(),
                           contact_force,
                           f_star,
                           static_cast<double>(pack_flags(flags)),
                           wrench.head<3>(),
                           wrench.tail<3>()};
        Eigen::Matrix<double, kCycleColumns, 1> numbers;
        write_row(row, numbers.data());
        return numbers;
      },
      nb::kw_only(), "time"_a, "q"_a, "dq"_a, "tau"_a, "position"_a, "quat_wxyz"_a,
      "twist"_a, "contact_force"_a, "f_star"_a, "flags"_a, "wrench"_a,
      "One row of a cycle log, for a loop that is not in C++.");
}

}  // namespace

void bind_cycle_log(nb::module_& m) {
  bind_layout(m);
  using Rows = nb::ndarray<const double, nb::shape<-1, kCycleColumns>, nb::c_contig,
                           nb::device::cpu>;
  using Row = nb::ndarray<const double, nb::shape<kCycleColumns>, nb::c_contig,
                          nb::device::cpu>;

  m.def(
      "summarize",
      [](const Chain& chain, const Vec7& q, const Vec7& dq, Rows log) {
        const StepSummary step =
            summarize(chain, q, dq, log.data(), static_cast<int>(log.shape(0)));
        // One array in pieces: to make an array costs as much as all of the sums.
        constexpr int kSize = 22;
        NewArray array(kSize);
        Eigen::Map<Eigen::Matrix<double, kSize, 1>>(array.data()) << step.p,
            step.quat_wxyz, step.twist, step.force, step.wrench;
        return nb::make_tuple(array.piece(0, 3), array.piece(3, 7), array.piece(7, 13),
                              array.piece(13, 16), array.piece(16, kSize), step.flags);
      },
      "chain"_a, "q"_a, "dq"_a, "log"_a,
      nb::sig("def summarize(chain: Chain, q: numpy.typing.NDArray[numpy.float64], "
              "dq: numpy.typing.NDArray[numpy.float64], log: "
              "numpy.typing.NDArray[numpy.float64]) -> "
              "tuple[numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], int]"),
      "TCP position [m], rotation (wxyz) and twist [m/s, rad/s] at the measured state; "
      "of all rows of a cycle log, the largest contact force [N], the last "
      "wrench [N, Nm] and the or-ed flags.");
  m.def(
      "count_outside",
      [](Rows log, Row low, Row high) {
        return count_outside(log.data(), static_cast<int>(log.shape(0)), low.data(),
                             high.data());
      },
      "log"_a, "low"_a, "high"_a,
      "How many rows have a number below its column's low or above its high.");
}
