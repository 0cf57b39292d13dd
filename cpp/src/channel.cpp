#include "dovetail/channel.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <string>

namespace dovetail {

namespace {

constexpr double kMaxDelay = 0.1;   // [s]
constexpr double kRounding = 1e-9;  // of a step: delay over step may be 3.9999...

void require(const char* name, double value, double max, const char* unit) {
  if (value >= 0.0 && value <= max) return;
  throw std::invalid_argument("channel " + std::string(name) + " is " +
                              std::to_string(value) + " " + unit +
                              ", allowed is 0 to " + std::to_string(max));
}

}  // namespace

Channel::Channel(const ChannelParams& params) : params_(params) {
  require("delay", params.delay, kMaxDelay, "s");
  require("torque_noise", params.torque_noise, 100.0, "Nm");
  require("position_noise", params.position_noise, 0.1, "rad");
  require("velocity_noise", params.velocity_noise, 1.0, "rad/s");
  seed(params.seed);
  reset();
}

void Channel::reset() noexcept {
  line_.fill(Vec7::Zero());
  head_ = 0;
}

void Channel::seed(std::uint64_t seed) noexcept {
  // splitmix64 spreads any seed, 0 included, over xoshiro256++'s state.
  for (auto& word : state_) {
    seed += 0x9e3779b97f4a7c15ULL;
    std::uint64_t z = seed;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    word = z ^ (z >> 31);
  }
  has_spare_ = false;
}

double Channel::uniform() noexcept {
  // xoshiro256++ (Blackman and Vigna 2019): the same numbers on every platform.
  auto& s = state_;
  const std::uint64_t result = std::rotl(s[0] + s[3], 23) + s[0];
  const std::uint64_t t = s[1] << 17;
  s[2] ^= s[0];
  s[3] ^= s[1];
  s[1] ^= s[2];
  s[0] ^= s[3];
  s[2] ^= t;
  s[3] = std::rotl(s[3], 45);
  return static_cast<double>(result >> 11) * 0x1.0p-53;
}

double Channel::normal() noexcept {
  // Marsaglia's polar method: two numbers per draw.
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  double x, y, r;
  do {
    x = 2.0 * uniform() - 1.0;
    y = 2.0 * uniform() - 1.0;
    r = x * x + y * y;
  } while (r >= 1.0 || r == 0.0);
  const double scale = std::sqrt(-2.0 * std::log(r) / r);
  spare_ = scale * y;
  has_spare_ = true;
  return scale * x;
}

void Channel::add_noise(Vec7& v, double deviation) noexcept {
  if (deviation == 0.0) return;
  for (int i = 0; i < kNumJoints; ++i) v[i] += deviation * normal();
}

Vec7 Channel::send(const Vec7& tau) noexcept {
  Vec7 sent = tau;
  add_noise(sent, params_.torque_noise);
  return sent;
}

Vec7 Channel::receive(const Vec7& sent, double h) noexcept {
  if (params_.delay == 0.0) return sent;
  // Of the step's time, the share `rest` still belongs to the command before.
  const double whole = std::floor(params_.delay / h + kRounding);
  const double rest = std::max(0.0, params_.delay / h - whole);
  const int steps = std::min(static_cast<int>(whole), kCapacity - 2);
  line_[static_cast<std::size_t>(head_)] = sent;
  const auto& late =
      line_[static_cast<std::size_t>((head_ - steps + kCapacity) % kCapacity)];
  const auto& later =
      line_[static_cast<std::size_t>((head_ - steps - 1 + kCapacity) % kCapacity)];
  head_ = (head_ + 1) % kCapacity;
  return rest < kRounding ? late : Vec7((1.0 - rest) * late + rest * later);
}

void Channel::measure(Vec7& q, Vec7& dq) noexcept {
  add_noise(q, params_.position_noise);
  add_noise(dq, params_.velocity_noise);
}

}  // namespace dovetail
