#include "analyzer/analyses/alarm_registers.hpp"

namespace tacho {
namespace {

std::optional<std::int64_t> code_at(const Batch& batch, FieldIndex f, std::size_t row) {
  const Column* column = batch.find(f);
  return column != nullptr && column->has(row) ? std::optional(column->integer[row]) : std::nullopt;
}

void add_code(AlarmPoll::Level& level, std::int64_t code) {
  if (code > 0) {
    level.items.push_back({code, 0, 0});
  }
}

}  // namespace

void read_alarm_registers(const Batch& batch, std::size_t row, AlarmPoll& poll) {
  for (std::size_t l = 0; l < kFirstAlarmCodes.size(); ++l) {
    const std::optional<std::int64_t> first = code_at(batch, kFirstAlarmCodes[l], row);
    AlarmPoll::Level& level = poll.levels[l];
    level.known = first.has_value();
    if (first) {
      add_code(level, *first);
      level.full = *first > 0;
    }
  }
  AlarmPoll::Level& errors = poll.levels[static_cast<std::size_t>(AlarmLevel::error)];
  std::size_t used = 0;
  bool agrees = false;
  for (const FieldIndex f : kErrorSlots) {
    const std::int64_t code = code_at(batch, f, row).value_or(0);
    agrees = agrees || (errors.known && !errors.items.empty() && errors.items.front().code == code);
    add_code(errors, code);
    used += code > 0 ? 1 : 0;
  }
  // Firmware that knows register 32 only reads 0 in the others: then they say nothing about free places.
  if (agrees) {
    errors.full = used == kErrorSlots.size();
  }
  errors.known = errors.known || used > 0;
}

}  // namespace tacho
