#include "samples/simulator/robot_clock.hpp"

#include <algorithm>
#include <chrono>

namespace tacho::sim {
namespace {

constexpr Micros kDay = 86'400'000'000;

Micros local(Micros t_us, double clock_offset_s) { return t_us + std::llround(clock_offset_s * 1e6) + kRobotZone; }

void append_digits(std::string& out, int value, int width) {
  const std::size_t end = out.size() + static_cast<std::size_t>(width);
  out.resize(end);
  for (int i = 1; i <= width; ++i) {
    out[end - static_cast<std::size_t>(i)] = static_cast<char>('0' + value % 10);
    value /= 10;
  }
}

void append_date_time(std::string& out, const ClockReading& c, char between) {
  append_digits(out, c.year, 4);
  out += '-';
  append_digits(out, c.month, 2);
  out += '-';
  append_digits(out, c.day, 2);
  out += between;
  append_digits(out, c.hour, 2);
  out += ':';
  append_digits(out, c.minute, 2);
  out += ':';
  append_digits(out, c.second, 2);
}

}  // namespace

Micros clock_fault_us(const Scenario& scenario, Micros since_us) {
  const double since_s = static_cast<double>(since_us) / 1e6;
  const double frozen_s = std::clamp(since_s - scenario.clock_frozen_from_s, 0.0, scenario.clock_frozen_s);
  const double step_s = since_s >= scenario.clock_step_at_s ? scenario.clock_step_s : 0.0;
  return std::llround((since_s * scenario.clock_drift_ppm * 1e-6 + step_s - frozen_s) * 1e6);
}

ClockReading robot_clock(Micros t_us, double clock_offset_s) {
  using namespace std::chrono;
  const Micros t = local(t_us, clock_offset_s);
  const Micros day = t >= 0 ? t / kDay : (t - kDay + 1) / kDay;
  const year_month_day date{sys_days{days{day}}};
  const auto ms = static_cast<int>((t - day * kDay) / 1000);
  ClockReading c;
  c.year = static_cast<int>(date.year());
  c.month = static_cast<int>(static_cast<unsigned>(date.month()));
  c.day = static_cast<int>(static_cast<unsigned>(date.day()));
  c.hour = ms / 3'600'000;
  c.minute = ms / 60'000 % 60;
  c.second = ms / 1000 % 60;
  c.millisecond = ms % 1000;
  return c;
}

void append_create_on(std::string& out, const ClockReading& clock) {
  append_date_time(out, clock, 'T');
  out += '.';
  append_digits(out, clock.millisecond, 3);
  out += "-1100";
}

std::string alarm_date_time(std::int64_t stamp_s) {
  std::string text;
  append_date_time(text, robot_clock(stamp_s * 1'000'000, 0), ' ');
  return text;
}

Micros next_robot_midnight(Micros t_us, double clock_offset_s) {
  const Micros t = local(t_us, clock_offset_s);
  const Micros since = (t % kDay + kDay) % kDay;
  return t_us + kDay - since;
}

}  // namespace tacho::sim
