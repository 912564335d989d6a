#include "samples/simulator/modbus_server.hpp"

#include <modbus/modbus.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "schema/error.hpp"

namespace tacho::sim {
namespace {

constexpr int kReadDiscreteInputs = 2;
constexpr int kReadInputRegisters = 4;
constexpr std::size_t kUnitAt = 6;
constexpr std::size_t kRequestFunctionAt = 7;
constexpr int kInputs = 80;
constexpr int kRegisters = 140;

struct FreeContext {
  void operator()(modbus_t* context) const { modbus_free(context); }  // the sockets are ours
};
struct FreeMapping {
  void operator()(modbus_mapping_t* mapping) const { modbus_mapping_free(mapping); }
};

}  // namespace

struct ModbusServer::Protocol {
  std::unique_ptr<modbus_t, FreeContext> context{modbus_new_tcp("127.0.0.1", 502)};
  std::unique_ptr<modbus_mapping_t, FreeMapping> mapping{modbus_mapping_new(0, kInputs, 0, kRegisters)};

  // libmodbus writes its answers here, where they can be read before a client sees them.
  std::array<Descriptor, 2> pipe;

  Protocol() {
    std::array<int, 2> ends{};
    if (!context || !mapping || ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
      throw Error("cannot serve Modbus", modbus_strerror(errno), "");
    }
    pipe = {Descriptor(ends[0]), Descriptor(ends[1])};
    modbus_set_indication_timeout(context.get(), 1, 0);
  }
};

ModbusServer::ModbusServer(LiveRobot& robot, const FaultPlan& faults, Listener listener)
    : robot_(robot),
      faults_(faults),
      protocol_(std::make_unique<Protocol>()),
      loop_(
          std::move(listener), [this](std::size_t, Script& out) { return welcome(out); },
          [this] { return faults_.listens(Port::modbus); }) {}

ModbusServer::~ModbusServer() = default;

ClientLoop::Serve ModbusServer::welcome(Script& out) {
  if (auto script = faults_.welcome(Port::modbus)) {
    out = std::move(*script);
    return ignore_client;
  }
  return [this, client = Client()](const Descriptor& socket, Script& script) mutable {
    return serve(socket, client, script);
  };
}

// False when the connection is over.
bool ModbusServer::serve(const Descriptor& socket, Client& client, Script& out) {
  modbus_t* context = protocol_->context.get();
  std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
  modbus_set_socket(context, socket.get());
  const int size = modbus_receive(context, request.data());
  if (size <= 0) {
    return size == 0;
  }
  const int unit = robot_.scenario().modbus_unit;
  if (unit >= 0 && request[kUnitAt] != unit) {
    return true;
  }
  std::string right = answer(std::span(request).first(static_cast<std::size_t>(size)));
  out = faults_.answer(Port::modbus, {{}, right, client.previous, client.answers++});
  client.previous = std::move(right);
  return true;
}

std::string ModbusServer::answer(std::span<const std::uint8_t> request) {
  modbus_t* context = protocol_->context.get();
  modbus_mapping_t* mapping = protocol_->mapping.get();
  modbus_set_socket(context, protocol_->pipe[0].get());
  const auto size = static_cast<int>(request.size());
  switch (request[kRequestFunctionAt]) {
    case kReadInputRegisters: {
      const auto words = robot_.registers();
      std::copy(words.begin(), words.end(), mapping->tab_input_registers);
      modbus_reply(context, request.data(), size, mapping);
      break;
    }
    case kReadDiscreteInputs: {
      const auto bits = robot_.inputs();
      std::copy(bits.begin(), bits.end(), mapping->tab_input_bits);
      modbus_reply(context, request.data(), size, mapping);
      break;
    }
    default:
      modbus_reply_exception(context, request.data(), MODBUS_EXCEPTION_ILLEGAL_FUNCTION);
  }
  std::string out(MODBUS_TCP_MAX_ADU_LENGTH, '\0');
  const ssize_t got = ::recv(protocol_->pipe[1].get(), out.data(), out.size(), MSG_DONTWAIT);
  out.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
  return out;
}

}  // namespace tacho::sim
