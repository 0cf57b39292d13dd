#include "bind_cycle_log.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <tuple>

#include "dovetail/cycle_log.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using namespace dovetail;

void bind_cycle_log(nb::module_& m) {
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
        Eigen::Matrix<double, 16, 1> numbers;
        numbers << step.p, step.quat_wxyz, step.twist, step.force;
        const nb::object array = nb::cast(numbers);
        const auto piece = [&array](int from, int to) {
          return nb::object(array[nb::slice(from, to)]);
        };
        return nb::make_tuple(piece(0, 3), piece(3, 7), piece(7, 13), piece(13, 16),
                              step.flags);
      },
      "chain"_a, "q"_a, "dq"_a, "log"_a,
      nb::sig("def summarize(chain: Chain, q: numpy.typing.NDArray[numpy.float64], "
              "dq: numpy.typing.NDArray[numpy.float64], log: "
              "numpy.typing.NDArray[numpy.float64]) -> "
              "tuple[numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], int]"),
      "TCP position [m], rotation (wxyz) and twist [m/s, rad/s] at the measured state; "
      "of all rows of a cycle log, the largest contact force [N] and the or-ed flags.");
  m.def(
      "count_outside",
      [](Rows log, Row low, Row high) {
        return count_outside(log.data(), static_cast<int>(log.shape(0)), low.data(),
                             high.data());
      },
      "log"_a, "low"_a, "high"_a,
      "How many rows have a number below its column's low or above its high.");
}
