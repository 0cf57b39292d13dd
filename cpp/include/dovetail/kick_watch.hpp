/// Sees a joint that is kicked: pushed so hard that it will be past its speed limit
/// before a torque can act against it (docs/control.md, Disturbance estimate).
#pragma once

#include "dovetail/decay.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// One thread. Nothing allocates or throws.
class KickWatch {
 public:
  explicit KickWatch(const LimitParams& limits) noexcept;

  void reset() noexcept;
  /// True in the cycle in which a kick is seen, then not again until what was done
  /// about it can have come round the loop. It is no kick where the motion becomes
  /// slower.
  /// \param dq  measured [rad/s]
  /// \param change  of it since the last cycle [rad/s]
  /// \param elapsed  since then [s]
  bool sees(const Vec7& dq, const Vec7& change, double elapsed) noexcept;

 private:
  Vec7 dq_max_;
  double time_;        // in which a torque acts: 1 / brake_rate [s]
  double wait_ = 0.0;  // until the next one [s]
  Vec7 ddq_ = Vec7::Zero();
  Decay decay_;
};

}  // namespace dovetail
