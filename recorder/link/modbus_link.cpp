#include "recorder/link/modbus_link.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstdlib>
#include <span>
#include <utility>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr int kIllegalAddress = 2;
constexpr int kIllegalValue = 3;
constexpr const char* kShiftSubject = "address shift";
constexpr int kSilences = 3;                    // of one range, before it is left out
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
  return index < kWords.size() && !kWords[index].empty() ? kWords[index] : "of no known meaning";
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
  Micros timeout_us = 0;
  Micros deadline_us = 0;
  std::string image;
  std::vector<wire::Range> read;
  std::optional<wire::Range> silent;  // was given most of the time, and nothing came
  Cause cause = Cause::modbus_exception;
  std::string why;     // of the first request that failed, refusals that taught the plan something included
  Micros sent_us = 0;  // monotonic, of the first request
  Micros t_send_us = 0;
  Micros t_recv_us = 0;

  void failed(Cause c, std::string text) {
    // A lost connection says more about missing ranges than the refusal that came before it.
    if (why.empty() || cause == Cause::modbus_exception) {
      cause = c;
      why = std::move(text);
    }
  }
};

ModbusLink::ModbusLink(ModbusLinkOptions options)
    : options_(std::move(options)), socket_(options_.host, options_.port) {
  recall();
}

std::string ModbusLink::known_as() const { return fmt::format("{} unit {}", socket_.address(), options_.unit); }

void ModbusLink::recall() {
  if (!options_.memory) {
    return;
  }
  const LearnedRobot known = options_.memory->recall(known_as());
  placed_ = !(known == LearnedRobot{});
  remembered_ = known.word_order;
  shift_ = known.shift;
  const auto restore = [](const LearnedPlan& learned, Planned& planned) {
    planned.learned_us = planned.plan.restore(learned.ranges, learned.illegal) ? learned.at_us : 0;
  };
  restore(known.registers, registers_);
  restore(known.inputs, inputs_);
}

void ModbusLink::learn() {
  if (!options_.memory) {
    return;
  }
  const auto learned = [](const Planned& planned) {
    return planned.plan.learned() ? LearnedPlan{planned.plan.ranges(), planned.plan.illegal(), planned.learned_us}
                                  : LearnedPlan{};
  };
  LearnedRobot robot;
  robot.word_order = guess_ && guess_->sure ? guess_->order : remembered_;
  robot.shift = shift_;
  robot.registers = learned(registers_);
  robot.inputs = learned(inputs_);
  options_.memory->learn(known_as(), robot);
}

ModbusLink::Planned& ModbusLink::planned(Source source) {
  assert(source == Source::registers || source == Source::inputs);
  return source == Source::inputs ? inputs_ : registers_;
}

const RegisterPlan& ModbusLink::plan(Source source) const {
  return source == Source::inputs ? inputs_.plan : registers_.plan;
}

/// A connection to ask on. One that was closed, or that holds bytes nobody asked for, is replaced, also within a sweep:
/// some servers close after every answer.
Failure ModbusLink::ready(Micros deadline_us) {
  if (socket_.connected() && socket_.idle() != Socket::Idle::ok) {
    close();
  }
  return socket_.connected() ? Failure{} : socket_.connect(deadline_us);
}

Reply ModbusLink::refused(Sweep& sweep, wire::Range range, int code) {
  sweep.failed(Cause::modbus_exception, fmt::format("{}: {} at {}{}", socket_.address(), exception_text(code),
                                                    sweep.discrete ? "[1x]" : "[3x]", range_text(range)));
  return code == kIllegalAddress ? Reply::bad_address : code == kIllegalValue ? Reply::bad_count : Reply::failed;
}

/// A connection with an unanswered or misunderstood request is useless: the next answer could be this one's.
Reply ModbusLink::give_up(Sweep& sweep, Cause cause, std::string why) {
  close();
  sweep.failed(cause, std::move(why));
  return Reply::stop;
}

/// Sends one request and waits for its answer, which points into `buffer`.
ModbusLink::Exchanged ModbusLink::exchange(const mbap::Request& request, Micros deadline_us, Buffer& buffer) {
  Exchanged out;
  out.failure = socket_.send(mbap::encode(request), deadline_us);
  std::size_t size = 0;
  while (!out.failure.failed && out.answer.verdict == mbap::Verdict::incomplete) {
    Received got = socket_.receive(std::span(buffer).subspan(size), deadline_us);
    out.failure = std::move(got.failure);
    size += got.bytes.size();
    out.answer = mbap::judge({buffer.data(), size}, request);
  }
  out.size = size;
  out.trailing = out.answer.size != 0 && size > out.answer.size;
  return out;
}

