#include <cmath>
#include <limits>
#include <sstream>

#include "dovetail/monotonic.hpp"
#include "dovetail/servo_loop.hpp"

namespace dovetail {
namespace {

double since(double moment) noexcept {
  if (moment == 0.0) return std::numeric_limits<double>::infinity();
  return monotonic() - moment;
}

}  // namespace

double ServoLoop::since_datagram() const noexcept { return since(datagram_at_); }

double ServoLoop::since_message() const noexcept { return since(message_at_); }

/// What is known of a cabinet that was there.
std::string ServoLoop::lost_text() const {
  std::ostringstream text;
  text.precision(2);
  text << "nothing has come for " << std::fixed << since_datagram() << " s, after "
       << count(Count::kReceived) << " datagrams: the cabinet, its Java application or "
       << "the connection has ended";
  return text.str();
}

std::string ServoLoop::last_undecodable() {
  const std::lock_guard lock(state_mutex_);
  failures_.update();
  const Failure& failure = failures_.value();
  if (failure.result.ok()) return "";
  return "datagram from " + dovetail::describe(failure.source) + ": " +
         fri::describe(failure.result);
}

std::string ServoLoop::last_not_finite() {
  const std::lock_guard lock(state_mutex_);
  failures_.update();
  const fri::DecodeResult& result = failures_.value().result;
  if (result.status != fri::DecodeStatus::kNotFinite) return "";
  const std::string field = result.field;
  return result.value == 0 ? field : field + " of A" + std::to_string(result.value);
}

std::string ServoLoop::diagnose() {
  const std::uint64_t before = diagnoses_;
  diagnosis_requested_ = true;
  wake_loop_.ring();
  const double end = monotonic() + 0.5;
  while (diagnoses_ == before && monotonic() < end && !closing_) {
    timespec moment{0, 1000000};
    nanosleep(&moment, nullptr);
  }
  const std::lock_guard lock(state_mutex_);
  sessions_.update();
  if (!sessions_.value()) return "";
  const bool is_over = sessions_.value()->counters().received == 0;
  if (is_over && count(Count::kReceived) > 0) return lost_text();
  return sessions_.value()->diagnose();
}

}  // namespace dovetail
