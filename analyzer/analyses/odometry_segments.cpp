#include "analyzer/analyses/odometry_segments.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tacho::odometry {
namespace {

struct CutText {
  std::string_view name;
  std::string_view meaning;
};
constexpr std::array<CutText, kCutCount> kCuts{{
    {"start", "first row of the log"},
    {"session", "the recorder was started again"},
    {"clock", "host time ran backwards"},
    {"reboot", "uptime fell"},
    {"gap", "no answer for longer than three median periods and 2 s"},
    {"map", "map name or md5 changed"},
    {"localisation", "localisation left or regained success"},
    {"counter", "the counter fell"},
    {"pose", "poses started or ended"},
}};

bool given(double v) { return std::isfinite(v); }
/// -0.0 becomes 0, missing becomes 0: the tags say which it was.
double zero(double v) { return given(v) ? v + 0.0 : 0.0; }

Row make_row(const RawRow& raw) {
  Row row;
  row.t_us = raw.t_us;
  row.x = zero(raw.x);
  row.y = zero(raw.y);
  row.angle = static_cast<float>(given(raw.angle) ? wrap_pi(raw.angle) : 0.0);
  row.vx = static_cast<float>(zero(raw.vx));
  row.vy = static_cast<float>(zero(raw.vy));
  row.w = static_cast<float>(zero(raw.w));
  row.odo = zero(raw.odo);
  row.confidence = given(raw.confidence) ? static_cast<float>(raw.confidence) : -1.0F;
  row.loc_method = static_cast<std::int8_t>(raw.loc_method);
  const bool localised = raw.reloc < 0 || raw.reloc == 1;
  const std::array<std::pair<bool, unsigned>, 9> tags{{
      {given(raw.x) && given(raw.y) && given(raw.angle) && localised, kPose},
      {given(raw.odo), kOdo},
      {given(raw.vx), kSpeed},
      {given(raw.w), kTurn},
      {raw.loc_method == 3, kOdometryMode},
      {raw.manual, kManual},
      {raw.free_wheel, kFreeWheel},
      {raw.charging, kCharging},
      {raw.confidence_sentinel, kNoEstimate},
  }};
  for (const auto& [on, tag] : tags) {
    row.tags = static_cast<std::uint16_t>(row.tags | (on ? tag : 0U));
  }
  return row;
}

bool zero_twist(const Row& row, const Config& config) {
  return row.all(kSpeed) && row.speed() < config.still_mps && std::abs(static_cast<double>(row.w)) < config.still_radps;
}

std::size_t bit_of(Tag tag) {
  std::size_t bit = 0;
  while ((1U << bit) != static_cast<unsigned>(tag)) {
    ++bit;
  }
  return bit;
}

}  // namespace

std::string_view cut_name(Cut cut) { return kCuts[static_cast<std::size_t>(cut)].name; }
std::string_view cut_meaning(Cut cut) { return kCuts[static_cast<std::size_t>(cut)].meaning; }

std::string too_slow(double period_s, const Config& config, std::string_view what_needs) {
  if (std::isnan(period_s)) {
    return "fewer than two rows";
  }
  return period_s <= kJitter * config.period_max_s ? ""
                                                   : fmt::format("period {:.3g} s: {} polling at least every {:.3g} s",
                                                                 period_s, what_needs, config.period_max_s);
}

double Preparation::gap_s() const {
  // The rate may have been changed before the first row: see PollClock.
  double period = std::max(planned_.seconds(), first_pause_s_);
  const std::size_t known = std::min(pause_count_, pauses_.size());
  if (known >= 5) {
    std::array<float, 31> sorted = pauses_;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(known / 2);
    std::nth_element(sorted.begin(), middle, sorted.begin() + static_cast<std::ptrdiff_t>(known));
    period = static_cast<double>(*middle);
  }
  return std::max(config_.gap_periods * std::max(period, rate_change_s_), config_.gap_min_s);
}

bool Preparation::cut_at(const RawRow& raw, const Row& row, double dt_s, Cut& cut) const {
  const bool reloc_edge = (last_.reloc == 1) != (raw.reloc == 1) && last_.reloc >= 0 && raw.reloc >= 0;
  const std::array<std::pair<bool, Cut>, 8> rules{{
      {raw.session != last_.session, Cut::session},
      {dt_s <= 0.0, Cut::clock},
      {raw.uptime_s < last_.uptime_s, Cut::reboot},
      {dt_s > gap_s(), Cut::gap},
      {raw.map != last_.map && raw.map != 0 && last_.map != 0, Cut::map},
      {reloc_edge, Cut::localisation},
      {row.all(kOdo) && last_row_.all(kOdo) && raw.odo < last_.odo - kTremble_m, Cut::counter},
      {row.all(kPose) != last_row_.all(kPose), Cut::pose},
  }};
  const auto hit = std::find_if(rules.begin(), rules.end(), [](const auto& rule) { return rule.first; });
  if (hit == rules.end()) {
    return false;
  }
  cut = hit->second;
  return true;
}

