#include "dovetail/mujoco_loop.hpp"

#include <dlfcn.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace dovetail {

namespace {

constexpr double kDiverged = 50.0;  // [rad/s]; the joints' limit is 2.4

template <typename Function>
Function find_function(void* library, const std::string& path, const char* name) {
  void* symbol = dlsym(library, name);
  if (symbol == nullptr) {
    throw std::runtime_error("MuJoCo library " + path + " has no function " + name);
  }
  return reinterpret_cast<Function>(symbol);
}

void* open_library(const std::string& path) {
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    throw std::runtime_error("MuJoCo library " + path +
                             " cannot be opened: " + dlerror());
  }
  const auto version = find_function<int (*)()>(library, path, "mj_version")();
  if (version != mjVERSION_HEADER) {
    throw std::runtime_error(
        "MuJoCo library " + path + " is version " + std::to_string(version) +
        ", the control loop was compiled against " + std::to_string(mjVERSION_HEADER) +
        "; install the version that dovetail pins, or build dovetail again");
  }
  return library;
}

}  // namespace

MujocoLoop::MujocoLoop(const std::string& library, std::uintptr_t model,
                       std::uintptr_t data, const Chain& nominal,
                       const Channel& channel, bool compensate_gravity)
    : model_(reinterpret_cast<mjModel*>(model)),
      data_(reinterpret_cast<mjData*>(data)),
      nominal_(nominal),
      channel_(channel),
      compensate_gravity_(compensate_gravity) {
  void* handle = open_library(library);
  step_ = find_function<Step>(handle, library, "mj_step");
  contact_force_ = find_function<ContactForce>(handle, library, "mj_contactForce");
  if (model_->nq < kNumJoints || model_->nv != model_->nq ||
      model_->njnt != model_->nq) {
    throw std::invalid_argument("MuJoCo model has " + std::to_string(model_->nq) +
                                " positions and " + std::to_string(model_->nv) +
                                " velocities, the loop drives 7 hinges, before those "
                                "of parts, which are hinges or slides");
  }
  is_carried_.assign(static_cast<std::size_t>(model_->nbody), 0);
  is_carried_[static_cast<std::size_t>(model_->jnt_bodyid[kNumJoints - 1])] = 1;
  for (int i = 1; i < model_->nbody; ++i) {  // a parent's number is below its child's
    const auto parent = static_cast<std::size_t>(model_->body_parentid[i]);
    if (is_carried_[parent] != 0) is_carried_[static_cast<std::size_t>(i)] = 1;
  }
  parts_.resize(static_cast<std::size_t>(model_->nq - kNumJoints));
  // MuJoCo times its stages for mjData.timer, which nobody reads here: an eighth of it.
  auto* clock = find_function<mjfTime*>(handle, library, "mjcb_time");
  if (*clock != nullptr) *clock = nullptr;  // a simulation on another thread reads it
  reset();
}

void MujocoLoop::set_part_joints(std::vector<PartJoint> joints) {
  if (joints.size() != parts_.size()) {
    throw std::invalid_argument("MuJoCo model has " + std::to_string(parts_.size()) +
                                " joints of parts, not " +
                                std::to_string(joints.size()));
  }
  parts_ = std::move(joints);
}

/// Linearly implicit Euler. What is implicit is inertia, not MuJoCo's damping: MuJoCo
/// finds contact forces without its damping, and then a light piece chatters.
void MujocoLoop::drive_parts(double h) noexcept {
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const std::size_t at = kNumJoints + i;
    const double q = data_->qpos[at];
    const double damping = parts_[i].implicit_damping(q, h);
    data_->qfrc_applied[at] = parts_[i].force(q) - damping * data_->qvel[at];
    model_->dof_armature[at] = parts_[i].armature + h * damping;
  }
}

void MujocoLoop::reset() noexcept {
  channel_.reset();
  force_.setZero();
  peak_.setZero();
  tau_held_.setZero();
  elapsed_ = 0.0;
  measure();
  past_q_.fill(q_);
  past_dq_.fill(dq_);
}

void MujocoLoop::measure() noexcept {
  q_ = Eigen::Map<const Vec7>(data_->qpos);
  dq_ = Eigen::Map<const Vec7>(data_->qvel);
  channel_.measure(q_, dq_);
}

void MujocoLoop::sum_contact_force() noexcept {
  force_.setZero();
  const auto is_carried = [this](int geom) {
    return is_carried_[static_cast<std::size_t>(model_->geom_bodyid[geom])] != 0;
  };
  for (int i = 0; i < data_->ncon; ++i) {
    const mjContact& contact = data_->contact[i];
    const bool is_second = is_carried(contact.geom[1]);
    const bool is_first = is_carried(contact.geom[0]);
    if (is_first == is_second) continue;
    mjtNum wrench[6];
    contact_force_(model_, data_, i, wrench);
    // Rows of the frame are the contact's axes; the force acts on the second geom.
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> axes(
        contact.frame);
    const Eigen::Map<const Vec3> local(wrench);
    const Vec3 world = axes.transpose() * local;
    force_ += is_second ? world : Vec3(-world);
  }
}

