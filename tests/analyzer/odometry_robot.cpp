#include "tests/analyzer/odometry_robot.hpp"

#include <algorithm>
#include <memory>

namespace tacho::test {
namespace {

constexpr Micros kEpoch = 1'767'225'600'000'000;  // 2026-01-01T00:00:00Z

double rounded(double value, double quantum) { return std::round(value / quantum) * quantum; }

/// One stream being polled.
struct Poller {
  const PaperLog::Stream* stream = nullptr;
  PaperDrive drive;
  SplitMix random;
  std::uint64_t polls = 0;
  BatchBuilder builder;

  double gauss() {
    const double u = std::max(random.uniform(), 1e-300);
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * kPi * random.uniform());
  }
  [[nodiscard]] double due() const { return stream->offset_s + static_cast<double>(polls) * stream->period_s; }
};

PaperAnswer answer(Poller& p, const PaperRobot& robot) {
  PaperAnswer a;
  a.t_s = p.due() + p.stream->jitter_s * p.random.uniform();
  const PaperState s = p.drive.at(a.t_s);
  a.uptime_s = rounded(1000.0 + a.t_s, 1e-3);
  a.x = rounded(s.pose.x + robot.sigma_m * p.gauss(), 1e-4);
  a.y = rounded(s.pose.y + robot.sigma_m * p.gauss(), 1e-4);
  a.angle = rounded(wrap_pi(s.pose.angle + robot.sigma_rad * p.gauss()), 1e-4);
  a.vx = rounded(s.v * robot.speed_scale, 1e-4);
  a.w = rounded(s.w * robot.turn_scale, 1e-4);
  a.odo = rounded(robot.odo_start_m + s.counter_m, 1e-3);
  a.today_odo = rounded(a.odo - robot.odo_start_m, 1e-3);
  a.total_time_s = 1e6 + a.t_s;
  return a;
}

void put(Sample& sample, FieldIndex f, double value) {
  if (std::isfinite(value)) {
    sample.cells[f].state = State::present;
    sample.cells[f].real = value;
  }
}
void put_code(Sample& sample, FieldIndex f, std::int64_t value) {
  if (value >= 0) {
    sample.cells[f].state = State::present;
    sample.cells[f].integer = value;
  }
}

void fill(Sample& sample, const PaperAnswer& a, Source source) {
  const bool registers = source == Source::registers;
  const auto number = [&](double v) { return registers ? static_cast<double>(static_cast<float>(v)) : v; };
  put(sample, field("x"), number(a.x));
  put(sample, field("y"), number(a.y));
  put(sample, field("angle"), number(a.angle));
  put(sample, field("vx"), number(a.vx));
  put(sample, field("vy"), number(a.vy));
  put(sample, field("w"), number(a.w));
  put(sample, field("odo"), number(a.odo));
  put(sample, field("today_odo"), number(a.today_odo));
  put(sample, field("battery_level"), registers ? rounded(a.soc, 0.01) : a.soc);
  put(sample, field("total_time"), registers ? number(a.total_time_s / 3600.0) * 3600.0 : a.total_time_s);
  put(sample, field("confidence"), a.confidence);
  sample.cells[field("confidence")].state = a.confidence == 0.0 ? State::not_supplied : State::present;
  if (registers) {
    put_code(sample, field("reloc_status_register"), a.reloc);
    put_code(sample, field("current_station_id"), a.station);
    put_code(sample, field("error_code"), a.alarms.empty() ? 0 : a.alarms.front());
    return;
  }
  put(sample, field("uptime"), a.uptime_s);
  put_code(sample, field("reloc_status"), a.reloc);
  put_code(sample, field("loc_method"), a.loc_method);
  put_code(sample, field("current_map"), sample.texts.intern(a.map));
  put_code(sample, field("current_station"),
           sample.texts.intern(a.station > 0 ? "LM" + std::to_string(a.station) : std::string()));
  put_code(sample, field("errors"), static_cast<std::int64_t>(a.alarms.size()));
  for (const std::int64_t code : a.alarms) {
    sample.alarms.push_back({AlarmLevel::error, code, 0, 0, 0, 0});
  }
  sample.alarms_incomplete.set(static_cast<std::size_t>(AlarmLevel::error), a.odd_alarm);
}

void poll(Poller& p, const PaperRobot& robot, Sample& sample) {
  PaperAnswer a = answer(p, robot);
  if (p.stream->edit) {
    p.stream->edit(a);
  }
  const std::uint64_t seq = p.polls++;
  if (a.skip) {
    return;
  }
  sample.clear();
  sample.meta = {1, p.stream->source, 1, seq, kEpoch + static_cast<Micros>(std::llround(a.t_s * 1e6)) - 2000, 0};
  sample.meta.t_recv_us = sample.meta.t_send_us + 4000;
  fill(sample, a, p.stream->source);
  p.builder.append(sample);
}

}  // namespace

void PaperLog::read(RobotId, Window, const Selection& selection, const std::function<void(const Slice&)>& yield) {
  std::vector<Poller> pollers;
  for (const Stream& stream : streams_) {
    const auto index = static_cast<std::size_t>(stream.source);
    if (selection.rows[index]) {
      pollers.push_back({&stream, PaperDrive(robot_), SplitMix(robot_.seed * 977 + index), 0,
                         BatchBuilder(stream.source, selection.fields[index])});
    }
  }
  const auto sample = std::make_unique<Sample>();
  std::size_t rows = 0;
  const auto flush = [&] {
    Slice slice;
    slice.robot = 1;
    slice.session = 1;
    for (Poller& p : pollers) {
      if (p.builder.rows() > 0) {
        slice.batches.push_back(p.builder.take());
      }
    }
    rows = 0;
    yield(slice);
  };
  for (;;) {
    const auto next = std::min_element(pollers.begin(), pollers.end(),
                                       [](const Poller& a, const Poller& b) { return a.due() < b.due(); });
    if (next == pollers.end() || next->due() >= robot_.hours * 3600.0) {
      break;
    }
    poll(*next, robot_, *sample);
    if (++rows >= slice_rows_) {
      flush();
    }
  }
  flush();
}

}  // namespace tacho::test
