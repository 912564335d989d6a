#include "analyzer/analyses/odometry_cross.hpp"

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/odometry_counter.hpp"
#include "analyzer/math/bootstrap.hpp"
#include "analyzer/math/proportion.hpp"
#include "analyzer/math/robust.hpp"

namespace tacho::odometry {
namespace {

struct ComparedText {
  std::string_view name;
  std::string_view unit;
};
constexpr std::array<ComparedText, kComparedCount> kCompared{{{"odo", "m"},
                                                              {"today_odo", "m"},
                                                              {"x", "m"},
                                                              {"y", "m"},
                                                              {"angle", "rad"},
                                                              {"vx", "m/s"},
                                                              {"vy", "m/s"},
                                                              {"w", "rad/s"},
                                                              {"battery_level", "1"},
                                                              {"total_time", "s"},
                                                              {"localisation", ""},
                                                              {"task_status", ""},
                                                              {"block_reason", ""},
                                                              {"station", ""},
                                                              {"alarms", ""}}};

constexpr double kLoosest = 0.25;             // m and rad
constexpr double kPoseFloor = 0.01;           // m and rad
constexpr Micros kLate_us = 30'000'000;       // a row may arrive so long after its time
constexpr Micros kForget_us = 7'200'000'000;  // registers without any JSON row beside them
constexpr std::size_t kMostLags = 400'000;

double planar_speed(const RawRow& row) { return std::hypot(row.vx, std::isfinite(row.vy) ? row.vy : 0.0); }

double mix(double a, double b, double f) { return a + f * (b - a); }

/// What linear interpolation of a speed can miss: any value between the ends, and what |dv/dt| <= a allows beyond.
double speed_doubt(double v0, double v1, double a, double f, double dt) {
  const double slope = (v1 - v0) / dt;
  const double bound = std::max(a, std::abs(slope));
  const double left = f * dt;
  const double right = (1.0 - f) * dt;
  const double between_ends = std::abs(v1 - v0) * std::max(f, 1.0 - f);
  return std::max({between_ends, std::min((bound - slope) * left, (bound + slope) * right),
                   std::min((bound + slope) * left, (bound - slope) * right)});
}

/// Register 8 for a JSON reloc_status: the lists differ at 0.
bool same_localisation(int json, int reg) { return json == reg || (json == 0 && reg == 2); }

bool contains(const CrossRow& row, std::int64_t code) {
  return std::find(row.codes.begin(), row.codes.end(), code) != row.codes.end();
}

}  // namespace

std::string_view compared_name(Compared what) { return kCompared[static_cast<std::size_t>(what)].name; }
std::string_view compared_unit(Compared what) { return kCompared[static_cast<std::size_t>(what)].unit; }

void RunningBound::add(double v) {
  const double bin = 128.0 + 16.0 * std::log(std::max(v, 1e-6));  // 3.4e-4 .. 2.9e3, 6 % wide
  ++bins_[static_cast<std::size_t>(std::clamp(bin, 0.0, 255.0))];
  ++n_;
  max_ = std::max(max_, v);
  if (n_ <= 200) {
    value_ = std::max(floor_, max_);
  } else if (n_ % 32 == 0) {
    std::uint64_t above = 0;
    std::size_t i = bins_.size();
    while (i > 0 && 1000 * (above + bins_[i - 1]) <= n_) {
      above += bins_[--i];
    }
    value_ = std::max(floor_, std::min(max_, std::exp((static_cast<double>(i) - 128.0) / 16.0)));
  }
}

void CrossFold::add_json(const CrossRow& row, bool joined) {
  if (joined && !json_.empty()) {
    const RawRow& a = json_.back().row.base;
    const RawRow& b = row.base;
    const double dt = static_cast<double>(b.t_us - a.t_us) * 1e-6;
    const double dv = std::abs(b.vx - a.vx) / dt;
    const double dw = std::abs(b.w - a.w) / dt;
    if (std::isfinite(dv) && dv > 0.0) {
      accel_.add(dv);
    }
    if (std::isfinite(dw) && dw > 0.0) {
      turn_accel_.add(dw);
    }
  }
  fastest_ = std::fmax(fastest_, std::abs(row.base.vx));
  fastest_turn_ = std::fmax(fastest_turn_, std::abs(row.base.w));
  json_.push_back({row, joined, accel_.value(), turn_accel_.value(), fastest_, fastest_turn_});
}

void CrossFold::count(Compared what, Micros t_us, double difference, double tolerance) {
  if (!std::isfinite(difference)) {
    return;
  }
  CrossCount& c = result_.counts[static_cast<std::size_t>(what)];
  ++c.n;
  c.tolerance_sum += tolerance;
  c.outside += difference > tolerance ? 1U : 0U;
  if (difference - tolerance > c.worst - c.allowed || c.n == 1) {
    c.worst = difference;
    c.allowed = tolerance;
    c.worst_us = t_us;
  }
}

void CrossFold::count_pose(Compared what, Micros t_us, double difference, double tolerance) {
  if (difference <= tolerance + kPoseFloor) {
    count(what, t_us, difference, tolerance + kPoseFloor);
  } else if (std::isfinite(difference)) {
    excess_.push_back({t_us, static_cast<float>(difference), static_cast<float>(tolerance), what});
  }
}

double CrossFold::path_doubt(const Pair& p, double accel, double change) {
  const double mixed = p.f * (1.0 - p.f) * p.dt;
  return std::max(0.5 * accel * mixed * p.dt, std::isfinite(change) ? change * mixed : 0.0);
}

void CrossFold::compare_motion(const Pair& p) {
  const RawRow& a = p.a.row.base;
  const RawRow& b = p.b.row.base;
  const RawRow& m = p.m.base;
  const double speed = std::max(planar_speed(a), planar_speed(b));
  const double turn = std::max(std::abs(a.w), std::abs(b.w));
  const bool still = speed < config_.still_mps && turn < config_.still_radps && a.odo == b.odo;
  const bool drives_seen = p.b.accel * p.dt < 0.9 * p.b.fastest;
  const bool turns_seen = p.b.turn_accel * p.dt < 0.9 * p.b.fastest_turn;
  const double dv = std::abs(planar_speed(b) - planar_speed(a));
  const double i = still ? 0.0 : path_doubt(p, p.b.accel, drives_seen ? dv : p.b.fastest);
  const double iw = path_doubt(p, p.b.turn_accel, turns_seen ? std::abs(b.w - a.w) : p.b.fastest_turn);
  if (i > kLoosest) {
    return;
  }
  const auto counter = [&](Compared what, double from, double to, double reg) {
    count(what, m.t_us, std::abs(reg - mix(from, to, p.f)),
          0.5 * float32_step(reg) + 5e-4 + (still ? 0.0 : config_.v_max_mps * p.u) + i);
  };
  counter(Compared::odo, a.odo, b.odo, m.odo);
  if (b.today_odo >= a.today_odo) {
    counter(Compared::today_odo, a.today_odo, b.today_odo, m.today_odo);
  }
  const Pose pose = interpolate({a.x, a.y, a.angle}, {b.x, b.y, b.angle}, p.f);
  const double v = std::isfinite(speed) ? speed : config_.v_max_mps;
  const double w = std::isfinite(turn) ? turn : 0.0;
  count_pose(Compared::x, m.t_us, std::abs(m.x - pose.x), 0.5 * float32_step(m.x) + 5e-5 + v * p.u + i);
  count_pose(Compared::y, m.t_us, std::abs(m.y - pose.y), 0.5 * float32_step(m.y) + 5e-5 + v * p.u + i);
  if (iw <= kLoosest) {
    count_pose(Compared::angle, m.t_us, std::abs(wrap_pi(m.angle - pose.angle)), 1e-4 + w * p.u + iw);
  }
  const auto rate = [&](Compared what, double from, double to, double reg, double bound) {
    count(what, m.t_us, std::abs(reg - mix(from, to, p.f)),
          0.5 * float32_step(reg) + 5e-5 + bound * p.u + speed_doubt(from, to, bound, p.f, p.dt));
  };
  if (drives_seen) {
    rate(Compared::vx, a.vx, b.vx, m.vx, p.b.accel);
    rate(Compared::vy, a.vy, b.vy, m.vy, p.b.accel);
  }
  if (turns_seen) {
    rate(Compared::w, a.w, b.w, m.w, p.b.turn_accel);
  }
}

void CrossFold::compare(const Pair& p) {
  compare_motion(p);
  const CrossRow& a = p.a.row;
  const CrossRow& b = p.b.row;
  const double odo = mix(a.base.odo, b.base.odo, p.f);
  odo_absurd_ += std::abs(p.m.base.odo - odo) > 0.5 * std::max(std::abs(odo), 1.0) ? 1U : 0U;
  const double v = mix(std::abs(a.base.vx), std::abs(b.base.vx), p.f);
  const double behind = (odo - p.m.base.odo) / v;
  if (std::min(std::abs(a.base.vx), std::abs(b.base.vx)) > 0.1 && std::abs(behind) < 60.0 && lag_.size() < kMostLags) {
    lag_.push_back(static_cast<float>(behind));
    lag_weight_.push_back(static_cast<float>(v));
  }
  const Micros t = p.m.base.t_us;
  count(Compared::soc, t, std::abs(p.m.soc - mix(a.soc, b.soc, p.f)), config_.soc_tolerance + 1e-9);
  count(Compared::total_time, t, std::abs(p.m.total_time_s - mix(a.total_time_s, b.total_time_s, p.f)),
        float32_step(p.m.total_time_s / 3600.0) * 1800.0 + 1e-3 + p.u);
}

void CrossFold::compare_states(const Pair& p, std::size_t k) {
  const CrossRow& a = p.a.row;
  const CrossRow& b = p.b.row;
  const CrossRow& before = k > 0 && p.a.joined ? json_[k - 1].row : a;
  const CrossRow& after = k + 2 < json_.size() && json_[k + 2].joined ? json_[k + 2].row : b;
  const Micros t = p.m.base.t_us;
  const auto state = [&](Compared what, bool given, bool same) {
    if (given) {
      count(what, t, same ? 0.0 : 1.0, 0.5);
    }
  };
  const int reloc = p.m.base.reloc;
  state(Compared::localisation, a.base.reloc >= 0 && a.base.reloc == b.base.reloc && reloc >= 0,
        same_localisation(a.base.reloc, reloc) || same_localisation(before.base.reloc, reloc));
  state(Compared::task, a.task >= 0 && a.task == b.task && p.m.task >= 0,
        p.m.task == a.task || p.m.task == before.task);
  state(Compared::block_reason, a.block_reason >= 0 && a.block_reason == b.block_reason && p.m.block_reason >= 0,
        p.m.block_reason == a.block_reason || p.m.block_reason == before.block_reason);
  state(Compared::station, a.station > 0 && a.station == b.station && p.m.station >= 0,
        p.m.station == a.station || p.m.station == before.station);
  const auto known = [&](std::int64_t code) {
    return contains(before, code) || contains(a, code) || contains(b, code) || contains(after, code);
  };
  state(Compared::alarms, a.codes_given && b.codes_given && p.m.codes_given,
        std::all_of(p.m.codes.begin(), p.m.codes.end(), known));
}

void CrossFold::compare_interval(std::size_t k) {
  const JsonRow& a = json_[k];
  const JsonRow& b = json_[k + 1];
  const Micros from = a.row.base.t_us;
  const Micros to = b.row.base.t_us;
  const CrossRow* nearest = nullptr;
  Micros distance = 0;
  for (const CrossRow& m : registers_) {
    const Micros t = m.base.t_us;
    if (t >= to) {
      break;
    }
    const Micros d = std::min(t - from, to - t);
    if (t >= from && m.base.session == a.row.base.session && (nearest == nullptr || d < distance)) {
      nearest = &m;
      distance = d;
    }
  }
  if (nearest == nullptr || !b.joined) {
    return;
  }
  const double dt = static_cast<double>(to - from) * 1e-6;
  const double f = static_cast<double>(nearest->base.t_us - from) * 1e-6 / dt;
  const Pair pair{a, b, *nearest, f, dt, std::max(a.row.base.half_s, b.row.base.half_s) + nearest->base.half_s};
  compare(pair);
  compare_states(pair, k);
}

void CrossFold::advance() {
  compare_interval(next_);
  ++next_;
  while (!registers_.empty() && registers_.front().base.t_us < json_[next_].row.base.t_us) {
    registers_.pop_front();
  }
  if (next_ > 1) {
    json_.pop_front();
    --next_;
  }
}

void CrossFold::settle(Micros t_us) {
  while (next_ + 2 < json_.size() && json_[next_ + 2].row.base.t_us < t_us - kLate_us) {
    advance();
  }
  while (!registers_.empty() && registers_.front().base.t_us < t_us - kForget_us) {
    registers_.pop_front();
  }
}

CrossResult CrossFold::finish(const StandstillResult& still) {
  while (next_ + 1 < json_.size()) {
    advance();
  }
  const double noise_m = std::max(kPoseFloor, 6.0 * std::sqrt(2.0) * still.sigma_p.value.value_or(0.0));
  const double noise_rad = std::max(kPoseFloor, 6.0 * std::sqrt(2.0) * still.sigma_theta.value.value_or(0.0));
  for (const Excess& e : excess_) {
    const double noise = e.what == Compared::angle ? noise_rad : noise_m;
    count(e.what, e.t_us, static_cast<double>(e.difference), static_cast<double>(e.tolerance) + noise);
  }
  CrossResult r = std::move(result_);
  for (const CrossCount& c : r.counts) {
    r.n += c.n;
    r.outside += c.outside;
  }
  const CrossCount& odo = r.counts[static_cast<std::size_t>(Compared::odo)];
  r.word_order = odo.n > 0 && 2 * odo_absurd_ > odo.n;
  r.share = {{}, "1", {}, {}, static_cast<std::int64_t>(r.n), {}, ""};
  r.lag_s = {{}, "s", {}, {}, static_cast<std::int64_t>(lag_.size()), {}, ""};
  if (r.n == 0) {
    r.reason = r.share.reason = "no register row between two status rows: nothing to compare";
  } else {
    const double n = static_cast<double>(r.n);
    r.share.value = static_cast<double>(r.outside) / n;
    const Limits limits = around(*r.share.value, wilson(static_cast<double>(r.outside), n));
    r.share.lo = limits.lo;
    r.share.hi = limits.hi;
  }
  if (lag_.size() < 30) {
    r.lag_s.reason = "fewer than 30 comparisons while moving";
    return r;
  }
  const std::vector<double> lag(lag_.begin(), lag_.end());
  const std::vector<double> weight(lag_weight_.begin(), lag_weight_.end());
  BootstrapOptions options;
  options.block = 30;
  options.draws = lag.size() > 20'000 ? 99 : static_cast<int>(config_.draws);
  r.lag_s.value = weighted_median(lag, weight);
  r.lag_s.reason = too_few_to_draw(lag.size(), options.block);
  if (!r.lag_s.reason.empty()) {
    return r;
  }
  const Limits limits = around(*r.lag_s.value, bootstrap_weighted_median(lag, weight, options));
  r.lag_s.lo = limits.lo;
  r.lag_s.hi = limits.hi;
  return r;
}

}  // namespace tacho::odometry