bool Preparation::step(const RawRow& raw, Prepared& out) {
  if (any_ && raw.session == last_.session && given(raw.uptime_s) && raw.uptime_s == last_.uptime_s) {
    ++duplicates_;
    return false;
  }
  out = Prepared{};
  out.row = make_row(raw);
  const double before_s = planned_.seconds();
  const bool changed = planned_.advance(raw.session, raw.seq) && any_ && raw.session == last_.session;
  out.slowed = planned_.standing();
  rate_change_s_ = changed ? std::max(before_s, planned_.seconds()) : 0.0;
  if (changed || !any_ || raw.session != last_.session) {
    first_pause_s_ = 0.0;
  } else if (pause_count_ == 0 && raw.seq == last_.seq + 1) {
    first_pause_s_ = static_cast<double>(raw.t_us - last_.t_us) * 1e-6;
  }
  if (any_) {
    out.dt_s = static_cast<double>(raw.t_us - last_.t_us) * 1e-6;
    out.joined = !cut_at(raw, out.row, out.dt_s, out.cut);
    segment_ += out.joined ? 0U : 1U;
    if (raw.session != last_.session || changed) {
      pause_count_ = 0;
    } else if (out.dt_s > 0.0) {
      pauses_[pause_count_++ % pauses_.size()] = static_cast<float>(out.dt_s);
    }
  }
  out.row.segment = segment_;
  if (!out.joined) {
    out.row.tags |= kCut;
  }
  RawRow kept = raw;
  kept.map = raw.map != 0 ? raw.map : last_.map;
  kept.uptime_s = given(raw.uptime_s) ? raw.uptime_s : last_.uptime_s;
  last_ = kept;
  last_row_ = out.row;
  any_ = true;
  return true;
}

Interval interval_of(const Row& a, const Row& b, const Config& config) {
  Interval i;
  i.dt_s = static_cast<double>(b.t_us - a.t_us) * 1e-6;
  const auto mean = [](float u, float v) { return 0.5 * (static_cast<double>(u) + static_cast<double>(v)); };
  i.twist = {mean(a.vx, b.vx), mean(a.vy, b.vy), mean(a.w, b.w)};
  i.counted_m = a.all(kOdo) && b.all(kOdo) ? b.odo - a.odo : 0.0;
  i.standing = b.all(kStood) || (zero_twist(a, config) && zero_twist(b, config) && i.counted_m == 0.0);
  if (i.standing) {
    i.twist = {};
  }
  i.metres = i.standing ? 0.0 : 0.5 * (a.speed() + b.speed()) * i.dt_s;
  return i;
}

bool Track::standing_on(const Row& row) const {
  const Row& kept = rows_.back();
  const unsigned watched = static_cast<unsigned>(~(kStood | kCut)) & 0xFFFFU;
  return row.segment == kept.segment && zero_twist(kept, config_) && zero_twist(row, config_) &&
         zero_twist(pending_, config_) && row.odo == kept.odo && (row.tags & watched) == (kept.tags & watched) &&
         row.loc_method == kept.loc_method && std::hypot(row.x - kept.x, row.y - kept.y) < 0.5 * config_.jump_m &&
         std::abs(wrap_pi(static_cast<double>(row.angle) - static_cast<double>(kept.angle))) < 0.5 * config_.jump_rad &&
         std::abs(row.confidence - kept.confidence) < 0.1F;
}

void Track::count(const Prepared& prepared) {
  ++total_rows_;
  if (!prepared.joined) {
    segments_.push_back({prepared.cut, prepared.row.t_us, prepared.row.t_us, 0, 0.0});
  }
  Segment& segment = segments_.back();
  segment.to_us = prepared.row.t_us;
  ++segment.rows;
  for (std::size_t tag = 0; tag < tag_seconds_.size(); ++tag) {
    if (prepared.row.all(1U << tag)) {
      tag_seconds_[tag] += prepared.joined ? prepared.dt_s : 0.0;
      ++tag_rows_[tag];
    }
  }
  if (prepared.dt_s > 0.0) {
    const double longest = static_cast<double>(pause_bins_.size() - 1);
    ++(prepared.slowed ? slowed_bins_
                       : pause_bins_)[static_cast<std::size_t>(std::min(std::round(prepared.dt_s * 1e3), longest))];
  }
}

void Track::push(const Prepared& prepared) {
  count(prepared);
  const Row& row = prepared.row;
  if (has_pending_) {
    const Row& before = pending_;
    if (prepared.joined && before.all(kOdo) && row.all(kOdo)) {
      segments_.back().driven_m += row.odo - before.odo;
    }
    if (standing_on(row)) {
      pending_ = row;
      return;
    }
    close();
  }
  rows_.push_back(row);
  pending_ = row;
  has_pending_ = true;
}

void Track::close() {
  if (has_pending_ && pending_.t_us != rows_.back().t_us) {
    pending_.tags |= kStood;
    rows_.push_back(pending_);
  }
}

double Track::period_s() const {
  const auto sum = [](const Bins& bins) { return std::accumulate(bins.begin(), bins.end(), std::uint64_t{0}); };
  // How often a standing robot is asked says nothing of how well its motion was seen.
  const Bins& bins = sum(pause_bins_) > 0 ? pause_bins_ : slowed_bins_;
  const std::uint64_t total = sum(bins);
  std::uint64_t seen = 0;
  for (std::size_t bin = 0; bin < bins.size(); ++bin) {
    seen += bins[bin];
    if (total > 0 && 2 * seen >= total) {
      return static_cast<double>(bin) * 1e-3;
    }
  }
  return kNone;
}

double Track::driven_m() const {
  double sum = 0.0;
  for (const Segment& segment : segments_) {
    sum += segment.driven_m;
  }
  return sum;
}

double Track::hours_with(Tag tag) const { return tag_seconds_[bit_of(tag)] / 3600.0; }
std::uint64_t Track::rows_with(Tag tag) const { return tag_rows_[bit_of(tag)]; }

}  // namespace tacho::odometry
