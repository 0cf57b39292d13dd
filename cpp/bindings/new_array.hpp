/// Numbers for Python, in pieces of one array of NumPy's.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

namespace dovetail {

/// A new array. To ask NumPy for it costs a third of what a cast from Eigen does.
class NewArray {
 public:
  explicit NewArray(int size)
      : array_(nanobind::borrow(empty())(size)),
        numbers_(nanobind::cast<Numbers>(array_)) {}

  double* data() { return numbers_.data(); }

  /// A view of the numbers from one index up to, without, another.
  nanobind::object piece(int begin, int end) const {
    return nanobind::object(array_[nanobind::slice(begin, end)]);
  }

 private:
  using Numbers = nanobind::ndarray<double, nanobind::ndim<1>, nanobind::c_contig>;

  static nanobind::handle empty() {
    static const nanobind::handle function =  // for good: Python ends before it would
        nanobind::object(nanobind::module_::import_("numpy").attr("empty")).release();
    return function;
  }

  nanobind::object array_;
  Numbers numbers_;
};

}  // namespace dovetail
