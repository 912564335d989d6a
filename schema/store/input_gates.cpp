#include "schema/store/input_gates.hpp"

#include <algorithm>

namespace tacho::store {

InputGates::InputGates(const FieldSet& registers) {
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    const FieldIndex flag = kFields[i].condition.empty() ? kNoField : find_field(kFields[i].condition);
    if (!registers[i] || flag == kNoField || !kFields[i].reg.present()) {
      continue;
    }
    needed_ = true;
    if (kFields[flag].reg.discrete && !flags_[flag]) {
      flags_.set(flag);
      flag_list_.push_back(flag);
    }
  }
}

void InputGates::begin_part(std::span<const Gap> gaps) {
  for (const Gap& gap : gaps) {
    if (gap.source == Source::inputs && !gap.partial && gap.seq_count > 0) {
      gaps_[{gap.session, gap.seq_from}] = gap.t_from_us;
    }
  }
}

void InputGates::inputs(SessionId session, const Batch& batch, std::span<const std::int64_t> place, std::size_t begin,
                        std::size_t end) {
  const std::size_t first = rows_.size();
  for (std::size_t row = begin; row < end; ++row) {
    rows_.push_back({session, batch.seq[row], batch.t_send_us[row], place[row], 0, 0});
  }
  for (std::size_t i = 0; i < flag_list_.size(); ++i) {
    const Column* const column = batch.find(flag_list_[i]);
    for (std::size_t row = begin; column != nullptr && row < end; ++row) {
      const std::uint64_t known = column->has(row) ? 1 : 0;
      rows_[first + row - begin].known |= known << i;
      rows_[first + row - begin].on |= (known != 0 && column->integer[row] != 0 ? std::uint64_t{1} : 0) << i;
    }
  }
}

/// Forgets what was known when a row of this time can no longer rely on it.
void InputGates::expire(SessionId session, Micros t_send_us) {
  const auto gap = gaps_.upper_bound(last_);
  const bool missed = gap != gaps_.end() && gap->first.first == last_.first && gap->second <= t_send_us;
  if (session != last_.first || missed) {
    known_ = 0;
  }
  if (session != last_.first) {
    last_ = {session, 0};
  }
}

void InputGates::take(const Row& row) {
  expire(row.session, row.t_send_us);
  last_ = {row.session, row.seq};
  known_ |= row.known;
  on_ = (on_ & ~row.known) | row.on;
}

void InputGates::apply(SessionId session, std::span<const std::int64_t> place, Batch& registers) {
  struct Conditional {
    Column* column;
    std::uint64_t flag;
  };
  std::vector<Conditional> conditional;
  for (Column& column : registers.columns) {
    const Field& field = kFields[column.field];
    if (!field.condition.empty()) {
      // A flag that inputs do not have never holds.
      const auto flag = std::find(flag_list_.begin(), flag_list_.end(), find_field(field.condition));
      conditional.push_back({&column, flag == flag_list_.end() ? 0 : std::uint64_t{1} << (flag - flag_list_.begin())});
    }
  }
  for (std::size_t row = 0; row < registers.rows(); ++row) {
    for (; next_ < rows_.size() && rows_[next_].place < place[row]; ++next_) {
      take(rows_[next_]);
    }
    expire(session, registers.t_send_us[row]);
    for (const Conditional& value : conditional) {
      State& state = value.column->state[row];
      const bool holds = (known_ & on_ & value.flag) != 0;
      if (!holds && (state == State::present || state == State::not_supplied)) {
        state = State::not_meaningful;
      }
    }
  }
}

void InputGates::catch_up() {
  for (; next_ < rows_.size(); ++next_) {
    take(rows_[next_]);
  }
  rows_.clear();
  next_ = 0;
}

}  // namespace tacho::store
