#include "dovetail/servo_loop.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

#include "dovetail/monotonic.hpp"

namespace dovetail {
namespace {

constexpr int kIdleWait = 100;       // [ms]; how late silence and closing are noticed
constexpr double kAfterEvent = 1.0;  // a log holds this much of what followed [s]
constexpr int kMaxBacklog = 1000;    // messages passed over for the newest, in a row
constexpr auto kNobody = std::numeric_limits<std::uint64_t>::max();

std::uint64_t pack(const Peer& peer) noexcept {
  return (static_cast<std::uint64_t>(peer.address) << 16) | peer.port;
}

Peer unpack(std::uint64_t packed) noexcept {
  return {static_cast<std::uint32_t>(packed >> 16), static_cast<std::uint16_t>(packed)};
}

bool is_active(const ServoState& state) noexcept {
  return state.session == fri::SessionState::kCommandingActive &&
         state.refusal == Refusal::kNone;
}

const LoopParams& checked(const LoopParams& loop) {
  if (loop.silence > 0.0) return loop;  // a NaN compares false
  throw std::invalid_argument("servo silence is " + std::to_string(loop.silence) +
                              " s; allowed: above 0 (infinity switches it off)");
}

}  // namespace

ServoLoop::ServoLoop(const LoopParams& loop, const ServoParams& servo,
                     const ChainParams& chain, const OscParams& osc,
                     const LimitParams& limits, const TaskSpec& task)
    : loop_(checked(loop)),
      cycle_(servo, chain, osc, limits, task),
      socket_(loop.address, loop.port),
      allowed_(address_number(loop.peer)) {
  awaited_ = kNobody;
  writer_ = std::thread(&ServoLoop::write_logs, this);
  thread_ = std::thread(&ServoLoop::run, this);
}

ServoLoop::~ServoLoop() { close(); }

void ServoLoop::close() noexcept {
  closing_ = true;
  wake_loop_.ring();
  if (thread_.joinable()) thread_.join();
  writer_closing_ = true;
  wake_writer_.ring();
  if (writer_.joinable()) writer_.join();
  socket_.release();
}

// -- the learner's side -----------------------------------------------------------

void ServoLoop::command(const Target& target, std::uint64_t motion,
                        std::uint64_t tick) noexcept {
  const std::lock_guard lock(order_mutex_);
  order_.target = target;
  order_.motion = motion;
  order_.tick = tick;
  ++order_.serial;
  orders_.write(order_);
  if (cycle_.params().lockstep) wake_loop_.ring();
}

void ServoLoop::hold_at(const Vec3& p_hold, const Vec4& quat_hold) noexcept {
  const std::lock_guard lock(order_mutex_);
  order_.p_hold = p_hold;
  order_.quat_hold = quat_hold;
  ++order_.latch;
  orders_.write(order_);
}

void ServoLoop::lean(const Vec7& q) noexcept {
  const std::lock_guard lock(order_mutex_);
  order_.lean = q;
  orders_.write(order_);
}

void ServoLoop::stop() noexcept {
  request_ = Request::kStop;
  wake_loop_.ring();
}

void ServoLoop::clear() noexcept {
  request_ = Request::kClear;
  wake_loop_.ring();
}

void ServoLoop::expect_end() noexcept { end_expected_ = true; }

ServoState ServoLoop::state() noexcept {
  const std::lock_guard lock(state_mutex_);
  states_.update();
  return states_.value();
}

WaitResult ServoLoop::wait(std::uint64_t tick, std::uint64_t motion,
                           double seconds) noexcept {
  const double end = monotonic() + seconds;
  while (true) {
    awaited_ = tick;
    wake_waiter_.silence();
    const ServoState now = state();
    if (now.motion != motion || !is_active(now)) return WaitResult::kMotionEnded;
    if (now.tick >= tick) return WaitResult::kReached;
    const double left = end - monotonic();
    if (left <= 0.0) return WaitResult::kTime;
    wake_waiter_.wait(static_cast<int>(std::ceil(1e3 * std::fmin(left, 1.0))));
  }
}

bool ServoLoop::wait_for_motion(std::uint64_t motion, double seconds) noexcept {
  const double end = monotonic() + seconds;
  while (true) {
    wake_waiter_.silence();
    const ServoState now = state();
    if (now.motion > motion && is_active(now)) return true;
    const double left = end - monotonic();
    if (left <= 0.0) return false;
    wake_waiter_.wait(static_cast<int>(std::ceil(1e3 * std::fmin(left, 1.0))));
  }
}

std::uint64_t ServoLoop::count(Count count) const noexcept {
  return counts_[static_cast<std::size_t>(count)].load(std::memory_order_relaxed);
}

std::uint64_t ServoLoop::undecodable(fri::DecodeStatus status) const noexcept {
  return undecodable_[static_cast<std::size_t>(status)].load(std::memory_order_relaxed);
}

Peer ServoLoop::peer() const noexcept { return unpack(packed_peer_); }

Peer ServoLoop::last_stranger() const noexcept { return unpack(packed_stranger_); }

// -- the loop ---------------------------------------------------------------------

void ServoLoop::add(Count count, std::uint64_t number) noexcept {
  auto& counter = counts_[static_cast<std::size_t>(count)];
  counter.store(counter.load(std::memory_order_relaxed) + number,
                std::memory_order_relaxed);
}

void ServoLoop::run() noexcept {
  set_up_thread();
  Datagram datagram;
  while (socket_.receive(bytes_.data(), bytes_.size(), datagram)) {
  }  // what came before is too old to answer
  while (!closing_.load(std::memory_order_relaxed)) {
    take_requests();
    answer_if_granted();
    if (socket_.receive(bytes_.data(), bytes_.size(), datagram)) {
      handle(datagram);
      continue;
    }
    watch_silence(monotonic());
    notice_events(monotonic());
    if (wait_for(socket_.descriptor(), wake_loop_.descriptor(), kIdleWait)) {
      wake_loop_.silence();
    }
  }
  if (save_at_ > 0.0) {
    jobs_.write(job_);
    wake_writer_.ring();
  }
}

void ServoLoop::take_requests() noexcept {
  if (request_.load(std::memory_order_relaxed) != Request::kNone) {
    if (request_.exchange(Request::kNone) == Request::kStop) {
      cycle_.watchdog().request_stop();
    } else {
      cycle_.clear();
    }
  }
  if (diagnosis_requested_.load(std::memory_order_relaxed) &&
      diagnosis_requested_.exchange(false)) {
    sessions_.write(cycle_.session());
    ++diagnoses_;
  }
}

/// Whether the datagram is of the session's peer, or may become its first.
bool ServoLoop::is_served(const Datagram& datagram) noexcept {
  if (has_peer_ && datagram.source == peer_) return true;
  if (is_locked_ || (allowed_ != 0 && datagram.source.address != allowed_)) {
    add(Count::kForeign);
    packed_stranger_ = pack(datagram.source);
    return false;
  }
  // A stranger takes over only with a message that can be read.
  fri::MonitoringMessage message;
  const fri::DecodeResult result = fri::decode_monitoring(
      bytes_.data(), datagram.size, cycle_.params().version, message);
  if (result.ok()) {
    cycle_.lose_session();
    peer_ = datagram.source;
    packed_peer_ = pack(peer_);
    has_peer_ = true;
    has_arrival_ = owes_reply_ = false;
  }
  return true;
}

void ServoLoop::count_arrival(const Datagram& datagram) noexcept {
  const double arrival = taken_ - datagram.waited;
  const double period = 1e-3 * cycle_.state().send_period;
  if (has_arrival_ && cycle_.step().missed == 0 && period > 0.0 &&
      !cycle_.params().lockstep) {
    arrival_jitter_.add(std::abs(arrival - last_arrival_ - period));
  }
  has_arrival_ = true;
  last_arrival_ = arrival;
}

void ServoLoop::handle(const Datagram& datagram) noexcept {
  taken_ = monotonic();
  waited_ = datagram.waited;
  add(Count::kReceived);
  if (!is_served(datagram)) {
    watch_silence(taken_);  // a flood must not keep these from their turn
    notice_events(taken_);
    return;
  }
  datagram_at_ = taken_;
  const fri::SessionCounters before = cycle_.session().counters();
  const bool was_waiting = cycle_.state().is_waiting;
  const ServoCycle::Action action = cycle_.receive(bytes_.data(), datagram.size);
  const fri::SessionStep& step = cycle_.step();
  const fri::SessionCounters& after = cycle_.session().counters();
  add(Count::kDuplicates, after.duplicates - before.duplicates);
  add(Count::kOlder, after.older - before.older);
  if (!step.decode.ok()) {
    add(Count::kUndecodable);
    ++undecodable_[static_cast<std::size_t>(step.decode.status)];
    failures_.write({step.decode, datagram.source});
    watch_silence(taken_);  // what cannot be read is no sign of life
  } else {
    last_heard_ = taken_;
  }
  if (!step.is_new) return;
  message_at_ = taken_;
  add(Count::kMissed, step.missed);
  if (was_waiting && cycle_.state().is_waiting) add(Count::kSuperseded);
  count_arrival(datagram);
  // From MONITORING_READY on the link is good: nobody else is listened to.
  if (step.state == fri::SessionState::kIdle) is_locked_ = false;
  if (step.state >= fri::SessionState::kMonitoringReady) is_locked_ = true;
  if (action == ServoCycle::Action::kSend) owes_reply_ = true;
  if (action == ServoCycle::Action::kAnswer || step.state != step.previous) {
    owes_reply_ = action == ServoCycle::Action::kSend;
  }
  // In lockstep the learner waits for this message; by the clock the answer is first.
  if (action != ServoCycle::Action::kAnswer || cycle_.params().lockstep) publish();
  answer_if_granted();
  notice_events(taken_);
}

/// Whether a newer message waits, which the answer should be to: after a stall the
/// cabinet takes an answer to the newest alone. In lockstep every answer counts.
bool ServoLoop::is_stale() noexcept {
  const bool is_newer_there =
      !cycle_.params().lockstep && backlog_ < kMaxBacklog && socket_.has_next_of(peer_);
  backlog_ = is_newer_there ? backlog_ + 1 : 0;
  return is_newer_there;
}

void ServoLoop::answer_if_granted() noexcept {
  const ServoState& state = cycle_.state();
  if (!(state.is_waiting || owes_reply_) || is_stale()) return;
  if (owes_reply_) {
    owes_reply_ = false;
    send(cycle_.reply(reply_.data()), false);
    return;
  }
  orders_.update();
  const Order& order = orders_.value();
  const bool is_granted = order.motion == state.motion && state.tick < order.tick;
  if (cycle_.params().lockstep && !is_granted) return;
  send(cycle_.answer(order, reply_.data()), true);
  publish();
}

void ServoLoop::send(std::size_t size, bool is_active) noexcept {
  const bool is_lockstep = cycle_.params().lockstep;
  if (is_active && !is_lockstep) cycle_time_.add(monotonic() - taken_);
  if (size == 0 || !socket_.send(reply_.data(), size, peer_)) {
    add(Count::kSendErrors);
    return;
  }
  add(Count::kAnswered);
  last_heard_ = monotonic();  // in lockstep the learner may have thought for long
  if (!is_lockstep) reply_time_.add(waited_ + last_heard_ - taken_);
}

void ServoLoop::watch_silence(double now) noexcept {
  if (!has_peer_ || cycle_.state().is_waiting) return;
  if (now - last_heard_ < loop_.silence) return;
  has_peer_ = is_locked_ = owes_reply_ = false;
  add(Count::kSilences);
  cycle_.lose_session();
  publish();
}

void ServoLoop::publish() noexcept {
  const ServoState& state = cycle_.state();
  states_.write(state);
  const bool is_reached = state.tick >= awaited_.load(std::memory_order_relaxed);
  if (is_reached) awaited_.store(kNobody, std::memory_order_relaxed);
  const bool is_news = state.session != last_state_.session ||
                       state.motion != last_state_.motion ||
                       state.refusal != last_state_.refusal;
  if (is_reached || is_news) wake_waiter_.ring();
}

void ServoLoop::plan_log(std::string_view cause, double now) noexcept {
  if (save_at_ > 0.0) return;  // the first cause counts
  job_ = {cause, cycle_.state().facts, cycle_.state()};
  save_at_ = now + kAfterEvent;
}

void ServoLoop::notice_events(double now) noexcept {
  const ServoState& state = cycle_.state();
  if (state.motion != last_state_.motion) add(Count::kMotions);
  if (is_active(last_state_) &&
      (!is_active(state) || state.motion != last_state_.motion)) {
    if (!end_expected_.exchange(false)) plan_log("session", now);
  }
  if (state.is_stopped && !last_state_.is_stopped) {
    add(Count::kStops);
    plan_log("stop", now);
  }
  const bool is_late = state.facts.reason == StopReason::kTargetTimeout;
  if (is_late && last_state_.facts.reason != StopReason::kTargetTimeout) {
    add(Count::kHolds);
    plan_log("hold", now);
  }
  last_state_ = state;
  if (save_at_ == 0.0 || now < save_at_) return;
  save_at_ = 0.0;
  jobs_.write(job_);
  wake_writer_.ring();
}

}  // namespace dovetail
