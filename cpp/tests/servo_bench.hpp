/// A servo cycle and the smallest cabinet, message by message.
#pragma once

#include <array>
#include <optional>

#include "dovetail/servo_cycle.hpp"
#include "fake_cabinet.hpp"

namespace dovetail::testing {

constexpr double kPeriod = 0.005;

struct Loop {
  FakeCabinet cabinet;
  ChainParams chain = iiwa14_with_tool();
  ServoParams params;
  LimitParams limits = limits_for(kPeriod);
  ServoCycle cycle{params, chain, OscParams{}, limits, kUsualTask};
  Order order;
  std::array<std::uint8_t, fri::kMaxDatagram> out{};
  std::optional<fri::CommandMessage> command;

  Loop() { order.target.quat_wxyz_d = Vec4(0, 1, 0, 0); }

  /// One message and its answer.
  ServoCycle::Action exchange() {
    const std::uint8_t* bytes = cabinet.message();
    const ServoCycle::Action action = cycle.receive(bytes, cabinet.size());
    std::size_t size = 0;
    if (action == ServoCycle::Action::kSend) size = cycle.reply(out.data());
    if (action == ServoCycle::Action::kAnswer) size = cycle.answer(order, out.data());
    command.reset();
    if (size > 0) command = cabinet.read(out.data(), size);
    return action;
  }

  void go_to(fri::SessionState state) {
    cabinet.state = state;
    exchange();
  }

  void activate() {
    go_to(fri::SessionState::kMonitoringWait);
    go_to(fri::SessionState::kMonitoringReady);
    go_to(fri::SessionState::kCommandingWait);
    go_to(fri::SessionState::kCommandingActive);
    new_target();
  }

  void new_target() {
    ++order.serial;
    order.motion = cycle.state().motion;
  }

  void lose(std::uint32_t messages) { cabinet.sequence += messages; }
  const ServoState& state() const { return cycle.state(); }
};

}  // namespace dovetail::testing
