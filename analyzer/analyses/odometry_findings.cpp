// Verdicts of METHODS A.4. A verdict uses the interval: PASS when all of it is inside the PASS band, FAIL when all of
// it is in the FAIL band, UNKNOWN when it is wider than the PASS band or when too little was driven, else WARN.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/odometry_result.hpp"

namespace tacho::odometry {
namespace {

constexpr std::size_t kMostEvidence = 10;

/// Verdict on a deviation that should be 0, given by its interval.
Verdict judge(double lo, double hi, double pass, double fail) {
  if (lo > -pass && hi < pass) {
    return Verdict::pass;
  }
  if (lo > fail || hi < -fail) {
    return Verdict::fail;
  }
  return hi - lo > 2.0 * pass ? Verdict::unknown : Verdict::warn;
}

int severity_of(Verdict verdict, int when_fail) {
  switch (verdict) {
    case Verdict::fail:
      return when_fail;
    case Verdict::warn:
      return when_fail / 2;
    case Verdict::unknown:
      return 1;
    default:
      return 0;
  }
}

const SourceResult* primary(const RobotResult& r) { return r.sources.empty() ? nullptr : &r.sources.front(); }

std::string source_of(const RobotResult& r) {
  return r.sources.empty() ? "" : std::string(source_name(r.sources.front().source));
}

Finding unknown(Finding f, const std::string& why, const std::string& advice) {
  f.verdict = Verdict::unknown;
  f.value.reason = why;
  f.advice = advice;
  return f;
}

constexpr const char* kNoRows = "the log has no rows with a pose, a speed or a counter";
constexpr const char* kRecord = "record the robot with source status at 1 Hz or faster";
constexpr const char* kAskFaster = "record source status more often than now";
constexpr const char* kDriveMore = "record more driving";

/// What helps against a measure of the pose that is missing for this reason.
const char* help_against(const std::string& reason) {
  const bool drove_little = reason.find("driven") != std::string::npos || reason.find("stretch") != std::string::npos;
  return drove_little ? kDriveMore : kRecord;
}

/// Stood in every row: neither speed nor counter moved.
bool stood(const RobotResult& r) {
  return !r.sources.empty() && r.still.runs > 0 && !(r.jumps.km > 0.0) && !(r.sources.front().counter.counted_m > 0.0);
}

/// Of a robot that stood there is nothing to say, whatever else is missing: faster polls would show it standing.
void say_that_it_stood(Finding& f) {
  if (f.verdict == Verdict::unknown) {
    f.value.reason += "; the robot stood the whole time, so it cannot be known";
    f.advice = "record the robot while it drives";
  }
}

/// The verdict of a scale that should be 1, with its evidence left to the caller.
void judge_scale(Finding& f, double driven_m, const Config& config, double fail, const std::string& wide) {
  if (!f.value.value) {
    f.advice = f.value.reason.find("period") != std::string::npos ? kAskFaster : kDriveMore;
    return;
  }
  if (driven_m < config.driven_min_m) {
    f = unknown(f, fmt::format("{:.3g} m driven, {:.3g} m needed", driven_m, config.driven_min_m), kDriveMore);
    return;
  }
  if (!f.value.lo || !f.value.hi) {
    f = unknown(f, f.value.reason, kDriveMore);
    return;
  }
  f.verdict = judge(*f.value.lo - 1.0, *f.value.hi - 1.0, config.scale_pass, fail);
  if (f.verdict == Verdict::unknown) {
    f.value.reason = "the interval is wider than the PASS band";
    f.advice = wide;
  }
}

Finding monotonic(const RobotResult& r) {
  Finding f{"ODO-01", r.robot, "counter monotonic", Verdict::unknown, 0, {}, "", "", {}, ""};
  f.threshold = fmt::format("PASS: no fall, no growth above {:.3g} m/s, never stuck for {:.3g} m; WARN: falls only",
                            r.config.v_max_mps, r.config.stuck_m);
  f.threshold_source = r.from({"v_max_mps", "stuck_m"});
  const SourceResult* s = primary(r);
  if (s == nullptr || !s->counter.seen || s->rows < 2) {
    return unknown(f, s == nullptr ? kNoRows : !s->counter.seen ? "the log has no odo" : "one row only", kRecord);
  }
  const std::uint64_t falls = s->counter.count(CounterEvent::What::fall);
  const std::uint64_t all = s->counter.events.size();
  f.value.value = static_cast<double>(all);
  f.value.n = static_cast<std::int64_t>(s->rows);
  f.verdict = all == 0 ? Verdict::pass : all == falls ? Verdict::warn : Verdict::fail;
  for (const CounterEvent& e : s->counter.events) {
    if (f.evidence.size() < kMostEvidence) {
      f.evidence.push_back(
          {e.from_us, e.to_us, source_of(r),
           fmt::format("{}: {:.3f} m -> {:.3f} m", counter_event_name(e.what), e.before_m, e.after_m)});
    }
  }
  if (all > 0) {
    f.advice = all == falls
                   ? "a controller was replaced or restored, or the counter was reset: totals start again there"
                   : "check encoders, motor controller and counter storage at the listed times";
  }
  return f;
}

Finding counter_speed(const RobotResult& r) {
  Finding f{"ODO-02", r.robot, "counter against speed", Verdict::unknown, 0, {}, "", "", {}, ""};
  const Config& c = r.config;
  f.threshold = fmt::format("|g-1|: PASS < {:.3g} %, FAIL > {:.3g} %; UNKNOWN below {:.3g} m or with u_g > {:.3g} %",
                            100 * c.scale_pass, 100 * c.speed_fail, c.driven_min_m, 100 * c.speed_u_max);
  f.threshold_source = r.from({"scale_pass", "speed_fail", "driven_min_m", "speed_u_max"});
  const SourceResult* s = primary(r);
  if (s == nullptr) {
    return unknown(f, kNoRows, kRecord);
  }
  f.value = s->speed.g;
  judge_scale(f, s->speed.driven_m, c, c.speed_fail, kDriveMore);
  std::vector<SpeedWindow> windows = s->speed.windows;
  std::erase_if(windows, [&](const SpeedWindow& w) { return !w.excludes_one(s->counter.q()); });
  std::stable_sort(windows.begin(), windows.end(), [](const SpeedWindow& a, const SpeedWindow& b) {
    return std::abs(a.g() - 1.0) > std::abs(b.g() - 1.0);
  });
  windows.resize(std::min(windows.size(), kMostEvidence));
  for (const SpeedWindow& w : windows) {
    f.evidence.push_back({w.from_us, w.to_us, source_of(r), fmt::format("g = {:.4f}", w.g())});
  }
  if (f.verdict == Verdict::warn || f.verdict == Verdict::fail) {
    f.advice = s->speed.signature.empty()
                   ? "counter and speed use different wheel diameters or gear ratios; compare both "
                     "with a measured distance"
                   : s->speed.signature;
  }
  return f;
}

Finding counter_path(const RobotResult& r) {
  Finding f{"ODO-03", r.robot, "counter against localised path", Verdict::unknown, 0, {}, "", "", {}, ""};
  const Config& c = r.config;
  f.threshold = fmt::format("|s_o-1|: PASS < {:.3g} %, FAIL > {:.3g} %; UNKNOWN below {:.3g} m", 100 * c.scale_pass,
                            100 * c.path_fail, c.driven_min_m);
  f.threshold_source = r.from({"scale_pass", "path_fail", "driven_min_m"});
  if (r.sources.empty()) {
    return unknown(f, kNoRows, kRecord);
  }
  f.value = r.path.s_o;
  judge_scale(f, r.path.counted_m, c, c.path_fail, kDriveMore);
  if (f.verdict == Verdict::warn || f.verdict == Verdict::fail) {
    f.advice =
        fmt::format("multiply the configured wheel diameter by {:.4f}, or check the map's scale", *f.value.value);
    for (std::size_t k = 1; k < r.path.curve.size() && f.evidence.size() < kMostEvidence; ++k) {
      if (std::abs(r.path.curve[k] - 1.0) >= c.scale_pass) {
        f.evidence.push_back({r.path.curve_t_us[k - 1], r.path.curve_t_us[k], source_of(r),
                              fmt::format("s_o = {:.4f} over 100 m", r.path.curve[k])});
      }
    }
  }
  return f;
}

Finding heading_drift(const RobotResult& r) {
  Finding f{"ODO-07", r.robot, "heading drift over 10 m", Verdict::unknown, 0, {}, "", "", {}, ""};
  const Config& c = r.config;
  f.threshold =
      fmt::format("|signed mean|: PASS < {:.3g} deg, FAIL > {:.3g} deg; UNKNOWN below {:.3g} independent stretches",
                  c.drift_pass_deg, c.drift_fail_deg, c.drift_n_min);
  f.threshold_source = r.from({"drift_pass_deg", "drift_fail_deg", "drift_n_min"});
  if (r.sources.empty()) {
    return unknown(f, kNoRows, kRecord);
  }
  f.value = r.drift.turn_at_10m_deg;
  if (!f.value.value) {
    return unknown(f, f.value.reason, help_against(f.value.reason));
  }
  if (static_cast<double>(f.value.n.value_or(0)) < c.drift_n_min) {
    return unknown(f, fmt::format("{} independent stretches of 10 m, {:.3g} needed", *f.value.n, c.drift_n_min),
                   kDriveMore);
  }
  if (!f.value.lo || !f.value.hi) {
    return unknown(f, f.value.reason, kDriveMore);
  }
  f.verdict = judge(*f.value.lo, *f.value.hi, c.drift_pass_deg, c.drift_fail_deg);
  if (f.verdict == Verdict::unknown) {
    return unknown(f, "the interval is wider than the PASS band", kDriveMore);
  }
  if (f.verdict != Verdict::pass) {
    f.advice = "calibrate the gyro or the wheel ratio: dead reckoning turns away from localisation";
    std::vector<SegmentError> longest = r.drift.segments;
    std::stable_sort(longest.begin(), longest.end(),
                     [](const SegmentError& a, const SegmentError& b) { return a.driven_m > b.driven_m; });
    longest.resize(std::min(longest.size(), kMostEvidence));
    for (const SegmentError& s : longest) {
      f.evidence.push_back({s.from_us, s.to_us, source_of(r), fmt::format("{:.0f} m", s.driven_m)});
    }
  }
  return f;
}

Finding jumps(const RobotResult& r) {
  Finding f{"LOC-02", r.robot, "unexplained localisation jumps", Verdict::unknown, 0, {}, "", "", {}, ""};
  const Config& c = r.config;
  f.threshold = fmt::format(
      "PASS: none in at least {:.3g} km, on most of which {:.2g} m would show; FAIL: lower limit above {:.3g} per 10 "
      "km",
      c.jump_min_km, c.jump_seen_m, c.jumps_fail_per_10km);
  f.threshold_source = r.from({"jump_min_km", "jump_seen_m", "jumps_fail_per_10km", "jump_m", "jump_rad"});
  if (r.sources.empty()) {
    return unknown(f, kNoRows, kRecord);
  }
  f.value = r.jumps.unexplained_per_km;
  const std::uint64_t n = r.jumps.count(JumpCause::unexplained);
  if (n == 0 && !f.value.value) {
    return unknown(f, f.value.reason, help_against(f.value.reason));
  }
  if (n == 0 && r.jumps.km < c.jump_min_km) {
    return unknown(f, fmt::format("no jump, but only {:.3g} km driven", r.jumps.km), kDriveMore);
  }
  const bool fail = r.jumps.least_per_km * 10.0 > c.jumps_fail_per_10km;
  f.verdict = n == 0 ? Verdict::pass : fail ? Verdict::fail : Verdict::warn;
  for (const Jump& j : r.jumps.jumps) {
    if (j.cause == JumpCause::unexplained && f.evidence.size() < kMostEvidence) {
      f.evidence.push_back({j.from_us, j.to_us, source_of(r),
                            fmt::format("{:+.3f} m, {:+.3f} m, {:+.2f} deg at ({:.2f}, {:.2f})", j.dx_m, j.dy_m,
                                        j.dangle_rad * 180.0 / kPi, j.before.x, j.before.y)});
    }
  }
  if (n > 0) {
    f.advice = "look at the map and the sensors at the listed places: the pose moved where the robot did not";
  }
  return f;
}

Finding cross(const RobotResult& r) {
  Finding f{"DATA-08", r.robot, "JSON against Modbus", Verdict::unknown, 0, {}, "", "", {}, ""};
  const Config& c = r.config;
  f.threshold =
      fmt::format("share outside tolerance: PASS <= {:.3g} %, FAIL > {:.3g} %", 100 * c.cross_pass, 100 * c.cross_fail);
  f.threshold_source = r.from({"cross_pass", "cross_fail", "soc_tolerance", "v_max_mps"});
  f.value = r.cross.share;
  if (!f.value.value) {
    return unknown(f, r.cross.reason, "record the sources status and registers of this robot together");
  }
  f.verdict = *f.value.hi <= c.cross_pass                ? Verdict::pass
              : *f.value.lo > c.cross_fail               ? Verdict::fail
              : *f.value.hi - *f.value.lo > c.cross_pass ? Verdict::unknown
                                                         : Verdict::warn;
  // An interval too wide for the PASS band can still be all above it.
  if (f.verdict == Verdict::unknown && *f.value.lo > c.cross_pass) {
    f.verdict = Verdict::warn;
  }
  for (std::size_t k = 0; k < kComparedCount; ++k) {
    const CrossCount& count = r.cross.counts[k];
    const auto what = static_cast<Compared>(k);
    if (count.outside > 0) {
      f.evidence.push_back({count.worst_us, count.worst_us, "registers",
                            fmt::format("{}: {} of {} outside, worst {:.4g} {}", compared_name(what), count.outside,
                                        count.n, count.worst, compared_unit(what))});
    }
  }
  if (r.cross.word_order) {
    f.advice = "byte or word order: set the word order of this robot's registers and decode again";
  } else if (f.verdict == Verdict::unknown) {
    f.value.reason = fmt::format("{} of {} outside: too few comparisons to tell {:.3g} %", r.cross.outside, r.cross.n,
                                 100 * c.cross_pass);
    f.advice = "record both sources longer";
  } else if (f.verdict != Verdict::pass) {
    f.advice = "see table json_modbus: which quantity, and how far outside";
  }
  return f;
}

}  // namespace

std::string RobotResult::from(std::initializer_list<std::string_view> names) const {
  std::vector<std::string> full;
  for (const std::string_view name : names) {
    full.push_back("odometry." + std::string(name));
  }
  const std::vector<std::string_view> views(full.begin(), full.end());
  return settings->sources(views, robot);
}

std::vector<Finding> make_findings(const RobotResult& r) {
  std::vector<Finding> all{monotonic(r), counter_speed(r), counter_path(r), heading_drift(r), jumps(r), cross(r)};
  if (stood(r)) {
    for (Finding* of_driving : {&all[1], &all[2], &all[3], &all[4]}) {
      say_that_it_stood(*of_driving);
    }
  }
  const std::array<int, 6> when_fail{8, 6, 7, 6, 8, 6};
  for (std::size_t i = 0; i < all.size(); ++i) {
    all[i].severity = severity_of(all[i].verdict, when_fail[i]);
  }
  return all;
}

}  // namespace tacho::odometry
