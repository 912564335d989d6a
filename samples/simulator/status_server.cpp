#include "samples/simulator/status_server.hpp"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <optional>

namespace tacho::sim {
namespace {

constexpr std::uint16_t kWrongRequest = 60001;
constexpr std::uint16_t kBadJson = 60002;
constexpr std::uint16_t kStatusPort = 19204;
constexpr std::uint32_t kLargestRequest = 10u << 20;

struct StatusParameters {
  std::vector<std::string> keys;
  bool lasers = true;  // a robot that is not asked otherwise sends them
};

// Empty when the body is not the JSON of request 1100.
std::optional<StatusParameters> parse_parameters(const std::string& body) {
  StatusParameters parameters;
  if (body.empty()) {
    return parameters;
  }
  const auto json = nlohmann::json::parse(body, nullptr, false);
  if (!json.is_object()) {
    return std::nullopt;
  }
  try {
    parameters.keys = json.value("keys", parameters.keys);
    parameters.lasers = json.value("return_laser", true);
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
  return parameters;
}

std::string reply(const wire::FrameHeader& request, std::uint16_t type, std::string_view body) {
  const std::array<std::uint8_t, 6> reserved{static_cast<std::uint8_t>(request.type >> 8),
                                             static_cast<std::uint8_t>(request.type & 0xFF)};
  return wire::encode_frame(request.version, request.sequence, type, body, reserved);
}

}  // namespace

StatusServer::StatusServer(LiveRobot& robot, Descriptor listener, int max_clients)
    : robot_(robot), listener_(std::move(listener)), max_clients_(max_clients), thread_([this] { run(); }) {}

StatusServer::~StatusServer() {
  stop_.signal();
  thread_.join();
}

void StatusServer::run() {
  std::vector<pollfd> fds;
  while (true) {
    fds.assign({{stop_.fd(), POLLIN, 0}, {listener_.get(), POLLIN, 0}});
    for (const Client& client : clients_) {
      fds.push_back({client.socket.get(), POLLIN, 0});
    }
    if (::poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) {
      return;
    }
    if (fds[0].revents != 0) {
      return;
    }
    for (std::size_t i = clients_.size(); i-- > 0;) {
      if (fds[i + 2].revents != 0 && !serve(clients_[i])) {
        clients_.erase(clients_.begin() + static_cast<std::ptrdiff_t>(i));
      }
    }
    if (fds[1].revents != 0) {
      welcome();
    }
  }
}

void StatusServer::welcome() {
  Descriptor socket = accept_client(listener_);
  if (!socket.open()) {
    return;
  }
  if (static_cast<int>(clients_.size()) >= max_clients_) {
    const nlohmann::ordered_json body{
        {"ret_code", 61001}, {"err_msg", "connection limit reached"}, {"limit", max_clients_}, {"port", kStatusPort}};
    send_all(socket, wire::encode_frame(1, 0, kStatusPort, body.dump()));
    return;
  }
  clients_.push_back({std::move(socket), wire::FrameDecoder(kLargestRequest)});
}

// False when the connection is over.
bool StatusServer::serve(Client& client) {
  std::array<char, 16384> buffer;
  const ssize_t got = ::recv(client.socket.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
  if (got < 0) {
    return errno == EAGAIN || errno == EINTR;
  }
  if (got == 0) {
    return false;
  }
  client.decoder.feed({buffer.data(), static_cast<std::size_t>(got)});
  wire::Frame request;
  while (client.decoder.next(request)) {
    if (!answer(client, request)) {
      return false;
    }
  }
  return !client.decoder.bad();
}

bool StatusServer::answer(Client& client, const wire::Frame& request) {
  const std::uint16_t type = request.header.type;
  if (type == wire::kStatusIo) {
    return send_all(client.socket, reply(request.header, wire::answer_type(type), robot_.io()));
  }
  if (type != wire::kStatusAll1) {
    return send_all(client.socket, reply(request.header, kWrongRequest, ""));
  }
  const auto parameters = parse_parameters(request.body);
  if (!parameters) {
    return send_all(client.socket, reply(request.header, kBadJson, ""));
  }
  return send_all(client.socket,
                  reply(request.header, wire::answer_type(type), robot_.status(parameters->keys, parameters->lasers)));
}

}  // namespace tacho::sim
