#include "attack_loop.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "dovetail/cycle_log.hpp"
#include "dovetail/velocity_observer.hpp"

namespace dovetail {
namespace {

constexpr double kBlownUp = 1e3;  // [rad, rad/s]: nothing after it means anything

/// Keeps the largest element; a NaN counts as infinitely large.
template <typename Vector>
void keep(Largest& worst, const Vector& values, int cycle) noexcept {
  for (int i = 0; i < values.size(); ++i) {
    const double value = std::isnan(values[i]) ? kBlownUp : values[i];
    if (value > worst.value) worst = {value, cycle, i};
  }
}

/// A controller, its arm, and what it made of the last message.
struct Side {
  Controller controller;
  RigidPlant plant;
  std::optional<VelocityObserver> observer;
  Vec7 tau = Vec7::Zero();
  Vec7 a = Vec7::Zero();
  double elapsed = 0.0;  // since the last message [s]
  Flags flags = {};

  void step(const Vec7& q, Vec7 dq, const Target& target) noexcept {
    elapsed += controller.period();
    if (observer) dq = observer->update(q, a, elapsed);
    const StepResult result = controller.step(q, dq, target, elapsed);
    if (observer && result.flags.implausible) observer->doubt();
    tau = result.tau;
    a = result.a;
    flags = result.flags;
    elapsed = 0.0;
  }

  void lose() noexcept { elapsed += controller.period(); }
};

/// Tells what bad samples did to the torque from what went on anyway. For each of them
/// a side goes on from before it, undeceived; a burst is one. What of a step the
/// undeceived side makes, too, up to three cycles earlier or one later, is not the
/// sample's: a new Target's step may come later by a cycle or two.
class Blame {
 public:
  /// Before the side takes what came in this cycle.
  void begin(const Side& side, bool is_bad) {
    if (is_bad && !was_bad_) undeceived_.push_back({side, 0, last_, {}});
    if (is_bad && !was_bad_) undeceived_.back().changes.fill(last_);
    if (is_bad) undeceived_.back().left = AttackResult::kAfterBad + 2;
    was_bad_ = is_bad;
  }

  /// Whether a bad sample was so near that its steps are looked for.
  bool is_awake() const noexcept { return !undeceived_.empty(); }

  /// After it. \param change  of its torque in this cycle [Nm]
  /// \param of_state  of it what no new Target made [Nm]
  /// \param is_lost  no message came: to nobody
  void judge(const Vec7& change, const Vec7& of_state, bool is_lost,
             const Target& target, int cycle, AttackResult& result) {
    if (!undeceived_.empty()) keep(result.step_after_bad, change.cwiseAbs(), cycle);
    for (Undeceived& one : undeceived_) {
      const Vec7 before = one.side.tau;
      if (is_lost) {
        one.side.lose();
      } else {
        one.side.step(one.side.plant.q(), one.side.plant.dq(), target);
      }
      one.side.plant.apply(one.side.tau, one.side.controller.period());
      --one.left;
      const Vec7 undeceived = one.side.tau - before;
      // Ended anyway: neither that step nor a Target's can be told from the sample's.
      if (!one.side.flags.ended) {
        Vec7 least = Vec7::Zero().cwiseMin(undeceived);
        Vec7 most = Vec7::Zero().cwiseMax(undeceived);
        for (const Vec7& other : one.changes) {
          least = least.cwiseMin(other);
          most = most.cwiseMax(other);
        }
        const Vec7 own = one.deceived - one.deceived.cwiseMax(least).cwiseMin(most);
        keep(result.step_by_bad, Vec7(own.cwiseAbs()), cycle - 1);
      }
      std::rotate(one.changes.begin(), one.changes.end() - 1, one.changes.end());
      one.changes[0] = undeceived;
      one.deceived = of_state;
    }
    std::erase_if(undeceived_, [](const Undeceived& one) { return one.left <= 0; });
    last_ = change;
  }

 private:
  struct Undeceived {
    Side side;
    int left;                     // cycles to go
    Vec7 deceived;                // its change of torque in the last cycle [Nm]
    std::array<Vec7, 4> changes;  // of the undeceived one in the last cycles [Nm]
  };

  std::vector<Undeceived> undeceived_;
  Vec7 last_ = Vec7::Zero();
  bool was_bad_ = false;
};

struct State {
  Vec7 q, dq;
};

/// Compares the true state with the limits.
class Judge {
 public:
  Judge(const Controller& controller, bool has_walls) noexcept
      : chain_(controller.chain()),
        limits_(controller.limits()),
        walls_(has_walls),
        brake_(2.0 * limits_.eta_wall * limits_.ddx_max) {}

