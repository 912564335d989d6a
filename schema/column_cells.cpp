#include "schema/column_cells.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "schema/store/block/wide_loops.hpp"
#include "schema/wire/validity.hpp"

namespace tacho {

using store::ColumnValues;
using store::ValueKind;

namespace {

State state_of(const StateOf& table, ValueKind kind) { return table[static_cast<std::size_t>(kind)]; }

/// Marks values that say "no sensor"; `values` as the robot sent them.
template <class T>
void mark_sentinels(Sentinel sentinel, const std::vector<T>& values, std::vector<State>& states) {
  if (sentinel == Sentinel::none) {
    return;
  }
  for (std::size_t i = 0; i < states.size(); ++i) {
    if (states[i] == State::present && wire::is_sentinel(sentinel, static_cast<double>(values[i]))) {
      states[i] = State::not_supplied;
    }
  }
}

}  // namespace

bool set_states(const StateOf& table, const ColumnValues& values, std::vector<State>& out) {
  out.resize(values.kind.size());
  if (values.alike) {
    const State state = state_of(table, values.kind.front());
    std::fill(out.begin(), out.end(), state);
    return state == State::present;
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = state_of(table, values.kind[i]);
  }
  return false;
}

bool all_finite(const std::vector<double>& values) {
  constexpr std::uint64_t kExponent = 0x7FF0'0000'0000'0000;
  constexpr std::uint64_t kOne = 0x0010'0000'0000'0000;
  // A sign appears where all bits of an exponent are set.
  std::uint64_t signs = 0;
  store::run_loop([&]() __attribute__((always_inline)) {
    std::uint64_t all = 0;
    for (const double value : values) {
      all |= (std::bit_cast<std::uint64_t>(value) & kExponent) + kOne;
    }
    signs = all;
  });
  return signs >> 63U == 0;
}

bool refuse_odd_flags(const std::vector<std::int64_t>& values, std::vector<State>& states) {
  std::int64_t bits = 0;
  store::run_loop([&]() __attribute__((always_inline)) {
    std::int64_t all = 0;
    for (const std::int64_t value : values) {
      all |= value;
    }
    bits = all;
  });
  if ((bits | 1) == 1) {
    return false;
  }
  for (std::size_t i = 0; i < states.size(); ++i) {
    if (states[i] == State::present && (values[i] | 1) != 1) {
      states[i] = State::wrong_type;
    }
  }
  return true;
}

bool any_absent(const ColumnValues& values) {
  return values.alike ? values.kind.front() == ValueKind::absent
                      : std::find(values.kind.begin(), values.kind.end(), ValueKind::absent) != values.kind.end();
}

void fill_absent(const ColumnValues& other, ColumnValues& values) {
  values.alike = false;
  const auto take = [&](auto& to, const auto& from, std::size_t row) {
    if (!to.empty()) {
      to[row] = from[row];
    }
  };
  for (std::size_t row = 0; row < values.kind.size(); ++row) {
    if (values.kind[row] == ValueKind::absent) {
      values.kind[row] = other.kind[row];
      take(values.real, other.real, row);
      take(values.integer, other.integer, row);
      take(values.text, other.text, row);
    }
  }
}

void put_reals(const Field& field, double scale, std::vector<double>& values, Column& out) {
  mark_sentinels(field.sentinel, values, out.state);
  std::swap(out.real, values);
  store::run_loop([&]() __attribute__((always_inline)) {
    const Sentinel sentinel = field.sentinel;
    const double factor = scale;
    for (double& value : out.real) {
      value = wire::without_minus_zero(sentinel, value * factor);
    }
  });
}

void put_integers(const Field& field, std::vector<std::int64_t>& values, Column& out) {
  mark_sentinels(field.sentinel, values, out.state);
  std::swap(out.integer, values);
}

void clear_missing(Column& column) {
  const auto missing = [](State state) {
    return state == State::absent || state == State::null || state == State::wrong_type;
  };
  for (std::size_t i = 0; i < column.state.size(); ++i) {
    if (missing(column.state[i])) {
      if (!column.real.empty()) {
        column.real[i] = 0.0;
      }
      if (!column.integer.empty()) {
        column.integer[i] = 0;
      }
    }
  }
}

void fill_absent_column(std::size_t rows, Column& out) {
  const bool real = kFields[out.field].kind == Kind::real;
  out.state.assign(rows, State::absent);
  out.real.assign(real ? rows : 0, 0.0);
  out.integer.assign(real ? 0 : rows, 0);
}

}  // namespace tacho
