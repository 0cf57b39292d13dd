#include <unistd.h>

#include <boost/test/unit_test.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <thread>

#include "dovetail/servo_loop.hpp"
#include "fake_cabinet.hpp"

using namespace dovetail;
using namespace dovetail::testing;
using fri::SessionState;

namespace {

constexpr double kPeriod = 0.005;

void sleep_ms(int milliseconds) {
  std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
}

/// A loop on a free port, and a cabinet with its own socket.
struct Network {
  FakeCabinet cabinet;
  UdpSocket socket{"127.0.0.1", 0};
  LoopParams loop_params;
  ServoParams params;
  std::filesystem::path folder = std::filesystem::temp_directory_path() /
                                 ("dovetail-servo-" + std::to_string(getpid()));
  std::unique_ptr<ServoLoop> loop;
  std::array<std::uint8_t, 2048> bytes{};

  ~Network() {
    loop.reset();
    std::filesystem::remove_all(folder);
  }

  void start(bool is_lockstep = false) {
    loop_params.address = "127.0.0.1";
    loop_params.port = 0;
    params.lockstep = is_lockstep;
    loop = std::make_unique<ServoLoop>(loop_params, params, iiwa14_with_tool(),
                                       OscParams{}, limits_for(kPeriod), kUsualTask);
    sleep_ms(20);  // the thread drops what came before it was there
  }

  Peer there() const {
    Peer peer;
    peer.address = htonl_loopback();
    peer.port = static_cast<std::uint16_t>((loop->port() >> 8) | (loop->port() << 8));
    return peer;
  }
  static std::uint32_t htonl_loopback() { return 0x0100007f; }

  void send(UdpSocket& from) {
    const std::uint8_t* message = cabinet.message();
    BOOST_REQUIRE(from.send(message, cabinet.size(), there()));
  }

  void send_garbage(UdpSocket& from) {
    const std::array<std::uint8_t, 8> garbage{1, 2, 3, 4, 5, 6, 7, 8};
    from.send(garbage.data(), garbage.size(), there());
  }

  /// The answer that comes within a time.
  std::optional<fri::CommandMessage> answer(UdpSocket& at, int milliseconds = 1000) {
    Datagram datagram;
    for (int i = 0; i < milliseconds; ++i) {
      if (at.receive(bytes.data(), bytes.size(), datagram)) {
        return cabinet.read(bytes.data(), datagram.size);
      }
      sleep_ms(1);
    }
    return {};
  }

  std::optional<fri::CommandMessage> exchange() {
    send(socket);
    return answer(socket);
  }

  void activate() {
    for (const auto state :
         {SessionState::kMonitoringWait, SessionState::kMonitoringReady,
          SessionState::kCommandingWait, SessionState::kCommandingActive}) {
      cabinet.state = state;
      BOOST_REQUIRE(exchange().has_value());
    }
  }
};

}  // namespace

BOOST_FIXTURE_TEST_SUITE(on_loopback, Network)

BOOST_AUTO_TEST_CASE(a_session_is_entered_and_entered_again) {
  start();
  activate();
  BOOST_TEST(loop->state().motion == 1);
  cabinet.state = SessionState::kIdle;
  send(socket);
  BOOST_TEST(!answer(socket, 50).has_value());
  activate();
  BOOST_TEST(loop->state().motion == 2);
  BOOST_TEST(loop->count(Count::kMotions) == 2);
}

BOOST_AUTO_TEST_CASE(only_the_pinned_address_is_served_whoever_speaks_first) {
  loop_params.peer = "127.0.0.2";
  start();
  cabinet.state = SessionState::kMonitoringReady;  // where the first is locked in
  send(socket);
  BOOST_TEST(!answer(socket, 50).has_value());
  BOOST_TEST(loop->count(Count::kForeign) == 1);
  BOOST_TEST(describe(loop->last_stranger()) ==
             describe({htonl_loopback(), [&] {
                         const std::uint16_t port = socket.port();
                         return static_cast<std::uint16_t>((port >> 8) | (port << 8));
                       }()}));
  UdpSocket pinned("127.0.0.2", 0);
  send(pinned);
  BOOST_TEST(answer(pinned).has_value());
  BOOST_TEST(loop->peer().address == 0x0200007fu);
}

BOOST_AUTO_TEST_CASE(a_peer_that_is_no_address_is_refused) {
  loop_params.peer = "robot";
  BOOST_CHECK_EXCEPTION(start(), std::invalid_argument, [](const auto& error) {
    return std::string(error.what()).find("peer is \"robot\"") != std::string::npos;
  });
}

