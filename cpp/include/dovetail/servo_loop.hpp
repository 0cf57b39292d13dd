/// The servo loop: a thread of its own, paced by the cabinet's datagrams.
///
/// Datagram -> decode -> ServoCycle -> encode -> datagram. The cycle does not allocate,
/// throw or lock. Any number of threads may call the public functions: they exchange
/// values with the loop wait-free on its side.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "dovetail/fri_packet.hpp"
#include "dovetail/histogram.hpp"
#include "dovetail/servo_cycle.hpp"
#include "dovetail/triple_buffer.hpp"
#include "dovetail/udp_socket.hpp"

namespace dovetail {

struct LoopParams {
  std::string address = "0.0.0.0";  ///< interface that the socket listens on
  std::uint16_t port = 30200;       ///< 0 takes a free one
  std::string peer;                 ///< only this IPv4 address is served; "" any first
  int priority = 0;                 ///< SCHED_FIFO 1 to 99; 0 is the normal scheduler
  int processor = -1;               ///< the thread stays on it; -1 is any
  bool lock_memory = false;
  double silence = 1.0;    ///< without a datagram the session is over [s]
  std::string log_folder;  ///< where logs of ended motions go; empty writes none
};

/// What happened since the loop was started.
enum class Count : std::uint8_t {
  kReceived,     ///< datagrams of any source
  kAnswered,     ///< commands sent
  kSendErrors,   ///< commands that the network did not take
  kForeign,      ///< of another source than the session's, or not of `peer`: ignored
  kUndecodable,  ///< ignored
  kDuplicates,   ///< ignored
  kOlder,        ///< overtaken: ignored
  kMissed,       ///< gaps in the sequence
  kMotions,      ///< times that COMMANDING_ACTIVE was entered
  kStops,        ///< controlled stops
  kHolds,        ///< no fresh Target
  kSilences,     ///< sessions that ended without a word
  kSuperseded,   ///< active cycles that passed before they could be answered
  kNumber,
};

const char* name(Count count) noexcept;

enum class WaitResult : std::uint8_t { kReached, kMotionEnded, kTime };

class ServoLoop {
 public:
  /// Opens the socket and starts the thread.
  /// Throws std::invalid_argument (a number out of range) or std::system_error (port in
  /// use, no permission, no such address).
  ServoLoop(const LoopParams& loop, const ServoParams& servo, const ChainParams& chain,
            const OscParams& osc, const LimitParams& limits, const TaskSpec& task);
  ~ServoLoop();
  ServoLoop(const ServoLoop&) = delete;
  ServoLoop& operator=(const ServoLoop&) = delete;

  /// A Target for one motion; no other follows it. Lockstep: its cycles below this tick
  /// are answered.
  void command(const Target& target, std::uint64_t motion, std::uint64_t tick) noexcept;

  /// Latches the pose that hold axes keep: TCP position [m] and rotation (wxyz).
  void hold_at(const Vec3& p_hold, const Vec4& quat_hold) noexcept;

  /// Leans the sent position by this [rad] from the next Target on, to feel whether the
  /// cabinet has a spring; zero ends it.
  void lean(const Vec7& q) noexcept;

  /// Waits until the active cycle of this tick was received, at most `seconds`; the end
  /// of this motion ends the wait.
  WaitResult wait(std::uint64_t tick, std::uint64_t motion, double seconds) noexcept;

  /// Waits, at most `seconds`, until a later motion than this one is commanded.
  bool wait_for_motion(std::uint64_t motion, double seconds) noexcept;

  void stop() noexcept;   ///< controlled stop
  void clear() noexcept;  ///< ends a controlled stop
  /// The next end of a motion is wanted: no log is saved for it.
  void expect_end() noexcept;
  void close() noexcept;  ///< ends the thread; harmless when repeated

  ServoState state() noexcept;
  std::uint64_t count(Count count) const noexcept;
  std::uint64_t undecodable(fri::DecodeStatus status) const noexcept;
  const RingLog& log() const noexcept { return cycle_.log(); }
  const Histogram& cycle_time() const noexcept { return cycle_time_; }
  const Histogram& reply_time() const noexcept { return reply_time_; }
  const Histogram& arrival_jitter() const noexcept { return arrival_jitter_; }
  std::uint16_t port() const noexcept { return socket_.port(); }
  Peer peer() const noexcept;
  Peer last_stranger() const noexcept;  ///< of the last foreign datagram; else all 0

