#include "samples/simulator/status_server.hpp"

#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

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
    : robot_(robot),
      max_clients_(max_clients),
      loop_(std::move(listener), [this](const auto& client, std::size_t n) { return welcome(client, n); }) {}

ClientLoop::Serve StatusServer::welcome(const Descriptor& client, std::size_t clients) {
  if (static_cast<int>(clients) >= max_clients_) {
    const nlohmann::ordered_json body{
        {"ret_code", 61001}, {"err_msg", "connection limit reached"}, {"limit", max_clients_}, {"port", kStatusPort}};
    send_all(client, wire::encode_frame(1, 0, kStatusPort, body.dump()));
    return {};
  }
  return [this, decoder = wire::FrameDecoder(kLargestRequest)](const Descriptor& socket) mutable {
    return serve(socket, decoder);
  };
}

// False when the connection is over.
bool StatusServer::serve(const Descriptor& client, wire::FrameDecoder& decoder) {
  std::array<char, 16384> buffer;
  const ssize_t got = ::recv(client.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
  if (got < 0) {
    return errno == EAGAIN || errno == EINTR;
  }
  if (got == 0) {
    return false;
  }
  decoder.feed({buffer.data(), static_cast<std::size_t>(got)});
  wire::Frame request;
  while (decoder.next(request)) {
    if (!answer(client, request)) {
      return false;
    }
  }
  return !decoder.bad();
}

bool StatusServer::answer(const Descriptor& client, const wire::Frame& request) {
  const std::uint16_t type = request.header.type;
  if (type == wire::kStatusIo) {
    return send_all(client, reply(request.header, wire::answer_type(type), robot_.io()));
  }
  if (type != wire::kStatusAll1) {
    return send_all(client, reply(request.header, kWrongRequest, ""));
  }
  const auto parameters = parse_parameters(request.body);
  if (!parameters) {
    return send_all(client, reply(request.header, kBadJson, ""));
  }
  return send_all(client,
                  reply(request.header, wire::answer_type(type), robot_.status(parameters->keys, parameters->lasers)));
}

}  // namespace tacho::sim
