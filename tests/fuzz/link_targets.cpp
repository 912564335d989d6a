#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "recorder/config.hpp"
#include "recorder/link/link_memory.hpp"
#include "recorder/link/mbap.hpp"
#include "recorder/link/register_plan.hpp"
#include "schema/fields.hpp"
#include "tests/fuzz/targets.hpp"

namespace tacho::fuzz {

namespace {

using namespace recorder;

void law(bool holds, const char* words) {
  if (!holds) {
    std::fprintf(stderr, "law broken: %s\n", words);
    std::abort();
  }
}

unsigned byte(std::string_view bytes, std::size_t at) {
  return at < bytes.size() ? static_cast<unsigned char>(bytes[at]) : 0;
}
unsigned word(std::string_view bytes, std::size_t at) { return byte(bytes, at) << 8 | byte(bytes, at + 1); }

mbap::Request request_in(std::string_view bytes) {
  mbap::Request request;
  const bool inputs = byte(bytes, 3) % 4 == 2;
  request.transaction = static_cast<std::uint16_t>(word(bytes, 0));
  request.unit = static_cast<std::uint8_t>(byte(bytes, 2));
  request.function = inputs ? mbap::Function::discrete_inputs : mbap::Function::input_registers;
  request.address = static_cast<std::uint16_t>(word(bytes, 4));
  request.count = static_cast<std::uint16_t>(1 + word(bytes, 6) % (inputs ? mbap::kMaxInputs : mbap::kMaxRegisters));
  return request;
}

/// A server made of bytes: what it does with a request.
struct ByteServer {
  std::string_view bytes;
  [[nodiscard]] bool discrete() const { return byte(bytes, 0) % 2 == 1; }
  [[nodiscard]] bool may_die() const { return byte(bytes, 0) % 4 >= 2; }
  [[nodiscard]] unsigned longest() const { return byte(bytes, 1) == 0 ? 200 : byte(bytes, 1); }
  /// Two bits of an address: 2 refuses it, 3 loses the connection when it may.
  [[nodiscard]] unsigned mood(unsigned address) const { return byte(bytes, 2 + address / 4) >> 2 * (address % 4) & 3; }