Reply ModbusLink::unanswered(Sweep& sweep, wire::Range range, std::size_t size, Micros waited_us) {
  if (size > 0) {
    return give_up(sweep, Cause::timeout, fmt::format("{}: only {} bytes of an answer", socket_.address(), size));
  }
  if (2 * waited_us >= sweep.timeout_us) {
    sweep.silent = range;  // else the answers before it may have been slow
  }
  if (sweep.read.empty()) {
    return give_up(sweep, Cause::timeout,
                   fmt::format("{}: connected, but no answer to unit {}; a robot with another modbusSlaveId stays "
                               "silent, see `unit`",
                               socket_.address(), options_.unit));
  }
  return give_up(sweep, Cause::timeout,
                 fmt::format("{}: no answer at {}{}, while others were answered", socket_.address(),
                             sweep.discrete ? "[1x]" : "[3x]", range_text(range)));
}

Reply ModbusLink::read(Sweep& sweep, wire::Range range) {
  if (sweep.deadline_us <= mono_now_us()) {
    sweep.failed(Cause::timeout, fmt::format("{}: the sweep took too long", socket_.address()));
    return Reply::stop;
  }
  if (Failure failure = ready(sweep.deadline_us); failure.failed) {
    return give_up(sweep, failure.cause, std::move(failure.detail));
  }
  mbap::Request request;
  request.transaction = ++transaction_;
  request.unit = static_cast<std::uint8_t>(options_.unit);
  request.function = sweep.discrete ? mbap::Function::discrete_inputs : mbap::Function::input_registers;
  request.address = static_cast<std::uint16_t>(range.first - 1 + shift_);  // documented from 1, sent from 0
  request.count = range.count;
  Buffer buffer;  // uninitialised on purpose: written by receive
  const Micros asked_us = mono_now_us();
  sweep.sent_us = sweep.sent_us == 0 ? asked_us : sweep.sent_us;
  const Exchanged got = exchange(request, sweep.deadline_us, buffer);
  if (got.failure.failed && got.failure.cause == Cause::timeout) {
    return unanswered(sweep, range, got.size, mono_now_us() - asked_us);
  }
  if (got.failure.failed) {
    return give_up(sweep, got.failure.cause, got.failure.detail);
  }
  const Reply reply = take(sweep, range, got.answer);
  if (got.trailing) {
    close();  // more than one answer to one question: this connection is out of step
  }
  return reply;
}

Reply ModbusLink::take(Sweep& sweep, wire::Range range, const mbap::Answer& answer) {
  switch (answer.verdict) {
    case mbap::Verdict::data:
      sweep.t_recv_us = wall_now_us();
      sweep.t_send_us = sweep.t_recv_us - (mono_now_us() - sweep.sent_us);
      sweep.read.push_back(range);
      wire::append_range(sweep.image, range, answer.payload);
      return Reply::ok;
    case mbap::Verdict::exception:
      return refused(sweep, range, answer.exception);
    case mbap::Verdict::other_request:
      return give_up(sweep, Cause::wrong_sequence, fmt::format("{}: {}", socket_.address(), answer.why));
    case mbap::Verdict::malformed:
    case mbap::Verdict::incomplete:
      break;
  }
  return give_up(sweep, Cause::malformed,
                 fmt::format("{}: {}; is this a Modbus TCP port (502)?", socket_.address(), answer.why));
}

/// The range that was met with silence too often, when it is not asked again. One that is asked first hides whether
/// others are answered: it is asked last before it is judged.
std::vector<wire::Range> ModbusLink::judge_silence(Planned& planned, const Sweep& sweep) {
  if (!sweep.silent) {
    if (planned.silent && not_covered({*planned.silent}, sweep.read).empty()) {
      planned.silent.reset();  // answered, alone or within a longer range
    }
    return {};
  }
  const bool again = planned.silent && *planned.silent == *sweep.silent;
  planned.silences = (again ? planned.silences : 0) + (sweep.read.empty() ? 0 : 1);
  planned.silent = sweep.silent;
  if (planned.silences < kSilences) {
    return {};
  }
  const wire::Range range = *std::exchange(planned.silent, std::nullopt);
  return planned.plan.leave_out(range) ? std::vector{range} : std::vector<wire::Range>();
}

