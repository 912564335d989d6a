// Every fault of the simulator on every port that has it: nothing unaccounted for, nothing wrong, soon well again.

#include <fmt/format.h>

#include <mutex>
#include <set>
#include <thread>

#include "recorder/link/modbus_link.hpp"
#include "recorder/link/push_link.hpp"
#include "recorder/link/tcp_link.hpp"
#include "recorder/poller.hpp"
#include "samples/simulator/serve.hpp"
#include "schema/fields.hpp"
#include "schema/time.hpp"
#include "schema/wire/requests.hpp"
#include "schema/wire/status_json.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace std::chrono_literals;

namespace {

constexpr auto kTimeout = 200ms;  // shorter than the delay of late answers
constexpr Micros kPeriod = 50'000;
constexpr auto kFaultLasts = 500ms;
constexpr Micros kSettling = 20'000;  // an answer asked for this long after the start of a fault has met it
constexpr auto kPatience = 60s;       // of a machine that does other things
constexpr std::size_t kAtOnce = 16;
// The issue says one second. This is a test on a machine that may be busy; the law of one second itself is tested in
// virtual time (poller_test) and the worst case here is printed.
constexpr double kBackWithinS = 5;

/// Rows of one poller, readable while it runs.
class SharedSink final : public Sink {
 public:
  [[nodiscard]] bool answer(Answer a, const std::optional<Gap>& before) override {
    const std::lock_guard lock(mutex_);
    if (before) {
      gaps_.push_back(*before);
    }
    answers_.push_back(std::move(a));
    return true;
  }
  void gap(const Gap& g) override {
    const std::lock_guard lock(mutex_);
    gaps_.push_back(g);
  }
  void event(const Event&) override {}
  void word_order(RobotId, Source, WordOrder) override {}

  [[nodiscard]] std::vector<Answer> answers() const {
    const std::lock_guard lock(mutex_);
    return answers_;
  }
  [[nodiscard]] std::vector<Gap> gaps() const {
    const std::lock_guard lock(mutex_);
    return gaps_;
  }
  /// Receive time of the first answer that was asked for after `since_us`.
  [[nodiscard]] std::optional<Micros> first_since(Micros since_us) const {
    const std::lock_guard lock(mutex_);
    const auto found = std::find_if(answers_.begin(), answers_.end(),
                                    [since_us](const Answer& a) { return a.meta.t_send_us >= since_us; });
    return found == answers_.end() ? std::nullopt : std::optional(found->meta.t_recv_us);
  }

