/// The parts of the servo loop that may take their time: real-time settings, logs and
/// names.
#ifdef __linux__
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#endif
#include <time.h>

#include <cerrno>
#include <cstring>

#include "dovetail/servo_loop.hpp"

namespace dovetail {
namespace {

constexpr std::size_t kMaxNotes = 100;

const char* name_of(fri::SessionState state) noexcept { return fri::name(state); }

std::string file_time() {
  timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  tm parts;
  gmtime_r(&now.tv_sec, &parts);
  char text[64];
  const std::size_t size = strftime(text, sizeof text, "%Y%m%dT%H%M%S", &parts);
  return std::string(text, size) + "." +
         std::to_string(1000 + now.tv_nsec / 1000000).substr(1);
}

std::string refused(const std::string& what, int error, const std::string& advice) {
  return what + " refused: " + std::strerror(error) + "; going on without it. " +
         advice;
}

}  // namespace

const char* name(Count count) noexcept {
  switch (count) {
    case Count::kReceived:
      return "received";
    case Count::kAnswered:
      return "answered";
    case Count::kSendErrors:
      return "send_errors";
    case Count::kForeign:
      return "foreign";
    case Count::kUndecodable:
      return "undecodable";
    case Count::kDuplicates:
      return "duplicates";
    case Count::kOlder:
      return "older";
    case Count::kMissed:
      return "missed";
    case Count::kMotions:
      return "motions";
    case Count::kStops:
      return "stops";
    case Count::kHolds:
      return "holds";
    case Count::kSilences:
      return "silences";
    case Count::kSuperseded:
      return "superseded";
    case Count::kNumber:
      break;
  }
  return "unknown";
}

void ServoLoop::set_up_thread() noexcept {
#ifdef __linux__
  pthread_setname_np(pthread_self(), "dovetail-servo");
  if (loop_.lock_memory) {
    // Later allocations are locked, too, only where no limit can make them fail.
    rlimit limit{};
    getrlimit(RLIMIT_MEMLOCK, &limit);
    const int which =
        limit.rlim_cur == RLIM_INFINITY ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT;
    if (mlockall(which) != 0) {
      add_note(refused("locking memory", errno, "Raise `ulimit -l`, or CAP_IPC_LOCK."));
    }
  }
  if (loop_.processor >= 0) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(loop_.processor) % CPU_SETSIZE, &set);
    const int error = pthread_setaffinity_np(pthread_self(), sizeof set, &set);
    if (error != 0) {
      add_note(refused("processor " + std::to_string(loop_.processor), error,
                       "Give one that `nproc` counts, from 0."));
    }
  }
  if (loop_.priority > 0) {
    sched_param parameters{};
    parameters.sched_priority = loop_.priority;
    const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
    if (error != 0) {
      add_note(refused("SCHED_FIFO priority " + std::to_string(loop_.priority), error,
                       "Raise `ulimit -r`, or CAP_SYS_NICE."));
    }
  }
#else
  if (loop_.lock_memory || loop_.processor >= 0 || loop_.priority > 0) {
    add_note("real-time settings are for Linux; going on without them");
  }
#endif
}

void ServoLoop::add_note(const std::string& text) noexcept {
  const std::lock_guard lock(notes_mutex_);
  if (notes_.size() < kMaxNotes) notes_.push_back(text);
}

std::vector<std::string> ServoLoop::notes() const {
  const std::lock_guard lock(notes_mutex_);
  return notes_;
}

void ServoLoop::write_logs() noexcept {
  while (true) {
    const bool is_last = writer_closing_;
    if (jobs_.update()) {
      try {
        save(jobs_.value());
      } catch (const std::exception& error) {
        add_note(std::string("log not saved: ") + error.what());
      }
    }
    if (is_last) return;
    wake_writer_.wait(1000);
    wake_writer_.silence();
  }
}

void ServoLoop::save(const SaveJob& job) {
  std::string cause(job.cause);
  std::string text;
  if (job.facts.reason != StopReason::kNone) {
    text = describe(job.facts);
    if (job.cause == "stop") cause = name(job.facts.reason);
  } else {
    text = std::string("the session is in ") + name_of(job.state.session);
    const Change change = change_of(job.state.end);
    if (!change.what.empty()) {
      text = change.what + " was " + change.before + " and became " + change.after;
    }
    if (job.state.safety != 0) {
      text += ", safety stop level " + std::to_string(job.state.safety - 1);
    }
  }
  if (loop_.log_folder.empty()) {
    add_note("motion ended (" + text + "), no log folder is set");
    return;
  }
  const RingLog& log = cycle_.log();
  const std::uint64_t to = log.count();
  const std::uint64_t from = log.oldest();
  std::vector<double> numbers((to - from) * log.columns());
  if (!log.copy(from, to, log.columns(), numbers.data())) {
    add_note("log of a motion that ended (" + text + ") was overwritten");
    return;
  }
  const std::string path =
      loop_.log_folder + "/fri-" + file_time() + "-" + cause + ".csv";
  const std::string failure = write_csv(path, text, servo_columns(), numbers);
  add_note(failure.empty() ? "motion ended (" + text + "), log " + path
                           : "motion ended (" + text + "), log lost: " + failure);
}

}  // namespace dovetail
