#pragma once
// Values of several fields at the rows of one source, whatever source each of them comes from.

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/analyses/poll_clock.hpp"
#include "analyzer/analysis.hpp"

namespace tacho {

/// Walks the rows of `primary`. A field that the robot gives in another source has the value of that source's last row
/// before, as long as that is younger than three of its periods as planned then (at least 2 s). Only State::present
/// counts as a value. Views stay valid until the next seek, open or close.
class Signals {
 public:
  /// Signal i is needs[i]; its source is chosen as RobotContext::choose does.
  Signals(const RobotContext& context, Source primary, const std::vector<Need>& needs);

  /// The slice must outlive the walk; call close() after it.
  void open(const Slice& slice);
  void close();
  [[nodiscard]] std::size_t rows() const { return primary_batch_ == nullptr ? 0 : primary_batch_->rows(); }
  [[nodiscard]] const Batch& batch() const { return *primary_batch_; }
  /// Rows must be visited in increasing order.
  void seek(std::size_t row);

  [[nodiscard]] std::optional<Source> source(std::size_t signal) const { return signals_[signal].source; }
  [[nodiscard]] std::optional<double> real(std::size_t signal) const;
  [[nodiscard]] std::optional<std::int64_t> integer(std::size_t signal) const;
  [[nodiscard]] std::optional<bool> flag(std::size_t signal) const;
  /// Empty when there is no value.
  [[nodiscard]] std::string_view text(std::size_t signal) const;

 private:
  struct Signal {
    FieldIndex field = kNoField;
    std::optional<Source> source;
    PlannedPeriod planned;
    std::uint64_t next_seq = 0;      // after the last row taken over
    const Batch* batch = nullptr;    // of this slice
    const Column* column = nullptr;  // of this slice
    std::size_t next = 0;            // first row of `batch` that was not taken over yet
    bool known = false;              // the last row taken over had a value
    Micros t_us = 0;
    double real = 0.0;
    std::int64_t integer = 0;
    std::string text;
  };
  Source primary_;
  std::vector<Signal> signals_;
  const Batch* primary_batch_ = nullptr;
  SessionId session_ = 0;
  std::size_t row_ = 0;

  void take_over(Signal& signal, std::size_t row);
  [[nodiscard]] bool own(const Signal& signal) const { return signal.source == primary_; }
  [[nodiscard]] bool has(const Signal& signal) const;
};

}  // namespace tacho
