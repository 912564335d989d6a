#include "analyzer/analyses/odometry_jumps.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "analyzer/math/poisson.hpp"

namespace tacho::odometry {
namespace {

struct CauseText {
  std::string_view name;
  std::string_view meaning;
};
constexpr std::array<CauseText, kJumpCauseCount> kCauses{{
    {"map", "map or map md5 changed"},
    {"localisation", "localisation was not successful within 2 s"},
    {"method", "localisation method changed within 2 s"},
    {"confidence", "confidence fell by 0.2 or more within 2 s"},
    {"gap", "nothing recorded before it: cannot tell"},
    {"unexplained", "no cause in the log"},
}};

constexpr auto kNear_us = static_cast<Micros>(kJitter * 2'000'000);
constexpr double kTurningNow_radps = 0.02;

/// What one pair of consecutive poses says.
struct Step {
  std::size_t before = 0;
  std::size_t row = 0;
  bool judged = false;
  bool off = false;
  bool joined = false;
  double dx = 0, dy = 0, dangle = 0;
  double allowed_m = 0, allowed_rad = 0;
};

class Finder {
 public:
  Finder(const Track& track, const Accelerations& accelerations, const StandstillResult& still, const Config& config)
      : track_(track), rows_(track.rows()), accelerations_(accelerations), config_(config) {
    sigma_p_ = still.sigma_p.value.value_or(0.0);
    sigma_theta_ = still.sigma_theta.value.value_or(0.0);
  }

  Step judge(std::size_t before, std::size_t after) const {
    const Row& a = rows_[before];
    const Row& b = rows_[after];
    Step step;
    step.before = before;
    step.row = after;
    step.joined = after == before + 1 && !b.all(kCut);
    Interval i = interval_of(a, b, config_);
    const bool odometer = a.all(kOdo) && b.all(kOdo);
    const bool continuous = step.joined || (after == before + 1 && polls_went_on(b));
    const bool stood = odometer && i.counted_m == 0.0;
    if (a.all(kOdometryMode) || b.all(kOdometryMode) || i.dt_s <= 0.0 || (!continuous && !stood)) {
      return step;
    }
    const bool twist = a.all(kSpeed | kTurn) && b.all(kSpeed | kTurn);
    if (continuous && !twist && !i.standing) {
      return step;
    }
    if (!continuous) {
      i.standing = true;
      i.twist = {};
      i.metres = 0.0;
    }
    step.judged = true;
    compare(a, b, i, step);
    return step;
  }

  [[nodiscard]] Jump describe(const Step& step) const {
    const Row& a = rows_[step.before];
    const Row& b = rows_[step.row];
    Jump jump{step.row, a.t_us, b.t_us, a.pose(), step.dx, step.dy, step.dangle, step.allowed_m, step.allowed_rad};
    jump.resolved = resolved(step);
    double highest = -1.0;
    double lowest = 2.0;
    bool lost = false;
    bool method = false;
    auto first = rows_.begin() + static_cast<std::ptrdiff_t>(step.before);
    while (first != rows_.begin() && std::prev(first)->t_us >= a.t_us - kNear_us) {
      --first;
    }
    for (auto row = first; row != rows_.end() && row->t_us <= b.t_us + kNear_us; ++row) {
      lost = lost || !row->all(kPose) || cut_of(*row) == Cut::localisation;
      method = method || row->loc_method != a.loc_method;
      if (row->confidence >= 0.0F) {
        highest = std::max(highest, static_cast<double>(row->confidence));
        lowest = std::min(lowest, static_cast<double>(row->confidence));
      }
    }
    jump.confidence = highest < 0.0 ? -1.0 : lowest;
    const bool dip = highest - lowest >= 0.2;
    jump.cause = changed_map(a, b) ? JumpCause::map
                 : lost            ? JumpCause::localisation
                 : method          ? JumpCause::method
                 : dip             ? JumpCause::confidence
                 : !step.joined    ? JumpCause::gap
                                   : JumpCause::unexplained;
    return jump;
  }

  [[nodiscard]] bool resolved(const Step& step) const { return step.judged && step.allowed_m <= config_.jump_seen_m; }

