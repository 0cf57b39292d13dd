/// Controller and exact rigid arm in one loop, under an adversary that chooses every
/// Target and spoils what the controller is told: for searches over millions of cycles.
#pragma once

#include <array>
#include <vector>

#include "dovetail/controller.hpp"
#include "dovetail/cycle_row.hpp"
#include "dovetail/rigid_plant.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// One wrong number in one message: added to what was measured.
struct WrongNumber {
  int cycle;
  int element;   ///< 0 to 6: q of A1 to A7 [rad], 7 to 13: dq [rad/s]
  double error;  ///< [rad] or [rad/s]; may be NaN or infinite
};

/// What an adversary does in one episode.
struct Attack {
  std::vector<Target> targets;  ///< each is held for `cycles_per_target`
  int cycles_per_target = 1;
  /// Per cycle: how many cycles old the state is that arrives. 0 is fresh, kLost: no
  /// message came, the torque stays and the next cycle knows the time that passed.
  std::vector<int> age;
  std::vector<WrongNumber> wrong;  ///< in the order of their cycles
  /// Above 0: dq comes from positions, as behind FRI, by an observer of this gain.
  double observer_gain = 0.0;

  static constexpr int kLost = -1;
};

/// A largest value and where it was seen.
struct Largest {
  double value;
  int cycle = -1;
  int element = -1;  ///< joint 0 to 6, or axis 0 to 2
};

/// Largest excess over the limits, their margins not taken off (negative: room left),
/// and largest torque steps.
struct AttackResult {
  static constexpr double kNever = -1e9;

  Largest position{kNever};  ///< of a joint limit [rad]
  Largest speed{kNever};     ///< of a joint's speed limit [rad/s]
  Largest wall{kNever};      ///< of a wall by the TCP [m]
  /// The same where the TCP would come to rest, braked from then on as planned [m]:
  /// what a search climbs before a wall is passed.
  Largest reach{kNever};
  Largest tool_speed{kNever};      ///< of the TCP's speed limit per axis [m/s]
  Largest torque{kNever};          ///< of a motor's torque, gravity included [Nm]
  Largest step{kNever};            ///< torque from cycle to cycle [Nm]
  Largest step_after_bad{kNever};  ///< the same within kAfterBad cycles of a bad sample
  /// The same, less what a controller does, in this cycle or in one beside it, that got
  /// true states since before the bad sample, where that is smaller [Nm]: a Target's
  /// step is none of a bad sample's, whether it is followed or not: where it changes,
  /// what the old one would have made counts. Nor is what comes once the last line has
  /// ended that other controller's motion. Each bad sample has its own such controller;
  /// the largest difference counts.
  Largest step_by_bad{kNever};
  int bad_cycles = 0;

  /// Longer than the guard that a bad sample leaves (StateCheck::kDoubt), so that what
  /// follows the guard is measured, too.
  static constexpr int kAfterBad = 20;
  static_assert(kAfterBad > StateCheck::kDoubt);
};

/// A cycle in a trace: the true state, and the largest excess during the cycle.
struct AttackRow {
  Numbers<7> q, dq, tau;
  Numbers<3> position, velocity;             ///< of the TCP
  double past_wall, past_joint, past_speed;  ///< beyond a limit
  double flags;                              ///< pack_flags
};

constexpr std::array kAttackGroups{
    ColumnGroup{offsetof(AttackRow, q), "q1 q2 q3 q4 q5 q6 q7", "rad"},
    ColumnGroup{offsetof(AttackRow, dq), "dq1 dq2 dq3 dq4 dq5 dq6 dq7", "rad/s"},
    ColumnGroup{offsetof(AttackRow, tau), "tau1 tau2 tau3 tau4 tau5 tau6 tau7", "Nm"},
    ColumnGroup{offsetof(AttackRow, position), "x y z", "m"},
    ColumnGroup{offsetof(AttackRow, velocity), "vx vy vz", "m/s"},
    ColumnGroup{offsetof(AttackRow, past_wall), "past_wall", "m"},
    ColumnGroup{offsetof(AttackRow, past_joint), "past_joint", "rad"},
    ColumnGroup{offsetof(AttackRow, past_speed), "past_speed", "rad/s"},
    ColumnGroup{offsetof(AttackRow, flags), "flags", "1"},
};
static_assert(is_gapless(kAttackGroups, 0, sizeof(AttackRow)));

/// Runs one episode from the plant's state; both are copies, nothing is left behind.
/// \param looks  how often a period the true state is judged
/// \param trace  room for age.size() AttackRows, or null
AttackResult run_attack(Controller controller, RigidPlant plant, const Attack& attack,
                        int looks, double* trace);

}  // namespace dovetail
