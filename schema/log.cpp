#include "schema/log.hpp"

#include <fmt/format.h>

#include <cassert>
#include <cstdlib>
#include <map>
#include <optional>
#include <utility>

#include "schema/column_decoder.hpp"
#include "schema/events.hpp"
#include "schema/signals.hpp"
#include "schema/store/log_reader.hpp"
#include "schema/time.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"

namespace tacho {

namespace {

constexpr Micros kClockPeriodUs = 60'000'000;
/// A point without the robot's clock waits a little longer, in case another source brings it.
constexpr Micros kClockPatienceUs = 10'000'000;
constexpr Micros kClockStepUs = 500'000;

/// Takes over a text that the sample gives; true when it changed something.
bool update_text(const Sample& sample, FieldIndex f, std::string& kept) {
  if (!sample.at(f).has() || sample.text(f).empty() || sample.text(f) == kept) {
    return false;
  }
  kept = sample.text(f);
  return true;
}

/// A push may spell it otherwise than the registers, which are believed once they have told it.
bool update_firmware(const Sample& sample, bool& by_registers, std::string& kept) {
  const std::optional<std::string> told = firmware_text(sample);
  const bool registers = sample.meta.source == Source::registers;
  if (!told || *told == "0.0.0.0" || (by_registers && !registers)) {
    return false;
  }
  by_registers = registers;
  return std::exchange(kept, *told) != *told;
}

/// The robot's clock when it made the answer, UTC.
std::optional<Micros> robot_time(const Sample& sample) {
  constexpr FieldIndex kCreateOn = field("create_on");
  return sample.at(kCreateOn).has() ? parse_time(sample.text(kCreateOn), "UTC") : std::nullopt;
}

store::Decoders decoders() {
  // Shared because a std::function must be copyable; the reader keeps one copy.
  const auto blocks = std::make_shared<ColumnDecoder>();
  return {answer_decode(), [blocks](store::BlockDecoder& block, const Stream& stream, Batch& out, std::string& damage) {
            return blocks->decode(block, stream, out, damage);
          }};
}

}  // namespace

store::Decode answer_decode() {
  // Shared because a std::function must be copyable.
  const auto answers = std::make_shared<AnswerDecoder>();
  return [answers](const Answer& answer, const Stream& stream, const FieldSet& wanted, Gates& gates, Sample& out) {
    answers->decode(answer, stream.word_order, wanted, false, gates, out);
  };
}

std::unique_ptr<RowSource> open_log(std::span<const std::filesystem::path> logs) {
  return std::make_unique<store::LogReader>(logs, decoders());
}

std::unique_ptr<RowSource> open_log_fast(std::span<const std::filesystem::path> logs) {
  return std::make_unique<store::LogReader>(logs, decoders(), store::Access::fast);
}

struct AnswerDecoder::Impl {
  wire::JsonDecoder json;
};

AnswerDecoder::AnswerDecoder() : impl_(std::make_unique<Impl>()) {}
AnswerDecoder::~AnswerDecoder() = default;

void AnswerDecoder::decode(const Answer& answer, WordOrder order, const FieldSet& wanted, bool collect_unknown,
                           Gates& gates, Sample& out) {
  out.meta = answer.meta;
  switch (source_info(answer.meta.source).encoding) {
    case Encoding::json:
      impl_->json.decode(answer.body, wanted, collect_unknown, out);
      return;
    case Encoding::registers:
      wire::decode_registers(answer.body, order, gates, wanted, out);
      return;
    case Encoding::inputs:
      wire::decode_inputs(answer.body, wanted, gates, out);
      return;
  }
}

Micros host_wall_minus_mono() {
  // The wall clock is read between two readings of the other, so that being interrupted in between does not count.
  Micros best = 0;
  Micros narrowest = 0;
  for (int i = 0; i < 3; ++i) {
    const Micros before = mono_now_us();
    const Micros wall = wall_now_us();
    const Micros after = mono_now_us();
    if (i == 0 || after - before < narrowest) {
      narrowest = after - before;
      best = wall - (before + (after - before) / 2);
    }
  }
  return best;
}

struct Ingest::Impl {
  /// What is known of one robot in this session.
  struct RobotState {
    EventMachine events;
    Gates gates;
    Robot identity;
    bool firmware_by_registers = false;
    std::optional<Micros> first_mono_us;
    std::optional<ClockPoint> last_point;
  };

