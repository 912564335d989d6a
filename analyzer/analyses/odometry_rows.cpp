#include "analyzer/analyses/odometry_rows.hpp"

#include <algorithm>
#include <cctype>

namespace tacho::odometry {
namespace {

constexpr std::array kBoth{
    field("x"),          field("y"),           field("angle"),       field("vx"),         field("vy"),
    field("w"),          field("odo"),         field("today_odo"),   field("confidence"), field("battery_level"),
    field("total_time"), field("task_status"), field("block_reason")};
constexpr std::array kStatusOnly{
    field("uptime"),    field("reloc_status"), field("loc_method"),     field("current_map"), field("current_map_md5"),
    field("emergency"), field("driver_emc"),   field("joystick_state"), field("charging"),    field("current_station"),
    field("fatals"),    field("errors"),       field("warnings"),       field("notices")};
constexpr std::array kRegistersOnly{field("reloc_status_register"), field("current_station_id"), field("fatal_code"),
                                    field("error_code"), field("warning_code")};

/// The number in a station's name: 12 for "LM12", 0 for no station, -1 when there is none.
int station_number(std::string_view name) {
  if (name.empty()) {
    return 0;
  }
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  const auto first = std::find_if(name.begin(), name.end(), digit);
  if (first == name.end() || name.end() - first > 6 || !std::all_of(first, name.end(), digit)) {
    return -1;
  }
  int number = 0;
  for (auto c = first; c != name.end(); ++c) {
    number = 10 * number + (*c - '0');
  }
  return number;
}

std::uint64_t fnv(std::string_view text, std::uint64_t hash) {
  for (const char c : text) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3U;
  }
  return hash;
}

}  // namespace

std::vector<Need> row_needs() {
  std::vector<Need> needs;
  for (const FieldIndex f : kBoth) {
    needs.push_back({f, {Source::status}});
    needs.push_back({f, {Source::registers}});
  }
  for (const FieldIndex f : kStatusOnly) {
    needs.push_back({f, {Source::status}});
  }
  for (const FieldIndex f : kRegistersOnly) {
    needs.push_back({f, {Source::registers}});
  }
  // Register 44 means something only while the input [1x]2 is on.
  needs.push_back({field("blocked"), {Source::inputs}});
  return needs;
}

RowReader::RowReader(const Slice& slice, Source source)
    : batch_(slice.find(source)), session_(slice.session), registers_(source == Source::registers) {
  if (batch_ != nullptr) {
    for (const Column& column : batch_->columns) {
      columns_[column.field] = &column;
    }
  }
}

double RowReader::real(FieldIndex f, std::size_t row) const {
  const Column* column = columns_[f];
  return column != nullptr && column->has(row) ? column->real[row] : kNone;
}

std::int64_t RowReader::integer(FieldIndex f, std::size_t row, std::int64_t missing) const {
  const Column* column = columns_[f];
  return column != nullptr && column->has(row) ? column->integer[row] : missing;
}

std::uint64_t RowReader::map_hash(std::size_t row) const {
  std::uint64_t hash = 0;
  for (const FieldIndex f : {field("current_map"), field("current_map_md5")}) {
    const Column* column = columns_[f];
    if (column != nullptr && column->has(row) && !batch_->text(*column, row).empty()) {
      hash = fnv(batch_->text(*column, row), hash == 0 ? 0xCBF29CE484222325U : hash);
    }
  }
  return hash;
}

void RowReader::add_codes(CrossRow& out, std::size_t row) const {
  if (registers_) {
    for (const FieldIndex f : {field("fatal_code"), field("error_code"), field("warning_code")}) {
      const std::int64_t code = integer(f, row, -1);
      out.codes_given = out.codes_given || code >= 0;
      if (code > 0) {
        out.codes.push_back(code);
      }
    }
    return;
  }
  const Column* errors = columns_[field("errors")];
  // An element that could not be read may be the code that the registers show.
  out.codes_given = errors != nullptr && errors->has(row) && !batch_->incomplete(row, AlarmLevel::error);
  if (out.codes_given) {
    for (const AlarmItem& alarm : batch_->alarms_of(row)) {
      out.codes.push_back(alarm.code);
    }
  }
}

CrossRow RowReader::at(std::size_t row) const {
  CrossRow out;
  RawRow& r = out.base;
  r.t_us = batch_->t_mid_us(row);
  r.half_s = 0.5e-6 * static_cast<double>(batch_->t_recv_us[row] - batch_->t_send_us[row]);
  r.session = session_;
  r.seq = batch_->seq[row];
  r.uptime_s = real(field("uptime"), row);
  r.x = real(field("x"), row);
  r.y = real(field("y"), row);
  r.angle = real(field("angle"), row);
  r.vx = real(field("vx"), row);
  r.vy = real(field("vy"), row);
  r.w = real(field("w"), row);
  r.odo = real(field("odo"), row);
  r.today_odo = real(field("today_odo"), row);
  r.confidence = real(field("confidence"), row);
  const Column* confidence = columns_[field("confidence")];
  r.confidence_sentinel = confidence != nullptr && confidence->state[row] == State::not_supplied;
  const FieldIndex reloc = registers_ ? field("reloc_status_register") : field("reloc_status");
  r.reloc = static_cast<int>(integer(reloc, row, -1));
  r.loc_method = static_cast<int>(std::clamp<std::int64_t>(integer(field("loc_method"), row, -1), -1, 127));
  r.map = map_hash(row);
  r.manual = integer(field("joystick_state"), row, 0) == 2;
  r.free_wheel = integer(field("emergency"), row, 0) == 1 || integer(field("driver_emc"), row, 0) == 1;
  r.charging = integer(field("charging"), row, 0) == 1;
  out.soc = real(field("battery_level"), row);
  out.total_time_s = real(field("total_time"), row);
  out.task = static_cast<int>(integer(field("task_status"), row, -1));
  out.block_reason = static_cast<int>(integer(field("block_reason"), row, -1));
  if (registers_) {
    out.station = static_cast<int>(integer(field("current_station_id"), row, -1));
  } else if (const Column* station = columns_[field("current_station")]; station != nullptr && station->has(row)) {
    out.station = station_number(batch_->text(*station, row));
  }
  add_codes(out, row);
  return out;
}

}  // namespace tacho::odometry
