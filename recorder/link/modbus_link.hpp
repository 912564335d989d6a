#pragma once
// Modbus TCP: input registers (FC4) and discrete inputs (FC2), nothing else. The connection is closed after everything
// but a whole answer to the request just sent, so that no answer can be taken for another one.
//
// One poll is one sweep over all ranges and yields one image. When a request of a sweep fails, what was read is kept
// and `partial` says what is missing.

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "recorder/link/link.hpp"
#include "recorder/link/link_memory.hpp"
#include "recorder/link/mbap.hpp"
#include "recorder/link/register_plan.hpp"
#include "recorder/link/socket.hpp"
#include "recorder/link/word_order.hpp"

namespace tacho::recorder {

struct ModbusLinkOptions {
  std::string host;
  std::uint16_t port = 502;
  int unit = 1;                         ///< robot parameter modbusSlaveId; 0 to 247 or 255
  std::optional<WordOrder> word_order;  ///< empty: detect
  Micros relearn_us = 3'600'000'000;    ///< how long a refused address is not asked for again
  std::shared_ptr<LinkMemory> memory;   ///< what earlier links have learned, and where to put more; may be null
  std::shared_ptr<StatusHint> status;   ///< what the robot's status port says, to compare with; may be null
};

class ModbusLink final : public Link {
 public:
  explicit ModbusLink(ModbusLinkOptions options);

  /// `source`: registers or inputs.
  PollResult poll(Source source, std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool connected() const override { return socket_.connected(); }
  void close() override { socket_.close(); }
  void interrupt() override { socket_.interrupt(); }

  [[nodiscard]] const RegisterPlan& plan(Source source) const;
  /// The word order found so far; empty before the first registers answer or when it is configured.
  [[nodiscard]] const std::optional<WordOrderGuess>& word_order() const { return guess_; }
  /// What is added to an address that is sent: 0 when a documented address is sent minus one, as it should be.
  [[nodiscard]] int shift() const { return shift_; }

 private:
  struct Planned {
    RegisterPlan plan;
    Micros learned_us = 0;                             // wall clock, because it outlives a restart
    bool told = false;                                 // a sweep has said what is missing
    std::optional<wire::Range> silent = std::nullopt;  // not answered in the last sweep
    int silences = 0;                                  // ... and in how many in a row, in which others were
  };
  struct Sweep;
  using Buffer = std::array<char, 2 * mbap::kMaxFrameBytes>;  // room to notice a second answer
  struct Exchanged {
    Failure failure;
    mbap::Answer answer;
    std::size_t size = 0;   // of what came
    bool trailing = false;  // bytes behind the answer: this connection is out of step
  };
  Planned& planned(Source source);
  Failure ready(Micros deadline_us);
  PollResult ask(Source source, Micros timeout_us);
  void run(Planned& planned, Sweep& sweep, PollResult& result);
  std::vector<wire::Range> judge_silence(Planned& planned, const Sweep& sweep);
  Exchanged exchange(const mbap::Request& request, Micros deadline_us, Buffer& buffer);
  Reply read(Sweep& sweep, wire::Range range);
  Reply take(Sweep& sweep, wire::Range range, const mbap::Answer& answer);
  Reply refused(Sweep& sweep, wire::Range range, int code);
  Reply unanswered(Sweep& sweep, wire::Range range, std::size_t size, Micros waited_us);
  Reply give_up(Sweep& sweep, Cause cause, std::string why);
  PollResult ask_first_inputs(Micros timeout_us);
  bool detect(PollResult& result);
  void recall();
  void learn();
  [[nodiscard]] std::string known_as() const;

  ModbusLinkOptions options_;
  Socket socket_;
  std::uint16_t transaction_ = 0;
  Planned registers_{RegisterPlan(false)};
  Planned inputs_{RegisterPlan(true)};
  std::optional<WordOrderGuess> guess_;
  std::optional<WordOrder> remembered_;
  int shift_ = 0;         // 0 or 1: a smaller one could not reach the first register
  bool settled_ = false;  // nothing left to detect
  bool placed_ = false;   // registers have been looked at for the shift
  int looks_left_ = 3;    // ... and so often they may fail before inputs are asked for as documented
  unsigned sweeps_until_guess_ = 0;
};

}  // namespace tacho::recorder
