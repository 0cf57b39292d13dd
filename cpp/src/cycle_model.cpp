#include "dovetail/cycle_model.hpp"

namespace dovetail {
namespace {

// Of tau_max: what is taken for a disturbance, but of a joint that is at its limit.
constexpr double kUsualEstimate = 0.3;

}  // namespace

void CycleModel::update(const Chain& chain, const LimitParams& limits, double period,
                        const Vec7& q, const Vec7& dq, const Vec7& r) noexcept {
  const double ahead = limits.mid_interval ? 0.5 * period : 0.0;
  chain.evaluate(q + ahead * dq, dq, terms);
  chain.tool_motion(q, dq, tool);
  terms.M.diagonal() += limits.armature;
  factor.factor(terms.M);
  Minv = factor.inverse();
  h = terms.c + limits.damping.cwiseProduct(dq);
  const Vec7 usual = kUsualEstimate * limits.tau_max;
  const Vec7 cut = r.cwiseMax(-usual).cwiseMin(usual);
  push.noalias() = Minv * cut;
  push_whole = push;
  if (cut != r) push_whole.noalias() = Minv * r;
  push_tool.noalias() = terms.J.topRows<3>() * push;
  lo = -limits.tau_max - tool.g;
  hi = limits.tau_max - tool.g;
}

void CycleModel::keep_near(const Vec7& tau_last, const Vec7& step) noexcept {
  if (!(step.array() < kInfinite).any()) return;
  const Vec7 least = tau_last - step;
  const Vec7 most = tau_last + step;
  lo = lo.cwiseMax(least).cwiseMin(most);
  hi = hi.cwiseMin(most).cwiseMax(least);
}

}  // namespace dovetail