  void look(const RigidPlant& plant, int cycle, AttackResult& result) noexcept {
    const Vec7& q = plant.q();
    chain_.tool_motion(q, plant.dq(), tool_);
    const Vec7 position = (q - limits_.q_max).cwiseMax(limits_.q_min - q);
    const Vec7 speed = plant.dq().cwiseAbs() - limits_.dq_max;
    keep(result.position, position, cycle);
    keep(result.speed, speed, cycle);
    worst_position_ = std::max(worst_position_, position.maxCoeff());
    worst_speed_ = std::max(worst_speed_, speed.maxCoeff());
    if (!walls_) return;
    const Vec3 wall = (tool_.p - limits_.x_max).cwiseMax(limits_.x_min - tool_.p);
    const Vec3 over = tool_.twist.head<3>().cwiseAbs() - limits_.dx_max;
    keep(result.wall, wall, cycle);
    const Vec3 out = tool_.twist.head<3>().cwiseMax(0.0);
    const Vec3 back = (-tool_.twist.head<3>()).cwiseMax(0.0);
    const Vec3 reach =
        (tool_.p - limits_.x_max + out.cwiseProduct(out).cwiseQuotient(brake_))
            .cwiseMax(limits_.x_min - tool_.p +
                      back.cwiseProduct(back).cwiseQuotient(brake_));
    keep(result.reach, reach, cycle);
    keep(result.tool_speed, over, cycle);
    worst_wall_ = std::max(worst_wall_, wall.maxCoeff());
  }

  void motor(const RigidPlant& plant, const Vec7& tau, int cycle,
             AttackResult& result) const noexcept {
    const Vec7 total = tau + chain_.gravity(plant.q());
    keep(result.torque, Vec7(total.cwiseAbs() - limits_.tau_max), cycle);
  }

  /// The row of the cycle that ends; the next one starts anew.
  void write(const State& state, const Side& side, double* to) noexcept {
    ToolMotion tool;
    chain_.tool_motion(state.q, state.dq, tool);
    AttackRow row;
    row.q = state.q;
    row.dq = state.dq;
    row.tau = side.tau;
    row.position = tool.p;
    row.velocity = tool.twist.head<3>();
    row.past_wall = worst_wall_;
    row.past_joint = worst_position_;
    row.past_speed = worst_speed_;
    row.flags = static_cast<double>(pack_flags(side.flags));
    write_row(row, to);
    worst_wall_ = worst_position_ = worst_speed_ = AttackResult::kNever;
  }

 private:
  const Chain& chain_;
  const LimitParams limits_;
  bool walls_;
  Vec3 brake_;  // twice the planned one [m/s2]
  ToolMotion tool_;
  double worst_wall_ = AttackResult::kNever;
  double worst_position_ = AttackResult::kNever;
  double worst_speed_ = AttackResult::kNever;
};

bool is_lost(const State& state) noexcept {
  return !(state.q.cwiseAbs().maxCoeff() < kBlownUp) ||
         !(state.dq.cwiseAbs().maxCoeff() < kBlownUp);
}

}  // namespace

AttackResult run_attack(Controller controller, RigidPlant plant, const Attack& attack,
                        int looks, double* trace) {
  AttackResult result;
  const double period = controller.period();
  Side side{controller, plant, {}};
  if (attack.observer_gain > 0.0) {
    side.observer.emplace(period, attack.observer_gain);
    side.observer->reset(plant.q());
  }
  Blame blame;
  Judge judge(controller, controller.limits().walls);
  std::vector<State> past;
  past.reserve(attack.age.size());
  auto wrong = attack.wrong.begin();
  Target last_target;
  const int cycles = static_cast<int>(attack.age.size());
  for (int k = 0; k < cycles; ++k) {
    past.push_back({side.plant.q(), side.plant.dq()});
    const State& now = past.back();
    if (is_lost(now)) break;
    const int age = std::min(attack.age[k], k);
    State seen = past[k - std::max(age, 0)];
    const bool is_lost_message = age < 0;
    bool is_bad = age > 0;
    for (; wrong != attack.wrong.end() && wrong->cycle <= k; ++wrong) {
      if (wrong->cycle < k) continue;
      double& number =
          wrong->element < 7 ? seen.q[wrong->element] : seen.dq[wrong->element - 7];
      number += wrong->error;
      is_bad = true;
    }
    if (is_bad || is_lost_message) ++result.bad_cycles;
    blame.begin(side, is_bad);
    const Target& target = attack.targets[std::min<std::size_t>(
        k / attack.cycles_per_target, attack.targets.size() - 1)];
    const Vec7 before = side.tau;
    // Of a step to a new Target only what the old one would have made is a sample's.
    const bool is_new = k > 0 && k % attack.cycles_per_target == 0;
    std::optional<Side> unasked;
    if (is_new && !is_lost_message && blame.is_awake()) unasked.emplace(side);
    if (is_lost_message) {
      side.lose();
    } else {
      side.step(seen.q, seen.dq, target);
    }
    const Vec7 change = side.tau - before;
    Vec7 of_state = change;
    if (unasked) {
      unasked->step(seen.q, seen.dq, last_target);
      const Vec7 other = unasked->tau - before;
      of_state =
          (other.cwiseAbs().array() < change.cwiseAbs().array()).select(other, change);
    }
    last_target = target;
    if (k > 0) keep(result.step, Vec7(change.cwiseAbs()), k);
    blame.judge(change, of_state, is_lost_message, target, k, result);
    judge.motor(side.plant, side.tau, k, result);
    const State start = now;
    for (int i = 0; i < looks; ++i) {
      side.plant.apply(side.tau, period / looks);
      judge.look(side.plant, k, result);
    }
    if (trace != nullptr)
      judge.write(start, side, trace + k * column_at(sizeof(AttackRow)));
  }
  return result;
}

}  // namespace dovetail
