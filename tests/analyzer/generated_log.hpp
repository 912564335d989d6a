#pragma once
// A log of one robot and one source whose rows are made while it is read, by a function of time: months of rows without
// the memory for them.

#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "schema/batch_builder.hpp"
#include "tests/support/memory_log.hpp"

namespace tacho::test {

class GeneratedLog final : public RowSource {
 public:
  /// Sets the cells of the row at `t_us`. Called in time order.
  using Fill = std::function<void(Micros t_us, Sample& sample)>;
  /// Called at the start of each read(): a fresh function, so that reading twice gives the same rows.
  using Start = std::function<Fill()>;

  GeneratedLog(double duration_s, double period_s, Start start)
      : duration_s_(duration_s), period_s_(period_s), start_(std::move(start)) {}

  void source(Source source) { source_ = source; }
  /// Polls in [from, to) seconds are lost.
  void lose(double from_s, double to_s) { lost_.emplace_back(from_s, to_s); }
  void slice_rows(std::size_t rows) { slice_rows_ = rows; }

  [[nodiscard]] std::vector<Robot> robots() const override {
    Robot robot;
    robot.id = 1;
    robot.name = "amr";
    return {robot};
  }
  [[nodiscard]] std::vector<Session> sessions() const override { return {}; }
  [[nodiscard]] std::vector<Stream> streams() const override { return {}; }
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override { return {}; }
  [[nodiscard]] std::vector<ReadProblem> problems() const override { return {}; }
  void read_raw(RobotId, Source, Window, const std::function<void(const Answer&)>&) override {}

  /// Seen and valued: what the first row has.
  [[nodiscard]] std::vector<Coverage> coverage() const override {
    Sample sample;
    sample.clear();
    start_()(MemoryLog::micros(0), sample);
    Coverage c;
    c.robot = 1;
    c.source = source_;
    c.stored = static_cast<std::uint64_t>(duration_s_ / period_s_);
    c.planned = c.stored;
    c.period_us = static_cast<Micros>(period_s_ * 1e6);
    c.first_us = MemoryLog::micros(0);
    c.last_us = MemoryLog::micros(duration_s_);
    c.seen = sample.seen();
    c.valued = sample.valued();
    return {c};
  }

  void read(RobotId robot, Window window, const Selection& selection,
            const std::function<void(const Slice&)>& yield) override {
    const auto index = static_cast<std::size_t>(source_);
    if (!selection.rows[index]) {
      return;
    }
    BatchBuilder builder(source_, selection.fields[index]);
    const auto flush = [&] {
      Slice slice;
      slice.robot = robot;
      slice.session = 1;
      slice.batches.push_back(builder.take());
      yield(slice);
    };
    const Fill fill = start_();
    Sample sample;
    for (std::uint64_t seq = 0; static_cast<double>(seq) * period_s_ < duration_s_; ++seq) {
      const double due_s = static_cast<double>(seq) * period_s_;
      const Micros send = MemoryLog::micros(due_s);
      if (is_lost(due_s) || !window.contains(send)) {
        continue;
      }
      sample.clear();
      sample.meta = {robot, source_, 1, seq, send - 2'000, send + 2'000};
      fill(send, sample);
      builder.append(sample);
      if (builder.rows() == slice_rows_) {
        flush();
      }
    }
    flush();
  }

 private:
  double duration_s_;
  double period_s_;
  Start start_;
  Source source_ = Source::status;
  std::vector<std::pair<double, double>> lost_;
  std::size_t slice_rows_ = 3'600;

  [[nodiscard]] bool is_lost(double t_s) const {
    for (const auto& [from, to] : lost_) {
      if (t_s >= from && t_s < to) {
        return true;
      }
    }
    return false;
  }
};

}  // namespace tacho::test
