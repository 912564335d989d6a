#include "schema/json_text.hpp"

#include <fmt/format.h>

#include <iterator>

namespace tacho {

void append_json_string(std::string& out, std::string_view text) {
  out += '"';
  for (const char c : text) {
    switch (c) {
      case '"':
        out += "\\\"";
        break;
      case '\\':
        out += "\\\\";
        break;
      case '\n':
        out += "\\n";
        break;
      case '\r':
        out += "\\r";
        break;
      case '\t':
        out += "\\t";
        break;
      default:
        if (static_cast<unsigned char>(c) < 0x20) {
          fmt::format_to(std::back_inserter(out), "\\u{:04x}", static_cast<unsigned>(c));
        } else {
          out += c;
        }
    }
  }
  out += '"';
}

std::string alarms_json(const Batch& batch, std::size_t row, std::string_view array) {
  std::string out = "[";
  for (const AlarmItem& item : batch.alarms_of(row)) {
    // The level's name is that of the array without its plural s.
    if (alarm_level_name(item.level) != array.substr(0, array.size() - 1)) {
      continue;
    }
    fmt::format_to(std::back_inserter(out),
                   "{}{{\"code\":{},\"stamp_s\":{},\"times\":{},\"desc\":", out.size() > 1 ? "," : "", item.code,
                   item.stamp_s, item.times);
    append_json_string(out, batch.texts.at(item.desc));
    out += '}';
  }
  return out + ']';
}

std::string points_json(const Batch& batch, std::size_t row, bool output) {
  std::string out = "[";
  for (const IoPoint& point : batch.points_of(row)) {
    if (point.output != output) {
      continue;
    }
    const char* valid = point.valid < 0 ? "null" : point.valid > 0 ? "true" : "false";
    fmt::format_to(std::back_inserter(out),
                   "{}{{\"id\":{},\"status\":{},\"valid\":{},\"source\":", out.size() > 1 ? "," : "", point.id,
                   point.status, valid);
    append_json_string(out, batch.texts.at(point.source));
    out += '}';
  }
  return out + ']';
}

std::string states_json(const Batch& batch, std::size_t row) {
  std::string out = "{";
  for (const Column& column : batch.columns) {
    const State state = column.state[row];
    if (state != State::absent && state != State::present) {
      fmt::format_to(std::back_inserter(out), "{}\"{}\":\"{}\"", out.size() > 1 ? "," : "", field_at(column.field).name,
                     state_name(state));
    }
  }
  return out + '}';
}

}  // namespace tacho