 private:
  const Track& track_;
  const std::vector<Row>& rows_;
  const Accelerations& accelerations_;
  const Config& config_;
  double sigma_p_ = 0;
  double sigma_theta_ = 0;

  [[nodiscard]] std::optional<Cut> cut_of(const Row& row) const {
    return row.all(kCut) ? std::optional(track_.segments()[row.segment].cut) : std::nullopt;
  }
  /// A change of map, localisation or counter is no hole: only gaps, restarts and clock steps are.
  [[nodiscard]] bool polls_went_on(const Row& row) const {
    const std::optional<Cut> cut = cut_of(row);
    return cut == Cut::map || cut == Cut::localisation || cut == Cut::counter;
  }
  [[nodiscard]] bool changed_map(const Row& a, const Row& b) const {
    const auto& segments = track_.segments();
    return std::any_of(segments.begin() + a.segment + 1, segments.begin() + b.segment + 1,
                       [](const Segment& s) { return s.cut == Cut::map; });
  }

  /// Whether there was time to stop and turn on the spot between two polls.
  [[nodiscard]] bool may_pivot(const Row& a, const Row& b, const Interval& i) const {
    const double hardest = std::max(accelerations_.hardest, accelerations_.linear);
    return !b.all(kStood) && a.speed() + b.speed() <= 1.1 * hardest * i.dt_s + config_.pivot_mps;
  }

  [[nodiscard]] double turn_doubt(const Row& a, const Row& b, const Interval& i) const {
    const double change = std::abs(static_cast<double>(b.w) - static_cast<double>(a.w));
    const double bound = std::max(accelerations_.radians(a, b, i), 0.5 * change * i.dt_s);
    if (accelerations_.resolves_turning(i.dt_s)) {
      return bound;
    }
    const double fastest = accelerations_.fastest_turn * i.dt_s;
    if (may_pivot(a, b, i)) {
      const double seen = std::abs(i.twist.w) * i.dt_s;
      return std::max({bound, seen, fastest - seen});
    }
    const bool turns = std::max(std::abs(a.w), std::abs(b.w)) > static_cast<float>(kTurningNow_radps);
    return turns ? std::max(bound, 0.5 * fastest) : bound;
  }

  [[nodiscard]] double drive_doubt(const Row& a, const Row& b, const Interval& i, double bound_rad) const {
    const double change = std::abs(b.speed() - a.speed());
    const double bound = std::max(accelerations_.metres(a, b, i), 0.5 * change * i.dt_s);
    // First driving, then turning, or the other way round: neither is the arc of the mean twist.
    const double turned = may_pivot(a, b, i) ? std::abs(i.twist.w) * i.dt_s : 0.0;
    return bound + 0.5 * i.metres * (bound_rad + turned);
  }

