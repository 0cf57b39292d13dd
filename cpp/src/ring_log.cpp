#include "dovetail/ring_log.hpp"

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <system_error>

namespace dovetail {
namespace {

struct Closer {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};

std::string reason(const std::string& what, const std::string& path, int error) {
  return what + " " + path + ": " + std::strerror(error);
}

std::string csv_line(const double* numbers, std::size_t count) {
  std::string line;
  char text[32];
  for (std::size_t i = 0; i < count; ++i) {
    const auto end = std::to_chars(text, text + sizeof text, numbers[i]).ptr;
    line.append(text, end);
    line += i + 1 < count ? ',' : '\n';
  }
  return line;
}

}  // namespace

RingLog::RingLog(std::size_t rows, std::size_t columns)
    : rows_(rows), columns_(columns), capacity_(rows + rows / 4 + 64) {
  if (rows == 0 || columns == 0) {
    throw std::invalid_argument("ring log needs at least one row and one column");
  }
  numbers_.resize(capacity_ * columns_);
}

const double* RingLog::row(std::uint64_t number) const noexcept {
  return numbers_.data() + static_cast<std::size_t>(number % capacity_) * columns_;
}

double* RingLog::next_row() noexcept {
  return const_cast<double*>(row(count_.load(std::memory_order_relaxed)));
}

void RingLog::commit() noexcept { count_.fetch_add(1, std::memory_order_release); }

std::uint64_t RingLog::count() const noexcept {
  return count_.load(std::memory_order_acquire);
}

std::uint64_t RingLog::oldest() const noexcept {
  const std::uint64_t written = count();
  return written > rows_ ? written - rows_ : 0;
}

bool RingLog::copy(std::uint64_t from, std::uint64_t to, std::size_t columns,
                   double* out) const noexcept {
  if (from > to || to > count() || columns > columns_) return false;
  for (std::uint64_t i = from; i < to; ++i) {
    std::memcpy(out, row(i), columns * sizeof(double));
    out += columns;
  }
  std::atomic_thread_fence(std::memory_order_acquire);
  return from + capacity_ > count_.load(std::memory_order_relaxed);
}

std::string write_csv(const std::string& path, const std::string& comment,
                      const std::vector<std::string>& columns,
                      const std::vector<double>& numbers) {
  const std::string beside = path + ".partial";
  std::error_code error;
  const auto folder = std::filesystem::path(path).parent_path();
  if (!folder.empty()) std::filesystem::create_directories(folder, error);
  if (error) {
    return "cannot make the folder " + folder.string() + ": " + error.message();
  }
  std::unique_ptr<std::FILE, Closer> file(std::fopen(beside.c_str(), "w"));
  if (!file) return reason("cannot write", beside, errno);
  const auto put = [&](const std::string& text) {
    return std::fwrite(text.data(), 1, text.size(), file.get()) == text.size();
  };
  std::string head = "# " + comment + "\n";
  for (std::size_t i = 0; i < columns.size(); ++i) {
    head += columns[i];
    head += i + 1 < columns.size() ? ',' : '\n';
  }
  bool is_good = put(head);
  for (std::size_t i = 0; is_good && i + columns.size() <= numbers.size();
       i += columns.size()) {
    is_good = put(csv_line(numbers.data() + i, columns.size()));
  }
  is_good = is_good && std::fflush(file.get()) == 0;
  int failure = errno;
  if (std::fclose(file.release()) != 0 && is_good) {
    failure = errno;
    is_good = false;
  }
  if (is_good) {
    std::filesystem::rename(beside, path, error);
    if (!error) return "";
    failure = error.value();
  }
  std::filesystem::remove(beside, error);
  return reason("cannot write", path, failure);
}

}  // namespace dovetail
