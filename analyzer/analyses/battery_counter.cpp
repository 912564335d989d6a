#include "analyzer/analyses/battery_counter.hpp"

#include <cmath>

namespace tacho::battery {
namespace {

constexpr double kFrozenEfc = 3.0;  // a counter that stands still for so many cycles is frozen

struct Share {
  CounterClass kind;
  double efc;
  double tolerance;
};
constexpr std::array<Share, 3> kShares{
    {{CounterClass::full_cycles, 1.0, 0.05}, {CounterClass::share_90, 0.9, 0.04}, {CounterClass::share_80, 0.8, 0.04}}};

bool near(const std::optional<SlopeLine>& line, double value, double tolerance) {
  return line && std::abs(line->slope - value) <= tolerance;
}

/// Limits within a quarter of the slope: the counter follows something.
bool steady(const std::optional<SlopeLine>& line) {
  return line && line->slope > 0 && line->hi - line->lo <= 0.25 * line->slope;
}

}  // namespace

std::string_view counter_class_name(CounterClass kind) {
  switch (kind) {
    case CounterClass::not_supplied:
      return "not supplied";
    case CounterClass::too_few:
      return "too few steps";
    case CounterClass::full_cycles:
      return "full cycles";
    case CounterClass::share_90:
      return "90 % of a full cycle";
    case CounterClass::share_80:
      return "80 % of a full cycle";
    case CounterClass::sessions:
      return "charge sessions";
    case CounterClass::other:
      return "another share of a full cycle";
    case CounterClass::frozen:
      return "frozen";
    case CounterClass::erratic:
      return "erratic";
  }
  return "";
}

void CycleCounter::step(const Row& row, const SocPath& path, std::size_t sessions_positive,
                        std::size_t sessions_negative) {
  if (row.counter <= 0) {
    return;  // 0 = not supplied, also for a while
  }
  if (!first_) {
    first_ = last_ = row.counter;
    begin_efc_ = path.so_far();
  } else if (row.counter > *last_) {
    steps_.push_back({static_cast<double>(row.counter), path.so_far(), static_cast<double>(sessions_positive),
                      static_cast<double>(sessions_negative)});
    last_ = row.counter;
  }
}

CounterResult CycleCounter::result(int sign, std::size_t rung, std::size_t least_steps) const {
  CounterResult out;
  if (!first_) {
    return out;
  }
  out.first = *first_;
  out.last = *last_;
  out.steps = steps_.size();
  out.falls = falls_;
  out.efc = end_efc_[rung] - begin_efc_[rung];
  if (falls_ > 0) {
    out.kind = CounterClass::erratic;
    return out;
  }
  if (steps_.size() < std::max<std::size_t>(least_steps, 2)) {
    out.kind = steps_.empty() && out.efc >= kFrozenEfc ? CounterClass::frozen : CounterClass::too_few;
    return out;
  }
  std::vector<double> counts, efc, sessions;
  for (const Step& step : steps_) {
    counts.push_back(step.value);
    efc.push_back(step.efc[rung]);
    sessions.push_back(sign > 0 ? step.sessions_positive : step.sessions_negative);
  }
  out.efc_per_count = theil_sen(counts, efc);
  out.sessions_per_count = theil_sen(counts, sessions);
  for (const Share& share : kShares) {
    if (near(out.efc_per_count, share.efc, share.tolerance)) {
      out.kind = share.kind;
      return out;
    }
  }
  out.kind = near(out.sessions_per_count, 1.0, 0.05) ? CounterClass::sessions
             : steady(out.efc_per_count)             ? CounterClass::other
                                                     : CounterClass::erratic;
  return out;
}

}  // namespace tacho::battery