BOOST_AUTO_TEST_CASE(a_stranger_is_counted_and_not_answered) {
  start();
  activate();
  const ServoState before = loop->state();
  UdpSocket stranger("127.0.0.1", 0);
  FakeCabinet false_cabinet;
  for (const auto state : {SessionState::kIdle, SessionState::kCommandingActive}) {
    false_cabinet.state = state;
    const std::uint8_t* message = false_cabinet.message();
    BOOST_REQUIRE(stranger.send(message, false_cabinet.size(), there()));
  }
  BOOST_TEST(!answer(stranger, 50).has_value());
  BOOST_TEST(loop->count(Count::kForeign) == 2);
  BOOST_TEST(loop->state().tick == before.tick);
  BOOST_CHECK(loop->state().session == SessionState::kCommandingActive);
  BOOST_TEST(exchange().has_value());
}

BOOST_AUTO_TEST_CASE(a_flood_of_strangers_does_not_hide_a_silent_cabinet) {
  loop_params.silence = 0.1;
  start();
  activate();
  UdpSocket stranger("127.0.0.1", 0);
  for (int i = 0; i < 2000 && loop->count(Count::kSilences) == 0; ++i) {
    for (int k = 0; k < 20; ++k) send_garbage(stranger);
    sleep_ms(1);
  }
  BOOST_TEST(loop->count(Count::kSilences) == 1);
  BOOST_TEST(loop->count(Count::kForeign) > 100);
}

BOOST_AUTO_TEST_CASE(after_idle_another_cabinet_may_come) {
  start();
  activate();
  cabinet.state = SessionState::kIdle;
  send(socket);
  sleep_ms(20);
  UdpSocket other("127.0.0.1", 0);
  cabinet.state = SessionState::kMonitoringWait;
  cabinet.sequence = 0;
  send(other);
  BOOST_TEST(answer(other).has_value());
}

BOOST_AUTO_TEST_CASE(a_silent_cabinet_makes_room_for_another) {
  loop_params.silence = 0.05;
  start();
  activate();
  sleep_ms(300);
  BOOST_TEST(loop->count(Count::kSilences) == 1);
  BOOST_CHECK(loop->state().session == SessionState::kIdle);
  UdpSocket other("127.0.0.1", 0);
  cabinet.state = SessionState::kMonitoringWait;
  cabinet.sequence = 0;
  send(other);
  BOOST_TEST(answer(other).has_value());
}

BOOST_AUTO_TEST_CASE(lockstep_answers_what_was_granted_and_no_more) {
  start(true);
  for (const auto state :
       {SessionState::kMonitoringWait, SessionState::kMonitoringReady,
        SessionState::kCommandingWait}) {
    cabinet.state = state;
    BOOST_REQUIRE(exchange().has_value());
  }
  cabinet.state = SessionState::kCommandingActive;
  send(socket);
  BOOST_TEST(!answer(socket, 50).has_value());
  BOOST_TEST(loop->wait_for_motion(0, 1.0));
  const ServoState state = loop->state();
  BOOST_TEST(state.is_waiting);
  Target target;
  target.quat_wxyz_d = Vec4(0, 1, 0, 0);
  loop->command(target, state.motion + 1, state.tick + 1);  // another motion's
  BOOST_TEST(!answer(socket, 50).has_value());
  loop->command(target, state.motion, state.tick + 2);
  BOOST_TEST(answer(socket).has_value());
  BOOST_TEST(exchange().has_value());
  BOOST_CHECK(loop->wait(state.tick + 2, state.motion, 0.01) == WaitResult::kTime);
  send(socket);
  BOOST_CHECK(loop->wait(state.tick + 2, state.motion, 1.0) == WaitResult::kReached);
  BOOST_TEST(!answer(socket, 50).has_value());
  BOOST_TEST(loop->log().count() == 2);
}

BOOST_AUTO_TEST_CASE(a_stop_is_logged_to_a_file_with_its_reason) {
  loop_params.log_folder = folder.string();
  start();
  activate();
  for (int k = 0; k < 20; ++k) exchange();
  loop->stop();
  for (int k = 0; k < 10; ++k) exchange();
  BOOST_TEST(loop->state().is_stopped);
  BOOST_TEST(loop->count(Count::kStops) == 1);
  loop->close();
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    ++files;
    BOOST_TEST(entry.path().extension() == ".csv");
    BOOST_TEST(entry.path().string().find("requested") != std::string::npos);
    std::ifstream file(entry.path());
    std::string line;
    std::getline(file, line);
    BOOST_TEST(line == "# a stop was asked for");
    std::getline(file, line);
    BOOST_TEST(line.rfind("time,q1,q2", 0) == 0U);
    int rows = 0;
    while (std::getline(file, line)) ++rows;
    BOOST_TEST(rows == 31);
  }
  BOOST_TEST(files == 1);
}

