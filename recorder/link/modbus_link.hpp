#pragma once
// Modbus TCP: input registers (FC4) and discrete inputs (FC2), nothing else. libmodbus codes the frames; connecting,
// deadlines and recovery are ours (RECORDER-LESSONS: its own recovery sleeps inside the library, its own connect has no
// usable deadline, and a socket kept after a timeout yields wrong answers for ever).
//
// One poll is one sweep over all ranges and yields one image. When a request of a sweep fails, what was read is kept
// and `partial` says what is missing.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "recorder/link/link.hpp"
#include "recorder/link/register_plan.hpp"
#include "recorder/link/socket.hpp"
#include "recorder/link/word_order.hpp"

struct _modbus;

namespace tacho::recorder {

struct ModbusLinkOptions {
  std::string host;
  std::uint16_t port = 502;
  int unit = 1;                         ///< robot parameter modbusSlaveId; 0 to 247 or 255
  std::optional<WordOrder> word_order;  ///< empty: detect
  Micros relearn_us = 3'600'000'000;    ///< how long a refused address is not asked for again
};

class ModbusLink final : public Link {
 public:
  explicit ModbusLink(ModbusLinkOptions options);
  ~ModbusLink() override;

  /// `source`: registers or inputs.
  PollResult poll(Source source, std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool connected() const override { return socket_.connected(); }
  void close() override;
  void interrupt() override { socket_.interrupt(); }

  [[nodiscard]] const RegisterPlan& plan(Source source) const;
  /// The word order found so far; empty before the first registers answer or when it is configured.
  [[nodiscard]] const std::optional<WordOrderGuess>& word_order() const { return guess_; }

 private:
  struct Planned {
    RegisterPlan plan;
    Micros learned_us = 0;
  };
  struct Sweep;
  Planned& planned(Source source);
  bool ready(Micros deadline_us, PollResult& result);
  void run(Planned& planned, Sweep& sweep, PollResult& result);
  Reply read(Sweep& sweep, wire::Range range);
  Reply refuse(Sweep& sweep, wire::Range range, int error);
  void detect(PollResult& result);

  struct Free {
    void operator()(_modbus* context) const;
  };
  ModbusLinkOptions options_;
  Socket socket_;
  std::unique_ptr<_modbus, Free> context_;
  Planned registers_{RegisterPlan(false), 0};
  Planned inputs_{RegisterPlan(true), 0};
  std::optional<WordOrderGuess> guess_;
  unsigned sweeps_until_guess_ = 0;
};

}  // namespace tacho::recorder
