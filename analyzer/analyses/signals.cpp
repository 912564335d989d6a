#include "analyzer/analyses/signals.hpp"

#include <algorithm>

namespace tacho {
namespace {

constexpr Micros kMinAge = 2'000'000;

bool is_text(FieldIndex f) {
  const Kind kind = field_at(f).kind;
  return kind == Kind::text || kind == Kind::list || kind == Kind::structured;
}

}  // namespace

Signals::Signals(const RobotContext& context, Source primary, const std::vector<Need>& needs) : primary_(primary) {
  for (const Need& need : needs) {
    Signal signal;
    signal.field = need.field;
    signal.source = context.choose(need);
    if (signal.source) {
      signal.planned = PlannedPeriod(planned_period_us(context.find(*signal.source)), *signal.source);
    }
    signals_.push_back(std::move(signal));
  }
}

void Signals::open(const Slice& slice) {
  primary_batch_ = slice.find(primary_);
  session_ = slice.session;
  row_ = 0;
  for (Signal& signal : signals_) {
    signal.batch = signal.source ? slice.find(*signal.source) : nullptr;
    signal.column = signal.batch != nullptr ? signal.batch->find(signal.field) : nullptr;
    signal.next = 0;
    signal.planned.open(slice);
  }
}

void Signals::take_over(Signal& signal, std::size_t row) {
  const Column& column = *signal.column;
  signal.t_us = signal.batch->t_recv_us[row];
  signal.next_seq = signal.batch->seq[row] + 1;
  signal.known = column.has(row);
  if (!signal.known) {
    return;
  }
  if (is_text(signal.field)) {
    signal.text = signal.batch->text(column, row);
  } else if (field_at(signal.field).kind == Kind::real) {
    signal.real = column.real[row];
  } else {
    signal.integer = column.integer[row];
  }
}

void Signals::seek(std::size_t row) {
  row_ = row;
  const Micros now = primary_batch_->t_recv_us[row];
  for (Signal& signal : signals_) {
    if (own(signal) || !signal.source) {
      continue;
    }
    const std::size_t before = signal.next;
    while (signal.column != nullptr && signal.next < signal.batch->rows() &&
           signal.batch->t_recv_us[signal.next] <= now) {
      ++signal.next;
    }
    if (signal.next > before) {
      take_over(signal, signal.next - 1);
    }
    signal.planned.advance(session_, signal.next_seq, now);  // how far away the next row may be
  }
}

void Signals::close() {
  for (Signal& signal : signals_) {
    if (!own(signal) && signal.column != nullptr && signal.next < signal.batch->rows()) {
      take_over(signal, signal.batch->rows() - 1);
    }
    signal.batch = nullptr;
    signal.column = nullptr;
  }
  primary_batch_ = nullptr;
}

bool Signals::has(const Signal& signal) const {
  if (own(signal)) {
    return signal.column != nullptr && signal.column->has(row_);
  }
  const Micros age = primary_batch_->t_recv_us[row_] - signal.t_us;
  return signal.known && age >= 0 && age <= std::max(kMinAge, 3 * signal.planned.us());
}

std::optional<double> Signals::real(std::size_t i) const {
  const Signal& signal = signals_[i];
  if (!has(signal)) {
    return std::nullopt;
  }
  return own(signal) ? signal.column->real[row_] : signal.real;
}

std::optional<std::int64_t> Signals::integer(std::size_t i) const {
  const Signal& signal = signals_[i];
  if (!has(signal)) {
    return std::nullopt;
  }
  return own(signal) ? signal.column->integer[row_] : signal.integer;
}

std::optional<bool> Signals::flag(std::size_t i) const {
  const std::optional<std::int64_t> value = integer(i);
  return value ? std::optional<bool>(*value != 0) : std::nullopt;
}

std::string_view Signals::text(std::size_t i) const {
  const Signal& signal = signals_[i];
  if (!has(signal)) {
    return {};
  }
  return own(signal) ? signal.batch->text(*signal.column, row_) : std::string_view(signal.text);
}

}  // namespace tacho
