#pragma once
// A robot both of whose ports answer with what shows which request the answer belongs to, and lie about it at random.

#include <sys/socket.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "recorder/link/mbap.hpp"
#include "samples/simulator/link_faults.hpp"
#include "samples/simulator/net.hpp"
#include "schema/wire/frame.hpp"

namespace tacho::recorder::test {

/// What register `address` (documented) holds in the answer to the `id`th request of the robot.
inline std::uint16_t echo_word(std::uint64_t id, unsigned address) {
  return static_cast<std::uint16_t>(id + 7919u * address);
}
inline std::string echo_body(std::uint64_t id) { return "{\"request\":" + std::to_string(id) + "}"; }

class EchoRobot {
 public:
  /// `share` of all answers is replaced by one of `faults`; their delays are divided by 100.
  EchoRobot(sim::Port port, std::vector<std::string_view> faults, double share)
      : port_(port),
        faults_(std::move(faults)),
        share_(share),
        listener_("127.0.0.1", 0),
        tcp_port_(listener_.port()),
        loop_(std::move(listener_), [this](std::size_t, sim::Script&) -> sim::ClientLoop::Serve {
          return [this, client = Client()](const sim::Descriptor& socket, sim::Script& out) mutable {
            return serve(socket, client, out);
          };
        }) {}

  [[nodiscard]] std::uint16_t port() const { return tcp_port_; }
  /// Number of the last request that arrived, from 1.
  [[nodiscard]] std::uint64_t last() const { return last_; }
  [[nodiscard]] std::uint64_t lies() const { return lies_; }

 private:
  struct Client {
    std::string bytes;
    std::string previous;
    int answers = 0;
  };

  bool serve(const sim::Descriptor& socket, Client& client, sim::Script& out) {
    std::array<char, 4096> buffer;
    const ssize_t got = ::recv(socket.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (got <= 0) {
      return got < 0 && (errno == EAGAIN || errno == EINTR);
    }
    client.bytes.append(buffer.data(), static_cast<std::size_t>(got));
    for (std::string request = next(client.bytes); !request.empty(); request = next(client.bytes)) {
      const std::uint64_t id = last_ + 1;
      std::string right = port_ == sim::Port::status ? status_answer(request, id) : modbus_answer(request, id);
      last_ = id;
      sim::Script script = reply({request, right, client.previous, client.answers++});
      out.insert(out.end(), script.begin(), script.end());
      client.previous = std::move(right);
    }
    return true;
  }

  /// Takes one whole request from the front; empty when there is none.
  [[nodiscard]] std::string next(std::string& bytes) const {
    const auto byte = [&](std::size_t at) { return static_cast<std::size_t>(static_cast<unsigned char>(bytes[at])); };
    const bool status = port_ == sim::Port::status;
    const std::size_t head = status ? wire::kHeaderBytes : mbap::kHeaderBytes;
    if (bytes.size() < head) {
      return {};
    }
    const std::size_t size = status ? head + (byte(6) << 8 | byte(7)) : 6 + (byte(4) << 8 | byte(5));
    if (bytes.size() < size) {
      return {};
    }
    std::string out = bytes.substr(0, size);
    bytes.erase(0, size);
    return out;
  }

  static std::string status_answer(std::string_view request, std::uint64_t id) {
    const auto word = [&](std::size_t at) {
      return static_cast<std::uint16_t>(static_cast<unsigned char>(request[at]) << 8 |
                                        static_cast<unsigned char>(request[at + 1]));
    };
    return wire::encode_frame(1, word(2), wire::answer_type(word(8)), echo_body(id));
  }

  static std::string modbus_answer(std::string_view request, std::uint64_t id) {
    const auto byte = [&](std::size_t at) { return static_cast<unsigned>(static_cast<unsigned char>(request[at])); };
    const unsigned first = (byte(8) << 8 | byte(9)) + 1;
    const unsigned count = byte(10) << 8 | byte(11);
    std::string words;
    for (unsigned a = first; a < first + count; ++a) {
      words += static_cast<char>(echo_word(id, a) >> 8);
      words += static_cast<char>(echo_word(id, a) & 0xFF);
    }
    const auto length = static_cast<unsigned>(words.size() + 3);
    return std::string(request.substr(0, 4)) + static_cast<char>(length >> 8) + static_cast<char>(length & 0xFF) +
           std::string(request.substr(6, 2)) + static_cast<char>(words.size()) + words;
  }

  sim::Script reply(const sim::Exchange& exchange) {
    sim::Script script{{sim::Action::Kind::send, exchange.answer, {}}};
    // The first answer of a connection is never a lie: three in a row that are would make a robot that does not echo.
    if (exchange.nth > 0 && chance_(random_) < share_) {
      const std::string_view name = faults_[random_() % faults_.size()];
      script = sim::find_link_fault(name)->on(port_)(exchange);
      ++lies_;
    }
    for (sim::Action& step : script) {
      step.after /= 100;
    }
    return script;
  }

  sim::Port port_;
  std::vector<std::string_view> faults_;
  double share_;
  std::atomic<std::uint64_t> last_{0};
  std::atomic<std::uint64_t> lies_{0};
  std::mt19937 random_{42};
  std::uniform_real_distribution<> chance_{0, 1};
  sim::Listener listener_;
  std::uint16_t tcp_port_;
  sim::ClientLoop loop_;  // last: its thread uses everything above
};

}  // namespace tacho::recorder::test
