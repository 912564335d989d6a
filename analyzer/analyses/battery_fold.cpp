#include "analyzer/analyses/battery_fold.hpp"

#include <algorithm>
#include <cmath>

namespace tacho::battery {
namespace {

constexpr int kFallRows = 3;        // a lower counter must last so long to be another pack
constexpr double kClosure = 0.005;  // SoC at both ends of a closed period
constexpr double kHintSoc = 0.05;   // steps across a gap that look like another pack
constexpr double kHintLimit = 0.01;

/// Ten minutes, finer for records under two weeks: about 2000 buckets.
Micros curve_bucket(const RobotContext& context) {
  Micros first = std::numeric_limits<Micros>::max();
  Micros last = std::numeric_limits<Micros>::min();
  for (const Coverage& coverage : context.coverage) {
    if (coverage.stored > 0) {
      first = std::min(first, coverage.first_us);
      last = std::max(last, coverage.last_us);
    }
  }
  return last < first ? 600'000'000 : std::clamp<Micros>((last - first) / 2'000, 1'000'000, 600'000'000);
}

bool stepped(double before, double after) { return std::abs(after - before) > kHintLimit * std::abs(before); }

}  // namespace

void ClosedPeriods::step(const Row& row, const FlowStep& flow, double efc_so_far) {
  const bool broken = flow.seconds <= 0.0 || !row.joins(t_us_);
  t_us_ = row.t_us;
  if (std::isnan(row.soc) || std::isnan(row.current_a)) {
    return;
  }
  if (broken || std::isnan(soc_)) {
    now_ = ClosedPeriod{};
    now_.from_us = row.t_us;
    soc_ = row.soc;
    efc_ = efc_so_far;
    return;
  }
  now_.positive_ah += flow.moved.positive.ah;
  now_.negative_ah += flow.moved.negative.ah;
  now_.efc = efc_so_far - efc_;
  now_.to_us = row.t_us;
  now_.soc_error = std::abs(row.soc - soc_);
  if (now_.soc_error <= kClosure && now_.efc > best_.efc) {
    best_ = now_;
  }
}

RobotFold::RobotFold(const RobotContext& context)
    : robot(context.robot),
      config(Config::load(*context.settings, context.robot.name)),
      settings(context.settings),
      reader(context, config),
      clock(context.zone),
      use(config.dwell_s),
      sessions{std::make_unique<ChargeSessions>(1, config), std::make_unique<ChargeSessions>(-1, config)},
      contradictions{std::make_unique<Contradictions>(1, config.contradiction_s),
                     std::make_unique<Contradictions>(-1, config.contradiction_s)},
      usage(config, curve_bucket(context)) {}

double RobotFold::threshold_a() const {
  const double noise_a = std::isnan(noise.sigma_a()) ? 0.0 : 3 * noise.sigma_a();
  return std::max(config.rest_current_a, std::min(noise_a, config.rest_current_max_a));
}

bool RobotFold::has_soc() const {
  const ItemStats& level = reader.stats(Item::level);
  return level.given > 0 && !level.always_zero();
}

bool RobotFold::has_current() const {
  const ItemStats& current = reader.stats(Item::current);
  return current.given > 0 && !current.always_zero();
}

bool RobotFold::has_temperature() const {
  const ItemStats& temp = reader.stats(Item::temp);
  return temp.given > 0 && !temp.always_zero();
}

void RobotFold::fold(const Slice& slice) {
  if (reader.any()) {
    reader.read(slice, [this](const Row& row) { step(row); });
  }
}

void RobotFold::step(Row row) {
  const std::int32_t day = clock.day(row.t_us);
  hint(row);
  if (packs.empty() || new_pack(row)) {
    packs.push_back(std::make_unique<Pack>(config));
    packs.back()->from_us = row.t_us;
  }
  Pack& pack = *packs.back();
  pack.to_us = row.t_us;
  noise.step(row);
  current_sign.step(row);
  const double threshold = threshold_a();
  const FlowStep flow = pack.flow.step(row, day);
  pack.path.step(row, day);
  pack.days.step(row, flow, day);
  pack.closed.step(row, flow, pack.path.so_far()[0]);
  use.step(row, threshold);
  sessions.positive->step(row, flow, threshold);
  sessions.negative->step(row, flow, threshold);
  contradictions.positive->step(row, threshold);
  contradictions.negative->step(row, threshold);
  pack.counter.step(row, pack.path, sessions.positive->started(), sessions.negative->started());
  usage.step(row, flow);
  last_ = row;
  last_.station = {};
  any_ = true;
}

/// Watches battery_cycle; a value that is not yet believed is taken out of the row.
bool RobotFold::new_pack(Row& row) {
  if (row.counter <= 0) {
    return false;
  }
  if (row.counter >= counter_) {
    if (lower_rows_ > 0) {
      packs.back()->counter.glitch();
    }
    lower_rows_ = 0;
    counter_ = row.counter;
    return false;
  }
  if (++lower_rows_ < kFallRows) {
    row.counter = -1;
    return false;
  }
  lower_rows_ = 0;
  counter_ = row.counter;
  return true;
}

void RobotFold::hint(const Row& row) {
  if (any_ && !row.joins(last_.t_us) && std::abs(row.soc - last_.soc) > kHintSoc &&
      stepped(last_.max_charge_v, row.max_charge_v) && stepped(last_.max_charge_a, row.max_charge_a)) {
    hints.push_back({last_.t_us, row.t_us});
  }
}

void RobotFold::finish() {
  for (const std::unique_ptr<Pack>& pack : packs) {
    pack->counter.finish(pack->path);
    pack->flow.finish();
    pack->cycles = pack->path.finish();
  }
  use.finish();
  sessions.positive->finish();
  sessions.negative->finish();
  contradictions.positive->finish();
  contradictions.negative->finish();
  usage.finish();
}

}  // namespace tacho::battery
