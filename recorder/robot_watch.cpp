#include "recorder/robot_watch.hpp"

#include <array>
#include <cmath>
#include <utility>

namespace tacho::recorder {

namespace {

constexpr double kStillMps = 0.01;  // a parked robot shows noise of 1e-4 (FIELD-FACTS 2.2)
constexpr double kStillRadps = 0.01;
constexpr std::int64_t kTaskWaiting = 1;
constexpr std::int64_t kTaskRunning = 2;

constexpr std::array kWatchedFields{field("vx"),          field("vy"),      field("w"),      field("is_stop"),
                                    field("task_status"), field("blocked"), field("slowed"), field("charging")};

const FieldSet& watched() {
  static const FieldSet fields = [] {
    FieldSet set = identity_fields();
    for (const FieldIndex f : kWatchedFields) {
      set.set(f);
    }
    return set;
  }();
  return fields;
}

bool exceeds(const Sample& sample, FieldIndex f, double limit) {
  return sample.at(f).has() && std::abs(sample.at(f).real) > limit;
}

std::optional<bool> flag(const Sample& sample, FieldIndex f) {
  return sample.at(f).has() ? std::optional<bool>(sample.at(f).integer != 0) : std::nullopt;
}

std::optional<bool> moves(const Sample& sample) {
  if (exceeds(sample, field("vx"), kStillMps) || exceeds(sample, field("vy"), kStillMps) ||
      exceeds(sample, field("w"), kStillRadps)) {
    return true;
  }
  if (sample.at(field("vx")).has() && sample.at(field("w")).has()) {
    return false;
  }
  const std::optional<bool> still = flag(sample, field("is_stop"));
  return still ? std::optional<bool>(!*still) : std::nullopt;
}

/// A task, or an obstacle in its way. A robot whose task is suspended waits for somebody: it is idle until it moves.
std::optional<bool> works(const Sample& sample) {
  if (flag(sample, field("blocked")).value_or(false) || flag(sample, field("slowed")).value_or(false)) {
    return true;
  }
  const Cell& task = sample.at(field("task_status"));
  return task.has() ? std::optional<bool>(task.integer == kTaskWaiting || task.integer == kTaskRunning) : std::nullopt;
}

constexpr std::size_t index(Activity activity) { return static_cast<std::size_t>(activity); }

}  // namespace

std::string activities_text(const Activities& activities) {
  if (activities.all()) {
    return "unknown";
  }
  std::string text;
  for (std::size_t i = 0; i < kActivityCount; ++i) {
    if (activities[i]) {
      text += (text.empty() ? "" : " or ") + std::string(kActivityNames[i]);
    }
  }
  return text;
}

Micros Rates::in(const Activities& possible) const {
  Micros least = slowest();
  for (std::size_t i = 0; i < kActivityCount; ++i) {
    least = possible[i] || possible.none() ? std::min(least, period_us[i]) : least;
  }
  return least;
}

void RobotWatch::Fact::tell(std::optional<bool> now, Micros mono_us) {
  if (now) {
    value = now;
    told_us = mono_us;
  }
}

std::optional<bool> RobotWatch::Fact::at(Micros mono_us, Micros stale_us) const {
  return mono_us - told_us <= stale_us ? value : std::nullopt;
}

void AnswerReader::read(const Answer& answer, WordOrder order, const FieldSet& wanted,
                        const std::function<void(const Sample&)>& use) {
  const std::lock_guard lock(mutex_);
  Gates gates;  // nothing that is looked at has a condition
  decoder_.decode(answer, order, wanted, false, gates, sample_);
  use(sample_);
}

RobotWatch::RobotWatch(Options options, AnswerReader& reader)
    : options_(std::move(options)), reader_(reader), identity_(options_.identity) {}

std::optional<Identity> RobotWatch::look(const Answer& answer, WordOrder order, Micros mono_us) {
  const bool tells_identity = source_info(answer.meta.source).whole;
  if (!tells_identity && !options_.rates_vary) {
    return std::nullopt;
  }
  std::optional<Identity> other;
  bool faster = false;
  reader_.read(answer, order, watched(), [&](const Sample& sample) {
    const std::lock_guard lock(mutex_);
    const Identity told = tells_identity ? identity_of(sample) : Identity{};
    if (told.differs(identity_)) {
      other = told;
      return;
    }
    identity_.learn(told);
    const Activities before = possible_now(mono_us);
    learn(sample, mono_us);
    faster = (possible_now(mono_us) & ~before).any();
  });
  if (faster && faster_) {
    faster_();
  }
  return other;
}

Identity RobotWatch::identity() const {
  const std::lock_guard lock(mutex_);
  return identity_;
}

void RobotWatch::learn(const Sample& sample, Micros mono_us) {
  if (!sample.decodable) {
    return;
  }
  moves_.tell(moves(sample), mono_us);
  works_.tell(works(sample), mono_us);
  charges_.tell(flag(sample, field("charging")), mono_us);
  const Activities now = told(mono_us);
  for (std::size_t i = 0; i < kActivityCount; ++i) {
    if (now[i] || !last_look_us_) {
      last_possible_us_[i] = mono_us;  // the first answer tells nothing of the hold time before it
    }
  }
  last_look_us_ = mono_us;
}

/// What the newest facts leave possible.
Activities RobotWatch::told(Micros mono_us) const {
  const std::optional<bool> moves = moves_.at(mono_us, options_.stale_us);
  const std::optional<bool> works = works_.at(mono_us, options_.stale_us);
  const std::optional<bool> charges = charges_.at(mono_us, options_.stale_us);
  Activities out;
  if (moves.value_or(false) || works.value_or(false)) {
    out.set(index(Activity::moving));
    return out;
  }
  out.set(index(Activity::moving), !moves || !works);
  out.set(index(Activity::idle), !charges.value_or(false));
  out.set(index(Activity::charging), charges.value_or(true));
  return out;
}

Activities RobotWatch::possible_now(Micros mono_us) const {
  Activities out;
  if (!last_look_us_ || mono_us - *last_look_us_ > options_.stale_us) {
    return out.set();
  }
  for (std::size_t i = 0; i < kActivityCount; ++i) {
    out.set(i, mono_us - last_possible_us_[i] < options_.hold_us);
  }
  return out.any() ? out : told(mono_us);
}

Activities RobotWatch::possible(Micros mono_us) const {
  const std::lock_guard lock(mutex_);
  return possible_now(mono_us);
}

}  // namespace tacho::recorder
