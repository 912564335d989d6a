#include "analyzer/analyses/incident_signals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace tacho {
namespace {

// Above noise of parked robots and below what a person calls a change (FIELD-FACTS: 1e-4 m/s while parked). A row holds
// for the fields of its unit.
constexpr auto kMaterial = std::to_array<SettingRow>({
    {"incident.step_m", 0.05, "m", "Lengths and positions that move by less have not changed", kAbove0},
    {"incident.step_rad", 0.02, "rad", "Angles that turn by less have not changed", kAbove0},
    {"incident.step_mps", 0.02, "m/s", "Speeds that differ by less have not changed", kAbove0},
    {"incident.step_radps", 0.02, "rad/s", "Turning speeds that differ by less have not changed", kAbove0},
    {"incident.step_mps2", 0.5, "m/s2", "Accelerations that differ by less have not changed", kAbove0},
    {"incident.step_v", 0.2, "V", "Voltages that differ by less have not changed", kAbove0},
    {"incident.step_a", 0.5, "A", "Currents that differ by less have not changed", kAbove0},
    {"incident.step_degc", 1.0, "degC", "Temperatures that differ by less have not changed", kAbove0},
    {"incident.step_share", 0.02, "1", "Shares (state of charge, confidence) that differ by less have not changed",
     kAbove0},
    {"incident.step_percent", 2.0, "%", "Percents that differ by less have not changed", kAbove0},
});

constexpr std::array<FieldIndex, kAlarmLevels> kAlarmArrays{field("fatals"), field("errors"), field("warnings"),
                                                            field("notices")};

bool is_number(Kind kind) { return kind == Kind::real; }
/// The robot's clock, field by field: it always runs.
bool is_clock(FieldIndex f) { return kFields[f].name.substr(0, 6) == "clock_"; }
bool is_discrete(Kind kind) {
  return kind == Kind::integer || kind == Kind::flag || kind == Kind::code || kind == Kind::text || kind == Kind::list;
}

std::string number_text(double value) { return fmt::format("{:.6g}", value + 0.0); }

/// "DI 3" for the field di_3 of the inputs source, else the field's name.
std::string change_name(FieldIndex f) {
  const std::string_view name = kFields[f].name;
  const bool point = kFields[f].kind == Kind::flag && (name.substr(0, 3) == "di_" || name.substr(0, 3) == "do_");
  return point ? (name[1] == 'i' ? "DI " : "DO ") + std::string(name.substr(3)) : std::string(name);
}

std::string point_name(const IoPoint& point) { return fmt::format("{} {}", point.output ? "DO" : "DI", point.id); }

}  // namespace

std::string cell_text(const Batch& batch, const Column& column, std::size_t row) {
  const Field& field = kFields[column.field];
  switch (field.kind) {
    case Kind::real:
      return number_text(column.real[row]);
    case Kind::flag:
      return column.integer[row] != 0 ? "true" : "false";
    case Kind::code: {
      const std::string_view name = code_name(field, column.integer[row]);
      return name.empty() ? std::to_string(column.integer[row]) : std::string(name);
    }
    case Kind::integer:
    case Kind::alarms:
    case Kind::points:
      return std::to_string(column.integer[row]);
    case Kind::text:
    case Kind::list:
    case Kind::structured:
      return std::string(batch.text(column, row));
  }
  return {};
}

std::span<const SettingRow> incident_settings() { return kMaterial; }

double SignalCurve::materiality() const {
  if (kFields[field].unit == "s") {
    return fell ? 1.0 : 0.0;
  }
  // Without a unit nobody knows what much is: half of the greatest value.
  const double step = material.value.value_or(0.5 * std::max(std::abs(least), std::abs(greatest)));
  return (greatest - least) / std::max(step, 1e-9);
}

SignalTracker::SignalTracker(Micros from_us, Micros at_us, const Settings& settings, std::string_view robot)
    : from_us_(from_us), at_us_(at_us) {
  for (const SettingRow& row : kMaterial) {
    material_.emplace(row.unit, settings.get(row.name, robot));
  }
}

