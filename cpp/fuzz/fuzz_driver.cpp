/// A small coverage-guided fuzzer for where libFuzzer is not: it changes messages that
/// are known to reach new code, and keeps those that do. One seed gives one sequence.
///
/// usage: fuzz_fri INPUTS [SEED]     or     fuzz_fri --replay FILE
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "../tests/fri_fixtures.hpp"

using namespace dovetail::fri;
using dovetail::fri::testing::Bytes;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
extern "C" void __sanitizer_set_death_callback(void (*callback)())
    __attribute__((weak));

namespace {

constexpr std::size_t kMaxInput = kMaxDatagram + 16;
constexpr std::size_t kMaxCorpus = 4096;
constexpr unsigned kHangSeconds = 20;  // for a thousand inputs

std::array<std::uint8_t, 1 << 16> hits{};
bool has_new_hit = false;
Bytes input;

/// The instrumented code comes by here at every edge of its flow.
extern "C" void __sanitizer_cov_trace_pc() {
  // Relative: where the program is loaded must not matter.
  const auto place = reinterpret_cast<std::uintptr_t>(__builtin_return_address(0)) -
                     reinterpret_cast<std::uintptr_t>(&LLVMFuzzerTestOneInput);
  std::uint8_t& hit = hits[(place ^ place >> 16) & 0xFFFF];
  if (hit == 0) has_new_hit = true;
  hit = 1;
}

/// So that it can be seen and replayed.
void save_input() {
  std::FILE* file = std::fopen("fuzz-failure.bin", "wb");
  if (file == nullptr) return;
  std::fwrite(input.data(), 1, input.size(), file);
  std::fclose(file);
  std::fprintf(stderr, "the failing input is in fuzz-failure.bin\n");
}

void on_signal(int number) {
  save_input();
  std::fprintf(stderr, number == SIGALRM ? "it hangs\n" : "it aborted\n");
  std::_Exit(1);
}

class Mutator {
 public:
  explicit Mutator(std::uint64_t seed) : random_(seed) {}

  std::size_t below(std::size_t limit) { return random_() % limit; }

  void mutate(Bytes& bytes, const Bytes& other) {
    for (std::size_t times = below(4) + 1; times > 0; --times) {
      if (bytes.size() < 2) bytes.resize(2 + below(64), value());
      const std::size_t at = below(bytes.size());
      const std::size_t length =
          std::min(below(below(4) == 0 ? 64 : 4) + 1, bytes.size() - at);
      change(bytes, other, at, length);
      if (bytes.size() > kMaxInput) bytes.resize(kMaxInput);
    }
  }

 private:
  using Offset = std::ptrdiff_t;

  void change(Bytes& bytes, const Bytes& other, std::size_t at, std::size_t length) {
    const auto here = bytes.begin() + static_cast<Offset>(at);
    const auto end = here + static_cast<Offset>(length);
    switch (below(8)) {
      case 0:
        bytes[at] ^= static_cast<std::uint8_t>(1u << below(8));
        break;
      case 1:
        bytes[at] = value();
        break;
      case 2:
        bytes[at] = static_cast<std::uint8_t>(bytes[at] + (below(2) == 0 ? 1 : 255));
        break;
      case 3:
        bytes.insert(here, length, value());
        break;
      case 4:
        bytes.erase(here, end);
        break;
      case 5: {  // a part once more
        const Bytes part(here, end);
        bytes.insert(bytes.begin() + static_cast<Offset>(below(bytes.size())),
                     part.begin(), part.end());
        break;
      }
      case 6:  // the end of another message
        bytes.resize(at);
        bytes.insert(bytes.end(),
                     other.begin() + static_cast<Offset>(std::min(at, other.size())),
                     other.end());
        break;
      default:
        bytes.resize(at);
    }
  }
  std::uint8_t value() {
    constexpr std::uint8_t kTelling[] = {0x00, 0x01, 0x07, 0x08, 0x09, 0x0A,
                                         0x3F, 0x7F, 0x80, 0xF0, 0xF8, 0xFF};
    return below(2) == 0 ? kTelling[below(std::size(kTelling))]
                         : static_cast<std::uint8_t>(below(256));
  }

