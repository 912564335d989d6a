#include "samples/simulator/status_server.hpp"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <iterator>
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

StatusServer::StatusServer(LiveRobot& robot, const FaultPlan& faults, Listener listener, int max_clients)
    : robot_(robot),
      faults_(faults),
      max_clients_(max_clients),
      loop_(
          std::move(listener), [this](std::size_t clients, Script& out) { return welcome(clients, out); },
          [this] { return faults_.listens(Port::status); }) {}

ClientLoop::Serve StatusServer::welcome(std::size_t clients, Script& out) {
  if (auto script = faults_.welcome(Port::status)) {
    out = std::move(*script);
    return ignore_client;
  }
  if (static_cast<int>(clients) >= max_clients_) {
    const nlohmann::ordered_json body{
        {"ret_code", 61001}, {"err_msg", "connection limit reached"}, {"limit", max_clients_}, {"port", kStatusPort}};
    out.push_back({Action::Kind::send, wire::encode_frame(1, 0, kStatusPort, body.dump()), {}});
    out.push_back({Action::Kind::close, {}, {}});
    return ignore_client;
  }
  return [this, client = Client{wire::FrameDecoder(kLargestRequest), {}, 0}](
             const Descriptor& socket, Script& script) mutable { return serve(socket, client, script); };
}

// False when the connection is over.
bool StatusServer::serve(const Descriptor& socket, Client& client, Script& out) {
  std::array<char, 16384> buffer;
  const ssize_t got = ::recv(socket.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
  if (got < 0) {
    return errno == EAGAIN || errno == EINTR;
  }
  if (got == 0) {
    return false;
  }
  client.decoder.feed({buffer.data(), static_cast<std::size_t>(got)});
  wire::Frame request;
  while (client.decoder.next(request)) {
    std::string right = answer(request);
    Script script = faults_.answer(Port::status, {request.body, right, client.previous, client.answers++});
    std::move(script.begin(), script.end(), std::back_inserter(out));
    client.previous = std::move(right);
  }
  return !client.decoder.bad();
}

std::string StatusServer::answer(const wire::Frame& request) {
  const std::uint16_t type = request.header.type;
  if (type == wire::kStatusIo) {
    return reply(request.header, wire::answer_type(type), robot_.io());
  }
  if (type != wire::kStatusAll1) {
    return reply(request.header, kWrongRequest, "");
  }
  const auto parameters = parse_parameters(request.body);
  if (!parameters) {
    return reply(request.header, kBadJson, "");
  }
  return reply(request.header, wire::answer_type(type), robot_.status(parameters->keys, parameters->lasers));
}

}  // namespace tacho::sim