 private:
  mutable std::mutex mutex_;
  std::vector<Answer> answers_;
  std::vector<Gap> gaps_;
};

struct FaultCell {
  const sim::LinkFault* fault = nullptr;
  sim::Port port = sim::Port::status;
  [[nodiscard]] std::string name() const { return fmt::format("{}:{}", sim::port_name(port), fault->name); }
};

/// What became of a cell; told to Catch in the main thread.
struct Outcome {
  std::string trouble;  ///< empty: all is well
  double back_s = 0;
};

std::unique_ptr<Link> link_to(const sim::Server& server, sim::Port port) {
  if (port == sim::Port::status) {
    wire::StatusRequest request;
    request.keys = {"vehicle_id", "odo"};  // short answers, also for a fault that sends every byte alone
    return std::make_unique<TcpLink>(
        TcpLinkOptions{"127.0.0.1", server.status_port(0), 1, wire::status_request_body(request), nullptr});
  }
  if (port == sim::Port::push) {
    return std::make_unique<PushLink>("127.0.0.1", server.push_port(0));
  }
  ModbusLinkOptions options;
  options.host = "127.0.0.1";
  options.port = server.modbus_port(0);
  return std::make_unique<ModbusLink>(options);
}

/// Each planned poll once among answers and gaps; empty when so.
std::string accounts(const Poller& poller, const SharedSink& sink) {
  for (std::size_t i = 0; i < poller.options().sources.size(); ++i) {
    const Source source = poller.options().sources[i].source;
    const SourceCounters& counters = poller.counters(i);
    std::vector<int> seen(counters.planned.load(), 0);
    for (const Answer& a : sink.answers()) {
      if (a.meta.source == source) {
        ++seen.at(a.meta.seq);
      }
    }
    for (const Gap& g : sink.gaps()) {
      for (std::uint64_t k = 0; g.source == source && !g.partial && k < g.seq_count; ++k) {
        ++seen.at(g.seq_from + k);
      }
    }
    const bool once = std::all_of(seen.begin(), seen.end(), [](int n) { return n == 1; });
    if (!once || counters.stored + counters.missed_total() != counters.planned) {
      return fmt::format("{}: {} planned, {} stored, {} missed", source_name(source), counters.planned.load(),
                         counters.stored.load(), counters.missed_total());
    }
  }
  return {};
}

/// A value that is not the robot's; empty when there is none.
std::string wrong_value(const Answer& answer, const std::string& robot) {
  Sample sample;
  if (source_info(answer.meta.source).whole) {
    wire::JsonDecoder().decode(answer.body, FieldSet().set(), true, sample);
    const bool own = !sample.decodable || sample.text(field("vehicle_id")) == robot ||
                     answer.body.find("\xFF\xFE") != std::string::npos;
    return own && sample.unknown_keys.empty()
               ? ""
               : std::string(source_name(answer.meta.source)) + ": " + answer.body.substr(0, 100);
  }
  const auto is = [&](std::string_view name, std::int64_t value) {
    const FieldIndex f = find_field(name);
    return sample.at(f).state == State::absent || sample.at(f).integer == value;  // absent: that range is a gap
  };
  Gates gates;
  if (answer.meta.source == Source::inputs) {
    wire::decode_inputs(answer.body, FieldSet().set(), gates, sample);
    return sample.decodable && is("is_stop", 1) && is("blocked", 0) && is("emergency", 0) ? "" : "inputs";
  }
  wire::decode_registers(answer.body, WordOrder::cdab, gates, FieldSet().set(), sample);
  const double volts = sample.at(field("voltage")).real;
  const bool fine = sample.decodable && is("ip_1", 127) && is("ip_2", 0) && is("ip_4", 1) &&
                    (sample.at(field("voltage")).state == State::absent || (volts > 30 && volts < 70));
  return fine ? "" : "registers";
}

template <class Done>
bool wait_for(Done done) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (!done()) {
    if (std::chrono::steady_clock::now() > end) {
      return false;
    }
    std::this_thread::sleep_for(5ms);
  }
  return true;
}

