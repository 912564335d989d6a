#pragma once
// Events and clock points since the last commit. A transaction that fails takes them along, and nobody gives them to
// the writer again: they are written with the next one that works. What is dropped meanwhile is told by an event `mark`
// of no robot.

#include <cstddef>
#include <cstdint>
#include <string>
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
      } else {
        drop(row.session, time_of(row));
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
    if (dropped_ > 0) {
      Event event = first_dropped_;
      event.detail = std::to_string(dropped_) +
                     " events and clock points from here on are lost: for too long the log could not be written";
      part.put(event);
    }
  }
  void clear() {
    rows_ = {};
    dropped_ = 0;
  }

 private:
  std::tuple<std::vector<Event>, std::vector<ClockPoint>> rows_;
  Event first_dropped_;
  std::uint64_t dropped_ = 0;

  static Micros time_of(const Event& event) { return event.t_us; }
  static Micros time_of(const ClockPoint& point) { return point.wall_us; }
  void drop(SessionId session, Micros t_us) {
    if (dropped_++ == 0) {
      first_dropped_ = {};
      first_dropped_.session = session;
      first_dropped_.kind = EventKind::mark;
      first_dropped_.t_us = first_dropped_.t_from_us = t_us;
    }
  }

  template <class Row>
  static void put_all(PartWriter& part, const std::vector<Row>& rows) {
    for (const Row& row : rows) {
      part.put(row);
    }
  }
};

}  // namespace tacho::store
