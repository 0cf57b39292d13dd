#include "bind_limits.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/pair.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "dovetail/bounds.hpp"
#include "dovetail/cholesky.hpp"
#include "dovetail/qp.hpp"
#include "dovetail/saturation.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <typename Vector>
bool is_ordered(const Vector& lower, const Vector& upper) {
  return (lower.array() <= upper.array()).all();
}

void bind_bounds(nb::module_& m) {
  m.def(
      "acceleration_bounds",
      [](double x, double v, double x_min, double x_max, double v_max, double a_max,
         double dt, double kappa, double eta, double delta_x, double delta_v,
         BoundsKind kind, double authority, double jerk, double taper_brake,
         double taper_offset) {
        BoundsParams params{kind, dt, kappa, eta, delta_x, delta_v, authority};
        params.jerk = jerk;
        params.taper_brake = taper_brake;
        params.taper_offset = taper_offset;
        const Interval interval =
            acceleration_bounds(x, v, x_min, x_max, v_max, a_max, params);
        return std::pair(interval.lb, interval.ub);
      },
      "x"_a, "v"_a, "x_min"_a, "x_max"_a, "v_max"_a, "a_max"_a, nb::kw_only(), "dt"_a,
      "kappa"_a = 1.0, "eta"_a = 1.0, "delta_x"_a = 0.0, "delta_v"_a = 0.0,
      "kind"_a = BoundsKind::kViability, "authority"_a = 1.0, "jerk"_a = kInfinite,
      "taper_brake"_a = kInfinite, "taper_offset"_a = 0.0,
      "Smallest and largest safe acceleration [rad/s2] of one coordinate at position x "
      "[rad] and speed v [rad/s]; (lb, ub). authority: most braking of what is beyond "
      "its limit already, over a_max. jerk [rad/s3]: what is asked for becomes braking "
      "on "
      "a ramp. taper_brake [rad/s2] and taper_offset [rad/s]: of a speed limit that "
      "falls towards a position limit.");
}

void bind_saturation(nb::module_& m) {
  nb::class_<SaturationResult>(m, "SaturationResult", "Outcome of a saturation stage.")
      .def_ro("a", &SaturationResult::a, "Joint acceleration [rad/s2], shape (7,).")
      .def_ro("upper", &SaturationResult::upper,
              "Rows held at their upper bound, bits.")
      .def_ro("lower", &SaturationResult::lower,
              "Rows held at their lower bound, bits.")
      .def_ro("passes", &SaturationResult::passes, "Linear solves made.")
      .def_ro("ok", &SaturationResult::ok, "False where the pass limit was reached.");
  m.def("scs", &scs, "a0"_a, "Minv"_a, "Jc"_a, "djc"_a, "cl"_a, "cu"_a, "s0"_a = 1e-3,
        "Saturation in Cartesian space of a0 [rad/s2] by walls cl <= Jc a + djc <= cu "
        "[m/s2].");
  m.def("sjs", &sjs, "a0"_a, "Minv"_a, "lb"_a, "ub"_a,
        "Saturation in joint space of a0 by lb <= a <= ub [rad/s2].");
  m.def("sjs_exact", &sjs_exact, "a0"_a, "Minv"_a, "lb"_a, "ub"_a,
        "The M-norm projection of a0 on the box lb <= a <= ub [rad/s2].");
  nb::class_<TorqueBlend>(m, "TorqueBlend", "Outcome of the torque stage.")
      .def_ro("a", &TorqueBlend::a, "Joint acceleration [rad/s2], shape (7,).")
      .def_ro("tau", &TorqueBlend::tau, "Torque [Nm], shape (7,).")
      .def_ro("share", &TorqueBlend::share,
              "Of the wanted action that is left, 0 to 1.")
      .def_ro("limited", &TorqueBlend::limited, "Joints that set the share, bits.")
      .def_ro("unsafe", &TorqueBlend::unsafe, "True where tau had to be clipped.");
  m.def("blend_torque", &blend_torque, "a"_a, "a_safe"_a, "M"_a, "h"_a, "lo"_a, "hi"_a,
        "Largest step from a_safe to a [rad/s2] with lo <= M a + h <= hi [Nm].");
}

void bind_qp(nb::module_& m) {
  nb::class_<QpResult>(m, "QpResult", "Answer of the limits' QP. Masks are bits.")
      .def_ro("a", &QpResult::a, "Joint acceleration [rad/s2], shape (7,).")
      .def_ro("tau", &QpResult::tau, "M a + h [Nm], shape (7,), not clipped.")
      .def_ro("upper", &QpResult::upper, "Joints held at ub.")
      .def_ro("lower", &QpResult::lower, "Joints held at lb.")
      .def_ro("wall_upper", &QpResult::wall_upper, "Axes held at cu.")
      .def_ro("wall_lower", &QpResult::wall_lower, "Axes held at cl.")
      .def_ro("torque", &QpResult::torque, "Joints held at lo or hi.")
      .def_ro("wall_displaced", &QpResult::wall_displaced, "Walls exceeded.")
      .def_ro("iterations", &QpResult::iterations, "Constraints added and dropped.")
      .def_ro("ok", &QpResult::ok, "False where it stopped early.")
      .def_ro("unsafe", &QpResult::unsafe, "True where a torque row is exceeded.");
  m.def(
      "solve_qp",
      [](const Mat7& M, const Vec7& a0, const Vec7& lb, const Vec7& ub, const Mat37& Jc,
         const Vec3& djc, const Vec3& cl, const Vec3& cu, const Vec7& h, const Vec7& lo,
         const Vec7& hi, double rho, int max_iter) {
        Cholesky<7> factor;
        if (!factor.factor(M))
          throw std::invalid_argument("M is not positive definite");
        const Mat7 Minv = factor.inverse();
        // The controller's numbers are in order: only others are looked at, here.
        const bool is_sound = rho > 0.0 && std::isfinite(rho) && is_ordered(lb, ub) &&
                              is_ordered(cl, cu) && is_ordered(lo, hi);
        const Vec7 wish = is_sound ? a0 : Vec7::Constant(kNaN);
        return solve_qp(
            {M, Minv, wish, lb, ub, Jc, djc, cl, cu, h, lo, hi, rho, max_iter});
      },
      "M"_a, "a0"_a, "lb"_a, "ub"_a, "Jc"_a, "djc"_a, "cl"_a, "cu"_a, "h"_a, "lo"_a,
      "hi"_a, "rho"_a = 1e6, "max_iter"_a = kQpIterations,
      "Nearest a to a0 [rad/s2] in the M norm: box lb, ub hard, walls cl <= Jc a + djc "
      "<= cu [m/s2] soft, torque rows lo <= M a + h <= hi [Nm] hard unless they "
      "exclude the box (unsafe). With a NaN anywhere, a bound below its other side or "
      "a rho that is not finite and > 0, ok is False and a is 0 clipped to the bounds "
      "that are numbers.");
}

}  // namespace

void bind_limits(nb::module_& m) {
  bind_bounds(m);
  bind_saturation(m);
  bind_qp(m);
}
