#pragma once
// Values of a path of a block -> cells of a column: states, "no sensor" marks, scale. Whole columns at once, and
// without looking at each row where nothing is missing.

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <vector>

#include "schema/fields.hpp"
#include "schema/row_source.hpp"
#include "schema/store/block/block_decoder.hpp"

namespace tacho {

/// State of a value before marks and conditions, by its kind.
using StateOf = std::array<State, 8>;

/// `good` kinds are present.
constexpr StateOf states(std::initializer_list<store::ValueKind> good) {
  StateOf table{};
  table.fill(State::wrong_type);
  table[static_cast<std::size_t>(store::ValueKind::absent)] = State::absent;
  table[static_cast<std::size_t>(store::ValueKind::null)] = State::null;
  for (const store::ValueKind kind : good) {
    table[static_cast<std::size_t>(kind)] = State::present;
  }
  return table;
}

/// True when all are known to be present, as in nearly every column of nearly every block.
bool set_states(const StateOf& table, const store::ColumnValues& values, std::vector<State>& out);

/// Neither infinite nor NaN.
bool all_finite(const std::vector<double>& values);

/// Flags that are neither 0 nor 1 are none; true when there was one.
bool refuse_odd_flags(const std::vector<std::int64_t>& values, std::vector<State>& states);

bool any_absent(const store::ColumnValues& values);

/// Takes the rows of `other` where `values` has none.
void fill_absent(const store::ColumnValues& other, store::ColumnValues& values);

/// Values of a field as the robot sent them -> column, whose states are set. `values` is anything afterwards.
void put_reals(const Field& field, double scale, std::vector<double>& values, Column& out);
void put_integers(const Field& field, std::vector<std::int64_t>& values, Column& out);

/// Rows without a value hold zeros, as cells do.
void clear_missing(Column& column);

/// A field that no row has.
void fill_absent_column(std::size_t rows, Column& out);

}  // namespace tacho
