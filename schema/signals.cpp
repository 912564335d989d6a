#include "schema/signals.hpp"

#include <fmt/format.h>

#include <array>

namespace tacho {

namespace {

constexpr FieldIndex kVersionText = field("firmware_version");
constexpr std::array kVersionParts{field("version_major"), field("version_minor"), field("version_patch"),
                                   field("version_redistribute")};

std::string value_text(const Sample& sample, FieldIndex f) {
  const Cell& cell = sample.at(f);
  const Field& row = field_at(f);
  switch (row.kind) {
    case Kind::flag:
      return flag_text(cell.integer != 0);
    case Kind::text:
      return std::string(sample.text(f));
    case Kind::code: {
      const std::string_view name = code_name(row, cell.integer);
      return name.empty() ? std::to_string(cell.integer) : std::string(name);
    }
    default:
      return std::to_string(cell.integer);
  }
}

std::optional<std::string> read_value(const Sample& sample, const std::vector<FieldIndex>& fields) {
  return sample.at(fields[0]).has() ? std::optional<std::string>(value_text(sample, fields[0])) : std::nullopt;
}

std::optional<std::string> read_firmware(const Sample& sample, const std::vector<FieldIndex>&) {
  return firmware_text(sample);
}

/// Fields: locked, nick name, address.
std::optional<std::string> read_owner(const Sample& sample, const std::vector<FieldIndex>& fields) {
  if (!sample.at(fields[0]).has()) {
    return std::nullopt;
  }
  if (sample.at(fields[0]).integer == 0) {
    return "nobody";
  }
  const auto text = [&](FieldIndex f) { return sample.at(f).has() ? std::string(sample.text(f)) : std::string(); };
  const std::string name = text(fields[1]);
  const std::string address = text(fields[2]);
  return (name.empty() ? "somebody" : name) + (address.empty() ? "" : " (" + address + ")");
}

}  // namespace

std::optional<std::string> firmware_text(const Sample& sample) {
  if (sample.at(kVersionText).has()) {
    return std::string(sample.text(kVersionText));
  }
  std::string text;
  for (const FieldIndex f : kVersionParts) {
    if (!sample.at(f).has()) {
      return std::nullopt;
    }
    text += fmt::format("{}{}", text.empty() ? "" : ".", sample.at(f).integer);
  }
  return text;
}

std::string flag_text(bool on) { return on ? "true" : "false"; }

const std::vector<Signal>& signals() {
  static const std::vector<Signal> table{
      {EventKind::identity, "vehicle_id", {field("vehicle_id")}, read_value},
      {EventKind::identity, "mac", {field("mac")}, read_value},
      {EventKind::identity, "model_md5", {field("model_md5")}, read_value},
      {EventKind::identity,
       "firmware",
       {kVersionText, kVersionParts[0], kVersionParts[1], kVersionParts[2], kVersionParts[3]},
       read_firmware},
      {EventKind::map, "name", {field("current_map")}, read_value},
      {EventKind::map, "md5", {field("current_map_md5")}, read_value},
      {EventKind::map, "number", {field("map_number")}, read_value},
      {EventKind::localisation, "", {field("reloc_status")}, read_value},
      {EventKind::localisation, "", {field("reloc_status_register")}, read_value},
      {EventKind::control_owner,
       "",
       {field("current_lock_locked"), field("current_lock_nick_name"), field("current_lock_ip")},
       read_owner},
      {EventKind::control_owner, "", {field("control_preempted")}, read_value},
      {EventKind::emergency, "", {field("emergency")}, read_value},
      {EventKind::emergency, "software", {field("soft_emc")}, read_value},
      {EventKind::driver_emergency, "", {field("driver_emc")}, read_value},
      {EventKind::blocked, "", {field("blocked")}, read_value},
      {EventKind::slowed, "", {field("slowed")}, read_value},
      {EventKind::charging, "", {field("charging")}, read_value},
      {EventKind::task, "", {field("task_status")}, read_value},
      {EventKind::station, "current_station", {field("current_station")}, read_value},
      {EventKind::station, "current_station_id", {field("current_station_id")}, read_value},
  };
  return table;
}

}  // namespace tacho