void SignalTracker::fold(const Batch& batch) {
  for (std::size_t row = 0; row < batch.rows(); ++row) {
    for (const Column& column : batch.columns) {
      const Kind kind = kFields[column.field].kind;
      if (column.state[row] == State::absent) {
        continue;
      }
      if (batch.t_recv_us[row] <= at_us_) {
        note_last(batch, column, row, column.has(row) ? cell_text(batch, column, row) : std::string());
      }
      if (column.has(row) && is_number(kind)) {
        number(batch, column, row);
      } else if (column.has(row) && is_discrete(kind) && !is_clock(column.field)) {
        discrete(batch, column, row);
      }
    }
    points(batch, row);
    alarms(batch, row);
    ++rows_[batch.source];
  }
}

void SignalTracker::note_last(const Batch& batch, const Column& column, std::size_t row, const std::string& text) {
  last_[{column.field, batch.source}] = {batch.source, column.state[row], text, batch.t_recv_us[row]};
}

void SignalTracker::number(const Batch& batch, const Column& column, std::size_t row) {
  double value = column.real[row];
  if (batch.t_recv_us[row] < from_us_ || !std::isfinite(value)) {
    return;
  }
  SignalCurve& curve = curves_[{column.field, batch.source}];
  if (curve.t_us.empty()) {
    const auto material = material_.find(kFields[column.field].unit);
    curve.field = column.field;
    curve.source = batch.source;
    curve.material = material == material_.end() ? SettingValue{} : material->second;
    curve.least = curve.greatest = value;
  } else {
    double step = value - curve.value.back();
    if (kFields[column.field].unit == "rad") {
      constexpr double turn = 6.283185307179586;
      step = std::remainder(step, turn);
      value = curve.value.back() + step;
    }
    curve.fell = curve.fell || step < 0.0;
    if (std::abs(step) > std::abs(curve.largest_step)) {
      curve.largest_step = step;
      curve.step_from_us = curve.t_us.back();
      curve.step_to_us = batch.t_recv_us[row];
    }
  }
  curve.least = std::min(curve.least, value);
  curve.greatest = std::max(curve.greatest, value);
  curve.t_us.push_back(batch.t_recv_us[row]);
  curve.value.push_back(value);
}

void SignalTracker::discrete(const Batch& batch, const Column& column, std::size_t row) {
  Discrete& d = discrete_[{column.field, batch.source}];
  std::string text = cell_text(batch, column, row);
  const bool inside = batch.t_recv_us[row] >= from_us_;
  d.rows += inside ? 1 : 0;
  if (d.known && inside && text != d.text) {
    SignalChange change;
    change.source = batch.source;
    change.seq = batch.seq[row];
    change.hull_from_us = d.t_send_us;
    change.hull_to_us = batch.t_recv_us[row];
    change.what = change_name(column.field);
    change.field = column.field;
    change.old_value = d.text;
    change.new_value = text;
    d.changes.push_back(std::move(change));
  }
  d.known = true;
  d.text = std::move(text);
  d.t_send_us = batch.t_send_us[row];
}

void SignalTracker::points(const Batch& batch, std::size_t row) {
  if (batch.point_begin.empty()) {
    return;
  }
  for (const IoPoint& point : batch.points_of(row)) {
    const std::string name = point_name(point);
    const auto [at, is_new] = points_.try_emplace({batch.source, name}, point.status, batch.t_send_us[row]);
    if (!is_new && at->second.first != point.status && batch.t_recv_us[row] >= from_us_) {
      const auto text = [](bool on) { return on ? std::string("true") : std::string("false"); };
      other_changes_.push_back({batch.source, batch.seq[row], at->second.second, batch.t_recv_us[row], name, kNoField,
                                text(!point.status), text(point.status), false});
    }
    at->second = {point.status, batch.t_send_us[row]};
  }
}

