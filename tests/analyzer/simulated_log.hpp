#pragma once
// A log of one simulated robot as a RowSource, made while it is read: robot -> answer bytes -> decoder -> batches. No
// store in between, so a day under sanitizers stays affordable; the truth is that of the last read().

#include <optional>
#include <utility>
#include <vector>

#include "samples/simulator/answers.hpp"
#include "samples/simulator/robot.hpp"
#include "schema/batch_builder.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"

namespace tacho::test {

struct Polling {
  Source source = Source::status;
  double period_s = 1.0;
};

class SimulatedLog final : public RowSource {
 public:
  static constexpr Micros kStart = 1'767'225'600'000'000;  // 2026-01-01T00:00:00Z

  SimulatedLog(sim::Scenario scenario, double duration_s, std::vector<Polling> polling)
      : scenario_(std::move(scenario)), duration_s_(duration_s), polling_(std::move(polling)) {}

  /// Polls due in [from, to) seconds are lost.
  void lose(double from_s, double to_s) { lost_.emplace_back(from_s, to_s); }
  void slice_rows(std::size_t rows) { slice_rows_ = rows; }
  [[nodiscard]] const sim::Truth& truth() const { return truth_; }

  [[nodiscard]] std::vector<Robot> robots() const override {
    Robot robot;
    robot.id = 1;
    robot.name = scenario_.name;
    return {robot};
  }
  [[nodiscard]] std::vector<Session> sessions() const override { return {}; }
  [[nodiscard]] std::vector<Stream> streams() const override { return {}; }
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override { return {}; }
  [[nodiscard]] std::vector<ReadProblem> problems() const override { return {}; }
  void read_raw(RobotId, Source, Window, const std::function<void(const Answer&)>&) override {}

  /// Seen: every field the source can give.
  [[nodiscard]] std::vector<Coverage> coverage() const override {
    std::vector<Coverage> out;
    for (const Polling& p : polling_) {
      Coverage c;
      c.robot = 1;
      c.source = p.source;
      c.period_us = static_cast<Micros>(p.period_s * 1e6);
      c.stored = static_cast<std::uint64_t>(duration_s_ / p.period_s);
      c.planned = c.stored;
      c.first_us = kStart;
      c.last_us = kStart + static_cast<Micros>(duration_s_ * 1e6);
      for (std::size_t f = 0; f < kFieldCount; ++f) {
        const Field& field = kFields[f];
        c.seen[f] = p.source == Source::status      ? !field.json.key.empty()
                    : p.source == Source::registers ? field.reg.present() && !field.reg.discrete
                                                    : field.reg.present() && field.reg.discrete;
      }
      out.push_back(c);
    }
    return out;
  }

  void read(RobotId robot, Window window, const Selection& selection,
            const std::function<void(const Slice&)>& yield) override {
    sim::Robot machine(scenario_, kStart);
    sim::AnswerMaker answers(scenario_);
    std::vector<Lane> lanes = lanes_for(selection);
    std::size_t rows = 0;
    const auto flush = [&] {
      Slice slice;
      slice.robot = robot;
      slice.session = 1;
      for (Lane& lane : lanes) {
        if (lane.builder.rows() > 0) {
          slice.batches.push_back(lane.builder.take());
        }
      }
      rows = 0;
      yield(slice);
    };
    while (Lane* lane = next_lane(lanes)) {
      const double due_s = lane->due_s();
      const std::uint64_t seq = lane->next++;
      const Micros send = kStart + static_cast<Micros>(due_s * 1e6);
      if (is_lost(due_s) || !window.contains(send)) {
        continue;
      }
      sample_.clear();
      sample_.meta = {robot, lane->polling.source, 1, seq, send, send + 4'000};
      decode(*lane, machine.at(send + 2'000), answers);
      lane->builder.append(sample_);
      if (++rows == slice_rows_) {
        flush();
      }
    }
    flush();
    truth_ = machine.truth();
  }

 private:
  struct Lane {
    Polling polling;
    FieldSet wanted;
    std::vector<std::string> keys;
    BatchBuilder builder;
    std::uint64_t next = 0;
    // Sources are not asked at the same instant.
    [[nodiscard]] double due_s() const {
      return polling.period_s * (static_cast<double>(next) + 0.2 * static_cast<double>(polling.source));
    }
  };

  sim::Scenario scenario_;
  double duration_s_;
  std::vector<Polling> polling_;
  std::vector<std::pair<double, double>> lost_;
  std::size_t slice_rows_ = 5'000;
  sim::Truth truth_;
  Sample sample_;
  Gates gates_;
  wire::JsonDecoder json_;

  [[nodiscard]] bool is_lost(double t_s) const {
    return std::any_of(lost_.begin(), lost_.end(), [&](auto& span) { return t_s >= span.first && t_s < span.second; });
  }

  [[nodiscard]] std::vector<Lane> lanes_for(const Selection& selection) const {
    std::vector<Lane> lanes;
    for (const Polling& p : polling_) {
      if (!selection.rows[static_cast<std::size_t>(p.source)]) {
        continue;
      }
      const FieldSet wanted = selection.fields[static_cast<std::size_t>(p.source)];
      Lane lane{p, wanted, {}, BatchBuilder(p.source, wanted)};
      for (std::size_t f = 0; f < kFieldCount && p.source == Source::status; ++f) {
        if (wanted[f]) {
          lane.keys.emplace_back(kFields[f].json.key);
        }
      }
      for (const std::string_view condition : {"blocked", "slowed"}) {
        lane.keys.emplace_back(condition);
      }
      lanes.push_back(std::move(lane));
    }
    return lanes;
  }

  [[nodiscard]] Lane* next_lane(std::vector<Lane>& lanes) const {
    Lane* first = nullptr;
    for (Lane& lane : lanes) {
      if (lane.due_s() < duration_s_ && (first == nullptr || lane.due_s() < first->due_s())) {
        first = &lane;
      }
    }
    return first;
  }

  void decode(const Lane& lane, const sim::RobotState& state, sim::AnswerMaker& answers) {
    if (lane.polling.source == Source::status) {
      json_.decode(answers.status(state, lane.keys), lane.wanted, false, sample_);
      return;
    }
    const std::string image = answers.body(lane.polling.source, state);
    if (lane.polling.source == Source::registers) {
      wire::decode_registers(image, scenario_.word_order, gates_, lane.wanted, sample_);
    } else {
      wire::decode_inputs(image, lane.wanted, gates_, sample_);
    }
  }
};

}  // namespace tacho::test
