/// What FRI messages say: fixed-size structs in the wire's units (rad, Nm, N, ms; mm in
/// transformations), std::optional where a field may be absent.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>

namespace dovetail::fri {

/// The wire format. No message names it: client and cabinet must agree.
enum class Version : std::uint8_t {
  k1_15,  ///< 1.14 to 1.16
  k2_5,
  k2_7,  ///< length and CRC around each message
};

enum class SessionState : std::uint8_t {
  kIdle,
  kMonitoringWait,
  kMonitoringReady,
  kCommandingWait,
  kCommandingActive,
};
enum class Quality : std::uint8_t { kPoor, kFair, kGood, kExcellent };
enum class SafetyState : std::uint8_t { kNormal, kStop0, kStop1, kStop2 };
enum class OperationMode : std::uint8_t { kT1, kT2, kAut };
enum class DriveState : std::uint8_t { kOff, kTransitioning, kActive };
enum class ControlMode : std::uint8_t {
  kPosition,
  kCartesianImpedance,
  kJointImpedance,
  kNoControl,
};
enum class CommandMode : std::uint8_t {
  kNone,
  kPosition,
  kWrench,
  kTorque,
  kCartesianPose,  ///< 2.x
};
enum class Overlay : std::uint8_t { kNone, kJoint, kCartesian };
enum class IoType : std::uint8_t { kBoolean, kDigital, kAnalog };
enum class IoDirection : std::uint8_t { kInput, kOutput };

inline constexpr std::size_t kMaxName = 63;
inline constexpr std::size_t kMaxIo = 10;
inline constexpr std::size_t kMaxTransformations = 5;

using Joints = std::array<double, 7>;
using Wrench = std::array<double, 6>;  ///< Fx Fy Fz, then moments about A B C

/// At most N elements. Holds its memory itself.
template <class T, std::size_t N>
class List {
 public:
  static constexpr std::size_t kCapacity = N;

  std::size_t size() const noexcept { return size_; }
  bool empty() const noexcept { return size_ == 0; }
  const T* begin() const noexcept { return items_.data(); }
  const T* end() const noexcept { return items_.data() + size_; }
  const T& operator[](std::size_t i) const noexcept { return items_[i]; }

  /// False where the list is full.
  bool push_back(const T& item) noexcept {
    if (size_ == N) return false;
    items_[size_++] = item;
    return true;
  }
  void clear() noexcept { *this = List{}; }

  bool operator==(const List& other) const noexcept {
    if (size_ != other.size_) return false;
    for (std::size_t i = 0; i < size_; ++i)
      if (!(items_[i] == other.items_[i])) return false;
    return true;
  }

 private:
  std::array<T, N> items_{};
  std::size_t size_ = 0;
};

/// Up to 63 bytes without a NUL.
class Name {
 public:
  Name() noexcept = default;

  /// False where the text is too long or holds a NUL: the name stays as it was.
  bool assign(std::string_view text) noexcept {
    if (text.size() > kMaxName) return false;
    if (text.find('\0') != std::string_view::npos) return false;
    bytes_ = {};
    std::memcpy(bytes_.data(), text.data(), text.size());
    size_ = static_cast<std::uint8_t>(text.size());
    return true;
  }
  std::string_view view() const noexcept { return {bytes_.data(), size_}; }
  bool operator==(const Name&) const noexcept = default;

 private:
  std::array<char, kMaxName> bytes_{};
  std::uint8_t size_ = 0;
};

struct TimeStamp {
  std::uint32_t sec = 0;
  std::uint32_t nanosec = 0;
  bool operator==(const TimeStamp&) const noexcept = default;
};

struct ConnectionInfo {
  SessionState state = SessionState::kIdle;
  Quality quality = Quality::kPoor;
  std::optional<std::uint32_t> send_period;         ///< [ms]
  std::optional<std::uint32_t> receive_multiplier;  ///< 0 and absent mean 1
  bool operator==(const ConnectionInfo&) const noexcept = default;
};

/// 1.x: a 3x4 matrix by rows (12 values). 2.x: tx ty tz qw qx qy qz (7). No values: a
/// request by name alone.
struct Transformation {
  Name name;
  List<double, 12> values;
  std::optional<TimeStamp> stamp;
  bool operator==(const Transformation&) const noexcept = default;
};

struct Redundancy {
  std::int32_t strategy = 4;  ///< 0 is E1, 4 is none
  double value = 0.0;
  bool operator==(const Redundancy&) const noexcept = default;
};

struct IoValue {
  Name name;  ///< "Group.Signal"
  IoType type = IoType::kBoolean;
  IoDirection direction = IoDirection::kInput;
  std::optional<std::uint64_t> digital;  ///< boolean and digital signals
  std::optional<double> analog;
  bool operator==(const IoValue&) const noexcept = default;
};

/// Of the message itself; the identifier is checked and written by the codec.
struct Header {
  std::uint32_t sequence = 0;   ///< grows by one per message sent
  std::uint32_t reflected = 0;  ///< the other side's last sequence
  bool operator==(const Header&) const noexcept = default;
};

/// Cabinet to client. Torques carry the wire's signs: measured and commanded torque are
/// minus the torque that acts on the link; external torque is as it acts.
struct MonitoringMessage {
  Header header;

  std::optional<std::int32_t> num_joints;
  std::optional<SafetyState> safety;
  List<DriveState, 7> drive_states;
  std::optional<OperationMode> operation_mode;
  std::optional<ControlMode> control_mode;

  std::optional<Joints> q_measured;    ///< [rad]
  std::optional<Joints> tau_measured;  ///< [Nm]
  std::optional<Joints> q_commanded;   ///< [rad], 1.x
  std::optional<Joints> tau_commanded;
  std::optional<Joints> tau_external;
  std::optional<Wrench> force_external;  ///< [N, Nm], 2.7
  List<IoValue, kMaxIo> io;
  std::optional<Transformation> pose_measured;  ///< 2.x
  std::optional<Redundancy> redundancy_measured;
  std::optional<TimeStamp> stamp;  ///< Unix time of the controller

  std::optional<ConnectionInfo> connection;

  std::optional<Joints> q_ipo;  ///< interpolator's set-point [rad], while commanding
  std::optional<Transformation> pose_ipo;  ///< 2.x
  std::optional<Redundancy> redundancy_ipo;
  std::optional<CommandMode> command_mode;
  std::optional<Overlay> overlay;
  std::optional<double> tracking;  ///< performance, 1 is perfect

  List<Transformation, kMaxTransformations> requested_transformations;

  /// Without connection data the state is IDLE, as in KUKA's client.
  SessionState state() const noexcept {
    return connection ? connection->state : SessionState::kIdle;
  }
  bool operator==(const MonitoringMessage&) const noexcept = default;
};

/// Client to cabinet.
struct CommandMessage {
  Header header;
  std::optional<Joints> q;       ///< [rad]
  std::optional<Wrench> wrench;  ///< feed-forward [N, Nm]
  std::optional<Joints> tau;     ///< overlay [Nm], gravity excluded
  List<Transformation, kMaxTransformations> transformations;
  List<IoValue, kMaxIo> io;
  std::optional<Transformation> pose;  ///< 2.x
  std::optional<Redundancy> redundancy;
  bool operator==(const CommandMessage&) const noexcept = default;
};

}  // namespace dovetail::fri
