#include "samples/simulator/modbus_server.hpp"

#include <modbus/modbus.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "schema/error.hpp"

namespace tacho::sim {
namespace {

constexpr int kReadDiscreteInputs = 2;
constexpr int kReadInputRegisters = 4;
constexpr std::size_t kUnitAt = 6;
constexpr std::size_t kFunctionAt = 7;
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

  Protocol() {
    if (!context || !mapping) {
      throw Error("cannot serve Modbus", modbus_strerror(errno), "");
    }
    modbus_set_indication_timeout(context.get(), 1, 0);
  }
};

ModbusServer::ModbusServer(LiveRobot& robot, Descriptor listener)
    : robot_(robot),
      protocol_(std::make_unique<Protocol>()),
      loop_(std::move(listener), [this](const Descriptor&, std::size_t) -> ClientLoop::Serve {
        return [this](const Descriptor& client) { return serve(client); };
      }) {}

ModbusServer::~ModbusServer() = default;

// False when the connection is over.
bool ModbusServer::serve(const Descriptor& client) {
  modbus_t* context = protocol_->context.get();
  modbus_mapping_t* mapping = protocol_->mapping.get();
  std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
  modbus_set_socket(context, client.get());
  const int size = modbus_receive(context, request.data());
  if (size <= 0) {
    return size == 0;
  }
  const int unit = robot_.scenario().modbus_unit;
  if (unit >= 0 && request[kUnitAt] != unit) {
    return true;
  }
  switch (request[kFunctionAt]) {
    case kReadInputRegisters: {
      const auto words = robot_.registers();
      std::copy(words.begin(), words.end(), mapping->tab_input_registers);
      return modbus_reply(context, request.data(), size, mapping) >= 0;
    }
    case kReadDiscreteInputs: {
      const auto bits = robot_.inputs();
      std::copy(bits.begin(), bits.end(), mapping->tab_input_bits);
      return modbus_reply(context, request.data(), size, mapping) >= 0;
    }
    default:
      return modbus_reply_exception(context, request.data(), MODBUS_EXCEPTION_ILLEGAL_FUNCTION) >= 0;
  }
}

}  // namespace tacho::sim
