#include "recorder/link/modbus_link.hpp"

#include <fmt/format.h>
#include <modbus/modbus.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <new>
#include <span>
#include <system_error>
#include <utility>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr unsigned kSweepsBetweenGuesses = 50;  // while the word order is undecided

std::string_view exception_words(int code) {
  static constexpr std::array<std::string_view, 12> kWords{"",
                                                           "illegal function: the robot does not offer this request",
                                                           "illegal data address",
                                                           "illegal data value",
                                                           "device failure",
                                                           "acknowledge, still working",
                                                           "device busy",
                                                           "negative acknowledge",
                                                           "memory parity error",
                                                           "",
                                                           "gateway path unavailable",
                                                           "gateway target did not respond"};
  const auto index = static_cast<std::size_t>(code);
  return index < kWords.size() ? kWords[index] : std::string_view();
}

std::string exception_text(int code) { return fmt::format("exception {} ({})", code, exception_words(code)); }

std::string range_text(wire::Range range) { return wire::to_text(std::span(&range, 1)); }

/// The parts of `wanted` that no range of `have` covers.
std::vector<wire::Range> not_covered(const std::vector<wire::Range>& wanted, const std::vector<wire::Range>& have) {
  std::vector<wire::Range> out;
  for (const wire::Range range : wanted) {
    for (std::uint32_t a = range.first; a < std::uint32_t{range.first} + range.count; ++a) {
      const bool covered = std::any_of(have.begin(), have.end(), [a](wire::Range h) {
        return a >= h.first && a < std::uint32_t{h.first} + h.count;
      });
      if (covered) {
        continue;
      }
      if (!out.empty() && std::uint32_t{out.back().first} + out.back().count == a) {
        ++out.back().count;
      } else {
        out.push_back({static_cast<std::uint16_t>(a), 1});
      }
    }
  }
  return out;
}

}  // namespace

/// What one sweep has read and what it has not.
struct ModbusLink::Sweep {
  bool discrete = false;
  Micros deadline_us = 0;
  std::string image;
  std::vector<wire::Range> read;
  Cause cause = Cause::modbus_exception;
  std::string why;  // of the first request that failed, refusals that taught the plan something included
  Micros t_recv_us = 0;

  void failed(Cause c, std::string text) {
    // A lost connection says more about missing ranges than the refusal that came before it.
    if (why.empty() || cause == Cause::modbus_exception) {
      cause = c;
      why = std::move(text);
    }
  }
};

// Only freed, never closed: the socket belongs to Socket.
void ModbusLink::Free::operator()(_modbus* context) const { modbus_free(context); }

ModbusLink::ModbusLink(ModbusLinkOptions options)
    : options_(std::move(options)),
      socket_(options_.host, options_.port),
      context_(modbus_new_tcp(nullptr, options_.port)) {
  if (!context_) {
    throw std::bad_alloc();
  }
  modbus_set_error_recovery(context_.get(), MODBUS_ERROR_RECOVERY_NONE);
  modbus_set_slave(context_.get(), options_.unit);
  // Zero: the whole answer, not its first byte, must arrive within the response timeout.
  modbus_set_byte_timeout(context_.get(), 0, 0);
}

ModbusLink::~ModbusLink() = default;

void ModbusLink::close() {
  modbus_set_socket(context_.get(), -1);
  socket_.close();
}

ModbusLink::Planned& ModbusLink::planned(Source source) {
  assert(source == Source::registers || source == Source::inputs);
  return source == Source::inputs ? inputs_ : registers_;
}

const RegisterPlan& ModbusLink::plan(Source source) const {
  return source == Source::inputs ? inputs_.plan : registers_.plan;
}

bool ModbusLink::ready(Micros deadline_us, PollResult& result) {
  if (socket_.connected() && socket_.idle() != Socket::Idle::ok) {
    close();
  }
  if (!socket_.connected()) {
    ConnectFailure failure = socket_.connect(deadline_us);
    if (failure.failed) {
      result.cause = failure.cause;
      result.detail = std::move(failure.detail);
      return false;
    }
    modbus_set_socket(context_.get(), socket_.fd());
  }
  return true;
}

