/// Whether a measured state can be one: what no joint can do in the time is not
/// believed.
///
/// The state is predicted with the acceleration that the last cycle expected. A sample
/// beyond what speed limit and motors allow is implausible: the prediction stands for
/// it. A plausible one moves the believed state by a bounded amount in a cycle, so that
/// one wrong sample is worth a bounded torque. A sample that repeats the one before,
/// bit by bit, while the arm moves is an old one: the prediction stands for it, too,
/// but no more than `kAgreed` times in a row.
///
/// Samples that agree with one another but not with the prediction are the arm after
/// all: after `kAgreed` of them they are believed.
#pragma once

#include <array>

#include "dovetail/types.hpp"

namespace dovetail {

/// One thread. Nothing allocates or throws.
class StateCheck {
 public:
  /// \param limits  speed limits and motor torques count
  explicit StateCheck(const LimitParams& limits) noexcept;

  /// Starts at q [rad], moving at dq [rad/s]. The same sample taken next is this one.
  void reset(const Vec7& q, const Vec7& dq) noexcept;

  /// Takes a sample `elapsed` [s] after the last one.
  /// \param a        acceleration expected since then [rad/s2]
  /// \param inertia  diagonal of the joint inertia, rotors included [kg m2]
  void take(const Vec7& q, const Vec7& dq, const Vec7& a, const Vec7& inertia,
            double elapsed) noexcept;

  const Vec7& q() const noexcept { return q_; }    ///< believed [rad]
  const Vec7& dq() const noexcept { return dq_; }  ///< believed [rad/s]
  /// Implausible samples in a row; 0 where the last one was believed.
  int implausible() const noexcept { return implausible_; }
  /// The joint that made the last one so, 0 to 6.
  int joint() const noexcept { return joint_; }

  /// Whether one of the last `kDoubt` samples was refused, or believed in part.
  bool is_in_doubt() const noexcept { return in_doubt_ > 0; }

  /// Samples in a row that must agree with one another before they are believed.
  static constexpr int kAgreed = 8;
  /// Cycles for which a sample that was not taken whole is remembered.
  static constexpr int kDoubt = 10;

 private:
  bool is_first(const Vec7& q, const Vec7& dq, double elapsed) const noexcept;
  bool is_old(const Vec7& q) const noexcept;
  bool is_near(const Vec7& q, const Vec7& dq, const Vec7& q_expected,
               const Vec7& dq_expected, const Vec7& kick, double time) noexcept;
  bool is_within(const Vec7& farther, const Vec7& faster,
                 const Vec7& inertia) const noexcept;
  void refuse(const Vec7& q_next, const Vec7& dq_next) noexcept;
  void remember(const Vec7& q, const Vec7& dq) noexcept;

  static constexpr int kRemembered = 6;  // a state that is late by five cycles

  Vec7 dq_max_, tau_max_;
  Vec7 q_ = Vec7::Zero();
  Vec7 dq_ = Vec7::Zero();
  std::array<Vec7, kRemembered> seen_;  // the last samples, believed or not
  int newest_ = 0;                      // of them
  Vec7 dq_seen_ = Vec7::Zero();
  double since_ = 0.0;  // time since a sample was believed [s]
  int implausible_ = 0;
  int agreed_ = 0;
  int repeated_ = 0;      // samples in a row that were seen before
  int in_doubt_ = 0;      // cycles to go
  bool is_surprised_ = false;  // the last sample was plausible, and not expected
  bool is_fresh_ = true;  // nothing was taken since the reset
  int joint_ = 0;
};

}  // namespace dovetail
