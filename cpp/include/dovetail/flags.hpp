/// What limited a control cycle, and which bit of the packed number says so.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <utility>

namespace dovetail {

/// What limited the last cycle. Masks: bit i is joint A(i+1) or axis X, Y, Z.
struct Flags {
  std::uint8_t joint_position = 0;      ///< the position limit bounds the joint
  std::uint8_t joint_velocity = 0;      ///< the speed limit bounds the joint
  std::uint8_t joint_acceleration = 0;  ///< +-A bounds the joint
  std::uint8_t torque = 0;              ///< the motor torque bounds the joint
  std::uint8_t wall_position = 0;       ///< a wall bounds the axis
  std::uint8_t wall_velocity = 0;       ///< the TCP speed limit bounds the axis
  std::uint8_t wall_acceleration = 0;   ///< the TCP acceleration bounds the axis
  std::uint8_t wall_displaced = 0;      ///< a wall row could not be met this cycle
  bool bad_input = false;    ///< input, or a torque, was no number: damped hold
  bool unsafe = false;       ///< even the safe action exceeded a torque: clipped
  bool qp_early = false;     ///< the QP stopped early; its safe answer was used
  bool target_late = false;  ///< no fresh Target (a servo loop's watchdog): held
  bool stopped = false;      ///< a watchdog's stop: braked, then held
  bool implausible = false;  ///< a measurement that cannot be one was not believed
  bool ended = false;        ///< the last line ended the motion: damped hold
  double displaced = 0.0;    ///< |a - a0| [rad/s2]
};

/// The bit of joint A(i+1) or of axis X, Y, Z in a mask.
constexpr std::uint8_t bit(int i) noexcept {
  return static_cast<std::uint8_t>(1U << i);
}

/// A mask's place in the packed number: its lowest bit, and how many.
struct FlagMask {
  std::string_view name;
  std::uint8_t Flags::* mask;
  int bit;
  int width;
};

/// A switch's place in the packed number.
struct FlagSwitch {
  std::string_view name;
  bool Flags::* is_set;
  int bit;
};

/// Logs hold these numbers: a bit never changes its meaning.
constexpr std::array kFlagMasks{
    FlagMask{"joint_position", &Flags::joint_position, 0, 7},
    FlagMask{"joint_velocity", &Flags::joint_velocity, 7, 7},
    FlagMask{"joint_acceleration", &Flags::joint_acceleration, 14, 7},
    FlagMask{"torque", &Flags::torque, 21, 7},
    FlagMask{"wall_position", &Flags::wall_position, 28, 3},
    FlagMask{"wall_velocity", &Flags::wall_velocity, 31, 3},
    FlagMask{"wall_acceleration", &Flags::wall_acceleration, 34, 3},
    FlagMask{"wall_displaced", &Flags::wall_displaced, 37, 3},
};
constexpr std::array kFlagSwitches{
    FlagSwitch{"bad_input", &Flags::bad_input, 40},
    FlagSwitch{"unsafe", &Flags::unsafe, 41},
    FlagSwitch{"qp_early", &Flags::qp_early, 42},
    FlagSwitch{"target_late", &Flags::target_late, 43},
    FlagSwitch{"stopped", &Flags::stopped, 44},
    FlagSwitch{"implausible", &Flags::implausible, 45},
    FlagSwitch{"ended", &Flags::ended, 46},
};

/// All masks and switches of Flags in one number, exact in a double.
constexpr std::int64_t pack_flags(const Flags& flags) noexcept {
  const auto masks = [&]<std::size_t... i>(std::index_sequence<i...>) {
    return (... | (std::int64_t{flags.*(kFlagMasks[i].mask)} << kFlagMasks[i].bit));
  };
  const auto switches = [&]<std::size_t... i>(std::index_sequence<i...>) {
    return (... |
            (std::int64_t{flags.*(kFlagSwitches[i].is_set)} << kFlagSwitches[i].bit));
  };
  return masks(std::make_index_sequence<kFlagMasks.size()>{}) |
         switches(std::make_index_sequence<kFlagSwitches.size()>{});
}

}  // namespace dovetail
