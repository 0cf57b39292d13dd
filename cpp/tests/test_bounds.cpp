#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "dovetail/bounds.hpp"

using namespace dovetail;

namespace {

constexpr int kSamples = 1000000;

struct Axis {
  double x_min = -2.0, x_max = 2.9, v_max = 1.5, a_max = 15.0;
};

double uniform(std::mt19937_64& rng, double a, double b) {
  return std::uniform_real_distribution<double>(a, b)(rng);
}

BoundsParams random_params(std::mt19937_64& rng) {
  BoundsParams params;
  params.dt = std::exp(uniform(rng, -7.0, -5.0));  // 0.9 to 6.7 ms
  params.kappa = uniform(rng, 1.0, 10.0);
  params.eta = uniform(rng, 0.3, 1.0);
  params.delta_x = uniform(rng, 0.0, 0.02);
  params.delta_v = uniform(rng, 0.0, 0.1);
  return params;
}

/// Way by which a coordinate may pass its margin, so that none is kicked at it: it
/// comes to rest by 2 / T, not by a brake that knows a hair's breadth.
double softness(const Axis& axis, const BoundsParams& params) {
  const double T = params.kappa * params.dt;
  return params.eta * axis.a_max * T * T / 8.0;
}

/// Can stop by braking with eta a_max before both limits, within the speed limit.
bool is_viable(double x, double v, const Axis& axis, const BoundsParams& params,
               double tolerance) {
  const double braking = v * v / (2.0 * params.eta * axis.a_max);
  const double front = v > 0 ? x + braking : x;
  const double back = v < 0 ? x - braking : x;
  return front <= axis.x_max - params.delta_x + tolerance &&
         back >= axis.x_min + params.delta_x - tolerance &&
         std::abs(v) <= (1.0 - params.delta_v) * axis.v_max + 1e-9;
}

/// A viable state, on the very border of the set every third time.
bool draw_viable(std::mt19937_64& rng, const Axis& axis, const BoundsParams& params,
                 double& x, double& v) {
  const double speed = (1.0 - params.delta_v) * axis.v_max;
  v = uniform(rng, -speed, speed);
  const int where = static_cast<int>(uniform(rng, 0.0, 3.0));
  if (where == 0) v = std::copysign(speed, v);
  x = uniform(rng, axis.x_min, axis.x_max);
  if (where == 1) {
    const double braking = v * v / (2.0 * params.eta * axis.a_max);
    x = v > 0 ? axis.x_max - params.delta_x - braking
              : axis.x_min + params.delta_x + braking;
  }
  return is_viable(x, v, axis, params, 0.0);
}

Interval bounds(double x, double v, const Axis& axis, const BoundsParams& params) {
  return acceleration_bounds(x, v, axis.x_min, axis.x_max, axis.v_max, axis.a_max,
                             params);
}

}  // namespace

BOOST_AUTO_TEST_CASE(under_a_push_a_bound_brakes_and_does_no_more) {
  // The change that a push makes to what may be asked for, times the speed towards the
  // limit, is never positive; at rest it is nothing before the margin is reached.
  std::mt19937_64 rng(6);
  const Axis axis;
  int brakes = 0, holds = 0;
  for (int k = 0; k < kSamples; ++k) {
    const BoundsParams params = random_params(rng);
    const double x = uniform(rng, -2.2, 3.1), v = uniform(rng, -1.8, 1.8);
    const double push = uniform(rng, 0.0, 40.0);  // towards x_max
    const double limit = uniform(rng, -15.0, 15.0);
    const double value = under_push(limit, push, v, 0.0, params.brake_rate);
    BOOST_REQUIRE(value <= limit);
    BOOST_REQUIRE(value >= std::min(limit, -params.brake_rate * std::max(v, 0.0)));
    const double slower = kDampingAway * params.brake_rate * std::max(-v, 0.0);
    if (v <= 0.0)
      BOOST_REQUIRE(value == std::min(limit, std::max(limit - push, slower)));
    const double held = under_push(limit, push, v, 1.0, params.brake_rate);
    BOOST_REQUIRE(held <= value && held >= limit - push - 1e-12);
    const double away = under_push(limit, -push, v, 0.3, params.brake_rate);
    BOOST_REQUIRE(away == limit + push);

    const Interval still = acceleration_bounds(x, v, axis.x_min, axis.x_max, axis.v_max,
                                               axis.a_max, params, 0.0);
    const Interval pushed = acceleration_bounds(x, v, axis.x_min, axis.x_max,
                                                axis.v_max, axis.a_max, params, push);
    const double met = 0.5 * std::max(v, 0.0) / params.brake_rate;
    const double room = axis.x_max - x - params.delta_x - met;
    BOOST_REQUIRE(pushed.lb <= pushed.ub);
    if (room < 0.0) {
      ++holds;  // soon behind the margin a push may be held against, and not beaten
      BOOST_REQUIRE(pushed.ub >= std::min(still.ub - push - 1e-9,
                                          -params.brake_rate * std::max(v, 0.0)));
    } else if (pushed.ub < 0.0 && pushed.ub < still.ub - 1e-9) {
      ++brakes;
      BOOST_REQUIRE_MESSAGE(
          v > 0.0 && pushed.ub >= -params.brake_rate * v - 1e-9,
          "x " << x << " v " << v << " push " << push << " ub " << pushed.ub);
    }
  }
  BOOST_TEST(brakes > kSamples / 1000);
  BOOST_TEST(holds > kSamples / 100);
}

