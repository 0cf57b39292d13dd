#include "dovetail/rigid_plant.hpp"

#include <cmath>

#include "dovetail/cholesky.hpp"

namespace dovetail {
namespace {

constexpr double kStickSpeed = 0.01;  // width of the smooth Coulomb friction [rad/s]

}  // namespace

RigidPlant::RigidPlant(const ChainParams& nominal, const ChainParams& actual,
                       const PlantParams& params) noexcept
    : nominal_(nominal), actual_(actual), params_(params) {}

void RigidPlant::reset(const Vec7& q, const Vec7& dq) noexcept {
  q_ = q;
  dq_ = dq;
}

Vec7 RigidPlant::acceleration(const Vec7& q, const Vec7& dq,
                              const Vec7& tau) const noexcept {
  ChainTerms terms;
  actual_.evaluate(q, dq, terms);
  ToolMotion compensated;
  nominal_.tool_motion(q, dq, compensated);
  const Vec7 dry = params_.coulomb.cwiseProduct(
      (dq / kStickSpeed).unaryExpr([](double x) { return std::tanh(x); }));
  Vec7 ddq = tau + compensated.g - terms.g - terms.c - dry -
             params_.damping.cwiseProduct(dq) +
             terms.J.topRows<3>().transpose() * force_;
  terms.M.diagonal() += params_.armature;
  Cholesky<7> M_factor;
  M_factor.factor(terms.M);
  M_factor.solve(ddq);
  return ddq;
}

void RigidPlant::integrate(const Vec7& tau, double dt) noexcept {
  const Vec7 a1 = acceleration(q_, dq_, tau);
  const Vec7 v2 = dq_ + 0.5 * dt * a1;
  const Vec7 a2 = acceleration(q_ + 0.5 * dt * dq_, v2, tau);
  const Vec7 v3 = dq_ + 0.5 * dt * a2;
  const Vec7 a3 = acceleration(q_ + 0.5 * dt * v2, v3, tau);
  const Vec7 v4 = dq_ + dt * a3;
  const Vec7 a4 = acceleration(q_ + dt * v3, v4, tau);
  q_ += dt / 6.0 * (dq_ + 2.0 * v2 + 2.0 * v3 + v4);
  dq_ += dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
}

void RigidPlant::apply(const Vec7& tau, double dt) noexcept {
  const int steps =
      std::max(1, static_cast<int>(std::ceil(dt / params_.dt_sub - 1e-9)));
  for (int i = 0; i < steps; ++i) integrate(tau, dt / steps);
}

double RigidPlant::kinetic_energy() const noexcept {
  ChainTerms terms;
  actual_.evaluate(q_, dq_, terms);
  terms.M.diagonal() += params_.armature;
  return 0.5 * dq_.dot(terms.M * dq_);
}

}  // namespace dovetail