/// An array that is missing, or has elements that could not be read, clears nothing.
void SignalTracker::alarms(const Batch& batch, std::size_t row) {
  std::array<bool, kAlarmLevels> whole{};
  bool given = false;
  for (std::size_t l = 0; l < kAlarmLevels; ++l) {
    const Column* column = batch.find(kAlarmArrays[l]);
    const bool has = column != nullptr && column->has(row);
    given = given || has;
    whole[l] = has && !batch.incomplete(row, static_cast<AlarmLevel>(l));
  }
  if (!given) {
    return;
  }
  Alarms& alarms = alarms_[batch.source];
  std::map<std::string, Alarm> now;
  for (const AlarmItem& item : batch.alarms_of(row)) {
    now.try_emplace(fmt::format("{} {}", alarm_level_name(item.level), item.code),
                    Alarm{item.level, std::string(batch.texts.at(item.desc)), batch.t_send_us[row]});
  }
  for (const auto& [name, alarm] : now) {
    const std::optional<Micros> absent_us = alarms.whole_us[static_cast<std::size_t>(alarm.level)];
    if (absent_us && alarms.standing.count(name) == 0) {
      alarm_change(batch, row, name, *absent_us, alarm.text.empty() ? "raised" : "raised: " + alarm.text);
    }
  }
  for (const auto& [name, alarm] : alarms.standing) {
    if (now.count(name) == 0 && whole[static_cast<std::size_t>(alarm.level)]) {
      alarm_change(batch, row, name, alarm.t_send_us, "cleared");
    } else {
      now.try_emplace(name, alarm);
    }
  }
  alarms.standing = std::move(now);
  for (std::size_t l = 0; l < kAlarmLevels; ++l) {
    alarms.whole_us[l] = whole[l] ? std::optional(batch.t_send_us[row]) : alarms.whole_us[l];
  }
  if (batch.t_recv_us[row] <= at_us_) {
    alarms_at_.clear();
    for (const auto& [name, alarm] : alarms.standing) {
      alarms_at_.push_back(alarm.text.empty() ? name : name + " (" + alarm.text + ")");
    }
  }
}

void SignalTracker::alarm_change(const Batch& batch, std::size_t row, const std::string& name, Micros from_us,
                                 std::string now) {
  if (batch.t_recv_us[row] >= from_us_) {
    other_changes_.push_back(
        {batch.source, batch.seq[row], from_us, batch.t_recv_us[row], name, kNoField, "", std::move(now), true});
  }
}

bool SignalTracker::best_source(const Key& key) const {
  const auto rows_of = [&](Source source) {
    const auto at = rows_.find(source);
    return at == rows_.end() ? 0 : at->second;
  };
  const auto has = [&](Source source) {
    const Key other{key.first, source};
    return curves_.count(other) > 0 || discrete_.count(other) > 0;
  };
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    const auto other = static_cast<Source>(s);
    const bool better =
        rows_of(other) > rows_of(key.second) || (rows_of(other) == rows_of(key.second) && other < key.second);
    if (other != key.second && has(other) && better) {
      return false;
    }
  }
  return true;
}

bool SignalTracker::running(const Discrete& d) { return d.changes.size() > 5 && 2 * d.changes.size() > d.rows; }

std::vector<SignalChange> SignalTracker::changes() const {
  std::vector<SignalChange> all = other_changes_;
  for (const auto& [key, d] : discrete_) {
    if (!running(d) && best_source(key)) {
      all.insert(all.end(), d.changes.begin(), d.changes.end());
    }
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const SignalChange& a, const SignalChange& b) { return a.hull_to_us < b.hull_to_us; });
  std::vector<SignalChange> out;
  for (SignalChange& change : all) {
    const bool repeated = std::any_of(out.begin(), out.end(), [&](const SignalChange& earlier) {
      return earlier.source != change.source && earlier.what == change.what && earlier.new_value == change.new_value &&
             earlier.hull_to_us >= change.hull_from_us;
    });
    if (!repeated) {
      out.push_back(std::move(change));
    }
  }
  return out;
}

std::vector<std::string> SignalTracker::running_values() const {
  std::set<std::string> names;
  for (const auto& [key, d] : discrete_) {
    if (running(d) && best_source(key)) {
      names.emplace(kFields[key.first].name);
    }
  }
  return {names.begin(), names.end()};
}

std::vector<const SignalCurve*> SignalTracker::curves() const {
  std::vector<const SignalCurve*> out;
  for (const auto& [key, curve] : curves_) {
    if (best_source(key)) {
      out.push_back(&curve);
    }
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const SignalCurve* a, const SignalCurve* b) { return a->materiality() > b->materiality(); });
  return out;
}

const LastValue* SignalTracker::last(FieldIndex field) const {
  const LastValue* best = nullptr;
  for (const auto& [key, value] : last_) {
    if (key.first == field && (best == nullptr || value.t_us > best->t_us)) {
      best = &value;
    }
  }
  return best;
}

}  // namespace tacho
