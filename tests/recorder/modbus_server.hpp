#pragma once
// libmodbus' own server side over test memory, with refusals and silences on demand.

#include <modbus/modbus.h>

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "tests/recorder/tiny_server.hpp"

namespace tacho::recorder::test {

/// One request as it came in; addresses as documented, from 1.
struct Asked {
  int function = 0;
  int first = 0;
  int count = 0;
  [[nodiscard]] bool holds(int address) const { return address >= first && address < first + count; }
};

/// 0 = answer, 1..11 = that exception, -1 = stay silent, -2 = close the connection.
using Decide = std::function<int(const Asked&)>;

class ModbusServer {
 public:
  explicit ModbusServer(Decide decide, std::uint16_t port = 0)
      : decide_(std::move(decide)),
        mapping_(modbus_mapping_new(0, 200, 0, 200)),
        server_([this](Peer& peer, int) { serve(peer); }, port) {
    for (int i = 0; i < 200; ++i) {
      mapping_->tab_input_registers[i] = static_cast<std::uint16_t>(i + 1);
      mapping_->tab_input_bits[i] = static_cast<std::uint8_t>(i % 3 == 0);
    }
  }
  [[nodiscard]] std::uint16_t port() const { return server_.port(); }
  [[nodiscard]] int connections() const { return server_.connections(); }
  /// Everything asked so far; cleared by the call.
  std::vector<Asked> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(asked_, {});
  }
  /// Before the first poll only: the server thread reads it.
  void set_register(int address, std::uint16_t value) { mapping_->tab_input_registers[address - 1] = value; }

 private:
  void serve(Peer& peer) {
    const std::unique_ptr<modbus_t, void (*)(modbus_t*)> context(modbus_new_tcp(nullptr, 0), modbus_free);
    modbus_set_socket(context.get(), peer.fd());
    modbus_set_indication_timeout(context.get(), 0, 0);
    // Seven header bytes, then the length they announce: read by hand so that the server can be stopped.
    for (std::string head = peer.read(7); head.size() == 7; head = peer.read(7)) {
      const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(head[i]); };
      const std::string rest = peer.read(static_cast<std::size_t>(byte(4) << 8 | byte(5)) - 1);
      std::vector<std::uint8_t> query(head.begin(), head.end());
      query.insert(query.end(), rest.begin(), rest.end());
      if (query.size() < 12) {
        return;
      }
      const Asked asked{query[7], (query[8] << 8 | query[9]) + 1, query[10] << 8 | query[11]};
      {
        const std::lock_guard lock(mutex_);
        asked_.push_back(asked);
      }
      const int what = decide_(asked);
      if (what == -2) {
        return;
      }
      if (what > 0) {
        modbus_reply_exception(context.get(), query.data(), static_cast<unsigned>(what));
      } else if (what == 0) {
        modbus_reply(context.get(), query.data(), static_cast<int>(query.size()), mapping_.get());
      }
    }
  }

  Decide decide_;
  struct FreeMapping {
    void operator()(modbus_mapping_t* m) const { modbus_mapping_free(m); }
  };
  std::unique_ptr<modbus_mapping_t, FreeMapping> mapping_;
  std::mutex mutex_;
  std::vector<Asked> asked_;
  TinyServer server_;  // last: its thread uses everything above
};

}  // namespace tacho::recorder::test
