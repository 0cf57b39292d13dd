/// Springs that keep the tool where it came to rest, on force axes of `Target.stay`.
#pragma once

#include "dovetail/osc.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// One thread. Nothing allocates or throws.
class AxisAnchor {
 public:
  /// Holds no axis.
  void reset() noexcept { anchored_ = 0; }

  /// Adds the springs' pull to f* [m/s2].
  void pull(const Target& target, const OperationalSpace& osc, const ToolMotion& tool,
            Vec6& f_star) noexcept {
    if (target.stay != 0 || anchored_ != 0) pull_each(target, osc, tool, f_star);
  }

 private:
  void pull_each(const Target& target, const OperationalSpace& osc,
                 const ToolMotion& tool, Vec6& f_star) noexcept;

  unsigned anchored_ = 0;       // axes, bits
  Vec3 anchor_ = Vec3::Zero();  // [m]
};

}  // namespace dovetail