void MujocoLoop::require_finite() const {
  for (int i = 0; i < kNumJoints; ++i) {
    if (std::abs(data_->qvel[i]) < kDiverged) continue;  // false for nan, too
    throw std::runtime_error("MuJoCo simulation diverged: joint A" +
                             std::to_string(i + 1) + " moves at " +
                             std::to_string(data_->qvel[i]) +
                             " rad/s at t = " + std::to_string(data_->time) +
                             " s; reduce physics_dt or the torques, then reset");
  }
  for (int i = kNumJoints; i < model_->nv; ++i) {
    if (std::isfinite(data_->qvel[i])) continue;
    throw std::runtime_error(
        "MuJoCo simulation diverged: joint " + std::to_string(i - kNumJoints + 1) +
        " of the parts moves at " + std::to_string(data_->qvel[i]) +
        " at t = " + std::to_string(data_->time) + " s; reduce physics_dt, then reset");
  }
}

void MujocoLoop::apply(const Vec7& tau, int steps, const Vec7& drive) {
  const Vec7 sent = channel_.send(tau);
  const double h = model_->opt.timestep;
  Eigen::Map<Vec7> applied(data_->qfrc_applied);
  peak_.setZero();
  double largest = 0.0;
  for (int i = 0; i < steps; ++i) {
    applied = channel_.receive(sent, h) + drive;
    if (compensate_gravity_) {
      applied += nominal_.gravity(Eigen::Map<const Vec7>(data_->qpos));
    }
    if (probe_ != nullptr) {
      Eigen::Map<Vec3>(data_->xfrc_applied + std::ptrdiff_t{6} * probe_body_) =
          probe_->force(Eigen::Map<const Vec7>(data_->qpos),
                        Eigen::Map<const Vec7>(data_->qvel));
    }
    drive_parts(h);
    step_(model_, data_);
    sum_contact_force();
    if (probe_ != nullptr) {
      probe_->look(Eigen::Map<const Vec7>(data_->qpos),
                   Eigen::Map<const Vec7>(data_->qvel), force_, h);
    }
    const double size = force_.squaredNorm();
    if (size > largest) {
      largest = size;
      peak_ = force_;
    }
    require_finite();
  }
  measure();
}

/// The tool is that of what is measured. A controller that believed it has it already.
CycleRow MujocoLoop::begin_row(const Controller& controller, const Vec7& tau,
                               const Target& target) const noexcept {
  ToolMotion motion = controller.tool();
  if (controller.state().q() != q_ || controller.state().dq() != dq_) {
    controller.chain().tool_motion(q_, dq_, motion);
  }
  CycleRow row;
  row.time = data_->time;
  row.q = q_;
  row.dq = dq_;
  row.tau = tau;
  row.position = motion.p;
  row.quat_wxyz = quat_wxyz(motion.R);
  row.velocity = motion.twist.head<3>();
  row.angular_velocity = motion.twist.tail<3>();
  row.f_star = target.f_star.head<3>();
  const Vec6 wrench = controller.wrench();
  row.wrench_force = wrench.head<3>();
  row.wrench_moment = wrench.tail<3>();
  return row;
}

/// Lets the row's torque act, and writes the row.
void MujocoLoop::run_row(CycleRow& row, int steps, const Flags& flags, double* log) {
  apply(row.tau, steps);
  row.contact_force = peak_;
  row.flags = static_cast<double>(pack_flags(flags));
  write_row(row, log);
}

void MujocoLoop::run(Controller& controller, const Target& target, int cycles,
                     int steps, double* log) {
  Target held = target;
  for (int i = 0; i < cycles; ++i, log += kCycleColumns) {
    const StepResult result = controller.step(q_, dq_, held);
    held.age += controller.period();
    CycleRow row = begin_row(controller, result.tau, target);
    run_row(row, steps, result.flags, log);
  }
}

void MujocoLoop::remember() noexcept {
  past_head_ = (past_head_ + 1) % past_q_.size();
  past_q_[past_head_] = q_;
  past_dq_[past_head_] = dq_;
}

void MujocoLoop::run_faulty(Controller& controller, const Target& target, int cycles,
                            int steps, const std::int8_t* faults, double* log) {
  for (int i = 0; i < cycles; ++i, log += kCycleColumns) {
    const int fault = faults[i];
    remember();
    Flags flags;
    if (fault < 0) {
      if (fault == kLost) elapsed_ += controller.period();
    } else {
      const std::size_t age = std::min(fault, kOldest);
      const std::size_t at = (past_head_ + past_q_.size() - age) % past_q_.size();
      const StepResult result = controller.step(past_q_[at], past_dq_[at], target,
                                                controller.period() + elapsed_);
      elapsed_ = 0.0;
      tau_held_ = result.tau;
      flags = result.flags;
      if (probe_ != nullptr) {
        probe_->command(result.tau + nominal_.gravity(past_q_[at]), flags);
      }
    }
    CycleRow row = begin_row(controller, tau_held_, target);
    run_row(row, steps, flags, log);
  }
}

}  // namespace dovetail
