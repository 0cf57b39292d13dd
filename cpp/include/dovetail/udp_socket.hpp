/// A bound UDP socket (IPv4), and a bell that one thread rings for another.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace dovetail {

/// Where a datagram came from; network byte order.
struct Peer {
  std::uint32_t address = 0;
  std::uint16_t port = 0;
  bool operator==(const Peer&) const noexcept = default;
};

std::string describe(const Peer& peer);

/// The number of an IPv4 address, network byte order; 0 for "".
/// Throws std::invalid_argument: not of the form 192.168.0.1.
std::uint32_t address_number(const std::string& text);

struct Datagram {
  std::size_t size = 0;  ///< 0 for an empty one
  Peer source;
  double waited = 0.0;  ///< from its arrival in the kernel until now [s]
};

class UdpSocket {
 public:
  /// \param address  "0.0.0.0" for every interface; port 0 takes a free one
  /// Throws std::system_error: port in use, no permission, no such address.
  UdpSocket(const std::string& address, std::uint16_t port);
  ~UdpSocket();
  UdpSocket(const UdpSocket&) = delete;
  UdpSocket& operator=(const UdpSocket&) = delete;

  /// Takes one datagram if there is one; what does not fit in `capacity` is cut.
  bool receive(std::uint8_t* bytes, std::size_t capacity, Datagram& datagram) noexcept;

  /// Whether a datagram of this source is the next that `receive` would give.
  bool has_next_of(const Peer& source) const noexcept;

  bool send(const std::uint8_t* bytes, std::size_t size, const Peer& to) noexcept;

  /// Frees the port at once; nothing is received or sent after it.
  void release() noexcept;

  int descriptor() const noexcept { return descriptor_; }
  std::uint16_t port() const noexcept { return port_; }

 private:
  int descriptor_ = -1;
  std::uint16_t port_ = 0;
};

/// Wakes a thread that waits for a descriptor, or for a time.
class Bell {
 public:
  Bell();
  ~Bell();
  Bell(const Bell&) = delete;
  Bell& operator=(const Bell&) = delete;

  void ring() noexcept;                        ///< any thread; never waits
  void silence() noexcept;                     ///< forgets the rings so far
  bool wait(int milliseconds) const noexcept;  ///< whether it rings
  int descriptor() const noexcept { return ends_[0]; }

 private:
  int ends_[2];
};

/// Waits until one of two descriptors can be read, or the time is over. \returns
/// whether the second can.
bool wait_for(int first, int second, int milliseconds) noexcept;

}  // namespace dovetail
