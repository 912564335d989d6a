#pragma once
// TCP sockets, and the loop that the two servers of a robot share.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace tacho::sim {

/// Owns a file descriptor.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() { reset(); }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    if (this != &other) {
      reset();
      fd_ = std::exchange(other.fd_, -1);
    }
    return *this;
  }
  void reset();
  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool open() const { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

/// A port that is this process's until the end, whether it is listened on or not: while it is not, clients are
/// refused, and nobody else can take it.
class Listener {
 public:
  /// Port 0: any free one. Throws Error naming the address.
  Listener(const std::string& bind, std::uint16_t port);
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] bool listens() const { return socket_.open(); }
  void listen();  ///< throws like the constructor
  void refuse() { socket_.reset(); }
  [[nodiscard]] const Descriptor& socket() const { return socket_; }

 private:
  std::string bind_;
  std::uint16_t port_;
  Descriptor held_;  // bound, never listens
  Descriptor socket_;
};

/// Accepts one waiting client, without blocking; not open when there is none. Sending to it gives up after a second.
Descriptor accept_client(const Descriptor& listener);
/// False when the peer is gone or does not read.
bool send_all(const Descriptor& socket, std::string_view bytes);

/// Wakes a thread that polls.
class Wakeup {
 public:
  Wakeup();
  void signal();
  [[nodiscard]] int fd() const { return event_.get(); }

 private:
  Descriptor event_;
};

/// One thing done to a connection, `after` the one before it (the first: after it was asked for).
struct Action {
  enum class Kind : std::uint8_t { send, half_close, close, reset };
  Kind kind = Kind::send;
  std::string bytes;
  std::chrono::microseconds after{0};
};
/// A whole answer, as a rule one step: send.
using Script = std::vector<Action>;

/// What every client is sent, how often. Empty: nothing.
struct Repeat {
  std::function<Script()> make;
  std::chrono::microseconds period{0};
};

/// Accepts clients and serves them, on one thread from construction to destruction. Steps that wait delay nobody else;
/// they end with their connection.
class ClientLoop {
 public:
  /// Called when a client has sent something or has gone; appends what to do. False when the connection is over.
  using Serve = std::function<bool(const Descriptor& socket, Script& out)>;
  /// Called for a new client with the number of those already there; appends what to do at once.
  using Welcome = std::function<Serve(std::size_t clients, Script& out)>;
  /// Asked often: false refuses new clients and drops those there are. Empty: always true.
  using Open = std::function<bool()>;

  ClientLoop(Listener listener, Welcome welcome, Open open = {}, Repeat repeat = {});
  ~ClientLoop();
  ClientLoop(const ClientLoop&) = delete;
  ClientLoop& operator=(const ClientLoop&) = delete;

 private:
  using Clock = std::chrono::steady_clock;
  struct Due {
    Action step;
    Clock::time_point at;
  };
  struct Client {
    Descriptor socket;
    Serve serve;
    std::deque<Due> steps;
  };

  Listener listener_;
  Welcome welcome_;
  Open open_;
  Repeat repeat_;
  Clock::time_point repeat_at_ = Clock::now();
  Wakeup stop_;
  std::vector<Client> clients_;
  std::jthread thread_;  // last: joined before the rest goes

  void run();
  void open_or_refuse();
  void repeat();
  void accept_one();
  [[nodiscard]] int patience_ms() const;
  static void append(Script script, Client& client);
  [[nodiscard]] static bool act(Client& client);
};

/// Serves a client by not listening to it; over when it goes.
bool ignore_client(const Descriptor& socket, Script& out);

}  // namespace tacho::sim