BOOST_AUTO_TEST_CASE(a_bound_is_continuous_in_the_push_and_in_its_sign) {
  std::mt19937_64 rng(7);
  for (int k = 0; k < kSamples / 10; ++k) {
    const double limit = uniform(rng, -15.0, 15.0), v = uniform(rng, -1.5, 1.5);
    const double held = uniform(rng, 0.0, 1.0), rate = uniform(rng, 0.0, 100.0);
    const double push = k % 2 == 0 ? 0.0 : uniform(rng, 0.0, 40.0);
    const double step = 1e-6;
    const double here = under_push(limit, push - step, v, held, rate);
    const double there = under_push(limit, push + step, v, held, rate);
    BOOST_REQUIRE(std::abs(there - here) <= 2.0 * step + 1e-12);
    const double faster = under_push(limit, push, v + step, held, rate);
    const double now = under_push(limit, push, v, held, rate);
    BOOST_REQUIRE(std::abs(faster - now) <= rate * step + 1e-12);
  }
}

BOOST_AUTO_TEST_CASE(a_push_is_held_against_at_a_limit_and_resisted_beyond_a_max) {
  BoundsParams params;
  params.delta_x = 0.002;
  const Axis axis;
  const auto at = [&](double behind, double v, double push) {
    return acceleration_bounds(axis.x_max - params.delta_x + behind, v, axis.x_min,
                               axis.x_max, axis.v_max, axis.a_max, params, push);
  };
  BOOST_TEST(at(-1e-9, 0.0, 10.0).ub > -1e-3);   // at rest before it: no push back
  BOOST_TEST(at(0.002, 0.0, 10.0).ub <= -10.0);  // a margin's width behind: held
  BOOST_TEST(at(0.001, 0.0, 10.0).ub <= -4.9);   // and half of it on the way
  BOOST_TEST(at(-0.5, 0.0, -30.0).ub == 45.0);   // what pushes off may be resisted
  BOOST_TEST(at(-0.5, 0.0, 30.0).lb == -45.0);
  BOOST_TEST(at(-0.5, 0.0, 30.0).ub == 15.0);
  params.passive = false;
  BOOST_TEST(at(-0.5, 0.0, 30.0).ub == -15.0);  // the push is taken off, at rest too
}

BOOST_AUTO_TEST_CASE(authority_bounds_the_braking_of_what_is_beyond) {
  const Axis axis;
  for (const double authority : {1.0, 4.0}) {
    BoundsParams params;
    params.authority = authority;
    std::mt19937_64 rng(8);
    double hardest = 0.0;
    for (int k = 0; k < kSamples / 10; ++k) {
      const double x = uniform(rng, -2.5, 3.4), v = uniform(rng, -4.0, 4.0);
      const Interval interval = bounds(x, v, axis, params);
      BOOST_REQUIRE(interval.ub >= -authority * axis.a_max);
      BOOST_REQUIRE(interval.lb <= authority * axis.a_max);
      if (is_viable(x, v, axis, params, 0.0)) {
        BOOST_REQUIRE(interval.ub >= -axis.a_max && interval.lb <= axis.a_max);
      }
      hardest = std::max(hardest, -interval.ub);
    }
    BOOST_TEST(hardest == authority * axis.a_max);
  }
}

