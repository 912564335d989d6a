#pragma once
// Batteries with known truth for the tests: a sawtooth of SoC whose every number follows from its parameters, and rows
// of a simulated robot kept for several readings.

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "analyzer/analyses/analyses.hpp"
#include "samples/simulator/robot.hpp"
#include "tests/analyzer/generated_log.hpp"
#include "tests/analyzer/section_text.hpp"

namespace tacho::test {

/// Discharges with a constant current from soc_high to soc_low, charges back, and so on.
struct Sawtooth {
  double capacity_ah = 40.0;
  double discharge_a = 8.0;
  double charge_a = 20.0;
  double soc_start = 0.95;
  double soc_low = 0.35;
  double soc_high = 0.95;
  double quantum = 1e-4;
  double noise_a = 0.0;
  double sign = 1.0;        ///< of the charging current as reported
  double efficiency = 1.0;  ///< share of the charged Ah that comes out again
  double fade_per_efc = 0.0;
  double load_spread = 0.0;  ///< each discharge draws a current that differs by this share (1 sigma)
  double count_share = 0.0;  ///< battery_cycle counts each discharge of this share of the capacity; 0 = no counter
  bool flag = true;          ///< reports `charging`
  std::uint64_t seed = 1;
};

struct SawtoothTruth {
  double efc = 0.0;
  double charged_ah = 0.0;
  double discharged_ah = 0.0;
  int sessions = 0;
};

/// One battery moving in steps of the poll period.
class SawtoothBattery {
 public:
  SawtoothBattery(const Sawtooth& s, std::shared_ptr<SawtoothTruth> truth)
      : s_(s), truth_(std::move(truth)), random_(s.seed), soc_(s.soc_start), load_(s.discharge_a) {
    *truth_ = {};
  }

  void operator()(Micros t_us, Sample& sample) {
    advance(static_cast<double>(t_us - last_us_) * 1e-6);
    last_us_ = t_us;
    std::normal_distribution<double> noise;
    const double current = charging_ ? s_.charge_a : -load_;
    MemoryLog::set(sample, "battery_level", std::round(soc_ / s_.quantum) * s_.quantum);
    MemoryLog::set(sample, "current", s_.sign * current + s_.noise_a * noise(random_));
    MemoryLog::set(sample, "voltage", 46.0 + 4.0 * soc_);
    MemoryLog::set(sample, "battery_temp", 25.0);
    MemoryLog::set_int(sample, "task_status", charging_ ? 0 : 2);
    if (s_.flag) {
      MemoryLog::set_int(sample, "charging", charging_ ? 1 : 0);
    }
    if (s_.count_share > 0) {
      const double counted = truth_->discharged_ah / s_.capacity_ah / s_.count_share;
      MemoryLog::set_int(sample, "battery_cycle", 10 + static_cast<std::int64_t>(counted));
    }
  }

 private:
  Sawtooth s_;
  std::shared_ptr<SawtoothTruth> truth_;
  std::mt19937_64 random_;
  double soc_;
  double load_;
  bool charging_ = false;
  Micros last_us_ = MemoryLog::micros(0);

  void advance(double dt) {
    const double fade = std::max(0.1, 1.0 - s_.fade_per_efc * truth_->efc);
    const double ah = (charging_ ? s_.charge_a * s_.efficiency : load_) * dt / 3600;
    const double change = std::min(ah / (s_.capacity_ah * fade), charging_ ? s_.soc_high - soc_ : soc_);
    soc_ += charging_ ? change : -change;
    truth_->efc += change / 2;
    (charging_ ? truth_->charged_ah : truth_->discharged_ah) += (charging_ ? s_.charge_a : load_) * dt / 3600;
    if (charging_ && soc_ >= s_.soc_high - 1e-12) {
      charging_ = false;
      load_ = s_.discharge_a * (1 + s_.load_spread * std::normal_distribution<double>()(random_));
    } else if (!charging_ && soc_ <= s_.soc_low) {
      charging_ = true;
      ++truth_->sessions;
    }
  }
};

struct SawtoothLog {
  std::shared_ptr<SawtoothTruth> truth = std::make_shared<SawtoothTruth>();
  GeneratedLog log;
  SawtoothLog(const Sawtooth& s, double days, double period_s)
      : log(days * 86'400, period_s, [s, t = truth] { return GeneratedLog::Fill(SawtoothBattery(s, t)); }) {}
};

/// What a simulated robot said about its battery, once, for several logs.
struct SimulatedBattery {
  struct Point {
    double soc, current, voltage, temp, vx;
    int counter, task;
    bool charging, standing;
  };
  std::vector<Point> points;
  sim::Truth truth;
  double period_s = 10.0;

