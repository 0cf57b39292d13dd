#include "dovetail/udp_socket.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>

namespace dovetail {
namespace {

sockaddr_in address_of(const Peer& peer) noexcept {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = peer.address;
  address.sin_port = peer.port;
  return address;
}

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), what);
}

void unblock(int descriptor) {
  const int flags = fcntl(descriptor, F_GETFL);
  if (flags < 0 || fcntl(descriptor, F_SETFL, flags | O_NONBLOCK) != 0 ||
      fcntl(descriptor, F_SETFD, FD_CLOEXEC) != 0) {
    fail("cannot set up a descriptor");
  }
}

#ifdef SO_TIMESTAMPNS
/// Time since the kernel took the datagram [s]; 0 where it did not say.
double age_of(msghdr& message) noexcept {
  for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr;
       part = CMSG_NXTHDR(&message, part)) {
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_TIMESTAMPNS) continue;
    timespec arrived, now;
    std::memcpy(&arrived, CMSG_DATA(part), sizeof arrived);
    clock_gettime(CLOCK_REALTIME, &now);
    return static_cast<double>(now.tv_sec - arrived.tv_sec) +
           1e-9 * static_cast<double>(now.tv_nsec - arrived.tv_nsec);
  }
  return 0.0;
}
#endif

}  // namespace

std::string describe(const Peer& peer) {
  char text[INET_ADDRSTRLEN] = "?";
  in_addr address{peer.address};
  inet_ntop(AF_INET, &address, text, sizeof text);
  return std::string(text) + ":" + std::to_string(ntohs(peer.port));
}

std::uint32_t address_number(const std::string& text) {
  if (text.empty()) return 0;
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) == 1) return address.s_addr;
  throw std::invalid_argument("servo peer is \"" + text +
                              "\"; give an IPv4 address as in 192.170.10.2");
}

UdpSocket::UdpSocket(const std::string& address, std::uint16_t port) {
  sockaddr_in local{};
  local.sin_family = AF_INET;
  local.sin_port = htons(port);
  const std::string where = address + ":" + std::to_string(port);
  if (inet_pton(AF_INET, address.c_str(), &local.sin_addr) != 1) {
    errno = EINVAL;
    fail("bind address " + address + " is not of the form 192.168.0.1");
  }
  descriptor_ = socket(AF_INET, SOCK_DGRAM, 0);
  if (descriptor_ < 0) fail("cannot open a UDP socket");
  try {
    unblock(descriptor_);
    if (bind(descriptor_, reinterpret_cast<sockaddr*>(&local), sizeof local) != 0) {
      fail("cannot bind " + where);
    }
    socklen_t length = sizeof local;
    getsockname(descriptor_, reinterpret_cast<sockaddr*>(&local), &length);
    port_ = ntohs(local.sin_port);
#ifdef SO_TIMESTAMPNS
    const int on = 1;  // without it reply times begin when the thread wakes
    setsockopt(descriptor_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
#endif
  } catch (...) {
    close(descriptor_);
    throw;
  }
}

UdpSocket::~UdpSocket() { release(); }

void UdpSocket::release() noexcept {
  if (descriptor_ >= 0) close(descriptor_);
  descriptor_ = -1;
}

bool UdpSocket::receive(std::uint8_t* bytes, std::size_t capacity,
                        Datagram& datagram) noexcept {
  sockaddr_in source{};
  iovec buffer{bytes, capacity};
  alignas(cmsghdr) char control[256];
  msghdr message{};
  message.msg_name = &source;
  message.msg_namelen = sizeof source;
  message.msg_iov = &buffer;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  ssize_t size = recvmsg(descriptor_, &message, 0);
  // "Port unreachable" of an earlier reply shows up here: nobody listens there now.
  while (size < 0 && (errno == EINTR || errno == ECONNREFUSED)) {
    message.msg_controllen = sizeof control;
    size = recvmsg(descriptor_, &message, 0);
  }
  if (size < 0) return false;
  datagram.size = static_cast<std::size_t>(size);
  datagram.source = {source.sin_addr.s_addr, source.sin_port};
  datagram.waited = 0.0;
#ifdef SO_TIMESTAMPNS
  datagram.waited = age_of(message);
#endif
  return true;
}

bool UdpSocket::has_next_of(const Peer& source) const noexcept {
  sockaddr_in from{};
  socklen_t length = sizeof from;
  std::uint8_t one;
  const ssize_t size = recvfrom(descriptor_, &one, 1, MSG_PEEK | MSG_DONTWAIT,
                                reinterpret_cast<sockaddr*>(&from), &length);
  return size >= 0 && Peer{from.sin_addr.s_addr, from.sin_port} == source;
}

bool UdpSocket::send(const std::uint8_t* bytes, std::size_t size,
                     const Peer& to) noexcept {
  const sockaddr_in address = address_of(to);
  const auto* where = reinterpret_cast<const sockaddr*>(&address);
  return sendto(descriptor_, bytes, size, 0, where, sizeof address) ==
         static_cast<ssize_t>(size);
}

Bell::Bell() {
  if (pipe(ends_) != 0) fail("cannot open a pipe");
  unblock(ends_[0]);
  unblock(ends_[1]);
}

Bell::~Bell() {
  close(ends_[0]);
  close(ends_[1]);
}

void Bell::ring() noexcept {
  const char one = 1;  // a full pipe rings already
  [[maybe_unused]] const ssize_t written = write(ends_[1], &one, 1);
}

void Bell::silence() noexcept {
  char many[64];
  while (read(ends_[0], many, sizeof many) > 0) {
  }
}

bool Bell::wait(int milliseconds) const noexcept {
  pollfd one{ends_[0], POLLIN, 0};
  return poll(&one, 1, milliseconds) > 0;
}

bool wait_for(int first, int second, int milliseconds) noexcept {
  pollfd two[2] = {{first, POLLIN, 0}, {second, POLLIN, 0}};
  return poll(two, 2, milliseconds) > 0 && two[1].revents != 0;
}

}  // namespace dovetail
