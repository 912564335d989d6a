#pragma once
// Events and clock points since the last commit. A transaction that fails takes them along, and nobody gives them to
// the writer again: they are written with the next one that works.

#include <cstddef>
#include <tuple>
#include <vector>

#include "schema/store/part_writer.hpp"

namespace tacho::store {

class UnsavedRows {
 public:
  /// While the disk fails for days, some 10 MB of them wait for it; later ones are dropped.
  static constexpr std::size_t kMost = 20'000;

  /// Runs `write`, which writes the row and, in a new transaction, those that wait; then the row is one of them, also
  /// when that throws.
  template <class Row, class Write>
  void keep(const Row& row, Write write) {
    const auto wait = [&] {
      auto& rows = std::get<std::vector<Row>>(rows_);
      if (rows.size() < kMost) {
        rows.push_back(row);
      }
    };
    try {
      write();
    } catch (const Error&) {
      wait();
      throw;
    }
    wait();
  }
  /// All that wait, again.
  void put(PartWriter& part) const {
    put_all(part, std::get<std::vector<Event>>(rows_));
    put_all(part, std::get<std::vector<ClockPoint>>(rows_));
  }
  void clear() { rows_ = {}; }

 private:
  std::tuple<std::vector<Event>, std::vector<ClockPoint>> rows_;

  template <class Row>
  static void put_all(PartWriter& part, const std::vector<Row>& rows) {
    for (const Row& row : rows) {
      part.put(row);
    }
  }
};

}  // namespace tacho::store
