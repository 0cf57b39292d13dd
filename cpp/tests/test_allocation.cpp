#include <atomic>
#include <boost/test/unit_test.hpp>
#include <cstdlib>
#include <limits>
#include <memory>
#include <utility>

#include "adversary.hpp"
#include "dovetail/fri_session.hpp"
#include "dovetail/servo_cycle.hpp"
#include "fake_cabinet.hpp"
#include "fri_fixtures.hpp"

// Eigen allocates by malloc, not by operator new: count at the bottom. A sanitizer
// brings its own malloc; the counter then sees nothing.
#if defined(__SANITIZE_ADDRESS__)
constexpr bool kIsCounting = false;
static std::atomic<long> allocations{0};
#else
constexpr bool kIsCounting = true;
static std::atomic<long> allocations{0};

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  ++allocations;
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}
}
#endif

using namespace dovetail;
using namespace dovetail::testing;

namespace {

using SevenNumbers = const Vec7&;
static_assert(noexcept(std::declval<Controller&>().step(
    std::declval<SevenNumbers>(), std::declval<SevenNumbers>(),
    std::declval<const Target&>())));
static_assert(noexcept(std::declval<Controller&>().reset(
    std::declval<SevenNumbers>(), std::declval<const Vec3&>(),
    std::declval<const Vec4&>(), std::declval<SevenNumbers>())));
static_assert(noexcept(std::declval<ServoCycle&>().receive(
    std::declval<const std::uint8_t*>(), std::size_t{0})));
static_assert(noexcept(std::declval<ServoCycle&>().answer(
    std::declval<const Order&>(), std::declval<std::uint8_t*>())));
static_assert(noexcept(std::declval<const Chain&>().evaluate(
    std::declval<SevenNumbers>(), std::declval<SevenNumbers>(),
    std::declval<ChainTerms&>())));

}  // namespace

BOOST_AUTO_TEST_CASE(the_counter_sees_allocations_of_eigen_and_of_new) {
  const long before = allocations;
  const Eigen::VectorXd numbers = Eigen::VectorXd::Ones(100 + std::rand() % 2);
  const auto other = std::make_unique<std::array<double, 64>>();
  BOOST_TEST(numbers.sum() + (*other)[0] >= 100.0);
  BOOST_TEST(allocations - before == (kIsCounting ? 2 : 0));
}

BOOST_AUTO_TEST_CASE(no_cycle_allocates_whatever_it_is_given) {
  const ChainParams chain = iiwa14_with_tool();
  std::mt19937_64 random(5);
  for (const Scheme scheme : {Scheme::kQp, Scheme::kPaper}) {
    for (const bool is_exact : {false, true}) {
      LimitParams limits = limits_for(0.001);
      limits.scheme = scheme;
      limits.exact_sjs = is_exact;
      Controller controller(chain, OscParams{}, limits, kUsualTask, 0.001);
      const long before = allocations;
      controller.reset(tool_down_posture(), Vec3(0.6, 0.0, 0.2), Vec4(0, 1, 0, 0));
      for (int k = 0; k < 5000; ++k) {
        Vec7 q = random_posture(random, limits, -0.2);
        if (k % 7 == 0) q = random_vector(random, 0.02);  // nearly singular
        if (k % 11 == 0) q[3] = std::numeric_limits<double>::quiet_NaN();
        Target target;
        target.f_star = random_vector<Vec6>(random, 50.0);
        target.joint_mode = k % 3 == 0;
        static_cast<void>(controller.step(q, random_vector(random, 3.0), target));
      }
      BOOST_TEST(allocations - before == 0);
    }
  }
}

BOOST_AUTO_TEST_CASE(no_datagram_makes_the_fri_session_allocate) {
  using namespace dovetail::fri;
  fri::testing::RandomMessages random(3);
  std::vector<fri::testing::Bytes> datagrams;
  for (int k = 0; k < 2000; ++k) {
    MonitoringMessage message = random.monitoring(Version::k2_7);
    message.header.sequence = static_cast<std::uint32_t>(k);
    datagrams.push_back(fri::testing::encoded(message, Version::k2_7));
    if (k % 5 == 0 && !datagrams.back().empty()) datagrams.back().back() ^= 1;
  }
  FriSession session(Version::k2_7);
  std::uint8_t out[kMaxDatagram];
  const long before = allocations;
  for (const fri::testing::Bytes& bytes : datagrams) {
    const SessionStep step = session.receive(bytes.data(), bytes.size());
    if (step.reply != Reply::kNothing) session.answer(Joints{}, Joints{}, out);
  }
  BOOST_TEST(allocations - before == 0);
  BOOST_TEST(session.counters().sent > 100u);
  BOOST_TEST(session.counters().undecodable > 100u);
}

BOOST_AUTO_TEST_CASE(no_cycle_behind_fri_allocates_in_any_state) {
  ServoCycle cycle(ServoParams{}, iiwa14_with_tool(), OscParams{}, limits_for(0.005),
                   kUsualTask);
  FakeCabinet cabinet;
  Order order;
  std::array<std::uint8_t, fri::kMaxDatagram> out;
  const long before = allocations;
  for (int k = 0; k < 5000; ++k) {
    cabinet.state = static_cast<fri::SessionState>(k < 1000 ? k / 200 : 4 - k % 5 / 4);
    cabinet.sequence += k % 9 == 0 ? 2 : 0;  // some are lost
    cabinet.q[3] += 1e-4;
    const std::uint8_t* bytes = cabinet.message();
    const std::size_t size = k % 13 == 0 ? cabinet.size() / 2 : cabinet.size();
    const ServoCycle::Action action = cycle.receive(bytes, size);
    order.motion = cycle.state().motion;
    order.serial += k % 3 == 0;
    if (action == ServoCycle::Action::kSend) static_cast<void>(cycle.reply(out.data()));
    if (action == ServoCycle::Action::kAnswer) {
      static_cast<void>(cycle.answer(order, out.data()));
    }
    if (k == 4000) cycle.watchdog().request_stop();
  }
  BOOST_TEST(cycle.state().rows > 100);
  BOOST_TEST(allocations - before == 0);
}