  SimulatedBattery(const sim::Scenario& scenario, double days, double period) : period_s(period) {
    sim::Robot robot(scenario, MemoryLog::micros(0));
    std::mt19937_64 random(scenario.seed);
    std::normal_distribution<double> noise;
    for (double t = 0; t < days * 86'400; t += period) {
      const sim::RobotState& s = robot.at(MemoryLog::micros(t));
      points.push_back({s.soc, s.current_a + scenario.current_noise_a * noise(random),
                        std::round(s.voltage_v * 100) / 100, std::round(s.battery_temp_c * 10) / 10, s.v_mps,
                        s.battery_cycle, s.task_status, s.charging, s.is_stop});
    }
    truth = robot.truth();
  }

  /// As a status answer gives it (SoC in steps of 1e-4), or the registers (whole percents, no flags).
  [[nodiscard]] GeneratedLog log(Source source = Source::status) const {
    const double step = source == Source::status ? 1e-4 : 0.01;
    GeneratedLog out(static_cast<double>(points.size()) * period_s, period_s, [this, source, step] {
      return [this, source, step](Micros t_us, Sample& sample) {
        const auto i =
            static_cast<std::size_t>(std::llround(static_cast<double>(t_us - MemoryLog::micros(0)) * 1e-6 / period_s));
        const Point& p = points[i];
        MemoryLog::set(sample, "battery_level", std::round(p.soc / step) * step);
        MemoryLog::set(sample, "current", p.current);
        MemoryLog::set(sample, "voltage", p.voltage);
        MemoryLog::set(sample, "battery_temp", p.temp);
        MemoryLog::set(sample, "vx", p.vx);
        MemoryLog::set_int(sample, "battery_cycle", p.counter);
        MemoryLog::set_int(sample, "task_status", p.task);
        if (source == Source::status) {
          MemoryLog::set_int(sample, "charging", p.charging ? 1 : 0);
          MemoryLog::set_int(sample, "auto_charge", p.charging ? 1 : 0);
          MemoryLog::set_int(sample, "is_stop", p.standing ? 1 : 0);
        }
      };
    });
    out.source(source);
    return out;
  }
};

inline Section run_battery(RowSource& log, const Settings& settings = {}, const std::string& zone = "UTC") {
  return run_analysis(kBattery, log, {}, {}, zone, settings);
}

inline Settings with_nominal(double ah) {
  Settings settings;
  settings.set("battery.nominal_capacity_ah", ah, "test");
  return settings;
}

inline const Quantity& quantity(const Section& section, std::string_view table_name, std::string_view column_name,
                                std::size_t row = 0) {
  return std::get<Quantity>(cell(table(section, table_name), row, column_name));
}

inline bool holds(const Quantity& q, double truth) { return q.lo && q.hi && *q.lo <= truth && truth <= *q.hi; }

/// Value of a (robot, measure, value, remark) table.
inline const Quantity& measure(const Section& section, std::string_view table_name, std::string_view name) {
  const DataTable& t = table(section, table_name);
  for (std::size_t i = 0; i < t.rows.size(); ++i) {
    if (std::get<std::string>(cell(t, i, "measure")) == name) {
      return std::get<Quantity>(cell(t, i, "value"));
    }
  }
  throw std::runtime_error("no measure " + std::string(name));
}

}  // namespace tacho::test
