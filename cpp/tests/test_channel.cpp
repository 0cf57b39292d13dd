#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "dovetail/channel.hpp"

using dovetail::Channel;
using dovetail::ChannelParams;
using dovetail::Vec7;

namespace {

Channel make(double delay, double torque_noise, std::uint64_t seed = 1) {
  ChannelParams params;
  params.delay = delay;
  params.torque_noise = torque_noise;
  params.seed = seed;
  return Channel(params);
}

}  // namespace

BOOST_AUTO_TEST_CASE(an_ideal_channel_changes_nothing) {
  Channel channel = make(0.0, 0.0);
  const Vec7 tau = Vec7::LinSpaced(-3.0, 3.0);
  BOOST_TEST(channel.receive(channel.send(tau), 0.001) == tau);
  Vec7 q = tau, dq = -tau;
  channel.measure(q, dq);
  BOOST_TEST(q == tau);
  BOOST_TEST(dq == Vec7(-tau));
}

BOOST_AUTO_TEST_CASE(a_command_arrives_after_whole_steps_unchanged) {
  for (const double h : {0.0001, 0.001, 0.0025, 0.005}) {
    Channel channel = make(0.005, 0.0);
    const int late = static_cast<int>(std::lround(0.005 / h));
    for (int k = 1; k <= 3000; ++k) {  // past the end of the ring, too
      const Vec7 received = channel.receive(Vec7::Constant(k), h);
      BOOST_REQUIRE_EQUAL(received[3], std::max(0, k - late));
    }
  }
}

BOOST_AUTO_TEST_CASE(a_ramp_is_late_by_the_delay_whatever_the_step) {
  for (const double delay : {0.0004, 0.005, 0.0073, 0.1}) {
    for (const double h : {0.0001, 0.001, 0.002, 0.0025}) {
      Channel channel = make(delay, 0.0);
      for (int k = 1; k <= 3000; ++k) {
        const Vec7 received = channel.receive(Vec7::Constant(k * h), h);
        if (k * h < delay + h) continue;  // some of it is from before the first
        BOOST_REQUIRE_SMALL(received[3] - (k * h - delay), 1e-9);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(the_impulse_of_a_jump_is_late_by_the_delay) {
  for (const double h : {0.001, 0.002, 0.0025}) {
    Channel channel = make(0.005, 0.0);
    double impulse = 0.0;  // [Nms] of 1 Nm from time 0 to 60 ms
    const int steps = static_cast<int>(std::lround(0.06 / h));
    for (int k = 0; k < steps; ++k) impulse += h * channel.receive(Vec7::Ones(), h)[3];
    BOOST_TEST(std::abs(impulse - (0.06 - 0.005)) < 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(reset_empties_the_delay_line) {
  Channel channel = make(0.003, 0.0);
  for (int k = 0; k < 10; ++k) channel.receive(Vec7::Ones(), 0.001);
  channel.reset();
  for (int k = 0; k < 3; ++k) {
    BOOST_TEST(channel.receive(Vec7::Ones(), 0.001) == Vec7(Vec7::Zero()));
  }
  BOOST_TEST(channel.receive(Vec7::Ones(), 0.001) == Vec7(Vec7::Ones()));
}

BOOST_AUTO_TEST_CASE(noise_is_normal_with_its_deviation) {
  Channel channel = make(0.0, 2.0);
  double sum = 0.0, square = 0.0, fourth = 0.0;
  const int count = 100000;
  for (int k = 0; k < count; ++k) {
    for (const double x : channel.send(Vec7::Zero())) {
      sum += x;
      square += x * x;
      fourth += x * x * x * x;
    }
  }
  const double n = 7.0 * count;
  BOOST_TEST(std::abs(sum / n) < 0.01);
  BOOST_TEST(std::abs(square / n - 4.0) < 0.04);
  BOOST_TEST(std::abs(fourth / n - 48.0) < 1.5);  // 3 sigma^4
}

BOOST_AUTO_TEST_CASE(one_seed_is_one_sequence) {
  Channel a = make(0.0, 1.0, 7), b = make(0.0, 1.0, 7), c = make(0.0, 1.0, 8);
  const Vec7 first = a.send(Vec7::Zero());
  BOOST_TEST(first == b.send(Vec7::Zero()));
  BOOST_TEST(first != c.send(Vec7::Zero()));
  a.seed(7);
  BOOST_TEST(first == a.send(Vec7::Zero()));
}

BOOST_AUTO_TEST_CASE(numbers_out_of_range_are_refused) {
  BOOST_CHECK_THROW(make(-0.001, 0.0), std::invalid_argument);
  BOOST_CHECK_THROW(make(0.2, 0.0), std::invalid_argument);
  BOOST_CHECK_THROW(make(std::nan(""), 0.0), std::invalid_argument);
  BOOST_CHECK_THROW(make(0.0, std::numeric_limits<double>::infinity()),
                    std::invalid_argument);
}