  std::mt19937_64 random_;
};

Bytes chosen(std::uint8_t selector, const Bytes& message) {
  Bytes bytes(message.size() + 1, selector);
  std::copy(message.begin(), message.end(), bytes.begin() + 1);
  return bytes;
}

/// KUKA's message once for every session state, with the next count.
void add_states(std::vector<Bytes>& all) {
  using namespace dovetail::fri::testing;
  MonitoringMessage message;
  decode(hex(kMonitoring), Version::k1_15, message);
  for (int state = 0; state < 5; ++state) {
    message.connection->state = static_cast<SessionState>(state);
    message.q_ipo = kGoldenQ;
    message.command_mode = CommandMode::kTorque;
    all.push_back(chosen(0x08, encoded(message, Version::k1_15)));
    all.push_back(chosen(0x09, encoded(message, Version::k2_5)));
  }
}

/// KUKA's datagrams, and some of ours with every field, for each version.
std::vector<Bytes> seeds() {
  using namespace dovetail::fri::testing;
  std::vector<Bytes> all;
  add_states(all);
  for (const std::uint8_t selector : {0, 1, 6})
    for (const std::string& text :
         {kHeaderOnly, kEcho, kTorque, kWrench, kIo, kMonitoring})
      all.push_back(chosen(selector, hex(text)));
  for (const std::string& text : {kHeaderOnly27, kHeaderOnly27At80, kTorque27})
    all.push_back(chosen(2, hex(text)));
  RandomMessages random(1);
  for (const std::uint8_t selector : {0, 1, 6}) {
    const Version version = static_cast<Version>(selector & 3);
    for (int k = 0; k < 50; ++k) {
      for (Bytes bytes : {encoded(random.command(version), version),
                          encoded(random.monitoring(version), version)}) {
        if (selector == 6 && bytes.size() > 8)  // the entry puts a frame around it
          bytes = Bytes(bytes.begin() + 4, bytes.end() - 4);
        all.push_back(chosen(selector, bytes));
      }
    }
  }
  return all;
}

int replay(const char* path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    std::fprintf(stderr, "%s cannot be read\n", path);
    return 2;
  }
  input.assign(std::istreambuf_iterator<char>(file), {});
  LLVMFuzzerTestOneInput(input.data(), input.size());
  std::printf("no failure\n");
  return 0;
}

void run(std::uint64_t inputs, std::uint64_t seed) {
  using Clock = std::chrono::steady_clock;
  std::vector<Bytes> corpus = seeds();
  for (const Bytes& bytes : corpus) {
    input = bytes;
    LLVMFuzzerTestOneInput(input.data(), input.size());
  }
  Mutator mutator(seed);
  const Clock::time_point start = Clock::now();
  for (std::uint64_t k = 0; k < inputs; ++k) {
    if (k % 1000 == 0) alarm(kHangSeconds);
    input = corpus[mutator.below(corpus.size())];
    mutator.mutate(input, corpus[mutator.below(corpus.size())]);
    has_new_hit = false;
    LLVMFuzzerTestOneInput(input.data(), input.size());
    if (has_new_hit && corpus.size() < kMaxCorpus) corpus.push_back(input);
  }
  alarm(0);
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  const auto edges = std::count(hits.begin(), hits.end(), std::uint8_t{1});
  std::printf(
      "%llu inputs from seed %llu in %.1f s (%.0f per s): no failure; %zu "
      "messages kept, %td edges reached\n",
      static_cast<unsigned long long>(inputs), static_cast<unsigned long long>(seed),
      seconds, static_cast<double>(inputs) / seconds, corpus.size(), edges);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "--replay") return replay(argv[2]);
  if (argc < 2 || argc > 3) {
    std::fprintf(stderr, "usage: %s INPUTS [SEED] | --replay FILE\n", argv[0]);
    return 2;
  }
  signal(SIGABRT, on_signal);
  signal(SIGALRM, on_signal);
  if (__sanitizer_set_death_callback != nullptr)
    __sanitizer_set_death_callback(save_input);
  run(std::strtoull(argv[1], nullptr, 10),
      argc == 3 ? std::strtoull(argv[2], nullptr, 10) : 1);
  return 0;
}
