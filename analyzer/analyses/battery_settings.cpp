#include "analyzer/analyses/battery_settings.hpp"

#include <array>

namespace tacho::battery {
namespace {

constexpr auto kTable = std::to_array<ConfigRow<Config>>({
    {{"battery.nominal_capacity_ah", std::nullopt, "Ah", "Nominal capacity of the pack", kAbove0},
     &Config::nominal_capacity_ah},
    {{"battery.rest_current_a", 0.3, "A", "Smaller currents are rest, unless the current's own noise is larger"},
     &Config::rest_current_a},
    {{"battery.rest_current_max_a", 1.0, "A", "The noise of the current raises the rest threshold up to this"},
     &Config::rest_current_max_a},
    {{"battery.dwell_s", 30, "s", "Charge, discharge and rest change after the new state has lasted so long"},
     &Config::dwell_s},
    {{"battery.gap_periods", 5, "1", "Nothing is integrated across a pause of more than so many poll periods", kFrom1},
     &Config::gap_periods},
    {{"battery.bridge_max_h", 24, "h", "Longer gaps are left out, shorter ones are bridged by the change of SoC"},
     &Config::bridge_max_h},
    {{"battery.session_gap_min", 30, "min", "A charge session goes on across a shorter gap"}, &Config::session_gap_min},
    {{"battery.current_offset_a", 0.05, "A", "Zero error of the current sensor"}, &Config::current_offset_a},
    {{"battery.hysteresis", 0.01, "1", "SoC must turn by more than this (or its quantum) to count as a turn", kShare},
     &Config::hysteresis},
    {{"battery.standing_current_a", 3.0, "A", "Resting voltage is taken while the robot stands and draws less"},
     &Config::standing_current_a},
    {{"battery.full_soc", 0.95, "1", "A charge that reaches this is full", kShare}, &Config::full_soc},
    {{"battery.low_soc", 0.20, "1", "WARN when SoC falls below", kShare}, &Config::low_soc},
    {{"battery.deep_soc", 0.10, "1", "FAIL when SoC falls below: deep discharge", kShare}, &Config::deep_soc},
    {{"battery.failed_s", 60, "s", "A charge without current for longer than this has failed"}, &Config::failed_s},
    {{"battery.failed_fail", 3, "", "FAIL from so many failed charges on, WARN below", kFrom1}, &Config::failed_fail},
    {{"battery.contradiction_s", 60, "s", "Flag and current may disagree for so long"}, &Config::contradiction_s},
    {{"battery.contradiction_fail", 0.01, "1", "FAIL when they disagree for more than this share of the time", kShare},
     &Config::contradiction_fail},
    {{"battery.temp_warn_c", 45, "degC", "WARN when the battery is warmer for a minute", kTemperature},
     &Config::temp_warn_c},
    {{"battery.temp_max_c", 55, "degC", "FAIL when the battery is warmer for a minute", kTemperature},
     &Config::temp_max_c},
    {{"battery.temp_min_c", 0, "degC", "WARN when the battery is colder for a minute", kTemperature},
     &Config::temp_min_c},
    {{"battery.day_coverage", 0.8, "1", "Days observed for less than this share are left out of trends", kShare},
     &Config::day_coverage},
    {{"battery.trend_days", 8, "", "Fewer days have no trend", kAbove0}, &Config::trend_days},
    {{"battery.counter_steps", 5, "", "Steps of battery_cycle needed to say what it counts", kAbove0},
     &Config::counter_steps},
    {{"battery.not_full_days", 14, "d", "A battery not charged full for longer cannot balance its cells"},
     &Config::not_full_days},
    {{"battery.missed_charge_min", 10, "min", "Standing idle for longer without charging is a missed charge"},
     &Config::missed_charge_min},
    {{"battery.missed_charge_soc", 0.8, "1", "Only below this SoC", kShare}, &Config::missed_charge_soc},
});

}  // namespace

std::span<const SettingRow> setting_rows() {
  static constexpr auto kRows = rows_of(kTable);
  return kRows;
}

Config Config::load(const Settings& settings, const std::string& robot) {
  Config config;
  fill(config, kTable, settings, robot);
  if (config.nominal_capacity_ah.value_or(0.0) <= 0.0) {
    config.nominal_capacity_ah.reset();
  }
  config.nominal_source = settings.get("battery.nominal_capacity_ah", robot).source;
  return config;
}

}  // namespace tacho::battery
