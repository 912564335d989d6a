#pragma once
// What goes wrong between a robot and whoever asks it. One table of named faults: each makes, from the right answer,
// the script of what happens instead. Pure but for FaultPlan, which knows when.

#include <array>
#include <cstdint>
#include <limits>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "samples/simulator/net.hpp"

namespace tacho::sim {

/// `push` has the faults of `status`.
enum class Port : std::uint8_t { status, modbus, push };
inline constexpr std::array kPorts{Port::status, Port::modbus, Port::push};
std::string_view port_name(Port port);

/// One request and what belongs to it. At the moment a client connects all is empty.
struct Exchange {
  std::string_view request;
  std::string answer;    ///< the right one, a whole frame
  std::string previous;  ///< the one before it on this connection; empty at first
  int nth = 0;           ///< of this connection, from 0
};

struct LinkFault {
  enum class When : std::uint8_t { listening, connecting, answering };
  using Make = Script (*)(const Exchange&);

  std::string_view name;
  std::string_view what;  ///< for --help and the README
  When when = When::answering;
  bool harmless = false;  ///< answers still arrive whole and in time
  Make status = nullptr;  ///< null: does not exist on that port
  Make modbus = nullptr;
  [[nodiscard]] Make on(Port port) const { return port == Port::modbus ? modbus : status; }
};

/// In the order of the README.
std::span<const LinkFault> link_faults();
/// Null when there is none of that name.
const LinkFault* find_link_fault(std::string_view name);

/// A fault from one time to another, in seconds since the robot was switched on.
struct FaultWindow {
  std::string fault;
  std::optional<Port> port;  ///< empty: every port that has it
  double from_s = 0;
  double to_s = std::numeric_limits<double>::infinity();
};

/// "silence", "silence@10..20", "modbus:silence@10..", as on the command line. Throws Error that says what was meant.
FaultWindow parse_fault_window(const std::string& text);
/// Throws Error when the fault or, on its port, is unknown, or the times are none.
void check_fault_window(const FaultWindow& window, const std::string& where);

/// Which fault is on. Thread-safe. The first window that holds now counts.
class FaultPlan {
 public:
  explicit FaultPlan(std::vector<FaultWindow> windows = {});
  /// From now on, whatever the windows say; null: none.
  void set(Port port, const LinkFault* fault);
  [[nodiscard]] const LinkFault* active(Port port) const;

  [[nodiscard]] bool listens(Port port) const;
  /// What happens to a client that has just connected and is never served; empty: it is served.
  [[nodiscard]] std::optional<Script> welcome(Port port) const;
  /// What happens instead of the right answer.
  [[nodiscard]] Script answer(Port port, const Exchange& exchange) const;

 private:
  std::vector<FaultWindow> windows_;
  std::chrono::steady_clock::time_point start_;
  mutable std::mutex mutex_;  // the two below
  std::array<bool, kPorts.size()> overridden_{};
  std::array<const LinkFault*, kPorts.size()> forced_{};
};

}  // namespace tacho::sim
