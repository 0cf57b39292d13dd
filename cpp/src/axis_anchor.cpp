#include "dovetail/axis_anchor.hpp"

#include <algorithm>
#include <cmath>

namespace dovetail {
namespace {

// An axis is anchored where it comes to be slower than this [m/s].
constexpr double kRestSpeed = 0.01;
constexpr double kLargestError = 0.02;  // largest way back that is used [m]

}  // namespace

void AxisAnchor::pull_each(const Target& target, const OperationalSpace& osc,
                           const ToolMotion& tool, Vec6& f_star) noexcept {
  for (int i = 0; i < 3; ++i) {
    const unsigned axis = bit(i);
    if (!(target.stay & axis) || osc.task()[i] != AxisMode::kForce) {
      anchored_ &= ~axis;
      continue;
    }
    if (!(anchored_ & axis)) {
      anchor_[i] = tool.p[i];
      if (std::abs(tool.twist[i]) < kRestSpeed) anchored_ |= axis;
    }
    const double error =
        std::clamp(anchor_[i] - tool.p[i], -kLargestError, kLargestError);
    f_star[i] += osc.params().stiffness[i] * error;
  }
}

}  // namespace dovetail