/// Good, then the fault for a while, then good again.
Outcome run_cell(const FaultCell& cell) {
  sim::Scenario scenario;
  scenario.name = "amr";
  scenario.always_idle = true;
  sim::ServeOptions serving;
  serving.push_period_us = kPeriod;
  sim::Server server({{scenario, 0, 0, 0}}, serving);
  SharedSink sink;
  HostClock clock;
  PollerOptions options;
  options.robot = 1;
  options.session = 1;
  options.timeout = kTimeout;
  options.spacing_us = 0;
  options.sources = {{Source::status, kPeriod, 0}};
  if (cell.port == sim::Port::modbus) {
    options.sources = {{Source::registers, kPeriod, 0}, {Source::inputs, kPeriod, kPeriod / 2}};
  }
  if (cell.port == sim::Port::push) {
    options.sources = {{Source::push, kPeriod, 0}};
  }
  Poller poller(std::move(options), link_to(server, cell.port), clock, sink);
  std::thread thread([&] { poller.run(mono_now_us(), mono_now_us() + 3'600'000'000); });

  Outcome out;
  const bool began = wait_for([&] { return sink.answers().size() >= 3; });
  const Micros from_us = wall_now_us();
  server.fault(0, cell.port, cell.fault);
  std::this_thread::sleep_for(kFaultLasts);
  const bool heard =
      !cell.fault->harmless || wait_for([&] { return sink.first_since(from_us + kSettling).has_value(); });
  server.fault(0, cell.port, nullptr);
  const Micros to_us = wall_now_us();
  const bool back = wait_for([&] { return sink.first_since(to_us).has_value(); });
  clock.stop();
  poller.interrupt();
  thread.join();

  out.trouble = !began ? "never began" : !back ? "never came back" : accounts(poller, sink);
  out.back_s = back ? static_cast<double>(*sink.first_since(to_us) - to_us) / 1e6 : 0;
  for (const Answer& answer : sink.answers()) {
    const std::string wrong = wrong_value(answer, scenario.name);
    out.trouble += wrong.empty() ? "" : " wrong " + wrong;
  }
  out.trouble += heard ? "" : " is called harmless, but cost every answer";
  return out;
}

std::vector<FaultCell> all_cells() {
  std::vector<FaultCell> cells;
  for (const sim::LinkFault& fault : sim::link_faults()) {
    for (const sim::Port port : sim::kPorts) {
      const bool right = port == sim::Port::push && fault.name == "unasked";  // it is a push
      if (fault.on(port) != nullptr && !right) {
        cells.push_back({&fault, port});
      }
    }
  }
  return cells;
}

}  // namespace

TEST_CASE(
    "under every fault of all three ports no poll is lost from the accounts, no value is wrong, and the robot is back "
    "at "
    "once") {
  const std::vector<FaultCell> cells = all_cells();
  std::set<std::string_view> names;
  for (const FaultCell& cell : cells) {
    names.insert(cell.fault->name);
  }
  CHECK(names.size() >= 30);
  CHECK(cells.size() >= 140);
  Outcome worst;
  std::string worst_name;
  for (std::size_t at = 0; at < cells.size(); at += kAtOnce) {
    const std::size_t end = std::min(at + kAtOnce, cells.size());
    std::vector<Outcome> outcomes(end - at);
    std::vector<std::thread> threads;
    for (std::size_t i = at; i < end; ++i) {
      threads.emplace_back([&, i] { outcomes[i - at] = run_cell(cells[i]); });
    }
    for (std::size_t i = at; i < end; ++i) {
      threads[i - at].join();
      const Outcome& outcome = outcomes[i - at];
      INFO(cells[i].name() << " was back after " << outcome.back_s << " s: " << outcome.trouble);
      CHECK(outcome.trouble.empty());
      CHECK(outcome.back_s < kBackWithinS);
      if (outcome.back_s > worst.back_s) {
        worst = outcome;
        worst_name = cells[i].name();
      }
    }
  }
  fmt::print("{} faults, {} cells; the slowest return is {}, {:.2f} s\n", names.size(), cells.size(), worst_name,
             worst.back_s);
}

TEST_CASE("a fault window of the command line is read, and mistakes in it are named") {
  const sim::FaultWindow window = sim::parse_fault_window("modbus:silence@1.5..20");
  CHECK(window.fault == "silence");
  CHECK(window.port == sim::Port::modbus);
  CHECK(window.from_s == 1.5);
  CHECK(window.to_s == 20);
  CHECK(sim::parse_fault_window("late").from_s == 0);
  CHECK(std::isinf(sim::parse_fault_window("late@3..").to_s));
  using Catch::Matchers::Contains;
  CHECK_THROWS_WITH(sim::parse_fault_window("silense"), Contains("silence"));
  CHECK_THROWS_WITH(sim::parse_fault_window("modbus:no_json"), Contains("modbus"));
  CHECK_THROWS_WITH(sim::parse_fault_window("late@5..2"), Contains("ends before"));
  CHECK_THROWS_WITH(sim::parse_fault_window("late@x"), Contains("no time"));
}

TEST_CASE("a fault of a scenario is on between its times and off outside") {
  sim::FaultPlan plan({{"silence", sim::Port::modbus, 0, 1e9}, {"reset", {}, 1e9, 2e9}});
  REQUIRE(plan.active(sim::Port::modbus) != nullptr);
  CHECK(plan.active(sim::Port::modbus)->name == "silence");
  CHECK(plan.active(sim::Port::status) == nullptr);
  CHECK(plan.answer(sim::Port::modbus, {{}, "x", {}, 0}).empty());
  CHECK(plan.answer(sim::Port::status, {{}, "x", {}, 0}).at(0).bytes == "x");
  plan.set(sim::Port::modbus, nullptr);
  CHECK(plan.active(sim::Port::modbus) == nullptr);
}