  [[nodiscard]] Reply ask(wire::Range range) const {
    if (range.count > longest()) {
      return Reply::bad_count;
    }
    for (unsigned a = range.first; a < unsigned{range.first} + range.count; ++a) {
      if (mood(a) >= 2) {
        return mood(a) == 3 && may_die() ? Reply::stop : Reply::bad_address;
      }
    }
    return Reply::ok;
  }
};

bool holds(wire::Range range, unsigned address) {
  return address >= range.first && address < unsigned{range.first} + range.count;
}

void check_request(bool discrete, wire::Range range) {
  law(range.count >= 1 && range.count <= mbap::kMaxRegisters, "a request has a legal length");
  for (const Field& f : kFields) {
    const bool mine = f.reg.present() && f.reg.discrete == discrete && f.reg.words() == 2;
    law(!mine || holds(range, f.reg.address) == holds(range, f.reg.address + 1u), "no value is split");
  }
}

void check_complete(const RegisterPlan& plan, bool discrete) {
  for (const wire::Range run : wire::documented_runs(discrete)) {
    for (unsigned a = run.first; a < unsigned{run.first} + run.count; ++a) {
      const auto known = [a](wire::Range r) { return holds(r, a); };
      law(std::any_of(plan.ranges().begin(), plan.ranges().end(), known) ||
              std::any_of(plan.illegal().begin(), plan.illegal().end(), known),
          "what is documented is asked for, or was refused");
    }
  }
}

}  // namespace

void mbap(std::string_view bytes) {
  const mbap::Request request = request_in(bytes);
  const std::string_view stream = bytes.substr(std::min<std::size_t>(8, bytes.size()));
  const mbap::Answer whole = mbap::judge(stream, request);
  law((whole.verdict == mbap::Verdict::malformed || whole.verdict == mbap::Verdict::other_request) ==
          !whole.why.empty(),
      "what is wrong is explained, and nothing else");
  for (std::size_t size = 0; size <= std::min<std::size_t>(stream.size(), mbap::kMaxFrameBytes); ++size) {
    const mbap::Answer part = mbap::judge(stream.substr(0, size), request);
    law(part.verdict == mbap::Verdict::incomplete || part.verdict == whole.verdict, "a verdict stands");
  }
  if (whole.verdict == mbap::Verdict::data) {
    const bool inputs = request.function == mbap::Function::discrete_inputs;
    const std::size_t payload = inputs ? (request.count + 7u) / 8u : 2u * request.count;
    law(whole.payload.size() == payload && whole.size == 9 + payload && whole.size <= stream.size(),
        "data are as long as was asked for");
    law(word(stream, 0) == request.transaction && word(stream, 2) == 0 && word(stream, 4) == 3 + payload &&
            byte(stream, 6) == request.unit && byte(stream, 7) == static_cast<unsigned>(request.function) &&
            byte(stream, 8) == payload,
        "every field of an answer fits its request");
  }
  const std::string sent = mbap::encode(request);
  law(sent.size() == 12 && word(sent, 8) == request.address && word(sent, 10) == request.count,
      "a request says what is asked for");
}

void register_plan(std::string_view bytes) {
  const ByteServer server{bytes};
  RegisterPlan plan(server.discrete());
  const std::vector<wire::Range> runs = wire::documented_runs(server.discrete());
  for (int sweep = 0; sweep < 4; ++sweep) {
    std::size_t asked = 0;
    std::size_t planned = plan.ranges().size();
    for (const wire::Range range : plan.ranges()) {  // one that spans gaps may be refused, and then it is its runs
      const auto inside = std::count_if(runs.begin(), runs.end(), [&](wire::Range run) {
        return run.first < range.first + range.count && range.first < run.first + run.count;
      });
      planned += inside > 1 ? static_cast<std::size_t>(inside) : 0;
    }
    bool stopped = false;
    const std::optional<wire::Range> last =
        byte(bytes, 60) % 2 == 1 ? std::optional(plan.ranges()[byte(bytes, 61) % plan.ranges().size()]) : std::nullopt;
    const auto ask = [&](wire::Range range) {
      law(!stopped, "nothing is asked after the connection was lost");
      check_request(server.discrete(), range);
      ++asked;
      const Reply reply = server.ask(range);
      stopped = reply == Reply::stop;
      return reply;
    };
    plan.sweep(ask, last);
    law(asked <= planned + RegisterPlan::kMaxExtraRequests, "a sweep keeps to its budget");
    if (last && byte(bytes, 62) % 4 == 3 && plan.ranges().size() > 1) {
      plan.leave_out(*last);
    }
    check_complete(plan, server.discrete());
    law(!plan.learned() || RegisterPlan(server.discrete()).restore(plan.ranges(), plan.illegal()),
        "what was learned can be learned from a file");
    if (byte(bytes, 63) % 8 == 7) {
      plan.forget();
    }
  }
}

void config(std::string_view bytes) {
  Config accepted;
  try {
    accepted = parse_config(bytes, "site.toml");
    validate(accepted);
  } catch (const UsageError& error) {
    law(std::string_view(error.what()).size() > 10, "a mistake is explained");
    return;
  }
  law(!accepted.robots.empty(), "there is somebody to be asked");
  const std::string written = to_toml(accepted);
  law(to_toml(parse_config(written, "written")) == written, "what is written reads the same");
}

void learned(std::string_view bytes) {
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / ("tacho-learned-" + std::to_string(getpid()) + ".json");
  std::ofstream(file, std::ios::binary) << bytes;
  constexpr const char* kAddress = "10.0.0.1:502 unit 1";
  LearnedRobot known;
  {
    LinkMemory memory(file);
    known = memory.recall(kAddress);
    law(memory.problem().empty() || known == LearnedRobot{}, "a damaged file says nothing about robots");
    for (const bool discrete : {false, true}) {
      RegisterPlan plan(discrete);
      const LearnedPlan& told = discrete ? known.inputs : known.registers;
      (void)plan.restore(told.ranges, told.illegal);
      for (const wire::Range range : plan.ranges()) {
        check_request(discrete, range);
      }
      check_complete(plan, discrete);
    }
    known.shift = 1 - known.shift;
    memory.learn(kAddress, known);
    law(memory.save().empty(), "what is learned can be kept");
  }
  law(LinkMemory(file).recall(kAddress) == known, "what was kept is known again");
  std::filesystem::remove(file);
}

}  // namespace tacho::fuzz
