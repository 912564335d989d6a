// Is the odometry right? Folds status and register rows of one robot into tracks and counters; everything that needs to
// know the noise, the bounds or the jumps of the whole log runs once at the end. Definitions: README.md and the
// headers.

#include <algorithm>
#include <map>

#include "analyzer/analyses/analyses.hpp"
#include "analyzer/analyses/odometry_result.hpp"
#include "analyzer/math/robust.hpp"
#include "schema/time.hpp"

namespace tacho {
namespace {

using namespace odometry;

constexpr std::string_view kQuestion = "Can the odometer, the speed and the localisation be trusted?";

/// One source of one robot.
class SourceFold {
 public:
  SourceFold(const RobotContext& context, const Config& config, Source source)
      : source_(source),
        config_(config),
        preparation_(config, {planned_us(context, source), source}),
        counter_(config, source == Source::registers),
        still_(config),
        track_(config) {}

  void open(const Slice& slice) { preparation_.open(slice); }
  /// Whether the row continues the one before; empty for a duplicate.
  std::optional<bool> add(const RawRow& raw) {
    Prepared prepared;
    if (!preparation_.step(raw, prepared)) {
      return std::nullopt;
    }
    counter_.add(raw, prepared);
    still_.add(prepared);
    track_.push(prepared);
    return prepared.joined;
  }

  /// The measures without pose. Call once.
  SourceResult finish() {
    track_.close();
    SourceResult r;
    r.source = source_;
    r.period_s = track_.period_s();
    r.rows = track_.total_rows();
    r.duplicates = preparation_.duplicates();
    r.counter = counter_.finish();
    r.accelerations = measure_accelerations(track_, config_);
    r.counts = find_what_it_counts(track_, r.accelerations, config_, r.counter.q());
    r.speed = compare_speed(track_, r.accelerations, r.counts, config_, r.counter.q());
    return r;
  }
  StandstillResult standstill(double quantum_m) { return still_.finish(quantum_m); }
  [[nodiscard]] const Track& track() const { return track_; }

 private:
  Source source_;
  Config config_;
  Preparation preparation_;
  CounterFold counter_;
  StandstillFold still_;
  Track track_;

  static Micros planned_us(const RobotContext& context, Source source) {
    const Coverage* coverage = context.find(source);
    return coverage == nullptr ? 0 : coverage->period_us;
  }
};

std::vector<TagTime> tag_times(const Track& track) {
  struct TagText {
    Tag tag;
    const char* name;
    const char* meaning;
  };
  constexpr std::array<TagText, 5> kTexts{{
      {kOdometryMode, "odometry_mode", "pose not independent: left out of path, drift and jumps"},
      {kManual, "manual", "driven by joystick"},
      {kFreeWheel, "emergency", "emergency stop: the wheels may turn freely"},
      {kCharging, "charging", "on the charging contact"},
      {kNoEstimate, "no_estimate", "confidence exactly 0: no estimate, not a low one"},
  }};
  std::vector<TagTime> times;
  for (const TagText& text : kTexts) {
    times.push_back({text.name, text.meaning, track.hours_with(text.tag), track.rows_with(text.tag)});
  }
  return times;
}

void add_days(RobotResult& r, const SpeedResult& speed) {
  constexpr Micros kDay = 86'400'000'000;
  struct Values {
    std::vector<double> g;
    std::vector<double> weight;
  };
  std::map<Micros, Values> days;
  for (const SpeedWindow& window : speed.windows) {
    const Micros offset = Micros{1'000'000} * zone_offset_s(r.zone, window.to_us).value_or(0);
    const Micros local = window.to_us + offset;
    Values& day = days[(local - (((local % kDay) + kDay) % kDay)) / kDay];
    day.g.push_back(window.g());
    day.weight.push_back(window.integral_m);
  }
  std::vector<double> x;
  std::vector<double> y;
  for (const auto& [number, values] : days) {
    x.push_back(static_cast<double>(number));
    y.push_back(weighted_median(values.g, values.weight));
    r.days.push_back(
        {iso_utc(number * kDay).substr(0, 10), x.back(), y.back(), static_cast<std::int64_t>(values.g.size())});
  }
  r.g_trend = find_trend(x, y);
}

class OdometryAnalysis final : public Analysis {
 public:
  explicit OdometryAnalysis(const RobotContext& context) : cross_(Config::load(*context.settings, context.robot.name)) {
    result_.robot = context.robot.name;
    result_.settings = context.settings;
    result_.zone = context.zone;
    result_.config = Config::load(*context.settings, context.robot.name);
    const auto usable = [&](Source source) {
      const auto needs = row_needs();
      return std::any_of(needs.begin(), needs.end(), [&](const Need& need) {
        const bool motion = need.field == field("odo") || need.field == field("vx") || need.field == field("x");
        return motion && need.sources.front() == source && context.choose(need).has_value();
      });
    };
    if (usable(Source::status)) {
      status_.emplace(context, result_.config, Source::status);
    }
    if (usable(Source::registers)) {
      registers_.emplace(context, result_.config, Source::registers);
    }
  }

