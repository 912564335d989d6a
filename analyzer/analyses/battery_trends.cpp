#include "analyzer/analyses/battery_trends.hpp"

#include <algorithm>
#include <cmath>

#include "schema/time.hpp"

namespace tacho::battery {
namespace {

constexpr Micros kDay = 86'400'000'000;
constexpr Micros kQuarter = 900'000'000;
constexpr std::uint32_t kLeastRest = 5;  // readings behind a day's resting voltage

Micros floor_div(Micros a, Micros b) { return a / b - (a % b < 0 ? 1 : 0); }

double lower(double a, double b) { return std::isnan(a) || b < a ? b : a; }
double higher(double a, double b) { return std::isnan(a) || b > a ? b : a; }

/// The band of SoC in which most days have a resting voltage.
std::size_t common_band(const std::map<std::int32_t, Day>& days) {
  std::array<std::size_t, Day::kBands> count{};
  for (const auto& [number, day] : days) {
    for (std::size_t b = 0; b < Day::kBands; ++b) {
      count[b] += day.rest_n[b] >= kLeastRest ? 1U : 0U;
    }
  }
  return static_cast<std::size_t>(std::max_element(count.begin(), count.end()) - count.begin());
}

}  // namespace

std::int32_t DayClock::day(Micros t_us) {
  const Micros quarter = floor_div(t_us, kQuarter);
  if (quarter != quarter_) {
    quarter_ = quarter;
    offset_us_ = static_cast<Micros>(zone_offset_s(zone_, t_us).value_or(0)) * 1'000'000;
  }
  return static_cast<std::int32_t>(floor_div(t_us + offset_us_, kDay));
}

Micros DayClock::noon_us(std::int32_t day) const {
  const Micros noon = static_cast<Micros>(day) * kDay + kDay / 2;
  return noon - static_cast<Micros>(zone_offset_s(zone_, noon).value_or(0)) * 1'000'000;
}

std::string day_name(std::int32_t day) { return iso_utc(static_cast<Micros>(day) * kDay).substr(0, 10); }

void Days::step(const Row& row, const FlowStep& flow, std::int32_t number) {
  Day& day = days_[number];
  if (any_ && row.joins(t_us_)) {
    day.observed_s += row.since(t_us_);
  }
  any_ = true;
  t_us_ = row.t_us;
  day.ah.positive += flow.moved.positive.ah;
  day.ah.negative += flow.moved.negative.ah;
  if (!std::isnan(row.soc)) {
    day.soc_min = lower(day.soc_min, row.soc);
    day.soc_max = higher(day.soc_max, row.soc);
    day.soc_peak = higher(day.soc_peak, row.soc);
    day.fall = higher(day.fall, day.soc_peak - row.soc);
  }
  if (!std::isnan(row.temp_c)) {
    day.temp_max = higher(day.temp_max, row.temp_c);
  }
  const bool resting = row.standing != Flag::off && row.charging != Flag::on && std::abs(row.current_a) <= standing_a_;
  if (resting && !std::isnan(row.voltage_v)) {
    const std::size_t band =
        std::isnan(row.soc) ? Day::kBands - 1 : std::min<std::size_t>(static_cast<std::size_t>(row.soc * 10), 9);
    day.rest_v[band] += row.voltage_v;
    ++day.rest_n[band];
  }
}

std::vector<Daily> daily_series(const std::map<std::int32_t, Day>& days, const std::map<std::int32_t, PerRung>& efc,
                                std::size_t rung, double least_coverage) {
  const std::size_t band = common_band(days);
  Daily cycles{"efc_per_day", "equivalent full cycles per observed 24 h", "1/d", {}, {}, "by SoC"};
  Daily depth{"depth_of_discharge", "largest fall of SoC inside the day", "1", {}, {}, ""};
  Daily rest{"rest_voltage", "mean voltage while standing with little current", "V", {}, {}, ""};
  rest.remark = band + 1 == Day::kBands
                    ? "any SoC"
                    : "SoC " + std::to_string(band * 10) + " to " + std::to_string(band * 10 + 10) + " %";
  for (const auto& [number, day] : days) {
    const bool counts = day.observed_s >= least_coverage * 86'400;
    const auto of_day = efc.find(number);
    const bool cycled = counts && of_day != efc.end() && !std::isnan(day.soc_min);
    cycles.value.push_back(cycled ? of_day->second[rung] / day.observed_s * 86'400 : kNone);
    depth.value.push_back(counts ? day.fall : kNone);
    rest.value.push_back(counts && day.rest_n[band] >= kLeastRest ? day.rest_v[band] / day.rest_n[band] : kNone);
    for (Daily* series : {&cycles, &depth, &rest}) {
      series->day.push_back(number);
    }
  }
  return {std::move(cycles), std::move(depth), std::move(rest)};
}

std::optional<Trend> daily_trend(const Daily& daily, std::size_t least, std::size_t& counted) {
  std::vector<double> x, y;
  for (std::size_t i = 0; i < daily.day.size(); ++i) {
    if (!std::isnan(daily.value[i])) {
      x.push_back(daily.day[i]);
      y.push_back(daily.value[i]);
    }
  }
  counted = x.size();
  return x.size() < least ? std::nullopt : find_trend(x, y);
}

}  // namespace tacho::battery