BOOST_AUTO_TEST_CASE(of_a_stop_and_a_clear_the_later_one_holds) {
  start();
  activate();
  for (int k = 0; k < 200; ++k) {
    loop->clear();
    loop->stop();  // often before the loop has seen the clear
    for (int cycle = 0; cycle < 3; ++cycle) exchange();
    BOOST_TEST(loop->state().is_stopped);
    loop->stop();
    loop->clear();
    for (int cycle = 0; cycle < 3; ++cycle) exchange();
    BOOST_TEST(!loop->state().is_stopped);
  }
}

BOOST_AUTO_TEST_CASE(a_log_that_cannot_be_written_is_a_note) {
  loop_params.log_folder = "/dev/full";
  start();
  activate();
  loop->stop();
  exchange();
  loop->close();
  BOOST_REQUIRE(loop->notes().size() == 1U);
  BOOST_TEST(loop->notes()[0].find("log lost") != std::string::npos);
}

BOOST_AUTO_TEST_CASE(times_and_counts_are_kept) {
  start();
  activate();
  for (int k = 0; k < 50; ++k) exchange();
  BOOST_TEST(loop->count(Count::kReceived) == 54);
  BOOST_TEST(loop->count(Count::kAnswered) == 54);
  BOOST_TEST(loop->cycle_time().count() == 51);
  BOOST_TEST(loop->reply_time().count() == 54);
  BOOST_TEST(loop->reply_time().quantile(0.5) > 1e-6);
  BOOST_TEST(loop->reply_time().quantile(0.5) <= loop->reply_time().largest());
}

BOOST_AUTO_TEST_SUITE_END()

BOOST_AUTO_TEST_CASE(a_port_in_use_is_an_error_that_says_so) {
  UdpSocket first("127.0.0.1", 0);
  BOOST_CHECK_EXCEPTION(UdpSocket("127.0.0.1", first.port()), std::system_error,
                        [](const std::system_error& error) {
                          return error.code() == std::errc::address_in_use;
                        });
}

BOOST_AUTO_TEST_CASE(a_full_disk_is_told_and_leaves_no_file) {
  const std::string path = "/dev/full/log.csv";
  BOOST_TEST(!write_csv(path, "reason", {"a"}, {1.0}).empty());
  const auto beside = std::filesystem::temp_directory_path() /
                      ("dovetail-full-" + std::to_string(getpid()) + ".csv");
  std::filesystem::create_symlink("/dev/full", beside.string() + ".partial");
  const std::string failure =
      write_csv(beside.string(), "reason", {"a"}, std::vector<double>(100000, 1.0));
  BOOST_TEST(failure.find("No space left") != std::string::npos);
  BOOST_TEST(!std::filesystem::exists(beside));
  BOOST_TEST(!std::filesystem::is_symlink(beside.string() + ".partial"));
}

BOOST_AUTO_TEST_CASE(quantiles_are_within_one_bin) {
  Histogram histogram;
  BOOST_TEST(histogram.quantile(0.5) == 0.0);
  for (int i = 1; i <= 1000; ++i) histogram.add(1e-6 * i);
  BOOST_TEST(histogram.count() == 1000);
  BOOST_TEST(std::abs(histogram.quantile(0.5) / 500e-6 - 1.0) < 0.13);
  BOOST_TEST(std::abs(histogram.quantile(0.99) / 990e-6 - 1.0) < 0.13);
  BOOST_TEST(histogram.largest() == 1000e-6);
  histogram.add(1e9);
  histogram.add(-1.0);
  histogram.add(NAN);
  BOOST_TEST(histogram.count() == 1003);
}

BOOST_AUTO_TEST_CASE(the_newest_value_is_read_whole) {
  TripleBuffer<std::array<long, 64>> buffer;
  std::thread writer([&] {
    std::array<long, 64> value;
    for (long k = 1; k <= 200000; ++k) {
      value.fill(k);
      buffer.write(value);
    }
  });
  long last = 0;
  while (last < 200000) {
    if (!buffer.update()) continue;
    const auto& value = buffer.value();
    BOOST_REQUIRE(value.front() == value.back());
    BOOST_REQUIRE(value.front() > last);
    last = value.front();
  }
  writer.join();
}

BOOST_AUTO_TEST_CASE(rows_that_were_overwritten_are_not_given) {
  RingLog log(100, 2);
  std::vector<double> rows(400);
  for (int i = 0; i < 1000; ++i) {
    double* row = log.next_row();
    row[0] = i;
    row[1] = -i;
    log.commit();
  }
  BOOST_TEST(log.oldest() == 900);
  BOOST_TEST(log.copy(900, 1000, 2, rows.data()));
  BOOST_TEST(rows[0] == 900.0);
  BOOST_TEST(rows[199] == -999.0);
  BOOST_TEST(!log.copy(0, 10, 2, rows.data()));
  BOOST_TEST(!log.copy(990, 1001, 2, rows.data()));
  BOOST_TEST(!log.copy(5, 4, 2, rows.data()));
}