  void fold(const Slice& slice) override {
    std::optional<Micros> last_us;
    const auto each = [&](Source source, const auto& use) {
      const RowReader reader(slice, source);
      for (std::size_t row = 0; row < reader.rows(); ++row) {
        const CrossRow cross = reader.at(row);
        last_us = std::max(last_us.value_or(cross.base.t_us), cross.base.t_us);
        use(cross);
      }
    };
    const bool both = status_ && registers_;
    for (std::optional<SourceFold>* fold : {&status_, &registers_}) {
      if (*fold) {
        (*fold)->open(slice);
      }
    }
    if (status_) {
      each(Source::status, [&](const CrossRow& row) {
        const std::optional<bool> joined = status_->add(row.base);
        if (both && joined) {
          cross_.add_json(row, *joined);
        }
      });
    }
    if (registers_) {
      each(Source::registers, [&](const CrossRow& row) {
        registers_->add(row.base);
        if (both) {
          cross_.add_registers(row);
        }
      });
    }
    if (last_us) {
      cross_.settle(*last_us);
    }
  }

  void merge(Analysis& other) override {
    conclude();
    auto& analysis = static_cast<OdometryAnalysis&>(other);
    analysis.conclude();
    std::move(analysis.done_.begin(), analysis.done_.end(), std::back_inserter(done_));
  }

  Section finish() override {
    conclude();
    Section section;
    section.name = "odometry";
    section.title = "Odometry";
    section.question = kQuestion;
    for (const RobotResult& robot : done_) {
      const auto append = [](auto& to, auto from) { std::move(from.begin(), from.end(), std::back_inserter(to)); };
      append(section.notes, make_notes(robot));
      append(section.findings, make_findings(robot));
      append(section.series, make_series(robot));
    }
    section.tables = make_tables(done_);
    return section;
  }

 private:
  RobotResult result_;
  std::optional<SourceFold> status_;
  std::optional<SourceFold> registers_;
  CrossFold cross_;
  std::vector<RobotResult> done_;
  bool concluded_ = false;

  void conclude() {
    if (concluded_) {
      return;
    }
    concluded_ = true;
    const bool both = status_ && registers_;
    for (std::optional<SourceFold>* fold : {&status_, &registers_}) {
      if (*fold) {
        result_.sources.push_back((*fold)->finish());
      }
    }
    if (result_.sources.empty()) {
      result_.cross.reason = "the log has neither status nor register rows with a pose, a speed or a counter";
      result_.cross.share.reason = result_.cross.reason;
    } else {
      measure(status_ ? *status_ : *registers_);
    }
    if (both) {
      result_.cross = cross_.finish(result_.still);
    } else if (!result_.sources.empty()) {
      result_.cross.reason = std::string("one source only: ") + (status_ ? "no registers" : "no status answers");
      result_.cross.share.reason = result_.cross.reason;
    }
    status_.reset();
    registers_.reset();
    done_.insert(done_.begin(), std::move(result_));
  }

  void measure(SourceFold& primary) {
    const SourceResult& base = result_.sources.front();
    const Track& track = primary.track();
    const Config& config = result_.config;
    result_.segments = track.segments();
    result_.tags = tag_times(track);
    result_.still = primary.standstill(base.counter.q());
    result_.jumps = find_jumps(track, base.accelerations, result_.still, config);
    result_.path = compare_path(track, result_.jumps, result_.still, base.counts, config, base.counter.q());
    result_.drift = measure_drift(track, result_.jumps, base.accelerations, result_.still, config);
    add_days(result_, base.speed);
  }
};

std::unique_ptr<Analysis> make(const RobotContext& context) { return std::make_unique<OdometryAnalysis>(context); }

}  // namespace

const AnalysisSpec kOdometry{"odometry", kQuestion, odometry::row_needs, make, odometry::setting_rows};

}  // namespace tacho
