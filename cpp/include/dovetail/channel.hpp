/// What lies between a controller and a twin's joints: delay, and noise both ways.
///
/// No allocation and no exception after construction. One thread at a time.
#pragma once

#include <array>
#include <cstdint>

#include "dovetail/types.hpp"

namespace dovetail {

struct ChannelParams {
  double delay = 0.0;           ///< of the torque command [s], 0 to 0.1
  double torque_noise = 0.0;    ///< standard deviation per command [Nm]
  double position_noise = 0.0;  ///< standard deviation per reading [rad]
  double velocity_noise = 0.0;  ///< standard deviation per reading [rad/s]
  std::uint64_t seed = 0;
};

class Channel {
 public:
  /// Throws std::invalid_argument for a negative or non-finite number.
  explicit Channel(const ChannelParams& params);

  /// Empties the delay line; the noise goes on where it was.
  void reset() noexcept;

  /// Starts the noise again from this seed.
  void seed(std::uint64_t seed) noexcept;

  /// The command as it leaves the controller: tau + noise [Nm]. Once per command.
  Vec7 send(const Vec7& tau) noexcept;

  /// The command that acts during one physics step of h [s]: the mean over the step of
  /// what was sent `delay` before, zero before the first arrives. The impulse is exact
  /// for any delay; where it is no whole number of steps, a change takes one to come.
  Vec7 receive(const Vec7& sent, double h) noexcept;

  /// Adds the encoders' noise to a true state [rad, rad/s].
  void measure(Vec7& q, Vec7& dq) noexcept;

  const ChannelParams& params() const noexcept { return params_; }

 private:
  static constexpr int kCapacity = 1024;  // physics steps in flight

  double normal() noexcept;
  double uniform() noexcept;
  void add_noise(Vec7& v, double deviation) noexcept;

  ChannelParams params_;
  std::array<std::uint64_t, 4> state_;
  double spare_ = 0.0;
  bool has_spare_ = false;
  std::array<Vec7, kCapacity> line_;
  int head_ = 0;
};

}  // namespace dovetail
