#include "bind_chain.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>

#include "dovetail/chain.hpp"
#include "dovetail/parameters.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace dovetail;

namespace {

template <size_t... Shape>
using InputArray =
    nb::ndarray<const double, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
using RowMat3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

ChainParams chain_params(InputArray<7, 3> origin_position,
                         InputArray<7, 3, 3> origin_rotation, InputArray<7> mass,
                         InputArray<7, 3> com, InputArray<7, 3, 3> inertia,
                         const Vec3& tool_position, const Mat3& tool_rotation,
                         const Vec3& gravity) {
  ChainParams params;
  for (int i = 0; i < kNumJoints; ++i) {
    params.origin_position[i] = Eigen::Map<const Vec3>(origin_position.data() + 3 * i);
    params.origin_rotation[i] =
        Eigen::Map<const RowMat3>(origin_rotation.data() + 9 * i);
    params.mass[i] = mass.data()[i];
    params.com[i] = Eigen::Map<const Vec3>(com.data() + 3 * i);
    params.inertia[i] = Eigen::Map<const RowMat3>(inertia.data() + 9 * i);
  }
  params.tool_position = tool_position;
  params.tool_rotation = tool_rotation;
  params.gravity = gravity;
  check_chain(params);
  return params;
}

ChainTerms terms_at(const Chain& chain, const Vec7& q, const Vec7& dq) {
  ChainTerms terms;
  chain.evaluate(q, dq, terms);
  return terms;
}

}  // namespace

void bind_chain(nb::module_& m) {
  nb::class_<Chain>(m, "Chain",
                    "Serial chain of seven revolute joints about their local z axes.")
      .def(
          "__init__",
          [](Chain* self, InputArray<7, 3> origin_position,
             InputArray<7, 3, 3> origin_rotation, InputArray<7> mass,
             InputArray<7, 3> com, InputArray<7, 3, 3> inertia,
             const Vec3& tool_position, const Mat3& tool_rotation,
             const Vec3& gravity) {
            new (self)
                Chain(chain_params(origin_position, origin_rotation, mass, com, inertia,
                                   tool_position, tool_rotation, gravity));
          },
          "origin_position"_a, "origin_rotation"_a, "mass"_a, "com"_a, "inertia"_a,
          "tool_position"_a, "tool_rotation"_a, "gravity"_a,
          "Positions [m] and rotations of the joints in the parent link, masses [kg], "
          "centres of mass [m] in the link, inertias [kg m2] about them, tool in link "
          "7, gravity [m/s2].")
      .def(
          "pose",
          [](const Chain& chain, const Vec7& q) {
            Vec3 p;
            Mat3 R;
            chain.pose(q, p, R);
            return std::pair(p, R);
          },
          "q"_a, "TCP position [m], shape (3,), and axes in world, shape (3, 3).")
      .def(
          "jacobian",
          [](const Chain& chain, const Vec7& q) {
            return terms_at(chain, q, Vec7::Zero()).J;
          },
          "q"_a, "Jacobian of the TCP in world axes, linear first, shape (6, 7).")
      .def(
          "jacobian_dot_dq",
          [](const Chain& chain, const Vec7& q, const Vec7& dq) {
            return terms_at(chain, q, dq).dJdq;
          },
          "q"_a, "dq"_a, "TCP acceleration at zero ddq [m/s2, rad/s2], shape (6,).")
      .def(
          "inertia_matrix",
          [](const Chain& chain, const Vec7& q) {
            return terms_at(chain, q, Vec7::Zero()).M;
          },
          "q"_a, "Joint inertia [kg m2], shape (7, 7).")
      .def(
          "coriolis",
          [](const Chain& chain, const Vec7& q, const Vec7& dq) {
            return terms_at(chain, q, dq).c;
          },
          "q"_a, "dq"_a, "Coriolis and centrifugal torque [Nm], shape (7,).")
      .def(
          "gravity",
          [](const Chain& chain, const Vec7& q) {
            return terms_at(chain, q, Vec7::Zero()).g;
          },
          "q"_a, "Gravity torque [Nm]: what holds the arm still, shape (7,).");
}
