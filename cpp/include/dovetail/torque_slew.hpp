/// Slew limit of the torque while the measured state is in doubt.
#pragma once

#include "dovetail/state_check.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// While the state is in doubt the torque changes slowly, into a standstill and out of
/// it, too: on the straight line between the last torque and the wanted one, which
/// keeps limits that both keep. Joint by joint each would disturb the others. What was
/// begun slowly is ended slowly: the rest of a step does not come at once where the
/// doubt ends. One thread. Nothing allocates or throws.
class TorqueSlew {
 public:
  void reset() noexcept {
    is_slow_ = false;
    lag_ = 0.0;
  }

  /// Changes the torque slowly from this cycle on, as in doubt.
  void begin() noexcept { is_slow_ = true; }

  /// Shortens the change from the last torque [Nm] to `tau`, where it must be slow.
  /// \param is_first  there is no last torque
  /// \return  whether it was shortened
  bool limit(const StateCheck& check, const Vec7& tau_last, bool is_first,
             Vec7& tau) noexcept;

 private:
  bool is_slow_ = false;  // the last torque was on its way to the wanted one
  double lag_ = 0.0;      // torques that were, of late, fading [cycles]
};

}  // namespace dovetail
