/// Whether a measured state can be one: what no joint can do in the time is not
/// believed.
///
/// The state is predicted with the acceleration that the last cycle expected. A sample
/// near the prediction, by what a bounded torque is worth, is taken as it is. Of any
/// other all is believed or nothing: what is believed in part is wrong in part, and the
/// next true sample then looks like a wrong one. Where nothing is, the prediction
/// stands.
///
/// * Bit by bit one of the last samples, while the arm moves: an old one, late or
///   repeated. Not believed, at most `kAgreed` times in a row.
/// * A way that no change of speed explains, a speed without a way, more than motors
///   and blows can do: implausible. Not believed.
/// * Otherwise a surprise, a contact or a push: believed at once if it goes on from the
///   sample before, whether that was believed or not. If it does not, one is bridged
///   without being counted as implausible: after a wrong sample it may be the true one.
///
/// After each of them the state is in doubt for a while.
///
/// Where a surprise is believed, what was expected without it is kept for a while: a
/// later sample whose way fits that again, and better than the surprise, unmasks the
/// surprise as a wrong sample. Its way is believed; its speed only where that fits,
/// too, for a speed made of positions is wrong once more where a wrong one ends. After
/// the first implausible sample the prediction without the surprise stands, and the one
/// with it is kept in its place: either sample may have been the wrong one. The next
/// one that is believed decides: the other prediction is forgotten.
///
/// An implausible sample may come late, where messages were lost and nobody told: up to
/// five. It is believed as a surprise where every joint went as far as in that time, at
/// speeds between the last two, and one of them visibly further than in the time told.
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
  /// \param limits  speed limits, motor torques and kappa count
  /// \param period  control period [s]
  StateCheck(const LimitParams& limits, double period) noexcept;

  /// Starts at q [rad], moving at dq [rad/s]. The same sample taken next is this one.
  void reset(const Vec7& q, const Vec7& dq) noexcept;

  /// Takes a sample `elapsed` [s] after the last one.
  /// \param a        acceleration expected since then [rad/s2]
  /// \param of_jump  what of it is there for the last surprise alone [rad/s2]
  /// \param inertia  diagonal of the joint inertia, rotors included [kg m2]
  void take(const Vec7& q, const Vec7& dq, const Vec7& a, const Vec7& of_jump,
            const Vec7& inertia, double elapsed) noexcept;

  const Vec7& q() const noexcept { return q_; }    ///< believed [rad]
  const Vec7& dq() const noexcept { return dq_; }  ///< believed [rad/s]
  /// Implausible samples in a row; 0 where the last one was believed.
  int implausible() const noexcept { return implausible_; }
  /// The joint that made the last one so, 0 to 6.
  int joint() const noexcept { return joint_; }

  /// Whether one of the last `kDoubt` samples was refused, or a surprise.
  bool is_in_doubt() const noexcept { return in_doubt_ > 0; }
  /// Whether the last one was old or implausible, which no motion is.
  bool is_refused() const noexcept { return is_refused_; }
  /// Whether the last one was the first surprise of a while that was believed.
  bool is_jump() const noexcept { return is_jump_; }
  /// Whether the prediction that is kept was put in the believed one's place.
  bool is_return() const noexcept { return is_return_; }
  /// Whether the last one was believed as it is, but is worth much to the limits.
  bool is_remarked() const noexcept { return is_remarked_; }

  /// For how long before the last one samples were lost, as its way shows [s]; untold.
  double missed() const noexcept { return missed_; }

  /// Samples in a row that must agree with one another before they are believed. More
  /// than a burst of five wrong ones has; and no more, for until then the arm is blind.
  static constexpr int kAgreed = 5;
  /// Cycles for which a doubt is remembered, that of its sample included.
  static constexpr int kDoubt = 11;

 private:
  bool is_first(const Vec7& q, const Vec7& dq, double elapsed) const noexcept;
  bool is_old(const Vec7& q) const noexcept;
  double missed(const Vec7& q, const Vec7& dq, const Vec7& kick,
                double elapsed) const noexcept;
  bool is_near(const Vec7& q, const Vec7& dq, const Vec7& q_expected,
               const Vec7& dq_expected, const Vec7& kick, double blow,
               double time) noexcept;
  bool is_within(const Vec7& farther, const Vec7& faster,
                 const Vec7& inertia) const noexcept;
  bool is_remarkable(const Vec7& farther, const Vec7& faster) const noexcept;
  bool returns(const Vec7& q, const Vec7& dq, const Vec7& q_next,
               const Vec7& inertia) noexcept;
  void refuse(const Vec7& q_next, const Vec7& dq_next) noexcept;
  void remember(const Vec7& q, const Vec7& dq) noexcept;

  static constexpr int kRemembered = 6;  // a state that is late by five cycles

  Vec7 dq_max_, tau_max_;
  double period_;
  double remarkable_speed_, remarkable_way_;  // beside what was expected [rad/s], [rad]
  Vec7 q_ = Vec7::Zero();
  Vec7 dq_ = Vec7::Zero();
  std::array<Vec7, kRemembered> seen_;  // the last samples, believed or not
  int newest_ = 0;                      // of them
  Vec7 dq_seen_ = Vec7::Zero();
  Vec7 q_without_, dq_without_;  // where the arm is if the last surprise was none
  int without_ = 0;              // cycles for which that is kept, to go
  double since_ = 0.0;           // time since a sample was believed [s]
  double since_seen_ = 0.0;      // time since the newest of seen_ [s]
  double missed_ = 0.0;          // before the last sample, not told [s]
  int implausible_ = 0;
  int agreed_ = 0;
  int repeated_ = 0;           // samples in a row that were seen before
  int in_doubt_ = 0;           // cycles to go
  bool is_surprised_ = false;  // the last sample was plausible, and not believed
  bool is_jump_ = false;
  bool is_return_ = false;
  bool is_remarked_ = false;
  bool is_refused_ = false;
  bool is_fresh_ = true;  // nothing was taken since the reset
  int joint_ = 0;
};

}  // namespace dovetail
