// Numbers as they stand in the Section, and what they need in order to be known.

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/battery_tables.hpp"
#include "analyzer/math/bootstrap.hpp"

namespace tacho::battery {
namespace {}  // namespace

DataTable make_table(std::string name, std::string title, std::vector<ColumnSpec> columns, bool detail) {
  DataTable out;
  out.name = std::move(name);
  out.title = std::move(title);
  out.columns = std::move(columns);
  out.detail = detail;
  return out;
}

Value cell(double value, std::string why) { return std::isnan(value) ? Value{Missing{std::move(why)}} : Value{value}; }

Value percent(double share) { return cell(share * 100); }

Quantity known(double value, std::string unit) {
  Quantity q;
  q.value = value;
  q.unit = std::move(unit);
  return q;
}

Quantity within(double value, double lo, double hi, std::string unit) {
  Quantity q = known(value, std::move(unit));
  q.lo = lo;
  q.hi = hi;
  return q;
}

Quantity unknown(std::string reason, std::string unit) {
  Quantity q;
  q.unit = std::move(unit);
  q.reason = std::move(reason);
  return q;
}

std::string missing(const RobotFold& fold, Item item) {
  const ItemStats& stats = fold.reader.stats(item);
  const std::string name(item_name(item));
  if (!stats.source) {
    return name + " is in no answer of this log";
  }
  if (stats.rows == 0) {
    return "no " + std::string(source_name(*stats.source)) + " answer in the period asked for";
  }
  if (stats.given == 0) {
    return name + " never has a usable value";
  }
  const bool zero_means_none =
      item == Item::level || item == Item::current || item == Item::temp || item == Item::counter;
  return zero_means_none && stats.always_zero() ? name + " is 0 in the whole record: not supplied" : std::string{};
}

Quantity moved_ah(const RobotFold& fold, const Pack& pack, bool charging) {
  if (!fold.has_current()) {
    return unknown(missing(fold, Item::current), "Ah");
  }
  if (pack.flow.seconds() <= 0) {
    return unknown("no two readings of the current without a gap between them", "Ah");
  }
  const int sign = charging ? fold.sign() : -fold.sign();
  const double ah = pack.flow.total(sign).ah.value();
  const double reach = kZ95 * pack.flow.sigma_ah(sign, fold.config.current_offset_a);
  return within(ah, std::max(0.0, ah - reach), ah + reach, "Ah");
}

double apparent_capacity_ah(const Pack& pack) {
  const double observed = pack.cycles.by_soc - pack.cycles.bridged;
  const double sum = pack.flow.total(1).ah.value() + pack.flow.total(-1).ah.value();
  return observed < 1.0 || sum <= 0.0 ? kNone : sum / (2 * observed);
}

std::vector<ChargeSession> failed_charges(const RobotFold& fold) {
  std::vector<ChargeSession> out = fold.charges().idle_contacts();
  for (const ChargeSession& s : fold.charges().all()) {
    if (s.failed(fold.config.failed_s, fold.config.full_soc)) {
      out.push_back(s);
    }
  }
  std::sort(out.begin(), out.end(),
            [](const ChargeSession& a, const ChargeSession& b) { return a.from_us < b.from_us; });
  return out;
}

CounterResult counter_result(const RobotFold& fold, const Pack& pack) {
  return pack.counter.result(fold.sign(), pack.cycles.rung, static_cast<std::size_t>(fold.config.counter_steps));
}

}  // namespace tacho::battery