BOOST_AUTO_TEST_CASE(a_pushed_double_integrator_stays_inside_its_limits) {
  // The push is known at once and is inside what is planned for braking.
  std::mt19937_64 rng(9);
  const Axis axis;
  int at_limit = 0;
  for (int episode = 0; episode < 100; ++episode) {
    BoundsParams params = random_params(rng);
    params.delta_x = uniform(rng, 0.005, 0.02);
    params.delta_v = 0.1;
    params.authority = 4.0;
    double x = 0.3, v = 0.0, wanted = 0.0, push = 0.0;
    for (int k = 0; k < 4000; ++k) {
      if (k % 40 == 0) wanted = uniform(rng, -60, 60);
      if (k % 300 == 0) push = uniform(rng, -5, 5);
      const Interval interval = acceleration_bounds(
          x, v, axis.x_min, axis.x_max, axis.v_max, axis.a_max, params, push);
      const double a = std::min(std::max(wanted, interval.lb), interval.ub) + push;
      x += v * params.dt + 0.5 * a * params.dt * params.dt;
      v += a * params.dt;
      BOOST_REQUIRE_MESSAGE(x <= axis.x_max && x >= axis.x_min,
                            "x " << x << " push " << push << " dt " << params.dt);
      BOOST_REQUIRE(std::abs(v) <= axis.v_max);
      at_limit += x > axis.x_max - params.delta_x - 1e-3;
    }
  }
  BOOST_TEST(at_limit > 100);
}

namespace {

/// The speed limit that falls towards a position limit at the distance d.
double tapered(double d, const BoundsParams& params) {
  const double o = params.taper_offset;
  return std::sqrt(o * o + 2.0 * params.taper_brake * std::max(d, 0.0)) - o;
}

}  // namespace

BOOST_AUTO_TEST_CASE(what_ramps_stays_inside_its_limits_and_its_falling_speed_limit) {
  // Its acceleration changes by jerk * dt in a cycle, and no faster.
  std::mt19937_64 rng(11);
  const Axis axis;
  int at_limit = 0, at_taper = 0, is_bound = 0;
  for (int episode = 0; episode < 400; ++episode) {
    BoundsParams params = random_params(rng);
    params.delta_x = uniform(rng, 0.002, 0.02);
    params.delta_v = uniform(rng, 0.01, 0.1);
    params.jerk = std::exp(uniform(rng, 5.0, 9.0));  // 150 to 8000 rad/s3
    params.taper_brake = uniform(rng, 2.0, 20.0);
    params.taper_offset = uniform(rng, 0.05, 0.4);
    double x = 0.3, v = 0.0, a = 0.0, wanted = 0.0;
    for (int k = 0; k < 4000; ++k) {
      if (k % 40 == 0) wanted = uniform(rng, -60, 60);
      const Interval interval = bounds(x, v, axis, params);
      BOOST_REQUIRE(interval.lb <= interval.ub);
      const double inside = std::min(std::max(wanted, interval.lb), interval.ub);
      is_bound += inside != wanted;
      const double most = params.jerk * params.dt;
      a = std::min(std::max(inside, a - most), a + most);
      x += v * params.dt + 0.5 * a * params.dt * params.dt;
      v += a * params.dt;
      const double up = std::min(axis.v_max, tapered(axis.x_max - x, params));
      const double down = std::min(axis.v_max, tapered(x - axis.x_min, params));
      BOOST_REQUIRE_MESSAGE(x <= axis.x_max && x >= axis.x_min && v <= up && -v <= down,
                            "x " << x << " v " << v << " a " << a << " limits " << up
                                 << " " << down << " dt " << params.dt << " kappa "
                                 << params.kappa << " jerk " << params.jerk << " brake "
                                 << params.taper_brake << " offset "
                                 << params.taper_offset << " eta " << params.eta);
      at_limit += x > axis.x_max - params.delta_x - 2e-3;
      at_taper += v > 0.1 && v > 0.9 * (1.0 - params.delta_v) * up && up < axis.v_max;
    }
  }
  BOOST_TEST(at_limit > 100);
  BOOST_TEST(at_taper > 100);
  BOOST_TEST(is_bound > 10000);
}

