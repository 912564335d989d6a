#include "analyzer/analyses/battery_rows.hpp"

#include <algorithm>

namespace tacho::battery {
namespace {

struct Input {
  FieldIndex field;
  std::vector<Source> sources;
};

/// In the order of Item.
const std::array<Input, kItems>& inputs() {
  using enum Source;
  static const std::array<Input, kItems> rows{{
      {field("battery_level"), {status, registers}},
      {field("voltage"), {status, registers}},
      {field("current"), {status, registers}},
      {field("battery_temp"), {status, registers}},
      {field("battery_cycle"), {status, registers}},
      {field("charging"), {status, Source::inputs}},
      {field("auto_charge"), {status}},
      {field("manual_charge"), {status}},
      {field("max_charge_voltage"), {status}},
      {field("max_charge_current"), {status}},
      {field("vx"), {status, registers}},
      {field("is_stop"), {status, Source::inputs}},
      {field("task_status"), {status, registers}},
      {field("current_station"), {status}},
      {field("emergency"), {status, Source::inputs}},
      {field("fatals"), {status}},
      {field("errors"), {status}},
      {field("has_fatal"), {Source::inputs}},
      {field("has_error"), {Source::inputs}},
  }};
  return rows;
}

constexpr std::size_t at(Item item) { return static_cast<std::size_t>(item); }

/// Usable as a quantity of this item, or a documented mark for "nothing there".
bool plausible(Item item, double value) {
  if (!std::isfinite(value)) {
    return false;
  }
  switch (item) {
    case Item::level:
      return value >= 0.0 && value <= 1.0 + 1e-6;
    case Item::voltage:
    case Item::max_charge_v:
    case Item::max_charge_a:
      return value > 0.0;
    case Item::counter:
      return value >= 0.0;
    default:
      return true;
  }
}

double planned_period_s(const Coverage& coverage) {
  if (coverage.period_us > 0) {
    return static_cast<double>(coverage.period_us) * 1e-6;
  }
  const auto steps = static_cast<double>(std::max<std::uint64_t>(coverage.stored, 2) - 1);
  return std::max(1e-3, static_cast<double>(coverage.last_us - coverage.first_us) * 1e-6 / steps);
}

}  // namespace

std::vector<Need> needs() {
  std::vector<Need> all;
  for (const Input& input : inputs()) {
    all.push_back({input.field, input.sources});
  }
  return all;
}

std::string_view item_name(Item item) { return field_at(inputs()[at(item)].field).name; }

RowReader::RowReader(const RobotContext& context, const Config& config) : config_(config) {
  for (std::size_t i = 0; i < kItems; ++i) {
    stats_[i].source = context.choose({inputs()[i].field, inputs()[i].sources});
  }
  for (const Item item : {Item::current, Item::level, Item::voltage, Item::temp, Item::charging}) {
    if (!clock_) {
      clock_ = stats_[at(item)].source;
    }
  }
  for (const Coverage& coverage : context.coverage) {
    planned_[static_cast<std::size_t>(coverage.source)] =
        PlannedPeriod(static_cast<Micros>(std::llround(1e6 * planned_period_s(coverage))), coverage.source);
  }
}

void RowReader::open(const Slice& slice) {
  cursors_.clear();
  session_ = slice.session;
  for (PlannedPeriod& planned : planned_) {
    planned.open(slice);
  }
  for (const Batch& batch : slice.batches) {
    Cursor cursor{&batch, 0, {}};
    for (std::size_t i = 0; i < kItems; ++i) {
      const Column* column = batch.find(inputs()[i].field);
      if (stats_[i].source == batch.source && column != nullptr) {
        cursor.columns.emplace_back(static_cast<Item>(i), column);
      }
    }
    if (!cursor.columns.empty()) {
      cursors_.push_back(std::move(cursor));
    }
  }
}

/// The row that arrived first: the order in which slices are cut, so that cuts do not matter.
RowReader::Cursor* RowReader::earliest() {
  Cursor* best = nullptr;
  for (Cursor& cursor : cursors_) {
    if (cursor.row < cursor.batch->rows() &&
        (best == nullptr || cursor.batch->t_recv_us[cursor.row] < best->batch->t_recv_us[best->row])) {
      best = &cursor;
    }
  }
  return best;
}

bool RowReader::take(Cursor& cursor) {
  const std::size_t row = cursor.row++;
  for (const auto& [item, column] : cursor.columns) {
    update(item, *cursor.batch, *column, row);
  }
  PlannedPeriod& planned = planned_[static_cast<std::size_t>(cursor.batch->source)];
  const double before_s = planned.seconds();
  const bool changed = planned.advance(session_, cursor.batch->seq[row]);
  if (cursor.batch->source != clock_) {
    return false;
  }
  rate_change_s_ = changed ? std::max(before_s, planned.seconds()) : 0.0;
  build(cursor.batch->t_mid_us(row));
  interval_count_ = changed ? 0 : interval_count_;
  return true;
}

void RowReader::update(Item item, const Batch& batch, const Column& column, std::size_t row) {
  Held& held = held_[at(item)];
  ItemStats& stats = stats_[at(item)];
  ++stats.rows;
  held.t_us = batch.t_mid_us(row);
  held.has = column.has(row);
  if (item == Item::station) {
    const std::string_view text = held.has ? batch.text(column, row) : std::string_view{};
    if (text != station_) {
      station_ = text;
    }
  } else if (held.has) {
    held.value = column.real.empty() ? static_cast<double>(column.integer[row]) : column.real[row];
    held.has = plausible(item, held.value);
  }
  if (held.has) {
    stats.first_us = stats.given == 0 ? held.t_us : stats.first_us;
    stats.last_us = held.t_us;
    ++stats.given;
    stats.zeros += held.value == 0.0 ? 1U : 0U;
  }
}

double RowReader::period_s() const {
  const std::size_t n = std::min(interval_count_, kRing);
  if (n < 8) {
    return planned_[static_cast<std::size_t>(*clock_)].seconds();
  }
  std::array<double, kRing> sorted = intervals_;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(n / 2);
  std::nth_element(sorted.begin(), middle, sorted.begin() + static_cast<std::ptrdiff_t>(n));
  return *middle;
}

double RowReader::value(Item item) const {
  const Held& held = held_[at(item)];
  if (!held.has) {
    return kNone;
  }
  const Source source = *stats_[at(item)].source;
  const double age_s = static_cast<double>(row_.t_us - held.t_us) * 1e-6;
  const bool fresh =
      source == *clock_ ||
      std::abs(age_s) <= config_.gap_periods * planned_[static_cast<std::size_t>(source)].seconds() + 1.0;
  return fresh ? held.value : kNone;
}

Flag RowReader::flag(Item item) const {
  const double v = value(item);
  return std::isnan(v) ? Flag::unknown : (v != 0.0 ? Flag::on : Flag::off);
}

void RowReader::build(Micros t_us) {
  if (rows_ > 0 && t_us > last_us_) {
    intervals_[interval_count_++ % kRing] = static_cast<double>(t_us - last_us_) * 1e-6;
  }
  first_us_ = rows_ == 0 ? t_us : first_us_;
  last_us_ = t_us;
  ++rows_;
  row_.t_us = t_us;
  row_.gap_limit_s = config_.gap_periods * std::max(period_s(), rate_change_s_);
  row_.soc = std::min(value(Item::level), 1.0);
  row_.voltage_v = value(Item::voltage);
  row_.current_a = value(Item::current);
  row_.temp_c = value(Item::temp);
  row_.max_charge_v = value(Item::max_charge_v);
  row_.max_charge_a = value(Item::max_charge_a);
  row_.speed_mps = std::abs(value(Item::vx));
  const double counter = value(Item::counter);
  const double task = value(Item::task);
  row_.counter = std::isnan(counter) ? -1 : static_cast<std::int64_t>(counter);
  row_.task_status = std::isnan(task) ? -1 : static_cast<std::int64_t>(task);
  row_.charging = flag(Item::charging);
  row_.docked = flag(Item::docked);
  row_.plugged = flag(Item::plugged);
  row_.standing = flag(Item::standing);
  row_.emergency = flag(Item::emergency);
  row_.alarm = std::max({flag(Item::fatals), flag(Item::errors), flag(Item::has_fatal), flag(Item::has_error)});
  row_.station = held_[at(Item::station)].has ? std::string_view(station_) : std::string_view{};
}

}  // namespace tacho::battery
