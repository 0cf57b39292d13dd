/// Controller and MuJoCo in one loop, without Python: the fast road of MujocoPlant.
///
/// Works on the mjModel and mjData that the Python package `mujoco` made, through that
/// package's own library, opened by its path. Compiled against one version's structs;
/// any other version is refused at construction.
#pragma once

#include <mujoco/mjdata.h>
#include <mujoco/mjmodel.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "dovetail/chain.hpp"
#include "dovetail/channel.hpp"
#include "dovetail/controller.hpp"
#include "dovetail/cycle_log.hpp"
#include "dovetail/part_joint.hpp"
#include "dovetail/step_probe.hpp"
#include "dovetail/types.hpp"

namespace dovetail {

/// What goes wrong with a control cycle, for tests: an age n of 1 to `kOldest` hands
/// the controller the state of n cycles ago; kLost does not call it, so that the last
/// torque holds, and tells the next call how long; kLostUntold does not tell.
constexpr int kOldest = 7;
constexpr std::int8_t kLost = -1, kLostUntold = -2;

class MujocoLoop {
 public:
  /// \param library  path of libmujoco, as the Python package loaded it
  /// \param model, data  addresses of its mjModel and mjData, which must outlive this
  /// Switches off the clock that MuJoCo reads some thirty times a step for its own
  /// statistics (mjcb_time), in the whole process.
  /// \param nominal  chain whose gravity torque is added to every command
  /// Throws std::runtime_error: library missing or of another version;
  /// std::invalid_argument: the model is not a seven-joint arm, perhaps with parts
  /// whose hinges and slides follow.
  MujocoLoop(const std::string& library, std::uintptr_t model, std::uintptr_t data,
             const Chain& nominal, const Channel& channel, bool compensate_gravity);

  /// Starts a trial from mjData's state: empties the delay, measures anew.
  void reset() noexcept;

  /// Holds the overlay torque tau [Nm] for `steps` physics steps. It passes the
  /// channel; `drive` [Nm] is of the arm's own drives and acts at once.
  /// Throws std::runtime_error when the simulation has diverged.
  void apply(const Vec7& tau, int steps, const Vec7& drive = Vec7::Zero());

  /// Forgets torques that are still on their way through the channel.
  void drop_commands() noexcept { channel_.reset(); }

  /// Runs `cycles` times: controller step, log row, `steps` physics steps. Does not
  /// allocate. `log` holds cycles x kCycleColumns numbers.
  /// Throws std::runtime_error when the simulation has diverged.
  void run(Controller& controller, const Target& target, int cycles, int steps,
           double* log);

  /// The same with one fault per cycle, 0 for none. A lost cycle leaves the row of its
  /// torque too, flags 0.
  void run_faulty(Controller& controller, const Target& target, int cycles, int steps,
                  const std::int8_t* faults, double* log);

  /// Lets a probe act and look in every physics step; null for none. It must outlive
  /// this. \param body  MuJoCo's body whose centre of mass is the TCP
  void attach_probe(StepProbe* probe, int body) noexcept {
    probe_ = probe;
    probe_body_ = body;
  }

  /// Gives the joints of parts, those after the arm's seven, spring and detents.
  /// Throws std::invalid_argument: not as many as the model has.
  void set_part_joints(std::vector<PartJoint> joints);

  void set_channel(const Channel& channel) noexcept { channel_ = channel; }
  void seed(std::uint64_t seed) noexcept { channel_.seed(seed); }

  /// Measured configuration [rad] and velocity [rad/s].
  const Vec7& q() const noexcept { return q_; }
  const Vec7& dq() const noexcept { return dq_; }

  /// Force on the tool in the last physics step [N], world axes.
  const Vec3& contact_force() const noexcept { return force_; }

  /// The largest such force of the last command [N].
  const Vec3& contact_force_peak() const noexcept { return peak_; }

 private:
  void measure() noexcept;
  void remember() noexcept;
  CycleRow begin_row(const Controller& controller, const Vec7& tau,
                     const Target& target) const noexcept;
  void run_row(CycleRow& row, int steps, const Flags& flags, double* log);
  void sum_contact_force() noexcept;
  void drive_parts(double h) noexcept;
  void require_finite() const;

  using Step = void (*)(const mjModel*, mjData*);
  using ContactForce = void (*)(const mjModel*, const mjData*, int, mjtNum*);

  Step step_ = nullptr;
  ContactForce contact_force_ = nullptr;
  mjModel* model_;  // only the armature of the parts' joints is written
  mjData* data_;
  Chain nominal_;
  Channel channel_;
  bool compensate_gravity_;
  std::vector<char> is_carried_;  // by body: it is the last link, or on it
  std::vector<PartJoint> parts_;
  StepProbe* probe_ = nullptr;
  int probe_body_ = 0;
  Vec7 q_ = Vec7::Zero();
  Vec7 dq_ = Vec7::Zero();
  Vec3 force_ = Vec3::Zero();  // of the last physics step
  Vec3 peak_ = Vec3::Zero();   // largest of the last command

  // what faulty cycles need: measured states, newest at past_head_, and what is held
  std::array<Vec7, kOldest + 1> past_q_, past_dq_;
  std::size_t past_head_ = 0;
  Vec7 tau_held_ = Vec7::Zero();
  double elapsed_ = 0.0;  // told to the next call beside its own period [s]
};

}  // namespace dovetail