Reply ModbusLink::refuse(Sweep& sweep, wire::Range range, int error) {
  if (error > MODBUS_ENOBASE && error < MODBUS_ENOBASE + MODBUS_EXCEPTION_MAX) {
    const int code = error - MODBUS_ENOBASE;
    sweep.failed(Cause::modbus_exception, fmt::format("{}: {} at {}{}", socket_.address(), exception_text(code),
                                                      sweep.discrete ? "[1x]" : "[3x]", range_text(range)));
    return code == MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS ? Reply::bad_address
           : code == MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE ? Reply::bad_count
                                                         : Reply::failed;
  }
  // A connection with an unanswered or misunderstood request is useless: the next answer could be this one's.
  close();
  if (error == ETIMEDOUT) {
    sweep.failed(Cause::timeout,
                 fmt::format("{}: connected, but no answer to unit {}; a robot with another modbusSlaveId stays "
                             "silent, see `unit`",
                             socket_.address(), options_.unit));
  } else if (error == ECONNRESET || error == EPIPE || error == ECONNABORTED || error == EBADF) {
    sweep.failed(Cause::closed, fmt::format("{}: closed by the robot", socket_.address()));
  } else {
    sweep.failed(error >= MODBUS_ENOBASE ? Cause::malformed : Cause::closed,
                 fmt::format("{}: {}; is this a Modbus TCP port (502)?", socket_.address(), modbus_strerror(error)));
  }
  return Reply::stop;
}

Reply ModbusLink::read(Sweep& sweep, wire::Range range) {
  const Micros left = sweep.deadline_us - mono_now_us();
  if (left <= 0) {
    sweep.failed(Cause::timeout, fmt::format("{}: the sweep took too long", socket_.address()));
    return Reply::stop;
  }
  modbus_set_response_timeout(context_.get(), static_cast<std::uint32_t>(left / 1'000'000),
                              static_cast<std::uint32_t>(left % 1'000'000));
  const int address = range.first - 1;  // documented from 1, sent from 0
  std::array<std::uint16_t, MODBUS_MAX_READ_REGISTERS> words{};
  std::array<std::uint8_t, MODBUS_MAX_READ_BITS> bits{};
  assert(range.count <= words.size());
  errno = 0;
  const int got = sweep.discrete ? modbus_read_input_bits(context_.get(), address, range.count, bits.data())
                                 : modbus_read_input_registers(context_.get(), address, range.count, words.data());
  const int error = errno;
  if (got != range.count) {
    return refuse(sweep, range, got < 0 ? error : EMBBADDATA);
  }
  sweep.t_recv_us = wall_now_us();
  sweep.read.push_back(range);
  if (sweep.discrete) {
    wire::append_bits(sweep.image, range, std::span(bits).first(range.count));
  } else {
    wire::append_words(sweep.image, range, std::span(words).first(range.count));
  }
  return Reply::ok;
}

void ModbusLink::run(Planned& planned, Sweep& sweep, PollResult& result) {
  RegisterPlan& plan = planned.plan;
  if (plan.learned() && mono_now_us() - planned.learned_us > options_.relearn_us) {
    plan.forget();
  }
  const bool had_learned = plan.learned();
  const std::vector<wire::Range> known_illegal = plan.illegal();
  result.t_send_us = wall_now_us();
  const std::vector<wire::Range> news = plan.sweep([&](wire::Range range) { return read(sweep, range); });
  if (plan.learned() && !had_learned) {
    planned.learned_us = mono_now_us();
  }
  result.ok = !sweep.image.empty();
  result.t_recv_us = sweep.t_recv_us;
  result.cause = sweep.cause;
  if (!result.ok) {
    result.detail = std::move(sweep.why);
    return;
  }
  std::vector<wire::Range> have = sweep.read;
  have.insert(have.end(), known_illegal.begin(), known_illegal.end());
  const std::vector<wire::Range> missing = not_covered(wire::documented_runs(sweep.discrete), have);
  result.partial = !missing.empty();
  if (result.partial) {
    result.detail =
        fmt::format("missing {}{}: {}", sweep.discrete ? "[1x]" : "[3x]", wire::to_text(missing), sweep.why);
    if (!news.empty()) {
      result.detail +=
          fmt::format("; {} not asked again for {}", wire::to_text(news), duration_text(options_.relearn_us));
    }
  }
  result.body = std::move(sweep.image);
}

void ModbusLink::detect(PollResult& result) {
  if (options_.word_order || (guess_ && guess_->sure) || sweeps_until_guess_-- > 0) {
    return;
  }
  sweeps_until_guess_ = kSweepsBetweenGuesses;
  const bool first = !guess_;
  guess_ = guess_word_order(result.body, socket_.peer());
  if (first || guess_->sure) {
    result.word_order = guess_->order;
    result.notes.push_back({EventKind::word_order, {}, {}, std::string(word_order_name(guess_->order)), guess_->why});
  }
}

PollResult ModbusLink::poll(Source source, std::chrono::milliseconds timeout) {
  PollResult result;
  Sweep sweep;
  sweep.discrete = source == Source::inputs;
  sweep.deadline_us = mono_now_us() + std::chrono::microseconds(timeout).count();
  if (ready(sweep.deadline_us, result)) {
    run(planned(source), sweep, result);
    if (result.ok && source == Source::registers) {
      detect(result);
    }
  }
  if (!result.ok && socket_.interrupted()) {
    result.cause = Cause::shutdown;
  }
  return result;
}

}  // namespace tacho::recorder