BOOST_AUTO_TEST_CASE(a_ramp_that_takes_no_time_is_none) {
  std::mt19937_64 rng(12);
  const Axis axis;
  for (int drawn = 0; drawn < kSamples / 10;) {
    BoundsParams params = random_params(rng);
    double x, v;
    if (!draw_viable(rng, axis, params, x, v)) continue;
    ++drawn;
    const Interval at_once = bounds(x, v, axis, params);
    params.jerk = 1e12;
    const Interval ramped = bounds(x, v, axis, params);
    // The search is as exact as this; a turn within T is judged without a root.
    const double off =
        std::max(std::abs(ramped.ub - at_once.ub), std::abs(ramped.lb - at_once.lb));
    BOOST_REQUIRE_MESSAGE(
        off < 0.05, "x " << x << " v " << v << " kappa " << params.kappa << " dt "
                         << params.dt << " eta " << params.eta << " bounds "
                         << at_once.lb << " " << at_once.ub << " and " << ramped.lb
                         << " " << ramped.ub << " dx " << params.delta_x);
  }
}

BOOST_AUTO_TEST_CASE(any_choice_from_a_viable_state_stays_viable) {
  std::mt19937_64 rng(1);
  const Axis axis;
  int drawn = 0;
  while (drawn < kSamples) {
    const BoundsParams params = random_params(rng);
    double x, v;
    if (!draw_viable(rng, axis, params, x, v)) continue;
    ++drawn;
    const Interval interval = bounds(x, v, axis, params);
    BOOST_REQUIRE(interval.lb <= interval.ub);
    BOOST_REQUIRE(interval.lb >= -axis.a_max);
    BOOST_REQUIRE(interval.ub <= axis.a_max);
    const double share = uniform(rng, 0.0, 1.0);
    for (const double part : {0.0, share, 1.0}) {
      const double a = interval.lb + part * (interval.ub - interval.lb);
      for (const double moment : {1.0, 0.5}) {  // and on the way there
        const double t = params.dt * moment;
        BOOST_REQUIRE_MESSAGE(is_viable(x + v * t + 0.5 * a * t * t, v + a * t, axis,
                                        params, softness(axis, params) + 1e-9),
                              "x " << x << " v " << v << " a " << a << " dt "
                                   << params.dt << " kappa " << params.kappa << " eta "
                                   << params.eta);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(bounds_are_the_largest_that_stay_viable) {
  std::mt19937_64 rng(2);
  const Axis axis;
  for (int drawn = 0; drawn < kSamples / 10;) {
    BoundsParams params = random_params(rng);
    double x, v;
    if (!draw_viable(rng, axis, params, x, v)) continue;
    ++drawn;
    const Interval interval = bounds(x, v, axis, params);
    if (interval.ub >= axis.a_max || interval.ub <= -axis.a_max) continue;
    const double T = params.kappa * params.dt;
    const double a = interval.ub + 1e-3;
    const bool is_turning = a < 0.0 && v > 0.0 && -v / a < T;
    const double x_peak = is_turning ? x - v * v / (2.0 * a) : x;
    bool is_lost = x_peak > axis.x_max - params.delta_x;
    const double v_end = v + a * T;
    const double x_end = x + v * T + 0.5 * a * T * T;
    is_lost = is_lost || !is_viable(x_end, v_end, axis, params, 0.0);
    BOOST_REQUIRE_MESSAGE(is_lost, "x " << x << " v " << v << " a " << a);
  }
}

BOOST_AUTO_TEST_CASE(noise_at_a_limit_kicks_no_joint) {
  std::mt19937_64 rng(6);
  const Axis axis;
  for (int k = 0; k < kSamples / 10; ++k) {
    const BoundsParams params = random_params(rng);
    const double T = params.kappa * params.dt;
    const double v = uniform(rng, 0.0, 0.01);
    const double limit = axis.x_max - params.delta_x;
    const double before = bounds(limit - 1e-9, v, axis, params).ub;
    const double behind = bounds(limit + 1e-9, v, axis, params).ub;
    BOOST_REQUIRE_SMALL(before - behind, 1e-8 / (T * T));
  }
}

BOOST_AUTO_TEST_CASE(bounds_mirror) {
  std::mt19937_64 rng(3);
  for (int k = 0; k < kSamples; ++k) {
    BoundsParams params = random_params(rng);
    if (k % 3 == 1) params.kind = BoundsKind::kPaperCorrected;
    if (k % 3 == 2) params.kind = BoundsKind::kPaperPrinted;
    const double x = uniform(rng, -4, 4), v = uniform(rng, -3, 3);
    const Interval one = acceleration_bounds(x, v, -2.0, 2.9, 1.5, 15.0, params);
    const Interval two = acceleration_bounds(-x, -v, -2.9, 2.0, 1.5, 15.0, params);
    BOOST_REQUIRE_EQUAL(one.lb, -two.ub);
    BOOST_REQUIRE_EQUAL(one.ub, -two.lb);
    BOOST_REQUIRE(one.ub_cause == two.lb_cause);
  }
}

BOOST_AUTO_TEST_CASE(any_state_gives_a_finite_interval_that_brakes) {
  std::mt19937_64 rng(4);
  const Axis axis;
  for (int k = 0; k < kSamples; ++k) {
    BoundsParams params = random_params(rng);
    if (k % 2 == 1) params.kind = BoundsKind::kPaperCorrected;
    const double x = uniform(rng, -50, 50), v = uniform(rng, -50, 50);
    const Interval interval = bounds(x, v, axis, params);
    BOOST_REQUIRE(interval.lb <= interval.ub);
    BOOST_REQUIRE(interval.lb >= -axis.a_max && interval.ub <= axis.a_max);
    if (v > axis.v_max + axis.a_max * 10 * params.kappa * params.dt) {
      BOOST_REQUIRE_EQUAL(interval.ub, -axis.a_max);
      BOOST_REQUIRE_EQUAL(interval.lb, -axis.a_max);
    }
  }
}

BOOST_AUTO_TEST_CASE(double_integrator_never_leaves_its_limits) {
  std::mt19937_64 rng(5);
  const Axis axis;
  for (int episode = 0; episode < 200; ++episode) {
    const BoundsParams params = random_params(rng);
    double x = 0.3, v = 0.0, wanted = 0.0;
    for (int k = 0; k < 5000; ++k) {
      if (k % 40 == 0) wanted = uniform(rng, -60, 60);
      const Interval interval = bounds(x, v, axis, params);
      const double a = std::min(std::max(wanted, interval.lb), interval.ub);
      x += v * params.dt + 0.5 * a * params.dt * params.dt;
      v += a * params.dt;
      BOOST_REQUIRE(is_viable(x, v, axis, params, softness(axis, params) + 1e-9));
    }
  }
}

BOOST_AUTO_TEST_CASE(paper_bounds_overshoot_by_the_stopping_distance) {
  BoundsParams params;
  params.kind = BoundsKind::kPaperCorrected;
  const Axis axis;
  double x = 0.0, v = 0.0, x_worst = 0.0;
  for (int k = 0; k < 5000; ++k) {
    const Interval interval = bounds(x, v, axis, params);
    x += v * params.dt + 0.5 * interval.ub * params.dt * params.dt;
    v += interval.ub * params.dt;
    x_worst = std::max(x_worst, x);
  }
  const double stopping_distance = axis.v_max * axis.v_max / (2.0 * axis.a_max);
  BOOST_TEST(x_worst - axis.x_max > 0.8 * stopping_distance);
}

BOOST_AUTO_TEST_CASE(paper_as_printed_mixes_position_into_the_speed_bound) {
  BoundsParams params;
  params.kind = BoundsKind::kPaperPrinted;
  // (V - x) / dt with x = 1.4 and V = 1.5, not (V - v) / dt.
  const Interval interval = acceleration_bounds(1.495, 0.0, -2, 2.9, 1.5, 15, params);
  BOOST_TEST(interval.ub == (1.5 - 1.495) / params.dt);
  BOOST_TEST(bool(interval.ub_cause == BoundCause::kVelocity));
  // At speed, close to the limit, the interval is empty.
  const Interval empty = acceleration_bounds(2.89, 1.4, -2, 2.9, 15, 15, params);
  BOOST_TEST(empty.ub == 15.0);
  const Interval late = acceleration_bounds(2.899, 1.4, -2, 2.9, 15, 15, params);
  BOOST_TEST(late.ub < late.lb);
}

BOOST_AUTO_TEST_CASE(cause_names_the_limit_that_acts) {
  BoundsParams params;
  const Axis axis;
  const Interval free = bounds(0, 0, axis, params);
  BOOST_TEST(bool(free.ub_cause == BoundCause::kAcceleration));
  BOOST_TEST(bool(free.lb_cause == BoundCause::kAcceleration));
  const Interval fast = bounds(0, 1.48, axis, params);
  BOOST_TEST(bool(fast.ub_cause == BoundCause::kVelocity));
  const Interval near = bounds(2.85, 0.9, axis, params);
  BOOST_TEST(bool(near.ub_cause == BoundCause::kPosition));
  BOOST_TEST(bool(near.lb_cause == BoundCause::kAcceleration));
}
