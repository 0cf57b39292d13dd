#include <boost/test/unit_test.hpp>
#include <cmath>
#include <functional>
#include <string>

#include "arm.hpp"
#include "dovetail/last_line.hpp"

using namespace dovetail;
using namespace dovetail::testing;

namespace {

/// One joint's speed as a function of time; the others rest.
struct Watch {
  LimitParams limits = limits_for(0.001);
  Vec7 explained = Vec7::Zero();
  double power = 0.0;
  double push = 0.0;

  using Speed = std::function<double(double)>;

  LastLine run(int joint, const Speed& speed, double period, double time = 2.0) const {
    LastLine line(limits);
    for (double t = 0.0; t < time; t += period) {
      Vec7 dq = Vec7::Zero();
      dq[joint] = speed(t);
      line.check({dq, explained, power, push, period});
    }
    return line;
  }
};

double swing(double amplitude, double frequency, double t) {
  return amplitude * std::sin(2.0 * M_PI * frequency * t);
}

constexpr std::array<double, 4> kPeriods = {0.001, 0.002, 0.0025, 0.005};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(last_line, Watch)

BOOST_AUTO_TEST_CASE(a_growing_swing_ends_and_its_joint_and_width_are_named) {
  for (const double period : kPeriods) {
    for (const double frequency : {10.0, 15.0, 25.0}) {
      for (int joint = 0; joint < kNumJoints; ++joint) {
        const double fastest = limits.dq_max[joint];
        const auto speed = [&](double t) {
          return swing(std::min(0.01 * std::exp(3.0 * t), 0.5) * fastest, frequency, t);
        };
        const LastLine line = run(joint, speed, period);
        BOOST_TEST((line.cause() == EndCause::kOscillation),
                   frequency << " Hz at " << period << " s");
        BOOST_TEST(line.joint() == joint);
        BOOST_TEST(line.value() > line.limit());
        BOOST_TEST(line.value() < fastest);
        BOOST_TEST(line.limit() >= 0.1 * fastest);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(it_ends_before_the_swing_has_reached_the_speed_limit) {
  LastLine line(limits);
  double peak = 0.0;
  for (double t = 0.0; t < 2.0; t += 0.001) {
    Vec7 dq = Vec7::Zero();
    dq[1] = swing(0.005 * std::exp(4.0 * t), 12.0, t);
    if (line.check({dq, explained, power, push, 0.001})) break;
    peak = std::max(peak, std::abs(dq[1]));
  }
  BOOST_TEST((line.cause() == EndCause::kOscillation));
  BOOST_TEST(peak < 0.5 * limits.dq_max[1]);
}

BOOST_AUTO_TEST_CASE(what_decays_is_slow_or_small_does_not_end) {
  const double fastest = limits.dq_max[2];
  for (const double period : kPeriods) {
    const auto decays = [&](double t) {  // a half swing is 0.6 of the one before
      return std::exp(-15.0 * t) * swing(0.9 * fastest, 15.0, t);
    };
    const auto slow = [&](double t) { return swing(0.9 * fastest, 2.0, t); };
    const auto small = [&](double t) { return swing(0.02 * fastest, 15.0, t); };
    const auto ramp = [&](double t) { return 0.45 * fastest * t; };
    const auto noise = [&, random = std::mt19937_64(4)](double) mutable {
      return 0.03 * fastest * random_vector<Vec3>(random, 1.0)[0];
    };
    for (const Speed& speed :
         {Speed(decays), Speed(slow), Speed(small), Speed(ramp), Speed(noise)}) {
      BOOST_TEST((run(2, speed, period).cause() == EndCause::kNone));
    }
  }
}

BOOST_AUTO_TEST_CASE(only_swings_between_seven_and_two_hundred_and_fifty_hertz_count) {
  const double wide = 0.9 * limits.dq_max[2];
  const auto quick = [&](double t) { return std::lround(1e3 * t) % 2 ? wide : -wide; };
  BOOST_TEST((run(2, quick, 0.001).cause() == EndCause::kNone));  // a sample a turn
  for (const double period : kPeriods) {
    const auto slow = [&](double t) { return swing(wide, 5.5, t); };
    const auto in_between = [&](double t) { return swing(wide, 10.0, t); };
    BOOST_TEST((run(2, slow, period).cause() == EndCause::kNone));
    BOOST_TEST((run(2, in_between, period).cause() == EndCause::kOscillation));
  }
}

BOOST_AUTO_TEST_CASE(a_reset_forgets_the_swings_so_far) {
  LastLine line(limits);
  double time = 0.0;
  const auto go_on = [&](double duration) {
    for (double end = time + duration; time < end; time += 0.001) {
      Vec7 dq = Vec7::Zero();
      dq[2] = swing(0.5 * limits.dq_max[2], 10.0, time);
      line.check({dq, explained, power, push, 0.001});
    }
    return line.cause() != EndCause::kNone;
  };
  double until_end = 0.0;
  for (; !go_on(0.005); until_end += 0.005) BOOST_REQUIRE(until_end < 1.0);
  line.reset();
  BOOST_TEST(!go_on(0.6 * until_end));
}

BOOST_AUTO_TEST_CASE(a_swing_that_the_target_explains_does_not_end) {
  // A policy that reverses 15 rad/s2 at 20 Hz makes the joint swing at 10 Hz.
  for (const bool is_told : {true, false}) {
    LastLine line(limits);
    double a = 7.5;
    Vec7 dq = Vec7::Zero();
    dq[3] = -0.5 * 0.05 * a;
    for (int k = 1; k < 2000; ++k) {
      explained.setZero();
      if (k % 50 == 0) {
        a = -a;
        if (is_told) explained[3] = 2.0 * a;
      }
      dq[3] += 0.001 * a;
      line.check({dq, explained, 0.0, 0.0, 0.001});
    }
    BOOST_TEST((line.cause() == EndCause::kNone) == is_told);
  }
}

BOOST_AUTO_TEST_CASE(a_small_change_of_the_target_excuses_no_large_swing) {
  explained.setConstant(1.0);
  const auto speed = [&](double t) { return swing(0.4 * limits.dq_max[5], 12.0, t); };
  BOOST_TEST((run(5, speed, 0.002).cause() == EndCause::kOscillation));
}

BOOST_AUTO_TEST_CASE(limiters_that_drive_end_it_and_limiters_that_brake_do_not) {
  const auto still = [](double) { return 0.0; };
  for (const double period : kPeriods) {
    power = 2.0;
    const LastLine line = run(0, still, period);
    BOOST_TEST((line.cause() == EndCause::kEnergy));
    BOOST_TEST(line.joint() == -1);
    BOOST_TEST(line.value() > line.limit());
    power = 0.2;  // noise: forgotten as quickly as it comes
    BOOST_TEST((run(0, still, period, 10.0).cause() == EndCause::kNone));
    power = -1e3;
    BOOST_TEST((run(0, still, period).cause() == EndCause::kNone));
  }
}

BOOST_AUTO_TEST_CASE(braking_earns_no_right_to_drive) {
  LastLine line(limits);
  const Vec7 rest = Vec7::Zero();
  for (int k = 0; k < 1000; ++k) line.check({rest, rest, -50.0, 0.0, 0.001});
  for (int k = 0; k < 100; ++k) line.check({rest, rest, 4.0, 0.0, 0.001});
  BOOST_TEST((line.cause() == EndCause::kEnergy));
}

BOOST_AUTO_TEST_CASE(limiters_that_push_on_at_rest_end_it_the_sooner_the_harder) {
  const auto still = [](double) { return 0.0; };
  for (const double period : kPeriods) {
    for (const double force : {21.0, 40.0, 200.0}) {
      push = force;
      const double time = 0.8 / force;  // 0.8 N s
      const LastLine line = run(0, still, period, time + 2.0 * period);
      BOOST_TEST((line.cause() == EndCause::kForce));
      BOOST_TEST(line.is_loop());
      BOOST_TEST(line.joint() == -1);
      BOOST_TEST(line.value() == force);
      BOOST_TEST(line.limit() == 20.0);
      BOOST_TEST((run(0, still, period, time - period).cause() == EndCause::kNone));
    }
    push = 19.0;
    BOOST_TEST((run(0, still, period, 10.0).cause() == EndCause::kNone));
  }
}

BOOST_AUTO_TEST_CASE(short_pushes_of_limiters_do_not_add_up) {
  LastLine line(limits);
  for (int k = 0; k < 1000; ++k) {
    push = k % 10 ? 80.0 : 0.0;
    line.check({Vec7::Zero(), explained, power, push, 0.001});
  }
  BOOST_TEST((line.cause() == EndCause::kNone));
}

BOOST_AUTO_TEST_CASE(a_joint_that_used_three_fifths_of_its_speed_margin_ends_it) {
  limits.delta_v = 0.2;
  for (int joint = 0; joint < kNumJoints; ++joint) {
    for (const double sign : {1.0, -1.0}) {
      const double most = sign * (1.0 - 0.4 * limits.delta_v) * limits.dq_max[joint];
      BOOST_TEST((run(
                      joint, [&](double) { return 0.999 * most; }, 0.001)
                      .cause() == EndCause::kNone));
      const LastLine line = run(joint, [&](double) { return 1.001 * most; }, 0.001);
      BOOST_TEST((line.cause() == EndCause::kSpeed));
      BOOST_TEST(line.joint() == joint);
      BOOST_TEST(line.value() == 1.001 * most);
      BOOST_TEST(line.limit() == std::abs(most));
    }
  }
}

BOOST_AUTO_TEST_CASE(a_speed_that_jumps_is_too_fast_if_it_is_there_in_the_next_cycle) {
  const Vec7 fast = Vec7::Unit(3) * limits.dq_max[3], none = Vec7::Zero();
  LastLine wrong(limits), right(limits);
  for (LastLine* line : {&wrong, &right}) {
    BOOST_TEST(!line->check({fast, none, 0.0, 0.0, 0.005, true}));
  }
  BOOST_TEST(!wrong.check({none, none, 0.0, 0.0, 0.005}));
  BOOST_TEST(right.check({fast, none, 0.0, 0.0, 0.005}));
  BOOST_TEST((right.cause() == EndCause::kSpeed));
}

BOOST_AUTO_TEST_CASE(the_first_cause_stays_until_a_reset) {
  LastLine line(limits);
  Vec7 dq = Vec7::Zero();
  dq[6] = 3.0;
  BOOST_TEST(line.check({dq, Vec7::Zero(), 0.0, 0.0, 0.001}));
  dq.setZero();
  dq[2] = 3.0;
  for (int k = 0; k < 500; ++k)
    BOOST_TEST(line.check({dq, Vec7::Zero(), 9.0, 0.0, 0.001}));
  BOOST_TEST((line.cause() == EndCause::kSpeed));
  BOOST_TEST(line.joint() == 6);
  BOOST_TEST(name(line.cause()) == std::string("speed"));
  line.reset();
  BOOST_TEST((line.cause() == EndCause::kNone));
  BOOST_TEST(!line.check({Vec7::Zero(), Vec7::Zero(), 0.0, 0.0, 0.001}));
}

BOOST_AUTO_TEST_CASE(each_cause_is_told_with_its_own_unit) {
  const auto told = [](EndCause cause, int joint, const char* words) {
    BOOST_TEST(describe(cause, joint, 2.5, 2.0).find(words) != std::string::npos);
  };
  told(EndCause::kOscillation, 3, "A4 swings to and fro by 2.5 rad/s");
  told(EndCause::kSpeed, 6, "A7 is 2.5 rad/s, allowed is 2 rad/s");
  told(EndCause::kEnergy, -1, "2.5 J, allowed is 2 J");
  told(EndCause::kForce, -1, "2.5 N, allowed is 2 N");
  BOOST_TEST(describe(EndCause::kNone, -1, 0.0, 0.0).empty());
}

BOOST_AUTO_TEST_CASE(switched_off_it_sees_nothing) {
  limits.last_line = false;
  power = 100.0;
  BOOST_TEST((run(0, [](double) { return 50.0; }, 0.001).cause() == EndCause::kNone));
}

BOOST_AUTO_TEST_SUITE_END()