void ModbusLink::run(Planned& planned, Sweep& sweep, PollResult& result) {
  RegisterPlan& plan = planned.plan;
  // Both ways: a wall clock that was set must not keep a refusal for years.
  if (plan.learned() && std::abs(wall_now_us() - planned.learned_us) > options_.relearn_us) {
    plan.forget();
  }
  const bool had_learned = plan.learned();
  // What an earlier recording found to be illegal is said once in this one as well.
  const std::vector<wire::Range> known_illegal = planned.told ? plan.illegal() : std::vector<wire::Range>();
  std::vector<wire::Range> news = plan.sweep([&](wire::Range range) { return read(sweep, range); }, planned.silent);
  const std::vector<wire::Range> left_out = judge_silence(planned, sweep);
  news.insert(news.end(), left_out.begin(), left_out.end());
  if (plan.learned() && !had_learned) {
    planned.learned_us = wall_now_us();
  }
  result.ok = !sweep.image.empty();
  result.t_send_us = sweep.t_send_us;
  result.t_recv_us = sweep.t_recv_us;
  result.cause = sweep.cause;
  if (!result.ok) {
    result.detail = std::move(sweep.why);
    return;
  }
  planned.told = true;
  std::vector<wire::Range> have = not_covered(known_illegal, plan.ranges());  // what is asked for again counts
  have.insert(have.end(), sweep.read.begin(), sweep.read.end());
  const std::vector<wire::Range> missing = not_covered(wire::documented_runs(sweep.discrete), have);
  result.partial = !missing.empty();
  if (result.partial) {
    result.detail = fmt::format("missing {}{}: {}", sweep.discrete ? "[1x]" : "[3x]", wire::to_text(missing),
                                sweep.why.empty() ? "refused in an earlier recording" : sweep.why);
    if (!news.empty()) {
      result.detail +=
          fmt::format("; {} not asked again for {}", wire::to_text(news), duration_text(options_.relearn_us));
    }
  }
  result.body = std::move(sweep.image);
}

/// False when the sweep was asked for at the wrong addresses.
bool ModbusLink::detect(PollResult& result) {
  if (settled_ || sweeps_until_guess_-- > 0) {
    return true;
  }
  sweeps_until_guess_ = kSweepsBetweenGuesses;
  placed_ = true;
  const bool first = !guess_;
  const std::string status = options_.status ? options_.status->recent() : std::string();
  WordOrderGuess guess = guess_word_order({result.body, socket_.peer(), status});
  if (const int shift = shift_ - guess.shift; shift != shift_ && (shift == 0 || shift == 1)) {
    shift_ = shift;
    registers_ = {RegisterPlan(false)};  // what was refused were other addresses
    inputs_ = {RegisterPlan(true)};
    result.notes.push_back({EventKind::word_order, kShiftSubject, {}, std::to_string(shift_), guess.why});
    sweeps_until_guess_ = 0;
    return false;
  }
  settled_ = guess.sure || options_.word_order;
  if (options_.word_order) {
    return true;
  }
  if (!guess.sure && remembered_) {
    guess.order = *remembered_;
    guess.why = "remembered from an earlier recording; " + guess.why;
  } else if (guess.sure && remembered_ && *remembered_ != guess.order) {
    guess.why += fmt::format("; earlier recordings had {}", word_order_name(*remembered_));
  }
  guess_ = std::move(guess);
  if (first || guess_->sure) {
    result.word_order = guess_->order;
    result.notes.push_back({EventKind::word_order, {}, {}, std::string(word_order_name(guess_->order)), guess_->why});
  }
  return true;
}

/// One sweep, and a second one in the time that is left when the first shows that addresses are other than documented.
PollResult ModbusLink::ask(Source source, Micros timeout_us) {
  PollResult result;
  const Micros deadline_us = mono_now_us() + timeout_us;
  for (const bool last : {false, true}) {
    Sweep sweep;
    sweep.discrete = source == Source::inputs;
    sweep.deadline_us = deadline_us;
    sweep.timeout_us = timeout_us;
    std::vector<LinkNote> notes = std::move(result.notes);
    result = PollResult();
    result.notes = std::move(notes);
    run(planned(source), sweep, result);
    if (!result.ok || source != Source::registers || detect(result)) {
      break;
    }
    if (last) {  // found nowhere: better no answer than one with wrong names
      result.ok = false;
      result.cause = Cause::malformed;
      result.detail = fmt::format("{}: the robot's address moves in its registers", socket_.address());
    }
  }
  return result;
}

/// Inputs show nowhere that they were asked for at the wrong addresses, registers do: they are looked at first, and
/// their answer is not kept. Where there is none, that is the outcome.
PollResult ModbusLink::ask_first_inputs(Micros timeout_us) {
  const Micros begin_us = mono_now_us();
  PollResult seen = ask(Source::registers, timeout_us);
  placed_ = placed_ || seen.cause == Cause::modbus_exception || --looks_left_ == 0;
  guess_.reset();  // the first registers that are kept say what was found
  settled_ = false;
  sweeps_until_guess_ = 0;
  std::erase_if(seen.notes, [](const LinkNote& note) { return note.subject != kShiftSubject; });
  if (!placed_) {
    return seen;
  }
  PollResult result = ask(Source::inputs, std::max<Micros>(timeout_us - (mono_now_us() - begin_us), 0));
  result.notes.insert(result.notes.begin(), seen.notes.begin(), seen.notes.end());
  return result;
}

PollResult ModbusLink::poll(Source source, std::chrono::milliseconds timeout) {
  const Micros timeout_us = std::chrono::microseconds(timeout).count();
  PollResult result = source == Source::inputs && !placed_ ? ask_first_inputs(timeout_us) : ask(source, timeout_us);
  learn();
  if (!result.ok && socket_.interrupted()) {
    result.cause = Cause::shutdown;
  }
  return result;
}

}  // namespace tacho::recorder
