/// The walls around the TCP, widened while the tool starts outside them.
#pragma once

#include "dovetail/types.hpp"

namespace dovetail {

/// A wall that the tool is behind at the start, margin included, begins at the tool and
/// moves in slowly to its place: it takes the tool along.
class Walls {
 public:
  explicit Walls(const LimitParams& limits) noexcept
      : x_min_(limits.x_min),
        x_max_(limits.x_max),
        margin_(limits.delta_x),
        min_(limits.x_min),
        max_(limits.x_max) {}

  /// The next update is of a start.
  void reset() noexcept { is_placed_ = false; }

  /// Moves the walls in for `elapsed` [s]; at a start places them around p [m].
  void update(const Vec3& p, double elapsed) noexcept {
    const double way = kReturnSpeed * elapsed;
    min_ = is_placed_ ? Vec3(min_.array() + way) : Vec3(p.array() - margin_);
    max_ = is_placed_ ? Vec3(max_.array() - way) : Vec3(p.array() + margin_);
    min_ = min_.cwiseMin(x_min_);
    max_ = max_.cwiseMax(x_max_);
    is_placed_ = true;
  }

  const Vec3& min() const noexcept { return min_; }  ///< lower walls, world [m]
  const Vec3& max() const noexcept { return max_; }  ///< upper walls, world [m]
  bool is_widened() const noexcept { return min_ != x_min_ || max_ != x_max_; }

 private:
  static constexpr double kReturnSpeed = 0.05;  // at which a wall moves in [m/s]

  Vec3 x_min_, x_max_;  // where the walls belong [m]
  double margin_;       // [m]
  Vec3 min_, max_;
  bool is_placed_ = false;
};

}  // namespace dovetail