  store::LogWriter& writer;
  std::function<Micros()> wall_minus_mono;
  std::function<void(const Event&)> on_event;
  AnswerDecoder decoder;
  std::map<std::pair<RobotId, Source>, WordOrder> word_orders;
  std::map<RobotId, RobotState> robots;
  Sample sample;
  const FieldSet all = FieldSet().set();

  Impl(store::LogWriter& log, std::function<Micros()> clock) : writer(log), wall_minus_mono(std::move(clock)) {}

  void identity(RobotState& robot) {
    Robot& known = robot.identity;
    bool changed = update_text(sample, field("vehicle_id"), known.vehicle_id);
    changed = update_text(sample, field("mac"), known.mac) || changed;
    changed = update_text(sample, field("model_md5"), known.model_md5) || changed;
    changed = update_firmware(sample, robot.firmware_by_registers, known.firmware) || changed;
    if (changed) {
      known.id = sample.meta.robot;
      writer.identify(known.id, known);
    }
  }

  void clock(RobotState& robot) {
    const Micros offset = wall_minus_mono();
    ClockPoint point;
    point.robot = sample.meta.robot;
    point.session = sample.meta.session;
    point.wall_us = sample.meta.t_mid_us();
    point.mono_us = point.wall_us - offset;
    robot.first_mono_us = robot.first_mono_us.value_or(point.mono_us);

    const bool stepped = robot.last_point && std::abs(offset - offset_of(*robot.last_point)) > kClockStepUs;
    const Micros waited = robot.last_point ? point.mono_us - robot.last_point->mono_us
                                           : point.mono_us - *robot.first_mono_us + kClockPeriodUs;
    if (!stepped && waited < kClockPeriodUs) {
      return;
    }
    point.robot_us = robot_time(sample);
    if (stepped) {
      writer.add(step_event(*robot.last_point, offset));
    } else if (!point.robot_us && waited < kClockPeriodUs + kClockPatienceUs) {
      return;
    }
    writer.add(point);
    robot.last_point = point;
  }

  static Micros offset_of(const ClockPoint& point) { return point.wall_us - point.mono_us; }

  [[nodiscard]] Event step_event(const ClockPoint& before, Micros offset) const {
    const Micros step = offset - offset_of(before);
    Event event;
    event.robot = sample.meta.robot;
    event.session = sample.meta.session;
    event.source = sample.meta.source;
    event.kind = EventKind::clock_step;
    event.seq = sample.meta.seq;
    event.t_us = sample.meta.t_recv_us;
    event.t_from_us = std::min(before.wall_us, event.t_us);
    event.subject = "host";
    event.new_value = fmt::format("{:+.3f} s", static_cast<double>(step) * 1e-6);
    event.detail = "the wall clock of this host was set; times before and after differ by this much";
    return event;
  }
};

Ingest::Ingest(store::LogWriter& writer, std::function<Micros()> wall_minus_mono)
    : impl_(std::make_unique<Impl>(writer, std::move(wall_minus_mono))) {}
Ingest::~Ingest() = default;

void Ingest::declare(const Stream& stream) {
  impl_->word_orders[{stream.robot, stream.source}] = stream.word_order;
  impl_->robots[stream.robot];
  impl_->writer.declare(stream);
}

void Ingest::append(const Answer& answer) {
  const auto order = impl_->word_orders.find({answer.meta.robot, answer.meta.source});
  assert(order != impl_->word_orders.end());
  Impl::RobotState& robot = impl_->robots[answer.meta.robot];
  Sample& sample = impl_->sample;
  impl_->decoder.decode(answer, order->second, impl_->all, true, robot.gates, sample);
  impl_->writer.append(answer);
  impl_->writer.note(sample);
  robot.events.step(sample, [this](const Event& event) {
    impl_->writer.add(event);
    if (impl_->on_event) {
      impl_->on_event(event);
    }
  });
  if (answer.meta.source != Source::ring) {  // written late: it would turn back what has been told since
    impl_->identity(robot);
    impl_->clock(robot);
  }
}

void Ingest::add(const Gap& gap) {
  if (gap.source == Source::inputs && !gap.partial) {
    impl_->robots[gap.robot].gates = Gates{};
  }
  impl_->writer.add(gap);
}

void Ingest::add(const Event& event) { impl_->writer.add(event); }

void Ingest::set_word_order(RobotId robot, Source source, WordOrder order) {
  impl_->word_orders[{robot, source}] = order;
  impl_->writer.set_word_order(robot, source, order);
}

void Ingest::on_event(std::function<void(const Event&)> call) { impl_->on_event = std::move(call); }

const Sample& Ingest::last() const { return impl_->sample; }

}  // namespace tacho