  void compare(const Row& a, const Row& b, const Interval& i, Step& step) const {
    const Pose predicted = compose(a.pose(), exp_se2(i.twist, i.dt_s));
    step.dx = b.x - predicted.x;
    step.dy = b.y - predicted.y;
    step.dangle = wrap_pi(static_cast<double>(b.angle) - predicted.angle);
    const double bound_rad = turn_doubt(a, b, i);
    const double bound_m = drive_doubt(a, b, i, bound_rad);
    const double sigma_e = std::sqrt(2.0 * sigma_p_ * sigma_p_ + i.metres * i.metres * sigma_theta_ * sigma_theta_);
    step.allowed_m = std::max(config_.jump_m, config_.jump_sigmas * sigma_e + bound_m);
    step.allowed_rad = std::max(config_.jump_rad, config_.jump_sigmas * std::sqrt(2.0) * sigma_theta_ + bound_rad);
    step.off = std::hypot(step.dx, step.dy) > step.allowed_m || std::abs(step.dangle) > step.allowed_rad;
  }
};

/// Whether the error goes on in a neighbouring interval, e.g. wheels that spin for two seconds: the neighbour shares at
/// least 40 % of it and more than half of what it may be off by itself.
bool goes_on(const Step& step, const Step& neighbour) {
  if (!step.off || !neighbour.judged || !step.joined || !neighbour.joined) {
    return false;
  }
  const double metres = std::hypot(step.dx, step.dy);
  const double along = metres > 0.0 ? (step.dx * neighbour.dx + step.dy * neighbour.dy) / metres : 0.0;
  const double turn = step.dangle < 0.0 ? -neighbour.dangle : neighbour.dangle;
  const bool moved = metres > step.allowed_m && along >= std::max(0.4 * metres, 0.5 * neighbour.allowed_m);
  const bool turned = std::abs(step.dangle) > step.allowed_rad &&
                      turn >= std::max(0.4 * std::abs(step.dangle), 0.5 * neighbour.allowed_rad);
  return moved || turned;
}

void take_rates(JumpResult& r, const Config& config) {
  Quantity& rate = r.unexplained_per_km;
  if (r.intervals == 0) {
    r.reason = rate.reason = "the log has no pair of poses with a speed between them";
  } else if (r.km <= 0.0) {
    rate.reason = "nothing driven";
  } else {
    r.least_per_km = math::poisson_rate(static_cast<double>(r.count(JumpCause::unexplained)), r.km).lo;
  }
  if (!rate.reason.empty()) {
    return;
  }
  if (2.0 * r.seen_km < r.km) {
    rate.reason = fmt::format("period {:.3g} s: a step of {:.2g} m would have shown on {:.3g} of {:.3g} km only",
                              r.period_s, config.jump_seen_m, r.seen_km, r.km);
    return;
  }
  const auto n = std::count_if(r.jumps.begin(), r.jumps.end(),
                               [](const Jump& j) { return j.cause == JumpCause::unexplained && j.resolved; });
  const math::Rate seen = math::poisson_rate(static_cast<double>(n), r.seen_km);
  rate = {seen.value, "1/km", seen.lo, seen.hi, n, r.seen_km, ""};
}

}  // namespace

std::string_view jump_cause_name(JumpCause cause) { return kCauses[static_cast<std::size_t>(cause)].name; }
std::string_view jump_cause_meaning(JumpCause cause) { return kCauses[static_cast<std::size_t>(cause)].meaning; }

std::uint64_t JumpResult::count(JumpCause cause) const {
  return static_cast<std::uint64_t>(
      std::count_if(jumps.begin(), jumps.end(), [cause](const Jump& j) { return j.cause == cause; }));
}

bool JumpResult::at(std::size_t row) const {
  const auto found =
      std::lower_bound(jumps.begin(), jumps.end(), row, [](const Jump& j, std::size_t r) { return j.row < r; });
  return found != jumps.end() && found->row == row;
}

JumpResult find_jumps(const Track& track, const Accelerations& accelerations, const StandstillResult& still,
                      const Config& config) {
  JumpResult r;
  r.unexplained_per_km.unit = "1/km";
  const std::vector<Row>& rows = track.rows();
  r.period_s = track.period_s();
  r.reason = too_slow(r.period_s, config, "jumps need");
  if (!r.reason.empty()) {
    r.unexplained_per_km.reason = r.reason;
    return r;
  }
  const Finder finder(track, accelerations, still, config);
  Step before;
  Step current;
  const auto settle = [&](const Step& after) {
    if (current.off && (goes_on(current, before) || goes_on(current, after))) {
      ++r.sustained;
    } else if (current.off) {
      r.jumps.push_back(finder.describe(current));
    }
    before = current;
    current = after;
  };
  std::optional<std::size_t> last;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (!rows[k].all(kPose)) {
      continue;
    }
    if (last) {
      const Step step = finder.judge(*last, k);
      const Interval i = interval_of(rows[*last], rows[k], config);
      r.intervals += step.judged ? 1U : 0U;
      const double km = step.judged && i.counted_m > 0.0 ? i.counted_m / 1000.0 : 0.0;
      r.km += km;
      r.seen_km += finder.resolved(step) ? km : 0.0;
      settle(step);
    }
    last = k;
  }
  settle(Step{});
  take_rates(r, config);
  return r;
}

}  // namespace tacho::odometry