  /// Since the cabinet's last datagram, and since its last one that could be read [s];
  /// infinity where none came.
  double since_datagram() const noexcept;
  double since_message() const noexcept;

  /// The last datagram that could not be read: why, and from where; "" where none.
  std::string last_undecodable();

  /// The field that made it so by a value that is no finite number, with its joint;
  /// "" where something else did.
  std::string last_not_finite();

  /// Why no command acts on the robot, likely causes first; "" where all is well.
  std::string diagnose();

  /// What could not be had (real-time priority, memory, a log file), and logs saved.
  std::vector<std::string> notes() const;

 private:
  /// Only the newest is carried out: a stop after a `clear` stops.
  enum class Request : std::uint8_t { kNone, kStop, kClear };

  struct Failure {
    fri::DecodeResult result;
    Peer source;
  };
  struct SaveJob {
    std::string_view cause;
    StopFacts facts;
    ServoState state;
  };

  void run() noexcept;
  void set_up_thread() noexcept;
  void take_requests() noexcept;
  void handle(const Datagram& datagram) noexcept;
  bool is_stale() noexcept;
  bool is_served(const Datagram& datagram) noexcept;
  void count_arrival(const Datagram& datagram) noexcept;
  void send(std::size_t size, bool is_active) noexcept;
  void answer_if_granted() noexcept;
  void watch_silence(double now) noexcept;
  void publish() noexcept;
  void notice_events(double now) noexcept;
  void plan_log(std::string_view cause, double now) noexcept;
  void write_logs() noexcept;
  void save(const SaveJob& job);
  void add_note(const std::string& text) noexcept;
  std::string lost_text() const;
  void add(Count count, std::uint64_t number = 1) noexcept;

  LoopParams loop_;
  ServoCycle cycle_;
  UdpSocket socket_;
  Bell wake_loop_, wake_waiter_, wake_writer_;

  // learner -> loop
  std::mutex order_mutex_;  // among learners only
  Order order_;
  TripleBuffer<Order> orders_;
  std::atomic<Request> request_{Request::kNone};
  std::atomic<bool> end_expected_{false}, closing_{false}, writer_closing_{false};
  std::atomic<bool> diagnosis_requested_{false};

  // loop -> learner
  std::mutex state_mutex_;  // among learners only
  TripleBuffer<ServoState> states_;
  std::atomic<std::uint64_t> awaited_{0};
  std::array<std::atomic<std::uint64_t>, static_cast<std::size_t>(Count::kNumber)>
      counts_{};
  std::array<std::atomic<std::uint64_t>, 32> undecodable_{};
  TripleBuffer<Failure> failures_;
  TripleBuffer<std::optional<fri::FriSession>> sessions_;
  std::atomic<std::uint64_t> diagnoses_{0};
  std::atomic<std::uint64_t> packed_peer_{0}, packed_stranger_{0};
  std::atomic<double> datagram_at_{0.0}, message_at_{0.0};  // 0 for never [s]
  Histogram cycle_time_, reply_time_, arrival_jitter_;

  // loop's own
  std::array<std::uint8_t, 2048> bytes_{};
  std::array<std::uint8_t, fri::kMaxDatagram> reply_{};
  std::uint32_t allowed_;  // IPv4 address of the peer; 0 for any
  Peer peer_;
  bool has_peer_ = false;
  bool owes_reply_ = false;  // outside a motion: to the newest message
  int backlog_ = 0;          // messages passed over since the last answer
  bool is_locked_ = false;   // only the peer is served
  bool has_arrival_ = false;
  double last_arrival_ = 0.0;  // of a new message [s]
  double last_heard_ = 0.0;    // of a message of the peer, or an answer to it [s]
  double waited_ = 0.0;        // of the datagram in work, before it was taken [s]
  double taken_ = 0.0;         // when it was taken [s]
  ServoState last_state_;      // of the last look at events
  double save_at_ = 0.0;       // when the log is due, 0 for never [s]
  SaveJob job_;

  // loop -> writer
  TripleBuffer<SaveJob> jobs_;
  mutable std::mutex notes_mutex_;  // never taken by the loop once it runs
  std::vector<std::string> notes_;

  std::thread writer_, thread_;
};

}  // namespace dovetail
